//! The result of a joint fit.

use crate::geometry::spline::Spline;
use crate::geometry::{Point, RigidMotion};

/// A point's place on the tubes after a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootPoint {
    /// The number of the curve that explains the point best.
    pub curve: usize,
    /// The curve's parameter at the foot point.
    pub parameter: f64,
    /// Distance of the point from the surface, metres: positive outside, infinite if no tube is near.
    pub residual: f64,
    /// The surface's outward unit normal at the foot point.
    pub outward: Point,
    /// Cosine between the normal and the direction to the camera.
    pub facing: f64,
    /// Weight in the fit; 0 if the point takes no part.
    pub weight: f64,
    /// Whether the camera could have seen the tube at this point.
    pub explained: bool,
    /// Whether the point is explained and its residual is within the last limit.
    pub inlier: bool,
}

/// The result of a joint fit.
#[derive(Debug, Clone, PartialEq)]
pub struct TubeFit {
    /// The curves.
    pub curves: Vec<Spline>,
    /// For each view, the rigid motion of the world frame that corrects its reported pose.
    pub motions: Vec<RigidMotion>,
    /// The radii, metres.
    pub radii: Vec<f64>,
    /// Robust standard deviation of the residuals, metres.
    pub sigma: f64,
    /// For each radius, Tukey's last limit, metres.
    pub bands: Vec<f64>,
    /// For each view, the foot points of its points.
    pub foot_points: Vec<Vec<FootPoint>>,
    /// Gauss–Newton steps taken.
    pub iterations: usize,
    /// The uncertainty, if the caller asked for it.
    pub uncertainty: Option<Uncertainty>,
}

/// The uncertainty of the unknowns, given the data and the priors.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Uncertainty {
    /// For each view, the covariance of its rotation vector, radians, and of the translation of the points' centroid,
    /// metres; 0 for a view that stays.
    pub poses: Vec<[[f64; 6]; 6]>,
    /// Standard deviations of the radii, metres; 0 for held radii.
    pub radii: Vec<f64>,
    /// For each curve and control point, its 3x3 covariances with itself and with the next three control points, m²;
    /// empty for held curves.
    pub curves: Vec<Vec<[[Point; 3]; 4]>>,
}
