//! Gauss's linking integral of two polylines: how often they wind around each other.
//!
//! Two segments see each other over a spherical quadrilateral. The sum of these signed areas is 4 pi times the
//! integral, which is the linking number of closed curves. (K. Klenin and J. Langowski: Computation of writhe in
//! modeling of supercoiled DNA, Biopolymers 54, 2000; areas of triangles by A. van Oosterom and J. Strackee, 1983.)

use crate::geometry::{Point, cross, dot, sub};
use crate::parallel::go_on;

/// Returns the integral over two lists of segments.
pub fn compute_linking_integral(a: &[[Point; 2]], b: &[[Point; 2]]) -> f64 {
    let total: f64 = a
        .iter()
        .map(|&[start, stop]| {
            go_on();
            b.iter().map(|&[from, to]| measure_area(start, stop, from, to)).sum::<f64>()
        })
        .sum();
    total / (4.0 * std::f64::consts::PI)
}

/// Returns the signed area of the directions from one segment to the other.
fn measure_area(a: Point, b: Point, c: Point, d: Point) -> f64 {
    // with this order the area is positive if the first segment lies over the second at a right-handed crossing
    let corners = [sub(c, a), sub(c, b), sub(d, b), sub(d, a)];
    let lengths = corners.map(|p| dot(p, p).sqrt());
    let triangle = |[i, j, k]: [usize; 3]| {
        let (p, q, r) = (corners[i], corners[j], corners[k]);
        let volume = dot(p, cross(q, r));
        let base = lengths[i] * lengths[j] * lengths[k]
            + dot(p, q) * lengths[k]
            + dot(q, r) * lengths[i]
            + dot(r, p) * lengths[j];
        2.0 * volume.atan2(base)
    };
    triangle([0, 1, 2]) + triangle([0, 2, 3])
}
