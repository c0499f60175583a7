//! The extraction range: an axis-aligned box in the world frame.

use rayon::prelude::*;

use crate::clouds::depth::{Pinhole, has_return};
use crate::geometry::{Point, RigidMotion};
use crate::parallel;
use crate::simd::{LANES, kernel};

const POINTS_PER_TASK: usize = 16384; // points that one task works on
/// Rounding error of a coordinate, with a wide margin, as a share of the largest number that it is computed from.
const ROUNDING: f64 = 1e-12;

/// Returns the indices of the points of a camera frame that lie in a box of the world frame, faces included.
///
/// Sides may be infinite. A point that is not finite lies in no box.
pub(crate) fn crop(points: &[Point], pose: &RigidMotion, bounds: [Point; 2]) -> Vec<usize> {
    let bounds = finite(bounds);
    let inside = |i: &usize| is_inside(pose.apply(points[*i]), bounds);
    parallel::run(|| (0..points.len()).into_par_iter().with_min_len(POINTS_PER_TASK).filter(inside).collect())
}

#[inline(always)]
fn is_inside(world: Point, [low, high]: [Point; 2]) -> bool {
    (0..3).all(|k| world[k] >= low[k] && world[k] <= high[k])
}

/// Returns bounds that no infinite coordinate lies between.
fn finite(bounds: [Point; 2]) -> [Point; 2] {
    bounds.map(|corner| corner.map(|x| x.clamp(f64::MIN, f64::MAX)))
}

/// A depth image and its camera.
#[derive(Debug, Clone, Copy)]
pub struct DepthView<'a> {
    /// Depths row by row, metres.
    pub depth: &'a [f64],
    /// Pixels in a row.
    pub width: usize,
    /// The camera.
    pub camera: Pinhole,
    /// Camera to world.
    pub pose: RigidMotion,
}

/// Returns the points of depth images that lie in a box of the world frame, in their camera's frame.
///
/// One pass over the images; pixels outside the box are not unprojected. The box includes its faces. Infinite bounds
/// leave a side open. Points that overflow are dropped.
pub fn crop_images(views: &[DepthView], bounds: [Point; 2]) -> Vec<Vec<Point>> {
    let bounds = finite(bounds);
    let bands: Vec<(usize, usize, &[f64])> = views
        .iter()
        .enumerate()
        .flat_map(|(number, view)| {
            let width = view.width.max(1);
            let rows = POINTS_PER_TASK.div_ceil(width);
            let bands = view.depth.chunks(rows * width).enumerate();
            bands.map(move |(band, depth)| (number, band * rows, depth))
        })
        .collect();
    let found: Vec<Vec<Point>> = parallel::run(|| {
        bands
            .par_iter()
            .map(|&(number, first_row, depth)| {
                parallel::go_on();
                crop_band(&views[number], first_row, depth, bounds)
            })
            .collect()
    });
    let mut points = vec![Vec::new(); views.len()];
    for (&(number, ..), found) in bands.iter().zip(found) {
        points[number].extend(found);
    }
    points
}

kernel! {
    /// The points of some rows of a depth image that lie in a box of the world frame.
    fn crop_band<S>(simd, view: &DepthView, first_row: usize, depth: &[f64], bounds: [Point; 2]) -> Vec<Point> {
        let DepthView { width, camera, pose, .. } = view;
        let [low, high] = bounds;
        let numbers = simd.load_half(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        // products of subnormal numbers lose all their digits
        let (share, least) = (simd.splat_half(ROUNDING), simd.splat_half(f64::MIN_POSITIVE));
        let mut points = Vec::new();
        for (row, depths) in depth.chunks_exact((*width).max(1)).enumerate() {
            let v = (first_row + row) as f64;
            // along a row a world coordinate is z (a + u b) + t
            let [start, end] = [0.0, *width as f64].map(|u| {
                let ray = camera.point(u, v, 1.0);
                (pose.rotation * nalgebra::Vector3::from(ray)).into()
            });
            let (start, end): (Point, Point) = (start, end);
            let step: Point = std::array::from_fn(|k| (end[k] - start[k]) / *width as f64);
            let steepest = start.iter().chain(&end).fold(0.0, |most: f64, x| most.max(x.abs()));
            let farthest = pose.translation.amax();
            let (steepest, farthest) = (simd.splat_half(steepest), simd.splat_half(farthest));
            for (part, depths) in depths.chunks(LANES).enumerate() {
                let first = (part * LANES) as f64;
                let mut z = [0.0; LANES];
                match depths.first_chunk() {
                    Some(whole) => z = *whole,
                    None => z[..depths.len()].copy_from_slice(depths),
                }
                let depths = simd.load_half(&z);
                let columns = simd.add_half(simd.splat_half(first), numbers);
                let rounding = simd.add_half(simd.mul_half(depths, steepest), farthest);
                let rounding = simd.add_half(simd.mul_half(rounding, share), least);
                // NaN, where a ray is infinite, may be inside
                let mut out = !simd.lt_half(simd.splat_half(0.0), depths);
                for k in 0..3 {
                    let across = simd.mul_half(columns, simd.splat_half(step[k]));
                    let ray = simd.add_half(simd.splat_half(start[k]), across);
                    let world = simd.add_half(simd.mul_half(depths, ray), simd.splat_half(pose.translation[k]));
                    out |= simd.lt_half(simd.add_half(world, rounding), simd.splat_half(low[k]));
                    out |= simd.lt_half(simd.splat_half(high[k]), simd.sub_half(world, rounding));
                }
                let mut left = !out & ((1 << LANES) - 1);
                while left != 0 {
                    let l = left.trailing_zeros() as usize % LANES;
                    left &= left - 1;
                    if has_return(z[l]) {
                        let point = camera.point(first + l as f64, v, z[l]);
                        if is_inside(pose.apply(point), [low, high]) {
                            points.push(point);
                        }
                    }
                }
            }
        }
        points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_pass_over_images_keeps_what_crop_keeps_of_their_points() {
        let camera = Pinhole { focal: [30.0, 31.0], center: [18.3, 9.1] };
        let pose = RigidMotion {
            rotation: nalgebra::Rotation3::new([0.4, -0.7, 1.1].into()).into_inner(),
            translation: [0.1, -0.2, 0.3].into(),
        };
        let mut depth: Vec<f64> = (0..37 * 20).map(|i| 1.0 + (f64::from(i) * 0.7).sin()).collect();
        (depth[3], depth[50], depth[99]) = (f64::NAN, 0.0, f64::INFINITY);
        let points = crate::clouds::depth::unproject(&depth, 37, camera);
        let world = pose.apply(points[200]);
        for bounds in [
            [[-0.3, -0.4, f64::NEG_INFINITY], [0.6, 0.9, 0.8]],
            // a point on the faces
            [world, world.map(|x| x + 0.5)],
        ] {
            let kept = crop(&points, &pose, bounds);
            let expected: Vec<Point> = kept.into_iter().map(|i| points[i]).collect();
            assert!(!expected.is_empty());
            let view = DepthView { depth: &depth, width: 37, camera, pose };
            assert_eq!(crop_images(&[view, view], bounds), [expected.clone(), expected]);
        }
    }

    #[test]
    fn numbers_at_the_ends_of_double_precision_are_cropped_alike() {
        let depth = [5e-324, 3e-320, 1e-310, 2e-308, 1e-300, 1e-160, 1.0, 1e99, 1e200, 1e308];
        for focal in [5e-324, 1e-310, 1e-200, 30.0, 1e300] {
            for center in [-2.5, 1e300] {
                let camera = Pinhole { focal: [focal, 2.0 * focal], center: [center, 0.25] };
                let pose = RigidMotion {
                    rotation: nalgebra::Rotation3::new([0.4, -0.7, 1.1].into()).into_inner(),
                    ..RigidMotion::identity()
                };
                let points = crate::clouds::depth::unproject(&depth, 5, camera);
                let open = [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
                let corners = points.iter().map(|&corner| pose.apply(corner));
                for bounds in corners.map(|low| [low, low.map(|x| x + x.abs())]).chain([open]) {
                    let kept = crop(&points, &pose, bounds);
                    let expected: Vec<Point> = kept.into_iter().map(|i| points[i]).collect();
                    assert!(expected.as_flattened().iter().all(|x| x.is_finite()));
                    let view = DepthView { depth: &depth, width: 5, camera, pose };
                    assert_eq!(crop_images(&[view], bounds), [expected], "{focal} {center} {bounds:?}");
                }
            }
        }
    }

    #[test]
    fn the_faces_of_the_range_belong_to_it() {
        let pose = RigidMotion { translation: [1.0, 0.0, 0.0].into(), ..RigidMotion::identity() };
        let points = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.1, 0.0, 0.0], [0.5, f64::NAN, 0.5]];
        assert_eq!(crop(&points, &pose, [[1.0, 0.0, 0.0], [2.0, 1.0, f64::INFINITY]]), [0, 1]);
    }
}
