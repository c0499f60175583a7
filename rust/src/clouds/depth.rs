//! Depth images and the pinhole camera.

use nalgebra::Vector3;

use crate::error::{Error, Result};
use crate::geometry::median::median;
use crate::geometry::{Point, RigidMotion};
use crate::simd::kernel;

/// A pinhole camera. All numbers are pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    /// Focal lengths.
    pub focal: [f64; 2],
    /// Principal point; integer coordinates are the middle of a pixel.
    pub center: [f64; 2],
}

impl Pinhole {
    /// Returns the point of the camera frame that the pixel at column `u` and row `v` sees at the depth `z`.
    #[inline(always)]
    pub(crate) fn point(&self, u: f64, v: f64, z: f64) -> Point {
        [(u - self.center[0]) * z / self.focal[0], (v - self.center[1]) * z / self.focal[1], z]
    }

    /// Returns the column and row at which a point of the camera frame is seen.
    #[inline(always)]
    pub(crate) fn pixel(&self, [x, y, z]: Point) -> [f64; 2] {
        [self.focal[0] * x / z + self.center[0], self.focal[1] * y / z + self.center[1]]
    }
}

const MANY: usize = 64; // numbers that are passed over together
const MIN_DEPTH: f64 = 1e-100; // smaller depths are no return: their products lose all digits, metres

#[inline(always)]
pub(crate) fn has_return(z: f64) -> bool {
    z > MIN_DEPTH && z < f64::INFINITY
}

/// Replaces NaN and infinite depths by 0, which also means no return; also returns how many it replaced.
pub(crate) fn cleaned(mut depth: Vec<f64>, farthest: f64) -> Result<(Vec<f64>, usize)> {
    let (mut dropped, mut outside) = (0, false);
    for part in depth.chunks_mut(1024) {
        let (lost, out) = clean(part, farthest);
        dropped += lost;
        outside |= out;
    }
    if outside {
        let reason = format!("expected depths from 0 to {farthest:.3e}, where points are finite");
        return Err(match depth.iter().find(|&&z| z < 0.0 && z.is_finite()) {
            Some(z) => Error::invalid("depth", format!("expected depths >= 0, got {z}")),
            None => Error::invalid("depth", reason),
        });
    }
    Ok((depth, dropped))
}

kernel! {
    /// Replaces depths that are not finite by 0; returns how many these were, and whether others are out of range.
    fn clean<S>(_, depth: &mut [f64], farthest: f64) -> (usize, bool) {
        let (mut lost, mut outside) = (0u64, 0u64);
        for z in depth {
            let finite = z.is_finite();
            lost += u64::from(!finite);
            outside |= u64::from(finite & ((*z < 0.0) | (*z > farthest)));
            *z = if finite { *z } else { 0.0 };
        }
        (lost as usize, outside != 0)
    }
}

/// Returns the `count` largest different values below a number, and the `count` smallest of the others, ascending.
pub(crate) fn find_values_near(values: &[f64], at: f64, count: usize) -> Vec<f64> {
    if count == 0 {
        return Vec::new();
    }
    let (mut below, mut above): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut rest = values;
    while !rest.is_empty() {
        // most numbers are farther than those found
        if let (Some(&low), Some(&high)) = (below.get(count - 1), above.get(count - 1)) {
            rest = &rest[pass_over(rest, low, high)..];
        }
        let (some, others) = rest.split_at(rest.len().min(MANY));
        for &value in some.iter().filter(|value| !value.is_nan()) {
            if value >= at {
                insert_different(&mut above, value, count, |other| other < value);
            } else {
                insert_different(&mut below, value, count, |other| other > value);
            }
        }
        rest = others;
    }
    below.reverse();
    below.extend(above);
    below
}

kernel! {
    /// Returns how many numbers come before the first group that holds one between `low` and `high`.
    fn pass_over<S>(_, values: &[f64], low: f64, high: f64) -> usize {
        let mut at = 0;
        for some in values.chunks(MANY) {
            let mut any = false;
            for &value in some {
                any |= (value > low) & (value < high);
            }
            if any {
                break;
            }
            at += some.len();
        }
        at
    }
}

/// Inserts a number among at most `count` different ones after those that are nearer.
fn insert_different(found: &mut Vec<f64>, value: f64, count: usize, is_nearer: impl Fn(f64) -> bool) {
    if found.len() == count && is_nearer(found[count - 1]) {
        return;
    }
    let place = found.partition_point(|&other| is_nearer(other));
    if place < count && found.get(place) != Some(&value) {
        found.insert(place, value);
        found.truncate(count);
    }
}

/// Returns the points of a depth image's pixels inside a mask, as [`unproject`] does.
pub(crate) fn unproject_masked(depth: &[f64], mask: &[bool], width: usize, camera: Pinhole) -> Vec<Point> {
    let mut points = Vec::with_capacity(mask.iter().filter(|&&inside| inside).count());
    let rows = depth.chunks_exact(width.max(1)).zip(mask.chunks_exact(width.max(1)));
    for (v, (depth, mask)) in rows.enumerate() {
        for u in (0..width).filter(|&u| mask[u] && has_return(depth[u])) {
            points.push(camera.point(u as f64, v as f64, depth[u]));
        }
    }
    points
}

/// Returns the points of a depth image in the camera frame, row by row: x = (u − cx) z / fx, y = (v − cy) z / fy.
pub(crate) fn unproject(depth: &[f64], width: usize, camera: Pinhole) -> Vec<Point> {
    let mut points = Vec::with_capacity(depth.len());
    for (v, row) in depth.chunks_exact(width.max(1)).enumerate() {
        for (u, &z) in row.iter().enumerate() {
            if has_return(z) {
                points.push(camera.point(u as f64, v as f64, z));
            }
        }
    }
    points
}

/// Returns how much farther along the camera's axis an image saw a surface than each of some points, metres.
///
/// It is infinite where the point's pixel has no return, and NaN where the point has no pixel. Points less than
/// `nearest` in front of the camera have no pixel.
pub(crate) fn seen_behind(
    depth: &[f64],
    width: usize,
    camera: Pinhole,
    pose: &RigidMotion,
    points: &[Point],
    nearest: f64,
) -> Vec<f64> {
    let height = depth.len() / width.max(1);
    let behind = |&p: &Point| {
        let seen_from: Point = pose.rotation.tr_mul(&(Vector3::from(p) - pose.translation)).into();
        let z = seen_from[2];
        let [u, v] = camera.pixel(seen_from).map(f64::round_ties_even);
        if !(z > nearest && (0.0..width as f64).contains(&u) && (0.0..height as f64).contains(&v)) {
            return f64::NAN;
        }
        let seen = depth[v as usize * width + u as usize];
        if has_return(seen) { seen - z } else { f64::INFINITY }
    };
    points.iter().map(behind).collect()
}

/// Returns medians of twice the distance of depths from the mean of their left and right neighbours, metres.
///
/// One median is over every `every`-th row of an image, one over the pixels of some points of the camera frame. Both
/// are 0 where no three neighbours have a return. Slopes cancel in these second differences.
pub(crate) fn bends(
    depth: &[f64],
    width: usize,
    camera: Pinhole,
    points: &[Point],
    every: usize,
) -> [f64; 2] {
    let bend = |row: &[f64], column: usize| {
        let three = row.get(column.checked_sub(1)?..column + 2)?;
        three.iter().all(|&z| z > 0.0).then(|| (three[0] - 2.0 * three[1] + three[2]).abs())
    };
    let rows: Vec<&[f64]> = depth.chunks_exact(width.max(1)).collect();
    let some = rows.iter().step_by(every.max(1)).flat_map(|row| (1..width).filter_map(|u| bend(row, u)));
    let own = points.iter().filter_map(|&p| {
        let [u, v] = camera.pixel(p).map(f64::round_ties_even);
        let inside = (0.0..width as f64).contains(&u) && v >= 0.0;
        bend(rows.get(v as usize).filter(|_| inside)?, u as usize)
    });
    [some.collect(), own.collect()].map(|bends| median(bends).unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_near_a_number_are_different_and_ascend() {
        let values = [5.0, 3.0, f64::NAN, 1.0, 3.0, 2.0, 8.0, 6.0, 5.0, 7.0, 4.0];
        assert_eq!(find_values_near(&values, 5.0, 2), [3.0, 4.0, 5.0, 6.0]);
        assert_eq!(find_values_near(&values, 2.5, 3), [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(find_values_near(&values, f64::NAN, 2), [7.0, 8.0]);
        assert!(find_values_near(&values, 5.0, 0).is_empty());
        // among many
        let values: Vec<f64> = (0..1000).map(|k| f64::from(k * 7919 % 1009 / 2)).collect();
        let mut all = values.clone();
        all.sort_by(f64::total_cmp);
        all.dedup();
        let middle = all.partition_point(|&value| value < 200.0);
        assert_eq!(find_values_near(&values, 200.0, 4), all[middle - 4..middle + 4]);
    }

    #[test]
    fn pixels_without_a_return_make_no_points() {
        let camera = Pinhole { focal: [2.0, 4.0], center: [1.0, 0.0] };
        let depth = [0.0, 2.0, f64::NAN, 4.0, f64::INFINITY, 0.0];
        assert_eq!(unproject(&depth, 3, camera), [[0.0, 0.0, 2.0], [-2.0, 1.0, 4.0]]);
        let mut mask = vec![true; depth.len()];
        assert_eq!(unproject_masked(&depth, &mask, 3, camera), unproject(&depth, 3, camera));
        mask[depth.iter().position(|&z| z == 2.0).unwrap()] = false;
        assert_eq!(unproject_masked(&depth, &mask, 3, camera), [[-2.0, 1.0, 4.0]]);
        assert_eq!(cleaned(depth.to_vec(), 4.0).unwrap(), (vec![0.0, 2.0, 0.0, 4.0, 0.0, 0.0], 2));
        assert!(cleaned(depth.to_vec(), 3.9).is_err());
        assert!(cleaned(vec![-1.0], 4.0).is_err());
        assert!(unproject(&[], 0, camera).is_empty());
    }

    #[test]
    fn what_an_image_saw_behind_points() {
        let camera = Pinhole { focal: [2.0, 2.0], center: [1.0, 1.0] };
        let turned = [[0.0, 0.0, 1.0, 5.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let pose = RigidMotion::from_rows(&turned).unwrap();
        let depth = [9.0, 3.0, 0.0, 4.0, 2.0, f64::INFINITY];
        // of the camera frame: x right, y down, z forward
        let seen =
            |x: f64, y: f64, z: f64| seen_behind(&depth, 3, camera, &pose, &[pose.apply([x, y, z])], 0.5)[0];
        assert_eq!(seen(0.0, 0.0, 1.5), 0.5);
        assert_eq!(seen(0.0, -1.0, 2.0), 1.0);
        assert_eq!(seen(-1.0, 0.0, 2.0), 2.0);
        // rows 0 and 1 are the image's
        assert!(seen(0.0, 1.0, 2.0).is_nan() && seen(-2.0, 0.0, 2.0).is_nan());
        assert!(seen(0.0, 0.0, 0.5).is_nan() && seen(0.0, 0.0, -1.0).is_nan());
        assert_eq!(seen(1.0, -1.0, 2.0), f64::INFINITY);
        assert_eq!(seen(1.0, 0.0, 2.0), f64::INFINITY);
        assert!(seen_behind(&[], 0, camera, &pose, &[[6.0, 0.0, 0.0]], 0.5)[0].is_nan());
    }

    #[test]
    fn bends_are_those_of_three_neighbours_with_returns() {
        let camera = Pinhole { focal: [2.0, 2.0], center: [0.0, 0.0] };
        let depth = [1.0, 5.0, 3.0, 4.0, 0.0, 9.0, 1.0, 2.0, 3.0, 1.0, 5.0, 1.0];
        let at = |u: f64, v: f64| camera.point(u, v, 2.0);
        let [all, own] = bends(
            &depth,
            4,
            camera,
            &[at(1.0, 0.0), at(2.0, 0.0), at(0.0, 0.0), at(1.0, 9.0), at(-3.0, 0.0)],
            2,
        );
        assert_eq!((all, own), (6.0, 4.5));
        assert_eq!(bends(&depth, 4, camera, &[], 3), [4.5, 0.0]);
        assert_eq!(bends(&[], 0, camera, &[[0.0; 3]], 0), [0.0; 2]);
    }
}
