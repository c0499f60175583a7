//! Pixels that stand out of a table.

use crate::geometry::Point;
use crate::geometry::median::{MEDIAN_TO_SD, median_of_many};
use crate::images::heights::{DepthPixels, Smoothing, measure_heights, smoothed};
use crate::images::image::{Image, smoothing_kernel};
use crate::images::parts::turn_blobs;
use crate::simd::kernel;

const SMOOTHING: f64 = 0.8; // standard deviation of the Gaussian that smooths heights, pixels
const MIN_SEEN: f32 = 0.3; // share of the weight of smoothed pixels that has depth
const DEVIATIONS: f64 = 5.0; // what is higher stands above the table, standard deviations of its heights
const MIN_HEIGHT: f64 = 0.001; // what stands above the table is higher, its distances
const TABLE_HEIGHT: f64 = 0.005; // what is this near the table belongs to it, its distances
const MAX_HEIGHT: f64 = 0.03; // larger heights are cut before they are smoothed, the table's distances
const EACH: usize = 4; // every fourth row gives the scatter
const MIN_BLOB: usize = 25; // smaller blobs are noise, pixels

/// Returns the height of pixels above a table normal·x = offset, 0 without depth, and which of them stand out of it; the
/// table is at a distance.
pub fn find_tabletop(
    seen: &DepthPixels<'_>,
    (normal, offset): (Point, f64),
    distance: f64,
) -> (Vec<f64>, Vec<bool>) {
    let (mut above, counts) = measure_heights(seen, (normal, offset), None);
    // relative to the distance, as single precision does not hold metres in every unit
    let mut relative = vec![0.0; above.len()];
    divide_seen(&mut above, &counts, distance, &mut relative);
    let kernel = smoothing_kernel(SMOOTHING);
    let smoothing = Smoothing { range: [-MAX_HEIGHT, MAX_HEIGHT], kernel: &kernel, share: MIN_SEEN };
    let smooth = smoothed(&relative, &counts, seen.width, &smoothing);
    let mut low = Vec::with_capacity(smooth.len() / EACH);
    let rows = smooth.chunks(seen.width).zip(counts.chunks(seen.width)).step_by(EACH);
    for (smooth, counts) in rows {
        for (height, counts) in smooth.iter().zip(counts) {
            let size = f64::from(height.abs());
            if *counts && size < TABLE_HEIGHT {
                low.push(size);
            }
        }
    }
    let scatter = MEDIAN_TO_SD * median_of_many(&low).unwrap_or(0.0);
    let least = (DEVIATIONS * scatter).max(MIN_HEIGHT) as f32;
    let values = smooth.iter().map(|height| *height > least).collect();
    let mut found = Image { width: seen.width, height: above.len() / seen.width, values };
    turn_blobs(&mut found, true, true, |size| size < MIN_BLOB);
    (above, found.values)
}

kernel! {
    /// Sets numbers that do not count to 0, and divides all by another.
    fn divide_seen<S>(_, values: &mut [f64], counts: &[bool], by: f64, quotients: &mut [f64]) {
        for ((value, quotient), counts) in values.iter_mut().zip(quotients).zip(counts) {
            *value = if *counts { *value } else { 0.0 };
            *quotient = *value / by;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clouds::depth::Pinhole;
    use crate::geometry::RigidMotion;

    #[test]
    fn things_stand_out_of_a_table_and_specks_do_not() {
        let (width, height) = (90, 60);
        let mut depth = vec![0.5; width * height];
        for k in 0..depth.len() {
            let (x, y) = (k % width, k / width);
            let thing = (20..60).contains(&x) && (20..26).contains(&y);
            let speck = (70..73).contains(&x) && (40..43).contains(&y);
            depth[k] = if k % 97 == 0 { 0.0 } else { 0.5 - 0.004 * f64::from(u8::from(thing || speck)) };
        }
        let camera = Pinhole { focal: [80.0; 2], center: [44.5, 29.5] };
        let rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let pose = RigidMotion::from_rows(&rows).unwrap();
        let seen = DepthPixels { depth: &depth, width, camera, pose };
        let (above, standing) = find_tabletop(&seen, ([0.0, 0.0, -1.0], -0.5), 0.5);
        for k in 0..depth.len() {
            let (x, y) = (k % width, k / width);
            let expected = if depth[k] > 0.0 { 0.5 - depth[k] } else { 0.0 };
            assert!((above[k] - expected).abs() < 1e-12);
            let core = (21..59).contains(&x) && (21..25).contains(&y);
            assert!(!core || standing[k], "{x}, {y}");
            let near = (18..62).contains(&x) && (18..28).contains(&y);
            assert!(near || !standing[k], "{x}, {y}");
        }
    }
}
