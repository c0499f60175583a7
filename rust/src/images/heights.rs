//! Heights of an image's pixels above a plane, and the pixels whose smoothed height is that of a rope.

use nalgebra::Vector3;

use crate::clouds::depth::Pinhole;
use crate::geometry::{Point, RigidMotion};
use crate::parallel;
use crate::simd::kernel;

const MIN_WEIGHT: f32 = 1e-9; // weight that sums of heights are divided by at least

/// A depth image. Depths that are not above 0 are missing.
pub struct DepthPixels<'a> {
    pub depth: &'a [f64],
    pub width: usize,
    pub camera: Pinhole,
    /// Camera to world.
    pub pose: RigidMotion,
}

/// A box in which the axis of a rope must be for the rope's pixels to count.
pub struct AxisBox {
    pub sides: [Side; 3],
    /// Height of a rope's axis above its table, metres.
    pub height: f64,
}

/// The points x with low ≤ direction·x ≤ high.
pub struct Side {
    /// In the world frame.
    pub direction: Point,
    pub low: f64,
    pub high: f64,
}

/// d·x of the points x that pixels show, for one direction d: z (column u + row v + ahead) + origin at depths z.
struct Along {
    column: f64,
    row: f64,
    ahead: f64,
    origin: f64,
}

impl Along {
    fn new(direction: Point, seen: &DepthPixels<'_>) -> Self {
        let Pinhole { focal, center } = seen.camera;
        let direction = Vector3::from(direction);
        let own = seen.pose.rotation.tr_mul(&direction);
        let (column, row) = (own[0] / focal[0], own[1] / focal[1]);
        let ahead = own[2] - column * center[0] - row * center[1];
        Self { column, row, ahead, origin: direction.dot(&seen.pose.translation) }
    }

    /// Returns the function of column and depth that gives d·x in a row.
    #[inline(always)]
    fn in_row(&self, v: usize) -> impl Fn(usize, f64) -> f64 + use<> {
        let (column, ahead, origin) = (self.column, self.row * v as f64 + self.ahead, self.origin);
        #[inline(always)]
        move |u, z| z * (column * u as f64 + ahead) + origin
    }
}

/// Returns each pixel's height above the plane normal·x = offset, and whether it has depth and would be in the box if it
/// were a rope's.
pub fn measure_heights(
    seen: &DepthPixels<'_>,
    (normal, offset): (Point, f64),
    within: Option<&AxisBox>,
) -> (Vec<f64>, Vec<bool>) {
    let mut above = vec![0.0; seen.depth.len()];
    let height = Along::new(normal, seen);
    measure_rows(seen, &Along { origin: height.origin - offset, ..height }, &mut above);
    let mut counts: Vec<bool> = seen.depth.iter().map(|&z| z > 0.0).collect();
    if let Some(AxisBox { sides, height }) = within {
        for side in sides {
            limit_rows(seen, side, normal, *height, &above, &mut counts);
        }
    }
    (above, counts)
}

kernel! {
    /// Fills the heights of all pixels.
    fn measure_rows<S>(_, seen: &DepthPixels<'_>, height: &Along, above: &mut [f64]) {
        let rows = seen.depth.chunks_exact(seen.width).zip(above.chunks_exact_mut(seen.width));
        for (v, (depth, above)) in rows.enumerate() {
            let at = height.in_row(v);
            for (u, (above, &z)) in above.iter_mut().zip(depth).enumerate() {
                *above = at(u, z);
            }
        }
    }
}

kernel! {
    /// Drops pixels of ropes whose axis, at a height along a normal, would be outside a box along one of its sides.
    fn limit_rows<S>(
        _,
        seen: &DepthPixels<'_>,
        side: &Side,
        normal: Point,
        height: f64,
        above: &[f64],
        counts: &mut [bool],
    ) {
        let lean = Vector3::from(side.direction).dot(&Vector3::from(normal));
        let place = Along::new(side.direction, seen);
        let rows = (seen.depth.chunks_exact(seen.width)).zip(above.chunks_exact(seen.width));
        for (v, ((depth, above), counts)) in rows.zip(counts.chunks_exact_mut(seen.width)).enumerate() {
            let at = place.in_row(v);
            for (u, ((counts, &z), &above)) in counts.iter_mut().zip(depth).zip(above).enumerate() {
                let axis = at(u, z) + (height - above) * lean;
                *counts &= (axis >= side.low) & (axis <= side.high);
            }
        }
    }
}

/// How heights are smoothed.
pub struct Smoothing<'a> {
    /// Lower and higher heights of single pixels are cut off.
    pub range: [f64; 2],
    /// A symmetric kernel, from its middle on.
    pub kernel: &'a [f32],
    /// Pixels that count must have more of the kernel's weight.
    pub share: f32,
}

/// Limits of the pixels that stand out.
pub struct Standing<'a> {
    pub smoothing: Smoothing<'a>,
    /// The mean height must be larger.
    pub edge: f32,
}

/// Returns the pixels around which the mean height of pixels that count is larger than a limit.
pub fn find_standing(above: &[f64], counts: &[bool], width: usize, limits: &Standing<'_>) -> Vec<bool> {
    let smooth = smoothed(above, counts, width, &limits.smoothing);
    smooth.iter().map(|height| *height > limits.edge).collect()
}

/// Returns the mean height of the pixels that count around each pixel; NaN where they have too little weight.
pub fn smoothed(above: &[f64], counts: &[bool], width: usize, smoothing: &Smoothing<'_>) -> Vec<f32> {
    let mut found = vec![0.0; above.len()];
    parallel::rows(&mut found, width, |first, part| {
        smooth_rows(above, counts, width, smoothing, first, part);
    });
    found
}

kernel! {
    /// Fills rows of [`smoothed`], from row `first` on.
    fn smooth_rows<S>(
        _,
        above: &[f64],
        counts: &[bool],
        width: usize,
        smoothing: &Smoothing<'_>,
        first: usize,
        to: &mut [f32],
    ) {
        let (kernel, reach) = (smoothing.kernel, smoothing.kernel.len() - 1);
        let height = above.len() / width;
        let from = first.saturating_sub(reach);
        let until = (first + to.len() / width + reach).min(height);
        // these rows and those beside them, smoothed along themselves: sums of heights, and weights
        let mut smooth = [vec![0.0f32; (until - from) * width], vec![0.0f32; (until - from) * width]];
        let mut padded = [vec![0.0f32; width + 2 * reach], vec![0.0f32; width + 2 * reach]];
        let [low, high] = smoothing.range;
        for y in from..until {
            let row = y * width..(y + 1) * width;
            let [heights, weights] = &mut padded;
            let own = heights[reach..].iter_mut().zip(&mut weights[reach..]);
            for (((height, weight), &above), &counts) in own.zip(&above[row.clone()]).zip(&counts[row]) {
                *height = if counts { above.clamp(low, high) as f32 } else { 0.0 };
                *weight = if counts { 1.0 } else { 0.0 };
            }
            for (smooth, padded) in smooth.iter_mut().zip(&padded) {
                let smooth = &mut smooth[(y - from) * width..][..width];
                for (value, x) in smooth.iter_mut().zip(&padded[reach..]) {
                    *value = kernel[0] * x;
                }
                for (i, k) in kernel.iter().enumerate().skip(1) {
                    for ((value, a), b) in smooth.iter_mut().zip(&padded[reach - i..]).zip(&padded[reach + i..]) {
                        *value += k * (a + b);
                    }
                }
            }
        }
        let beyond = vec![0.0f32; width];
        let mut sums = [vec![0.0f32; width], vec![0.0f32; width]];
        for (n, to) in to.chunks_exact_mut(width).enumerate() {
            for (sums, smooth) in sums.iter_mut().zip(&smooth) {
                let row = |y: Option<usize>| match y {
                    Some(y) if (from..until).contains(&y) => &smooth[(y - from) * width..][..width],
                    _ => &beyond,
                };
                let y = first + n;
                for (value, x) in sums.iter_mut().zip(row(Some(y))) {
                    *value = kernel[0] * x;
                }
                for (i, k) in kernel.iter().enumerate().skip(1) {
                    for ((value, a), b) in sums.iter_mut().zip(row(y.checked_sub(i))).zip(row(Some(y + i))) {
                        *value += k * (a + b);
                    }
                }
            }
            for ((to, sum), weight) in to.iter_mut().zip(&sums[0]).zip(&sums[1]) {
                *to = if *weight > smoothing.share { sum / weight.max(MIN_WEIGHT) } else { f32::NAN };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::image::Image;

    const WIDTH: usize = 70;
    const HEIGHT: usize = 50;

    /// Returns random depths, some of them missing.
    fn drawn() -> Vec<f64> {
        let mut state = 3u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        (0..WIDTH * HEIGHT).map(|_| if next() < 0.1 { 0.0 } else { 0.5 + 0.02 * next() }).collect()
    }

    fn pixels(depth: &[f64]) -> DepthPixels<'_> {
        let rows = [[0.8, 0.0, 0.6, 0.1], [0.0, 1.0, 0.0, -0.2], [-0.6, 0.0, 0.8, 0.3], [0.0, 0.0, 0.0, 1.0]];
        let camera = Pinhole { focal: [90.0, 95.0], center: [33.0, 26.5] };
        DepthPixels { depth, width: WIDTH, camera, pose: RigidMotion::from_rows(&rows).unwrap() }
    }

    #[test]
    fn heights_are_those_of_points_and_boxes_hold_axes() {
        let depth = drawn();
        let seen = pixels(&depth);
        let (normal, offset): (Point, f64) = ([0.6, 0.0, -0.8], -0.5);
        let side = |direction, low, high| Side { direction, low, high };
        let sides = [
            side([1.0, 0.0, 0.0], 0.3, 0.5),
            side([0.0, 0.6, 0.8], f64::NEG_INFINITY, 0.56),
            side([0.0, -0.8, 0.6], 0.4, 0.7),
        ];
        let within = AxisBox { sides, height: 0.01 };
        let (above, counts) = measure_heights(&seen, (normal, offset), Some(&within));
        let all = measure_heights(&seen, (normal, offset), None).1;
        for k in 0..depth.len() {
            let own = Vector3::from(seen.camera.point((k % WIDTH) as f64, (k / WIDTH) as f64, depth[k]));
            let x = seen.pose.rotation * own + seen.pose.translation;
            let normal = Vector3::from(normal);
            assert!((above[k] - (normal.dot(&x) - offset)).abs() < 1e-12);
            assert_eq!(all[k], depth[k] > 0.0);
            let axis = x + (0.01 - above[k]) * normal;
            let inside = within
                .sides
                .iter()
                .all(|side| (side.low..=side.high).contains(&Vector3::from(side.direction).dot(&axis)));
            assert_eq!(counts[k], all[k] && inside);
        }
        assert!(counts.contains(&true) && counts != all);
    }

    #[test]
    fn what_stands_out_is_found_by_smoothed_heights() {
        let depth = drawn();
        let (above, counts) = measure_heights(&pixels(&depth), ([0.0, 0.0, -1.0], -0.6), None);
        let kernel = [0.4, 0.2, 0.1];
        let smoothing = Smoothing { range: [-0.1, 0.05], kernel: &kernel, share: 0.9 };
        let limits = Standing { smoothing, edge: 0.01 };
        let found = find_standing(&above, &counts, WIDTH, &limits);
        // with a border of zeros
        let (wide, reach) = (WIDTH + 4, 2);
        let padded = |value: &dyn Fn(usize) -> f32| {
            let mut image = Image::filled(wide, HEIGHT + 4, 0.0f32);
            for k in (0..depth.len()).filter(|&k| counts[k]) {
                image.values[(k / WIDTH + reach) * wide + k % WIDTH + reach] = value(k);
            }
            image.convolved(&kernel)
        };
        let sums = padded(&|k| above[k].clamp(-0.1, 0.05) as f32);
        let weights = padded(&|_| 1.0);
        for k in 0..depth.len() {
            let (sum, weight) =
                (sums.at(k % WIDTH + 2, k / WIDTH + 2), weights.at(k % WIDTH + 2, k / WIDTH + 2));
            assert_eq!(found[k], sum / weight.max(1e-9) > 0.01 && weight > 0.9);
        }
        assert!(found.contains(&true) && found.contains(&false));
    }
}
