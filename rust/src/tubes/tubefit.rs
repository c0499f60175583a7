//! Joint fit of tubes and camera poses to surface points.
//!
//! The unknowns are the control points of each rope's spline, a small rigid motion of each view about its reported
//! pose, and the radii. A point's residual is its distance from the tube's surface. So opposite half-shells of a tube
//! stay separate, which a matching of points with points would pull into each other.

use crate::checks::{check_finite, check_positive, check_unit};
use crate::error::{Error, Result};
use crate::geometry::spline::Spline;
use crate::geometry::{Point, RigidMotion, normalized, sub};
use crate::parallel;

mod equations;
mod foot_points;
mod residuals;
mod search;
mod solver;
mod spans;
mod state;
mod sums;

/// Largest total length of the curves, radii: the samples of longer ones would fill the memory.
const MAX_RADII: f64 = 1e6;

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
    /// Number of points that count as one because neighbouring pixels share errors: errors along the viewing rays, and
    /// across them. It only widens the uncertainty; 1 means independent noise.
    pub shared: [f64; 2],
    /// Extraction range: low and high corner, metres. Noise moves points out of it but none into it, so points are
    /// dropped whose place on the tube lies within two standard deviations of its faces.
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

/// Fits curves, poses and radii to the points of all views.
///
/// The method is Gauss–Newton with Tukey's loss. The limit of the loss shrinks from `band[0]` to `band[1]`, unless that
/// would cost statistical efficiency. The reported poses are a prior. So are small third differences of the curves,
/// which matter only where points are few.
///
/// # Errors
/// [`InvalidArgument`](Error::InvalidArgument) if a coordinate is not finite, a number is out of range, or a curve has
/// fewer than four control points; [`NotEnoughData`](Error::NotEnoughData) if no point lies near a curve, or the points
/// do not fix the unknowns.
///
/// ```
/// use strand::{Point, RigidMotion, Spline, Tube, TubeFitOptions, TubeView, fit_tubes};
/// // the upper half of a tube of radius 0.01 along x
/// let points: Vec<Point> = (0..2000)
///     .map(|i| {
///         let (x, angle) = (0.2 * (i / 20) as f64 / 99.0, (i % 20) as f64 / 19.0 * std::f64::consts::PI);
///         [x, 0.01 * angle.cos(), 0.01 * angle.sin()]
///     })
///     .collect();
/// let start = Spline::through(&[[0.0, 0.0, 0.002], [0.2, 0.0, 0.002]], 0.015, 0.0)?;
/// let view =
///     TubeView { points: &points, viewpoint: [0.1, 0.0, 1.0], end_observations: &[], foot_points: &[] };
/// let tube = Tube { curve: start, radius_class: 0 };
/// let still = [RigidMotion::identity()];
/// let fit = fit_tubes(&[view], &[tube], &still, &[0.01], &TubeFitOptions::DEFAULT)?;
/// let middle = fit.curves[0].at(0.5 * fit.curves[0].end()).position;
/// assert!(middle[2].abs() < 1e-4);
/// # Ok::<(), strand::Error>(())
/// ```
pub fn fit_tubes(
    views: &[TubeView],
    tubes: &[Tube],
    motions: &[RigidMotion],
    radii: &[f64],
    options: &TubeFitOptions,
) -> Result<TubeFit> {
    check_tubes(tubes, radii)?;
    check_views(views, tubes, motions)?;
    check_options(options, views.len(), radii.len())?;
    parallel::run(|| state::State::new(views, tubes, motions, radii).run(options))
}

fn check_views(views: &[TubeView], tubes: &[Tube], motions: &[RigidMotion]) -> Result<()> {
    for view in views {
        check_finite("points", view.points)?;
        check_finite("viewpoints", &[view.viewpoint])?;
        for seen in view.end_observations {
            check_finite("end_observations", &[seen.place])?;
            check_unit("end_observations", seen.outward)?;
            check_positive("end_observations", seen.sd)?;
        }
        let mut ends: Vec<usize> = view.end_observations.iter().map(|seen| seen.end).collect();
        ends.sort_unstable();
        if ends.windows(2).any(|pair| pair[0] == pair[1]) {
            return Err(Error::invalid("end_observations", "expected at most one of each end from a view"));
        }
    }
    for place in views.iter().flat_map(|view| view.foot_points).flatten() {
        if tubes.get(place.curve).is_none_or(|tube| !(0.0..=tube.curve.end()).contains(&place.parameter)) {
            return Err(Error::invalid("foot_points", "expected parameters within the curves"));
        }
    }
    if goes_on(views) && views.iter().any(|view| view.foot_points.len() != view.points.len()) {
        return Err(Error::invalid("foot_points", "expected one for each point of every view, or none"));
    }
    if motions.len() != views.len() {
        return Err(Error::invalid("motions", format!("expected one for each of {} views", views.len())));
    }
    Ok(())
}

fn check_tubes(tubes: &[Tube], radii: &[f64]) -> Result<()> {
    for &radius in radii {
        check_positive("radius", radius)?;
    }
    if tubes.is_empty() || tubes.iter().any(|tube| tube.curve.control.len() < 4) {
        return Err(Error::invalid(
            "curves",
            "expected at least one curve, each with four control points or more",
        ));
    }
    for tube in tubes {
        check_finite("curves", &tube.curve.control)?;
    }
    if tubes.iter().any(|tube| tube.radius_class >= radii.len()) {
        let reason = format!("expected the number of one of {} radii for each curve", radii.len());
        return Err(Error::invalid("radius_classes", reason));
    }
    let length: f64 = tubes.iter().map(|tube| tube.curve.length() / radii[tube.radius_class]).sum();
    if length > MAX_RADII {
        let reason = format!("the curves are {length:.1e} radii long, more than {MAX_RADII:e}");
        return Err(Error::invalid("radius", reason));
    }
    Ok(())
}

fn check_options(options: &TubeFitOptions, views: usize, radii: usize) -> Result<()> {
    if options.reference.is_some_and(|reference| reference >= views) {
        return Err(Error::invalid("reference", format!("expected the number of one of {views} views")));
    }
    for sd in options.pose_sd {
        check_positive("pose_sd", sd)?;
    }
    if let Some(priors) = &options.radius_prior {
        if priors.len() != radii {
            return Err(Error::invalid("radius_prior", format!("expected one for each of {radii} radii")));
        }
        for &value in priors.as_flattened() {
            check_positive("radius_prior", value)?;
        }
    }
    for band in options.band {
        check_positive("band", band)?;
    }
    check_positive("tolerance", options.tolerance)?;
    check_positive("min_bend", options.min_bend)?;
    if let Some(noise) = options.noise {
        check_positive("noise", noise)?;
    }
    for count in options.shared {
        check_positive("shared", count)?;
    }
    if let Some([low, high]) = options.bounds
        && !(0..3).all(|k| low[k] < high[k])
    {
        let reason = format!("expected low < high in x, y and z, got {low:?} and {high:?}");
        return Err(Error::invalid("bounds", reason));
    }
    Ok(())
}

/// Returns whether the views hold the foot points of an earlier fit.
fn goes_on(views: &[TubeView]) -> bool {
    views.iter().any(|view| !view.foot_points.is_empty())
}

/// Returns the standard deviations of a pose's rotation vector and translation.
pub(crate) fn deviations(covariance: &[[f64; 6]; 6]) -> [f64; 6] {
    std::array::from_fn(|k| covariance[k][k].sqrt())
}

/// Returns all views' points, moved by the corrections of the poses, and the unit vectors to their cameras.
pub(crate) fn placed(views: &[TubeView], motions: &[RigidMotion]) -> (Vec<Point>, Vec<Point>) {
    let (mut points, mut to_camera) = (Vec::new(), Vec::new());
    for (view, motion) in views.iter().zip(motions) {
        let camera = motion.apply(view.viewpoint);
        points.extend(view.points.iter().map(|&p| motion.apply(p)));
        let placed = &points[to_camera.len()..];
        to_camera.extend(placed.iter().map(|&p| normalized(sub(camera, p))));
    }
    (points, to_camera)
}
