//! The extraction range: an axis-aligned box in the world frame.

use rayon::prelude::*;

use crate::geometry::RigidMotion;
use crate::{Point, parallel};

/// Points looked at by one task.
const POINTS_PER_TASK: usize = 16384;

/// The numbers of the points of a camera frame that lie in a box of the world frame, on its faces too, in their order.
///
/// Sides may be infinite; a coordinate that is NaN lies in no box.
pub fn crop(points: &[Point], pose: &RigidMotion, [low, high]: [Point; 2]) -> Vec<usize> {
    let inside = |i: &usize| {
        let world = pose.apply(points[*i]);
        (0..3).all(|k| world[k] >= low[k] && world[k] <= high[k])
    };
    parallel::run(|| (0..points.len()).into_par_iter().with_min_len(POINTS_PER_TASK).filter(inside).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faces_of_the_range_belong_to_it() {
        let pose = RigidMotion { translation: [1.0, 0.0, 0.0].into(), ..RigidMotion::identity() };
        let points = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.1, 0.0, 0.0], [0.5, f64::NAN, 0.5]];
        assert_eq!(crop(&points, &pose, [[1.0, 0.0, 0.0], [2.0, 1.0, f64::INFINITY]]), [0, 1]);
    }
}
