//! Joint fit of tubes and camera poses to surface points.
//!
//! Unknown are the control points of each piece of rope's spline, a small rigid motion of each view about its reported
//! pose, and the radii. A point's residual is its distance from the tube's surface. So opposite half-shells of a tube,
//! which pull into each other when points are matched with points, are told apart by construction.

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

/// Curves longer than this in all, in radii, would fill the memory with places to compare points with.
const MOST_RADII: f64 = 1e6;

/// A piece of rope to fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Tube {
    /// Its axis.
    pub curve: Spline,
    /// Number of its radius: pieces of one class share it.
    pub radius_class: usize,
}

/// What one camera saw.
#[derive(Debug, Clone, Copy)]
pub struct TubeView<'a> {
    /// Surface points in the world frame, as the reported pose places them, metres.
    pub points: &'a [Point],
    /// The camera's centre in the world frame, as reported, metres.
    pub viewpoint: Point,
    /// Where it sees ropes end.
    pub end_observations: &'a [EndObservation],
    /// The foot point of each point in an earlier fit, None where no tube was near, if this fit goes on from the
    /// curves of that one; else empty.
    pub foot_points: &'a [Option<OnCurve>],
}

/// A place of one of the curves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnCurve {
    /// Number of the curve.
    pub curve: usize,
    /// The curve's parameter there.
    pub parameter: f64,
}

/// Where one camera sees a rope end: nothing else fixes a straight rope along itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndObservation {
    /// Which end. Observations of one end by several views bind these together.
    pub end: usize,
    /// Its place in the world frame, as the reported pose places it, metres.
    pub place: Point,
    /// Unit vector along the rope, out of it. The place counts in this direction only.
    pub outward: Point,
    /// Standard deviation of the place in that direction, metres.
    pub sd: f64,
}

/// How a residual is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Residual {
    /// The distance from the axis less the radius: forgiving far from the solution.
    Distance,
    /// The distance between the observed point and where its camera's ray hits the tube, times the cosine of the angle
    /// of incidence: without bias under noise along the ray.
    Ray,
}

/// What is fitted, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct TubeFitOptions {
    /// Whether curves change.
    pub fit_curves: bool,
    /// What is known of each radius beforehand, its mean and standard deviation, metres; None: radii are held.
    pub radius_prior: Option<Vec<[f64; 2]>>,
    /// The view that stays where it is while the others move; None: all stay.
    pub reference: Option<usize>,
    /// Standard deviations of the reported poses: rotation in radians, translation in metres.
    pub pose_sd: [f64; 2],
    /// How residuals are measured.
    pub residual: Residual,
    /// Tukey's limit at the first and the last iteration, in radii.
    pub band: [f64; 2],
    /// Most Gauss–Newton steps. Where a fit goes on from an earlier one, the first two count as taken.
    pub iterations: usize,
    /// The fit ends after a step of less than this, in standard deviations of the unknowns. After one of less than
    /// 0.1, another changes nothing that the data tell.
    pub tolerance: f64,
    /// The tightest bend of a curve: its radius of curvature, in radii. A curve that bends more tightly is made
    /// stiffer, as far as its points allow.
    pub min_bend: f64,
    /// Standard deviation of the sensor's noise along the viewing rays, metres; None: estimated from the residuals.
    pub noise: Option<f64>,
    /// How many points count as one where neighbouring pixels share their errors: for what moves a surface along the
    /// viewing rays, and across them. It widens the uncertainty and changes nothing else; 1 for independent noise.
    pub shared: [f64; 2],
    /// Extraction range, low and high corner, metres. Noise carries points out of it but none in, so points whose
    /// place on the tube lies within two standard deviations of its faces have no part.
    pub bounds: Option<[Point; 2]>,
    /// Whether to work out how well the unknowns are fixed, and to hold views at the reported poses in directions
    /// that the data leave open.
    pub uncertainty: bool,
}

impl TubeFitOptions {
    /// Poses and radii are held, curves change; reported poses are as good as a stage read off by hand.
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

/// Where a point ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootPoint {
    /// Number of the curve that explains the point best.
    pub curve: usize,
    /// The curve's parameter at the foot point.
    pub parameter: f64,
    /// Distance of the point from the surface, metres; positive outside, infinite if no tube is near.
    pub residual: f64,
    /// The surface's outward unit normal there.
    pub outward: Point,
    /// Cosine between that and the direction to the camera.
    pub facing: f64,
    /// Weight in the fit; 0 if the point has no part.
    pub weight: f64,
    /// Whether the point is where the tube could have been seen.
    pub explained: bool,
    /// Whether it is explained, and its residual within the last limit beyond which residuals did not count.
    pub inlier: bool,
}

/// The outcome of a joint fit.
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
    /// For each radius, the last limit beyond which residuals did not count, metres.
    pub bands: Vec<f64>,
    /// For each view, where its points ended.
    pub foot_points: Vec<Vec<FootPoint>>,
    /// Gauss–Newton steps taken.
    pub iterations: usize,
    /// How well the unknowns are fixed, if that was asked for.
    pub uncertainty: Option<Uncertainty>,
}

/// How well the data and the priors together fix the unknowns.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Uncertainty {
    /// Covariance of each view's rotation vector, radians, and translation of the points' centroid, metres; 0 for a
    /// view that stays.
    pub poses: Vec<[[f64; 6]; 6]>,
    /// Standard deviations of the radii, metres; 0 if they were held.
    pub radii: Vec<f64>,
    /// For each curve and control point, its 3x3 covariances with itself and with the next three, m²; empty if the
    /// curves were held.
    pub curves: Vec<Vec<[[Point; 3]; 4]>>,
}

/// Fits curves, poses and radii to the points of all views.
///
/// Gauss–Newton with Tukey's loss whose limit shrinks from `band[0]` to `band[1]`, but not below where it
/// would cost efficiency. Poses have the reported ones as a prior; curves one of small third differences, which
/// matters only where points are few.
///
/// # Errors
/// [`InvalidArgument`](Error::InvalidArgument) if a coordinate is not finite, a number is out of range, or a curve has
/// fewer than four control points; [`NotEnoughData`](Error::NotEnoughData) if no point lies near a curve, or the points
/// do not fix the unknowns.
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
            return Err(Error::invalid("end_observations", "a view sees an end once"));
        }
    }
    for place in views.iter().flat_map(|view| view.foot_points).flatten() {
        if tubes.get(place.curve).is_none_or(|tube| !(0.0..=tube.curve.end()).contains(&place.parameter)) {
            return Err(Error::invalid("foot_points", "expected parameters of the curves"));
        }
    }
    if goes_on(views) && views.iter().any(|view| view.foot_points.len() != view.points.len()) {
        return Err(Error::invalid("foot_points", "expected one for each point, or none for all views"));
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
    if length > MOST_RADII {
        let reason = format!("the curves are {length:.1e} radii long, more than {MOST_RADII:e}");
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

/// Whether the foot points of an earlier fit are known.
fn goes_on(views: &[TubeView]) -> bool {
    views.iter().any(|view| !view.foot_points.is_empty())
}

/// Standard deviations of a pose's rotation vector and translation.
pub(crate) fn deviations(covariance: &[[f64; 6]; 6]) -> [f64; 6] {
    std::array::from_fn(|k| covariance[k][k].sqrt())
}

/// All views' points where corrected poses place them, and the unit vectors to their cameras.
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
