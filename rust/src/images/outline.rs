//! Segmentation of noisy images by their pixels and the length of the outline.

use crate::images::image::Image;
use crate::simd::kernel;

const STEP: f32 = 0.353_553_4; // step size of both updates: the norm of the differences is at most √8

/// Finds the set of pixels with the least sum of `evidence` plus `weight` times the length of the outline.
///
/// The evidence of a pixel is the log of how much more likely its value is outside the set. The relaxed problem, with
/// the total variation of values from 0 to 1, has nearly the same minimum after a cut at one half. Primal-dual steps
/// solve it (Chambolle and Pock 2011, algorithm 1).
pub fn find_short_outline(evidence: &Image<f32>, weight: f32, steps: usize) -> Image<bool> {
    let (w, h) = (evidence.width, evidence.height);
    if w * h == 0 {
        return Image::filled(w, h, false);
    }
    let values = relax(evidence, weight, steps);
    Image { width: w, height: h, values: values.into_iter().map(|v| v > 0.5).collect() }
}

kernel! {
    /// Solves the relaxed problem: a value from 0 to 1 for each pixel.
    fn relax<S>(_, evidence: &Image<f32>, weight: f32, steps: usize) -> Vec<f32> {
        let (w, h) = (evidence.width, evidence.height);
        let mut values = vec![0.0f32; w * h];
        let mut ahead = values.clone();
        // the dual: a flow out of each pixel to the right and one down, at most `weight` long
        let (mut right, mut down) = (values.clone(), values.clone());
        let beyond = vec![0.0f32; w];
        for _ in 0..steps {
            crate::parallel::go_on();
            for y in 0..h {
                let row = y * w..(y + 1) * w;
                let here = &ahead[row.clone()];
                let below = if y + 1 < h { &ahead[(y + 1) * w..(y + 2) * w] } else { here };
                {
                    let (right, down) = (&mut right[row.clone()], &mut down[row.clone()]);
                    let shrink = |a: f32, b: f32| weight / (a * a + b * b).sqrt().max(weight);
                    for x in 0..w - 1 {
                        let a = right[x] + STEP * (here[x + 1] - here[x]);
                        let b = down[x] + STEP * (below[x] - here[x]);
                        let shrunk = shrink(a, b);
                        right[x] = a * shrunk;
                        down[x] = b * shrunk;
                    }
                    // values beyond the border equal those on it
                    let b = down[w - 1] + STEP * (below[w - 1] - here[w - 1]);
                    down[w - 1] = b * shrink(0.0, b);
                }
                // the flows of the next row need no more of this one's values
                let up = if y > 0 { &down[(y - 1) * w..y * w] } else { &beyond };
                let (right, down, evidence) =
                    (&right[row.clone()], &down[row.clone()], &evidence.values[row.clone()]);
                let (values, ahead) = (&mut values[row.clone()], &mut ahead[row]);
                let mut step = |x: usize, left: f32| {
                    let spread = right[x] - left + down[x] - up[x];
                    let value = (values[x] + STEP * (spread - evidence[x])).clamp(0.0, 1.0);
                    ahead[x] = 2.0 * value - values[x];
                    values[x] = value;
                };
                step(0, 0.0);
                for x in 1..w {
                    step(x, right[x - 1]);
                }
            }
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the cost of a set, with its outline as the total variation of differences to the right and down.
    fn cost(evidence: &Image<f32>, set: &[bool], weight: f32) -> f32 {
        let (w, h) = (evidence.width, evidence.height);
        let at = |x: usize, y: usize| f32::from(set[y * w + x]);
        let mut sum = 0.0;
        for y in 0..h {
            for x in 0..w {
                let right = at((x + 1).min(w - 1), y) - at(x, y);
                let down = at(x, (y + 1).min(h - 1)) - at(x, y);
                sum += at(x, y) * evidence.at(x, y) + weight * right.hypot(down);
            }
        }
        sum
    }

    /// No set of a small image costs much less: diagonal outlines cost a little more in pixels than relaxed.
    #[test]
    fn nearly_the_least_of_all_sets_is_found() {
        let mut state = 7u64;
        for _ in 0..20 {
            let mut evidence = Image::filled(4, 3, 0.0f32);
            for value in &mut evidence.values {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                *value = (state >> 40) as f32 / (1u64 << 23) as f32 - 1.0;
            }
            let found = find_short_outline(&evidence, 0.3, 400);
            let least = (0..1u32 << 12)
                .map(|bits| cost(&evidence, &std::array::from_fn::<bool, 12, _>(|k| bits >> k & 1 == 1), 0.3))
                .fold(f32::INFINITY, f32::min);
            let (found, empty) = (cost(&evidence, &found.values, 0.3), 0.0);
            assert!(found - least <= 0.1 * (empty - least) + 1e-3, "{found} for {least}");
        }
    }
}
