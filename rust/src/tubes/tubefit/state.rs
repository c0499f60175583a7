//! The state of a fit between steps.

use nalgebra::Rotation3;

use super::input::{Tube, TubeView};
use crate::geometry::spline::Spline;
use crate::geometry::{Point, RigidMotion, centroid, sub};

/// The state of a fit between steps.
pub(super) struct State<'a> {
    pub(super) views: &'a [TubeView<'a>],
    pub(super) curves: Vec<Spline>,
    pub(super) motions: Vec<RigidMotion>,
    /// Rotation vector and translation of each motion, about `center`.
    pub(super) twists: Vec<[f64; 6]>,
    pub(super) center: Point,
    /// The number of each curve's radius, and the radii now and at the start.
    pub(super) radius_classes: Vec<usize>,
    pub(super) radii: Vec<f64>,
    pub(super) start_radii: Vec<f64>,
    /// For each curve, the factor of the standard deviation of its second differences' prior.
    pub(super) bend_scale: Vec<f64>,
    /// For each view, the precision that holds it at the reported pose in open directions.
    pub(super) held: Vec<[[f64; 6]; 6]>,
    pub(super) sigma: f64,
    /// The least sigma so far.
    pub(super) least_sigma: f64,
    /// Whether stiff curves moved away from their points, so that no curve is stiffened further.
    pub(super) strained: bool,
    /// Standard deviation of the residual, or of the noise along the ray, of a point with weight 1.
    pub(super) noise: f64,
}

impl<'a> State<'a> {
    pub(super) fn new(
        views: &'a [TubeView<'a>],
        tubes: &[Tube],
        motions: &[RigidMotion],
        radii: &[f64],
    ) -> Self {
        let all: Vec<Point> = views.iter().map(|view| centroid(view.points)).collect();
        let center = centroid(&all);
        Self {
            views,
            curves: tubes.iter().map(|tube| tube.curve.clone()).collect(),
            motions: motions.to_vec(),
            twists: motions.iter().map(|motion| find_twist(motion, center)).collect(),
            center,
            radius_classes: tubes.iter().map(|tube| tube.radius_class).collect(),
            radii: radii.to_vec(),
            start_radii: radii.to_vec(),
            bend_scale: vec![1.0; tubes.len()],
            held: vec![[[0.0; 6]; 6]; views.len()],
            sigma: 0.2 * find_least(radii),
            least_sigma: f64::INFINITY,
            strained: false,
            noise: 0.2 * find_least(radii),
        }
    }

    /// Returns the radius of a curve.
    pub(super) fn radius(&self, curve: usize) -> f64 {
        self.radii[self.radius_classes[curve]]
    }
}

/// Returns the rotation vector of a rigid motion, and its translation of a point.
pub(super) fn find_twist(motion: &RigidMotion, center: Point) -> [f64; 6] {
    let w = Rotation3::from_matrix_unchecked(motion.rotation).scaled_axis();
    let t = sub(motion.apply(center), center);
    [w.x, w.y, w.z, t[0], t[1], t[2]]
}

/// Returns the least of some values.
pub(super) fn find_least(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}
