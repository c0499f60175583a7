//! Corrects the bends of axis points that were averaged over their neighbourhood.
//!
//! Equations are those of *Shape Modeling of A String And Recognition Using Distance Sensor*.

use nalgebra::{Matrix3, Vector3};

use super::polyline::arc_length;
use super::vector::{Point, advance, sub};
use crate::checks::{check_finite, check_positive};
use crate::error::Result;

/// Moves nodes outwards in bends, by as much as the average over two radii (eq. 17–18) moved them inwards.
///
/// Around a point of a tube, the surface points within 2r reach s² ≤ 2 r² (1 + cos φ) along the axis, φ being the angle
/// about it. Their mean s² is 8/9 r². So the mean of their axis points lies 4/9 r² κ inside the axis, where κ is the
/// curvature vector. A parabola fitted to the nodes within `span` along the chain gives κ.
pub(crate) fn straighten(nodes: &[Point], radius: f64, span: f64) -> Result<Vec<Point>> {
    check_finite("nodes", nodes)?;
    check_positive("radius", radius)?;
    check_positive("span", span)?;
    let s = arc_length(nodes);
    let straightened = |i: usize| {
        let (low, high) = (s.partition_point(|&t| s[i] - t > span), s.partition_point(|&t| t - s[i] <= span));
        let bend = fit_parabola(&s[low..high], &nodes[low..high], s[i], nodes[i], span);
        bend.map_or(nodes[i], |bend| advance(nodes[i], -4.0 / 9.0 * radius * radius, bend))
    };
    Ok((0..nodes.len()).map(straightened).collect())
}

/// Fits a parabola by least squares and returns its second derivative; None for fewer than four nodes.
fn fit_parabola(s: &[f64], nodes: &[Point], middle: f64, origin: Point, scale: f64) -> Option<Point> {
    if s.len() < 4 {
        return None;
    }
    let mut normal = Matrix3::<f64>::zeros();
    let mut right = Matrix3::<f64>::zeros();
    for (&s, &node) in s.iter().zip(nodes) {
        let t = (s - middle) / scale;
        let powers = Vector3::new(1.0, t, t * t);
        normal += powers * powers.transpose();
        right += powers * Vector3::from(sub(node, origin)).transpose();
    }
    let solved = normal.cholesky()?.solve(&right);
    Some(std::array::from_fn(|k| 2.0 * solved[(2, k)] / (scale * scale)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_grows_and_a_line_stays() {
        let circle: Vec<Point> =
            (0..60).map(|i| f64::from(i) * 0.05).map(|a| [10.0 * a.cos(), 10.0 * a.sin(), 0.0]).collect();
        for p in straighten(&circle, 1.0, 3.0).unwrap() {
            let distance = (p[0] * p[0] + p[1] * p[1]).sqrt();
            assert!((distance - 10.0 - 4.0 / 90.0).abs() < 2e-3, "{distance}");
        }
        let line: Vec<Point> = (0..20).map(|i| [f64::from(i) * 0.5, 1.0, 2.0]).collect();
        for (a, b) in straighten(&line, 1.0, 3.0).unwrap().iter().zip(&line) {
            assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-12));
        }
        assert_eq!(straighten(&line[..3], 1.0, 3.0).unwrap(), line[..3]);
        assert!(straighten(&line, 1.0, -3.0).is_err());
        assert!(straighten(&[[f64::NAN; 3]; 9], 1.0, 3.0).is_err());
    }
}
