//! The state of a fit between steps.

use nalgebra::Rotation3;

use super::{Tube, TubeView};
use crate::geometry::spline::Spline;
use crate::geometry::{Point, RigidMotion, centroid, sub};

/// State of a fit between iterations.
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
    /// For each curve, what the standard deviation of its second differences' prior is multiplied with.
    pub(super) bend_scale: Vec<f64>,
    /// For each view, the precision that holds it at the reported pose in open directions.
    pub(super) held: Vec<[[f64; 6]; 6]>,
    pub(super) sigma: f64,
    /// The least that it was.
    pub(super) least_sigma: f64,
    /// Whether stiff curves drew away from their points, so that none is made stiffer any more.
    pub(super) strained: bool,
    /// Standard deviation of a point whose weight is 1: of its residual, or of the noise along its ray.
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
            twists: motions.iter().map(|motion| twist(motion, center)).collect(),
            center,
            radius_classes: tubes.iter().map(|tube| tube.radius_class).collect(),
            radii: radii.to_vec(),
            start_radii: radii.to_vec(),
            bend_scale: vec![1.0; tubes.len()],
            held: vec![[[0.0; 6]; 6]; views.len()],
            sigma: 0.2 * smallest(radii),
            least_sigma: f64::INFINITY,
            strained: false,
            noise: 0.2 * smallest(radii),
        }
    }

    /// The radius of a curve.
    pub(super) fn radius(&self, curve: usize) -> f64 {
        self.radii[self.radius_classes[curve]]
    }
}

/// Rotation vector, and translation of a point, of a rigid motion.
pub(super) fn twist(motion: &RigidMotion, center: Point) -> [f64; 6] {
    let w = Rotation3::from_matrix_unchecked(motion.rotation).scaled_axis();
    let t = sub(motion.apply(center), center);
    [w.x, w.y, w.z, t[0], t[1], t[2]]
}

/// The least of some values.
pub(super) fn smallest(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}
