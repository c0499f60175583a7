//! Samples that no pixel supports: hidden by something nearer, or seen through.

use super::camera::{Camera, Shown};
use super::evidence::Evidence;
use super::rope::length;
use super::view::{Samples, Seen};
use crate::geometry::Point;
use crate::geometry::{dot, normalized, sub};

/// A plane normal · x = offset of the world, with the normal towards the cameras.
#[derive(Clone, Copy)]
pub struct Table {
    pub normal: Point,
    pub offset: f64,
}

const NEARER: f64 = 2.6; // radii: something this much nearer hides a sample
const GRIPPING: f64 = 1.8; // radii: something else than a rope hides a sample from here on
const BEHIND: f64 = 0.3; // radii: depth behind a sample at which it is seen through, with a known table
const BEHIND_BARE: f64 = 1.5; // radii: likewise, without a table
const AT_TABLE: f64 = 1.2; // radii: the table beside a rope that lies may be measured this much nearer
const LYING: f64 = 3.0; // radii: height over the table below which a rope lies
const CLEAR: f64 = 0.35; // radii: distance in the image to the nearest place of rope
const PULLED: f64 = 0.5; // radii: distance from which a sample is pulled
const REACH: f64 = 40.0; // radii: pulls come from no farther
const PULL_SD: f64 = 1.0; // radii: standard deviation of a pull
const COVERING: f64 = 3.0; // radii: what is this much nearer may hide rope
const MAX_PULLED: usize = 60; // samples whose pull is sought in one image

/// How an image shows each sample, beside its pixels.
pub struct Openings {
    pub hidden: Vec<bool>,
    pub through: Vec<bool>,
    /// Where a sample that is seen through is pulled: direction in the camera's frame, and distance, metres.
    pub pulls: Vec<(usize, Point, f64)>,
}

/// How one camera sees all samples, what its pixels say, and what is before and behind.
pub type Look = (Seen, Evidence, Openings);

/// Looks before and behind each sample.
pub fn look(
    camera: &Camera<'_>,
    samples: &Samples,
    seen: &Seen,
    evidence: &Evidence,
    table: Option<Table>,
) -> Openings {
    let count = samples.len();
    let mut found = Openings { hidden: vec![false; count], through: vec![false; count], pulls: vec![] };
    for j in 0..count {
        let (r, z) = (samples.radius[j], seen.places[j][2]);
        let [u, v] = seen.pixels[j];
        match camera.shown(camera.index(u, v)) {
            Shown::Unknown => found.hidden[j] = camera.index(u, v).is_none(),
            Shown::Occluder => found.hidden[j] = true,
            Shown::Rope(seen) => found.hidden[j] = seen > 0.0 && seen < z - NEARER * r,
            Shown::Other(depth) => {
                found.hidden[j] = depth < z - GRIPPING * r;
                if !found.hidden[j] && !evidence.on[j] {
                    let behind = if table.is_some() { BEHIND } else { BEHIND_BARE };
                    let lies = table.is_some_and(|table| {
                        let height = dot(to_world(camera, seen.places[j]), table.normal) - table.offset;
                        height < LYING * r && depth > z - AT_TABLE * r
                    });
                    found.through[j] = depth > z + behind * r || lies;
                }
            }
        }
    }
    let open: Vec<usize> = (0..count).filter(|&j| found.through[j]).collect();
    let stride = open.len().div_ceil(MAX_PULLED).max(1);
    for (k, &j) in open.iter().enumerate() {
        let r = samples.radius[j];
        let pixel = seen.places[j][2] / camera.pinhole.focal[0];
        if k % stride != 0 {
            continue;
        }
        let Some((to, distance)) = find_place(camera, seen, j, r, REACH * r / pixel) else { continue };
        if distance * pixel <= CLEAR * r {
            found.through[j] = false;
            continue;
        }
        if distance * pixel > PULLED * r {
            let target = camera.lift(to[0], to[1], seen.places[j][2]);
            let away = sub(target, seen.places[j]);
            found.pulls.push((j, normalized(away), length(away)));
        }
    }
    found
}

/// Returns the weight of a pull, 1/m².
pub fn weigh_pull(distance: f64, radius: f64, samples_a_node: f64) -> f64 {
    1.0 / ((PULL_SD * radius * (1.0 + distance / (3.0 * radius))).powi(2) * samples_a_node)
}

fn to_world(camera: &Camera<'_>, p: Point) -> Point {
    camera.pose.apply(p)
}

/// Returns the nearest pixel where a rope may be, and its distance in pixels: a rope, or something that hides it.
fn find_place(
    camera: &Camera<'_>,
    seen: &Seen,
    sample: usize,
    radius: f64,
    reach: f64,
) -> Option<([f64; 2], f64)> {
    let [u, v] = seen.pixels[sample];
    let least = seen.places[sample][2] - COVERING * radius;
    let may_hold = |index: Option<usize>| match camera.shown(index) {
        Shown::Unknown => false,
        Shown::Occluder | Shown::Rope(_) => true,
        Shown::Other(z) => z < least,
    };
    let mut best: Option<([f64; 2], f64)> = None;
    let mut ring = 0i64;
    while (ring as f64) < reach {
        if best.is_some_and(|(_, d)| ring as f64 > d) {
            break;
        }
        for down in -ring..=ring {
            let step = if down.abs() == ring { 1 } else { (2 * ring).max(1) };
            for right in (-ring..=ring).step_by(step as usize) {
                let place = [(u + right as f64).round(), (v + down as f64).round()];
                if may_hold(camera.index(place[0], place[1])) {
                    let d = ((place[0] - u).powi(2) + (place[1] - v).powi(2)).sqrt();
                    if best.is_none_or(|(_, least)| d < least) {
                        best = Some((place, d));
                    }
                }
            }
        }
        ring += if ring < 8 { 1 } else { 2 };
    }
    best
}
