//! The depth of a rope's middle: medians over small discs of the mask.

use std::sync::atomic::{AtomicU32, Ordering};

use super::places::Place2;
use crate::clouds::depth::has_return;
use crate::geometry::cut_off;
use crate::images::silhouette::Silhouette;

const DISC: f64 = 0.6; // radius of a disc, image radii
const MIN_DISC: f64 = 1.0; // radius of a disc at least, pixels
const MIN_RETURNS: usize = 3; // returns in a disc at least

/// Median depths on a grid over an image, and the image's pixels inside the silhouette.
///
/// Many hypotheses ask for the same places, but for few of all. A median is computed when it is asked for, and kept. The
/// grid is finer than the discs.
#[derive(Debug)]
pub struct Medians {
    origin: Place2,
    /// Step of the grid, whole pixels.
    step: f64,
    size: [usize; 2],
    /// Radius of the discs, and their pixels around the middle.
    reach: f64,
    disc: Vec<[i64; 2]>,
    /// Row by row, the bits of the medians that are known; 0 for others.
    known: Vec<AtomicU32>,
    /// Size of the silhouette's frame.
    frame: [usize; 2],
    /// The returns over the frame that count, metres; 0 for others.
    returns: Vec<f32>,
    /// Which pixels of the frame are inside the silhouette.
    inside: Vec<bool>,
}

impl Medians {
    /// Prepares medians over the pixels of a mask of `width` columns. `radius_px` is the radius of the ropes in it, which a
    /// mask may surround widely.
    pub fn new(depth: &[f64], mask: &[bool], width: usize, silhouette: &Silhouette, radius_px: f64) -> Self {
        let height = depth.len() / width.max(1);
        let reach = (DISC * radius_px).max(MIN_DISC);
        let step = (0.5 * reach).floor().max(1.0);
        let (origin, frame) = silhouette.frame();
        let size = frame.map(|n| (n as f64 / step) as usize + 1);
        let whole = reach.ceil() as i64;
        let disc: Vec<[i64; 2]> = (-whole..=whole)
            .flat_map(|b| (-whole..=whole).map(move |a| [a, b]))
            .filter(|[a, b]| ((a * a + b * b) as f64) <= reach * reach)
            .collect();
        let [left, top] = origin.map(|c| c as isize);
        let mut returns = vec![0.0f32; frame[0] * frame[1]];
        // the part of the frame that is in the image
        let columns = left.min(0).unsigned_abs()..frame[0].min(width.saturating_add_signed(-left));
        for y in top.min(0).unsigned_abs()..frame[1].min(height.saturating_add_signed(-top)) {
            let from = y.wrapping_add_signed(top) * width + columns.start.wrapping_add_signed(left);
            let own = y * frame[0] + columns.start..y * frame[0] + columns.end;
            let pixels = depth[from..].iter().zip(&mask[from..]).zip(&silhouette.mask.values[own.clone()]);
            for (to, ((&z, &mask), &inside)) in returns[own].iter_mut().zip(pixels) {
                *to = if (mask | inside) & has_return(z) { z as f32 } else { 0.0 };
            }
        }
        let known = (0..size[0] * size[1]).map(|_| AtomicU32::new(0)).collect();
        let inside = silhouette.mask.values.clone();
        Self { origin, step, size, reach, disc, known, frame, returns, inside }
    }

    /// Computes the median of a place of the grid; NaN if there are too few returns.
    fn compute(&self, silhouette: &Silhouette, [x, y]: [usize; 2]) -> f32 {
        let (x, y) = (self.step as usize * x, self.step as usize * y);
        if x >= self.frame[0] || y >= self.frame[1] || silhouette.pixel_distance(x, y) < -self.reach {
            return f32::NAN;
        }
        let mut seen = Vec::with_capacity(self.disc.len());
        for [a, b] in &self.disc {
            let (u, v) = (x as i64 + a, y as i64 + b);
            if u >= 0 && v >= 0 && (u as usize) < self.frame[0] && (v as usize) < self.frame[1] {
                let z = self.returns[v as usize * self.frame[0] + u as usize];
                if z != 0.0 {
                    seen.push(z);
                }
            }
        }
        if seen.len() >= MIN_RETURNS { median(&mut seen) } else { f32::NAN }
    }

    /// Fills which pixels of an image's row, from a column on, are inside the silhouette.
    pub fn fill_inside(&self, column: i64, row: i64, to: &mut [bool]) {
        let [x, y] = [column - self.origin[0] as i64, row - self.origin[1] as i64];
        let width = self.frame[0];
        to.fill(false);
        let known = usize::try_from(y).ok().and_then(|y| self.inside.chunks_exact(width.max(1)).nth(y));
        let before = usize::try_from(-x).unwrap_or(0).min(to.len());
        let from = usize::try_from(x).unwrap_or(0).min(width);
        for (to, &known) in to[before..].iter_mut().zip(known.map_or(&[][..], |row| &row[from..])) {
            *to = known;
        }
    }

    /// Returns the median at the nearest place of the grid; NaN if there is none. The silhouette is that of the new ones.
    #[inline]
    pub fn at(&self, silhouette: &Silhouette, uv: Place2) -> f64 {
        let cell: [f64; 2] = std::array::from_fn(|k| (uv[k] - self.origin[k]) / self.step);
        if !(0..2).all(|k| cell[k] > -0.5 && cell[k] < self.size[k] as f64) {
            return f64::NAN;
        }
        // the nearest whole numbers
        let [x, y] = cell.map(|c| cut_off(c + 0.5) as usize);
        if x >= self.size[0] || y >= self.size[1] {
            return f64::NAN;
        }
        let kept = &self.known[y * self.size[0] + x];
        // threads that meet here compute the same
        let known = kept.load(Ordering::Relaxed);
        if known != 0 {
            return f64::from(f32::from_bits(known));
        }
        let found = self.compute(silhouette, [x, y]);
        kept.store(found.to_bits(), Ordering::Relaxed);
        f64::from(found)
    }
}

/// Returns the middle value, or the mean of the two middle ones.
fn median(values: &mut [f32]) -> f32 {
    let half = values.len() / 2;
    let odd = values.len() % 2 == 1;
    let (low, &mut middle, _) = values.select_nth_unstable_by(half, f32::total_cmp);
    if odd { middle } else { 0.5 * (middle + low.iter().copied().fold(f32::NEG_INFINITY, f32::max)) }
}
