//! Joint fit of tubes and camera poses to surface points.
//!
//! The unknowns are the control points of each rope's spline, a small rigid motion of each view about its reported
//! pose, and the radii. A point's residual is its distance from the tube's surface. So opposite half-shells of a tube
//! stay separate, which a matching of points with points would pull into each other.

use crate::checks::{check_finite, check_positive, check_unit};
use crate::error::{Error, Result};
use crate::geometry::{Point, RigidMotion, normalized, sub};
use crate::parallel;

mod equations;
mod foot_points;
mod input;
mod outcome;
mod residuals;
mod search;
mod solver;
mod spans;
mod state;
mod sums;

pub use input::{EndObservation, OnCurve, Residual, Tube, TubeFitOptions, TubeView};
pub use outcome::{FootPoint, TubeFit, Uncertainty};

use input::goes_on;

/// Largest total length of the curves, radii: the samples of longer ones would fill the memory.
const MAX_RADII: f64 = 1e6;

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

/// Returns the standard deviations of a pose's rotation vector and translation.
pub(crate) fn deviations(covariance: &[[f64; 6]; 6]) -> [f64; 6] {
    std::array::from_fn(|k| covariance[k][k].sqrt())
}

/// Returns all views' points, moved by the corrections of the poses, and the unit vectors to their cameras.
pub(crate) fn placed(views: &[TubeView], motions: &[RigidMotion]) -> (Vec<Point>, Vec<Point>) {
    let count = views.iter().map(|view| view.points.len()).sum();
    let (mut points, mut to_camera) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for (view, motion) in views.iter().zip(motions) {
        let camera = motion.apply(view.viewpoint);
        points.extend(view.points.iter().map(|&p| motion.apply(p)));
        let placed = &points[to_camera.len()..];
        to_camera.extend(placed.iter().map(|&p| normalized(sub(camera, p))));
    }
    (points, to_camera)
}
