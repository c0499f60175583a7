//! The extraction range: an axis-aligned box in the world frame.

use rayon::prelude::*;

use crate::geometry::RigidMotion;
use crate::{Point, parallel};

/// Points looked at by one task.
const POINTS_PER_TASK: usize = 16384;

/// The points of a camera frame that lie in a box of the world frame, on its faces too, in their order.
///
/// Sides may be infinite; a coordinate that is NaN lies in no box.
pub fn crop(points: &[Point], pose: &RigidMotion, [low, high]: [Point; 2]) -> Vec<Point> {
    let inside = |&p: &Point| {
        let world = pose.apply(p);
        (0..3).all(|k| world[k] >= low[k] && world[k] <= high[k])
    };
    let kept: Vec<Vec<Point>> = parallel::run(|| {
        points.par_chunks(POINTS_PER_TASK).map(|some| some.iter().copied().filter(inside).collect()).collect()
    });
    kept.concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faces_of_the_range_belong_to_it() {
        let pose = RigidMotion { translation: [1.0, 0.0, 0.0].into(), ..RigidMotion::identity() };
        let points = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.1, 0.0, 0.0], [0.5, f64::NAN, 0.5]];
        assert_eq!(crop(&points, &pose, [[1.0, 0.0, 0.0], [2.0, 1.0, f64::INFINITY]]), points[..2]);
    }
}
