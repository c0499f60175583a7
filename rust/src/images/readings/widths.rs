//! The radius of ropes in an image, by the area of single strands.

use super::network::{SPURS, Skeleton};
use super::planar::{Place, length};
use crate::images::rope_mask::RopeMask;
use crate::images::runs::Mask;
use crate::images::strokes::find_scale_of_widths;

const MIN_LENGTH: f64 = 4.0; // shorter strands may be spurs of a ragged mask, image radii
/// The radius of a strand that counts as single at most, image radii: near strands are wider than far ones.
const SLACK: f64 = 1.25;
const OUTSIDE: u8 = 0; // owner of pixels outside the mask
const FREE: u8 = 1; // owner of pixels that have none yet
const MERGED: u8 = 2; // owner of pixels that measure nothing: where strands merge, and at ends
const SINGLE: u8 = 3; // owner of pixels of single strands

/// Measures the radius of ropes in a mask, pixels, and returns the middles of its single strands. `radius_px` is the
/// radius roughly.
///
/// A pixel of the mask belongs to the nearest place of its skeleton. The radius is half of the area of the single
/// strands over their length. Where strands merge, and at ends, nothing is measured. None without a single strand.
pub fn measure_strands(mask: &RopeMask, radius_px: f64) -> Option<(f64, Vec<Vec<Place>>)> {
    let widest = SLACK * radius_px;
    let filled = mask.fill(widest, find_scale_of_widths(radius_px))?;
    let strokes = mask.trace(&filled);
    let skeleton = Skeleton::new(&strokes, widest, SPURS[0]);
    let network = skeleton.read(widest, false, &[]);
    let inside = &filled.inside;
    let [width, height] = inside.size();
    // only the mask's pixels are written
    let mut owners = vec![OUTSIDE; width * height];
    for row in 0..height {
        let mut begin = inside.find_next(row, 0, true);
        while begin < width {
            let end = inside.find_next(row, begin, false);
            owners[row * width..][begin..end].fill(FREE);
            begin = inside.find_next(row, end, true);
        }
    }
    for zone in &network.zones {
        zone.iter().for_each(|&i| owners[skeleton.pixel(i)] = MERGED);
    }
    let mut measured = 0.0;
    let mut strands = Vec::new();
    for segment in network.segments {
        let long = length(&segment.points);
        if long < MIN_LENGTH * radius_px {
            segment.path.iter().for_each(|&i| owners[skeleton.pixel(i)] = MERGED);
            continue;
        }
        segment.path.iter().for_each(|&i| owners[skeleton.pixel(i)] = SINGLE);
        // pixels beyond an end are nearest to its last place
        for i in [segment.path[0], segment.path[segment.path.len() - 1]] {
            owners[skeleton.pixel(i)] = MERGED;
        }
        let between = segment.path.len() as f64 - 2.0;
        measured += long * (between / (between + 1.0)).max(0.0);
        strands.push(segment.points);
    }
    let mut open: Vec<usize> = strokes.skeleton.iter().copied().filter(|&k| owners[k] != FREE).collect();
    let mut area = 0usize;
    while !open.is_empty() {
        area += open.iter().filter(|&&k| owners[k] == SINGLE).count();
        let mut next = Vec::new();
        for &k in &open {
            for near in [k - width, k + 1, k + width, k - 1] {
                if owners[near] == FREE {
                    owners[near] = owners[k];
                    next.push(near);
                }
            }
        }
        open = next;
    }
    let single = (strokes.scale * strokes.scale) as f64;
    (measured > 0.0).then(|| (0.5 * area as f64 / single / measured, strands))
}
