//! The depth of a rope's middle: medians over small discs of the mask.

use super::places::Place2;
use crate::clouds::depth::has_return;
use crate::images::silhouette::Silhouette;
use crate::parallel;

const DISC: f64 = 0.6; // radius of a disc, image radii
const MIN_DISC: f64 = 1.0; // radius of a disc at least, pixels
const MIN_RETURNS: usize = 3; // returns in a disc at least

/// Median depths on a grid over an image, and the image's pixels inside the silhouette.
///
/// They are computed once for each view, because many hypotheses ask for the same places. The grid is finer than the
/// discs.
#[derive(Debug, Clone)]
pub struct Medians {
    origin: Place2,
    /// Step of the grid, pixels.
    step: f64,
    size: [usize; 2],
    /// Row by row, metres; NaN where there are too few returns.
    values: Vec<f32>,
    /// Size of the silhouette's frame, and which of its pixels are inside.
    frame: [usize; 2],
    inside: Vec<bool>,
}

impl Medians {
    /// Computes medians over the pixels of a mask of `width` columns. `radius_px` is the radius of the ropes in it, which a
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
        let corner = origin.map(|c| c as i64);
        // the returns that count, over the frame
        let mut returns = vec![f32::NAN; frame[0] * frame[1]];
        for y in 0..frame[1] {
            for x in 0..frame[0] {
                let (u, v) = (corner[0] + x as i64, corner[1] + y as i64);
                if u >= 0 && v >= 0 && (u as usize) < width && (v as usize) < height {
                    let i = v as usize * width + u as usize;
                    if has_return(depth[i]) && (mask[i] || silhouette.mask.at(x, y)) {
                        returns[y * frame[0] + x] = depth[i] as f32;
                    }
                }
            }
        }
        let mut values = vec![f32::NAN; size[0] * size[1]];
        parallel::rows(&mut values, size[0], |first, part| {
            let mut seen = Vec::with_capacity(disc.len());
            for (k, value) in part.iter_mut().enumerate() {
                // steps are whole pixels
                let (x, y) = (step as usize * (k % size[0]), step as usize * (first + k / size[0]));
                if x >= frame[0] || y >= frame[1] || silhouette.pixel_distance(x, y) < -reach {
                    continue;
                }
                seen.clear();
                for [a, b] in &disc {
                    let (u, v) = (x as i64 + a, y as i64 + b);
                    if u >= 0 && v >= 0 && (u as usize) < frame[0] && (v as usize) < frame[1] {
                        let z = returns[v as usize * frame[0] + u as usize];
                        if !z.is_nan() {
                            seen.push(z);
                        }
                    }
                }
                if seen.len() >= MIN_RETURNS {
                    *value = median(&mut seen);
                }
            }
        });
        Self { origin, step, size, values, frame, inside: silhouette.mask.values.clone() }
    }

    /// Returns whether a pixel is inside the silhouette.
    #[inline]
    pub fn inside(&self, pixel: [i64; 2]) -> bool {
        let [x, y]: [i64; 2] = std::array::from_fn(|k| pixel[k] - self.origin[k] as i64);
        let within = |n: i64, k: usize| (0..self.frame[k] as i64).contains(&n);
        within(x, 0) && within(y, 1) && self.inside[y as usize * self.frame[0] + x as usize]
    }

    /// Returns the median at the nearest place of the grid; NaN if there is none.
    #[inline]
    pub fn at(&self, uv: Place2) -> f64 {
        let cell: [f64; 2] = std::array::from_fn(|k| ((uv[k] - self.origin[k]) / self.step).round());
        if !(cell[0] >= 0.0 && cell[1] >= 0.0) {
            return f64::NAN;
        }
        let [x, y] = cell.map(|c| c as usize);
        if x >= self.size[0] || y >= self.size[1] {
            return f64::NAN;
        }
        f64::from(self.values[y * self.size[0] + x])
    }
}

/// Returns the middle value, or the mean of the two middle ones.
fn median(values: &mut [f32]) -> f32 {
    let half = values.len() / 2;
    let odd = values.len() % 2 == 1;
    let (low, &mut middle, _) = values.select_nth_unstable_by(half, f32::total_cmp);
    if odd { middle } else { 0.5 * (middle + low.iter().copied().fold(f32::NEG_INFINITY, f32::max)) }
}
