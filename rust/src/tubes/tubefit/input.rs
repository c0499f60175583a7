//! The input of a joint fit: tubes, the cameras' data and settings.

use crate::geometry::Point;
use crate::geometry::spline::Spline;

/// A piece of rope to fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Tube {
    /// Its axis.
    pub curve: Spline,
    /// The number of its radius; tubes with one number share a radius.
    pub radius_class: usize,
}

/// One camera's data.
#[derive(Debug, Clone, Copy)]
pub struct TubeView<'a> {
    /// Surface points in the world frame, placed by the reported pose, metres.
    pub points: &'a [Point],
    /// The camera's centre in the world frame, by the reported pose, metres.
    pub viewpoint: Point,
    /// The ends of ropes that it sees.
    pub end_observations: &'a [EndObservation],
    /// To continue an earlier fit from its curves: that fit's foot point of each point, None where no tube was near.
    /// Otherwise empty.
    pub foot_points: &'a [Option<OnCurve>],
}

/// A place on one of the curves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnCurve {
    /// Number of the curve.
    pub curve: usize,
    /// The curve's parameter there.
    pub parameter: f64,
}

/// The end of a rope as one camera sees it. Only ends fix a straight rope along itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndObservation {
    /// The number of the end. Observations of one end by several views tie these views together.
    pub end: usize,
    /// Its position in the world frame, placed by the reported pose, metres.
    pub place: Point,
    /// Unit vector along the rope, out of it. Only this component of the position counts.
    pub outward: Point,
    /// Standard deviation of the position in that direction, metres.
    pub sd: f64,
}

/// The measure of a residual.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Residual {
    /// The distance from the axis less the radius; robust far from the solution.
    Distance,
    /// The distance between the observed point and the place where its camera's ray hits the tube, times the cosine of
    /// the angle of incidence; unbiased under noise along the ray.
    Ray,
}

/// Settings of a joint fit.
#[derive(Debug, Clone, PartialEq)]
pub struct TubeFitOptions {
    /// Whether the fit changes curves.
    pub fit_curves: bool,
    /// Mean and standard deviation of the prior on each radius, metres; None holds the radii.
    pub radius_prior: Option<Vec<[f64; 2]>>,
    /// The view that stays in place while the others move; None holds all views.
    pub reference: Option<usize>,
    /// Standard deviations of the reported poses: rotation in radians, translation in metres.
    pub pose_sd: [f64; 2],
    /// The measure of residuals.
    pub residual: Residual,
    /// Tukey's limit in the first and the last iteration, radii.
    pub band: [f64; 2],
    /// Gauss–Newton steps at most. A continued fit counts the first two as taken.
    pub iterations: usize,
    /// The fit ends after a step smaller than this, standard deviations of the unknowns. After a step below 0.1,
    /// further steps change nothing that the data determine.
    pub tolerance: f64,
    /// Smallest radius of curvature of a curve, radii. The fit stiffens curves that bend more tightly, as far as their
    /// points allow.
    pub min_bend: f64,
    /// Standard deviation of the sensor's noise along the viewing rays, metres; None estimates it from the residuals.
    pub noise: Option<f64>,
    /// Number of points that count as one, because neighbouring pixels share errors. The first number is for errors along the
    /// viewing rays, the second for errors across them. Both only widen the uncertainty; 1 means independent noise.
    pub shared: [f64; 2],
    /// Extraction range: low and high corner, metres. Noise moves points out of it but none into it, so the fit
    /// drops points whose place on the tube lies within two standard deviations of its faces.
    pub bounds: Option<[Point; 2]>,
    /// Whether to compute the uncertainty, and to hold views at the reported poses in directions that the data do not
    /// fix.
    pub uncertainty: bool,
}

impl TubeFitOptions {
    /// Poses and radii are held, curves change. The poses' deviations are those of a stage read by hand.
    pub const DEFAULT: Self = Self {
        fit_curves: true,
        radius_prior: None,
        reference: None,
        pose_sd: [0.5 * std::f64::consts::PI / 180.0, 1.5e-3],
        residual: Residual::Distance,
        band: [0.6, 0.4],
        iterations: 12,
        tolerance: 0.1,
        min_bend: 1.5,
        noise: None,
        shared: [1.0; 2],
        bounds: None,
        uncertainty: true,
    };
}

impl Default for TubeFitOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Returns whether the views hold the foot points of an earlier fit.
pub fn goes_on(views: &[TubeView]) -> bool {
    views.iter().any(|view| !view.foot_points.is_empty())
}
