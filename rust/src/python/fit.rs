//! Bindings of the joint fit of tubes and poses, and of its results.

mod end_observation;
mod outcome;

use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

pub(super) use end_observation::EndObservation;
pub(super) use outcome::TubeFit;

use super::arguments::{
    Array, FloatArray, Given, Points, count, motions, number, numbers, slices, wrong_shape,
};
use super::arrays::{constant, constant_list, constant_points, list};
use super::curves::checked_spline;
use super::released::{CHEAP, released, released_if_many};
use crate::error::Error;
use crate::geometry::averages::average_groups;
use crate::geometry::{Point, RigidMotion};
use crate::parallel;
use crate::tubes::ends::{self, OnTubes};
use crate::tubes::tubefit::{OnCurve, Residual, Tube, TubeFitOptions, TubeView, placed};

const DEFAULT: &TubeFitOptions = &TubeFitOptions::DEFAULT;
const MAX_STRETCHES: f64 = 1e5; // of a curve

/// Counts, means and mean squares.
type StretchAverages<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

// the text signature of `fit_tubes` repeats these numbers
const _: () = {
    assert!(DEFAULT.fit_curves && DEFAULT.uncertainty && matches!(DEFAULT.residual, Residual::Distance));
    assert!(DEFAULT.band[0] == 0.6 && DEFAULT.band[1] == 0.4);
    assert!(DEFAULT.iterations == 12 && DEFAULT.tolerance == 0.1 && DEFAULT.min_bend == 1.5);
    assert!(DEFAULT.shared[0] == 1.0 && DEFAULT.shared[1] == 1.0);
};

/// Fit tubes around curves to the points of all views, together with the views' poses.
///
/// The method is Gauss-Newton on each point's distance from the tube's surface, with Tukey's loss. Opposite half-shells
/// of a tube stay separate, which a matching of points with points would pull into each other. Directions that the data
/// do not fix, such as sliding along a straight rope, stay at the reported poses.
///
/// Parameters
/// ----------
/// points : sequence of (N_v, 3) array_like of float
///     Each view's points in the world frame of the reported poses, metres.
/// viewpoints : (V, 3) array_like of float
///     The cameras' centres by the reported poses, metres.
/// curves : sequence of (n, 3) array_like of float
///     Start: control points, metres, n >= 4.
/// motions : (V, 4, 4) array_like of float
///     Start: corrections of the poses.
/// radius : float or (K,) array_like of float
///     The ropes' radius, or one for each class of ropes, metres; the start if it is fitted.
/// radius_classes : (C,) array_like of int, optional
///     The number of each curve's radius; by default, all curves have the first radius.
/// pose_sd : (float, float)
///     Standard deviations of the reported poses: rotation, radians, and translation, metres.
/// reference : int or None
///     The view that stays in place; None holds all views.
/// fit_curves : bool
///     Whether the fit changes curves.
/// radius_prior : (2,) or (K, 2) array_like of float, optional
///     Mean and standard deviation of the prior on each radius, metres. By default, radii are held.
/// along_ray : bool
///     Measure residuals along the viewing rays, times the cosine of the angle of incidence: unbiased under noise along
///     the ray, but only near the solution.
/// band : (float, float)
///     Tukey's limit in the first and the last iteration, radii; at least 4.685 standard deviations of the noise, which
///     keeps 95 % of the efficiency of least squares.
/// iterations : int
///     Gauss-Newton steps at most. A continued fit counts the first two as taken.
/// tolerance : float
///     The fit ends after a step smaller than this, standard deviations of the unknowns. After a step below 0.1, further
///     steps change nothing that the data determine.
/// min_bend : float
///     Smallest radius of curvature of a curve, radii.
/// noise : float, optional
///     Standard deviation of the sensor's noise along the viewing rays, metres; by default estimated from the residuals.
/// shared : (float, float)
///     Number of points that count as one because neighbouring pixels share errors: errors along the viewing rays, and
///     across them. It only widens standard deviations and covariances; 1 means independent noise.
/// bounds : (2, 3) array_like of float, optional
///     Extraction range: low and high corner, metres. Noise moves points out of it but none into it, so the fit
///     drops points whose place on the tube lies within two standard deviations of its faces.
/// end_observations : sequence of EndObservation
///     Ends of ropes that views see; they fix straight ropes along themselves.
/// previous : TubeFit, optional
///     An earlier fit to the same points. This fit continues from its curves and foot points.
/// uncertainty : bool
///     Compute standard deviations and covariances. Views are then held at the reported poses in directions that the data
///     do not fix: those in which a correction's standard deviation is over 0.71 times the reported pose's.
///
/// Returns
/// -------
/// strand.TubeFit
///
/// Raises
/// ------
/// TypeError
///     If an argument is of the wrong kind.
/// ValueError
///     If an array has a wrong shape or is not finite, or a number is out of range.
/// strand.NotEnoughDataError
///     If the points do not fix the tubes.
#[pyfunction]
#[pyo3(signature = (points, viewpoints, curves, motions, radius, *, radius_classes = None, pose_sd, reference,
                    fit_curves = DEFAULT.fit_curves, radius_prior = None, along_ray = false, band = Given(None),
                    iterations = Given(None), tolerance = Given(None), min_bend = Given(None), noise = None,
                    shared = Given(None), bounds = None, end_observations = Vec::new(), previous = None, uncertainty = DEFAULT.uncertainty),
       text_signature = "(points, viewpoints, curves, motions, radius, *, radius_classes=None, pose_sd, reference, \
                         fit_curves=True, radius_prior=None, along_ray=False, band=(0.6, 0.4), iterations=12, \
                         tolerance=0.1, min_bend=1.5, noise=None, shared=(1.0, 1.0), bounds=None, end_observations=(), \
                         previous=None, uncertainty=True)")]
#[allow(clippy::too_many_arguments)]
pub(super) fn fit_tubes<'py>(
    py: Python<'py>,
    points: Vec<Bound<'py, PyAny>>,
    viewpoints: &Bound<'py, PyAny>,
    curves: Vec<Bound<'py, PyAny>>,
    motions: Vec<Bound<'py, PyAny>>,
    radius: &Bound<'py, PyAny>,
    radius_classes: Option<&Bound<'py, PyAny>>,
    pose_sd: &Bound<'py, PyAny>,
    reference: Option<&Bound<'py, PyAny>>,
    fit_curves: bool,
    radius_prior: Option<&Bound<'py, PyAny>>,
    along_ray: bool,
    band: Given<'py>,
    iterations: Given<'py>,
    tolerance: Given<'py>,
    min_bend: Given<'py>,
    noise: Option<&Bound<'py, PyAny>>,
    shared: Given<'py>,
    bounds: Option<&Bound<'py, PyAny>>,
    end_observations: Vec<Bound<'py, EndObservation>>,
    previous: Option<&Bound<'py, TubeFit>>,
    uncertainty: bool,
) -> PyResult<TubeFit> {
    let points = Points::all("points", &points)?;
    let viewpoints = FloatArray::of_numbers("viewpoints", viewpoints)?;
    if viewpoints.shape() != [points.len(), 3] {
        return Err(wrong_shape("viewpoints", &format!("({}, 3)", points.len()), viewpoints.shape()));
    }
    let tubes = tubes(&curves, radius_classes)?;
    let motions = self::motions("motions", &motions)?;
    let radii = FloatArray::of_numbers("radius", radius)?;
    if radii.shape().len() > 1 {
        return Err(wrong_shape("radius", "() or (K,)", radii.shape()));
    }
    let options = TubeFitOptions {
        fit_curves,
        radius_prior: radius_prior.map(priors).transpose()?,
        reference: reference.map(|value| count("reference", value)).transpose()?,
        pose_sd: numbers("pose_sd", pose_sd)?,
        residual: if along_ray { Residual::Ray } else { Residual::Distance },
        band: band.or(DEFAULT.band, |value| numbers("band", value))?,
        iterations: iterations.or(DEFAULT.iterations, |value| count("iterations", value))?,
        tolerance: tolerance.or(DEFAULT.tolerance, |value| number("tolerance", value))?,
        min_bend: min_bend.or(DEFAULT.min_bend, |value| number("min_bend", value))?,
        noise: noise.map(|value| number("noise", value)).transpose()?,
        shared: shared.or(DEFAULT.shared, |value| numbers("shared", value))?,
        bounds: bounds.map(corners).transpose()?,
        uncertainty,
    };
    let ends = by_view(&end_observations, points.len())?;
    let sizes: Vec<usize> = points.iter().map(|points| points.len()).collect();
    let foot_points = previous.map_or(Ok(Vec::new()), |fit| earlier(fit, &tubes, sizes.iter().sum()))?;
    let viewpoints = viewpoints.points("viewpoints", "(V, 3)")?;
    let classes = tubes.iter().map(|tube| tube.radius_class as i64).collect();
    let (fit, (placed, to_camera), foot_points) = released(py, move || {
        let points = slices(&points);
        let mut foot_points = &foot_points[..];
        let views: Vec<TubeView> = (points.iter().zip(&*viewpoints).zip(&ends))
            .map(|((&points, &viewpoint), end_observations)| {
                let own = points.len().min(foot_points.len());
                let foot_points = foot_points.split_off(..own).unwrap_or_default();
                TubeView { points, viewpoint, end_observations, foot_points }
            })
            .collect();
        let fit = crate::fit_tubes(&views, &tubes, &motions, radii.slice(), &options)?;
        let (placed, columns) =
            parallel::both(|| placed(&views, &fit.motions), || FootPoints::of(&fit.foot_points));
        Ok::<_, Error>((fit, placed, columns))
    })??;
    let view = sizes.iter().enumerate().flat_map(|(view, &size)| std::iter::repeat_n(view as i64, size));
    let motions: Vec<[[f64; 4]; 4]> = fit.motions.iter().map(RigidMotion::to_rows).collect();
    let uncertainty = fit.uncertainty.unwrap_or_default();
    let poses = uncertainty.poses.as_flattened().as_flattened().to_vec();
    let covariances = uncertainty.curves.iter().map(|curve| {
        let flat = curve.as_flattened().as_flattened().as_flattened().to_vec();
        Ok(constant(py, flat, [curve.len(), 4, 3, 3])?.unbind())
    });
    Ok(TubeFit {
        curves: fit
            .curves
            .into_iter()
            .map(|curve| constant_points(py, curve.control).map(Bound::unbind))
            .collect::<PyResult<_>>()?,
        motions: constant(py, motions.into_flattened().into_flattened(), [fit.motions.len(), 4, 4])?.unbind(),
        radius_classes: constant_list(py, classes)?.unbind(),
        radii: constant_list(py, fit.radii)?.unbind(),
        radii_sd: constant_list(py, uncertainty.radii)?.unbind(),
        sigma: fit.sigma,
        bands: constant_list(py, fit.bands)?.unbind(),
        points: constant_points(py, placed)?.unbind(),
        to_camera: constant_points(py, to_camera)?.unbind(),
        view: constant_list(py, view.collect())?.unbind(),
        curve: constant_list(py, foot_points.curve)?.unbind(),
        parameter: constant_list(py, foot_points.parameter)?.unbind(),
        residual: constant_list(py, foot_points.residual)?.unbind(),
        facing: constant_list(py, foot_points.facing)?.unbind(),
        weight: constant_list(py, foot_points.weight)?.unbind(),
        explained: constant_list(py, foot_points.explained)?.unbind(),
        inlier: constant_list(py, foot_points.inlier)?.unbind(),
        pose_covariance: constant(py, poses, [uncertainty.poses.len(), 6, 6])?.unbind(),
        covariances: covariances.collect::<PyResult<_>>()?,
    })
}

/// The foot points of all views, attribute by attribute.
struct FootPoints {
    curve: Vec<i64>,
    parameter: Vec<f64>,
    residual: Vec<f64>,
    facing: Vec<f64>,
    weight: Vec<f64>,
    explained: Vec<bool>,
    inlier: Vec<bool>,
}

impl FootPoints {
    fn of(views: &[Vec<crate::FootPoint>]) -> Self {
        let count = views.iter().map(Vec::len).sum();
        let mut all = Self {
            curve: Vec::with_capacity(count),
            parameter: Vec::with_capacity(count),
            residual: Vec::with_capacity(count),
            facing: Vec::with_capacity(count),
            weight: Vec::with_capacity(count),
            explained: Vec::with_capacity(count),
            inlier: Vec::with_capacity(count),
        };
        for foot in views.iter().flatten() {
            all.curve.push(foot.curve as i64);
            all.parameter.push(foot.parameter);
            all.residual.push(foot.residual);
            all.facing.push(foot.facing);
            all.weight.push(foot.weight);
            all.explained.push(foot.explained);
            all.inlier.push(foot.inlier);
        }
        all
    }
}

/// Makes tubes of curves and the numbers of their radii.
fn tubes(curves: &[Bound<'_, PyAny>], radius_classes: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<Tube>> {
    let numbers = match radius_classes {
        None => vec![0; curves.len()],
        Some(classes) => classes
            .try_iter()
            .map_err(|_| PyTypeError::new_err("radius_classes: expected a whole number for each curve"))?
            .map(|class| count("radius_classes", &class?))
            .collect::<PyResult<_>>()?,
    };
    if numbers.len() != curves.len() {
        let reason = format!("expected one for each of {} curves, got {}", curves.len(), numbers.len());
        return Err(PyValueError::new_err(format!("radius_classes: {reason}")));
    }
    let tube = |((i, curve), radius_class): ((usize, &Bound<'_, PyAny>), usize)| {
        Ok(Tube { curve: checked_spline(&format!("curves[{i}]"), curve)?, radius_class })
    };
    curves.iter().enumerate().zip(numbers).map(tube).collect()
}

/// Takes a mean and a standard deviation, or both for each radius.
fn priors(value: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 2]>> {
    let array = FloatArray::of_numbers("radius_prior", value)?;
    match array.shape() {
        [2] | [_, 2] => Ok(array.slice().as_chunks().0.to_vec()),
        other => Err(wrong_shape("radius_prior", "(2,) or (K, 2)", other)),
    }
}

/// Takes the low and the high corner of a box.
fn corners(value: &Bound<'_, PyAny>) -> PyResult<[Point; 2]> {
    let array = FloatArray::of_numbers("bounds", value)?;
    match (array.shape(), array.slice().as_chunks().0) {
        ([2, 3], &[low, high]) => Ok([low, high]),
        (other, _) => Err(wrong_shape("bounds", "(2, 3)", other)),
    }
}

/// Groups end observations by view.
fn by_view(all: &[Bound<'_, EndObservation>], views: usize) -> PyResult<Vec<Vec<crate::EndObservation>>> {
    let mut found = vec![Vec::new(); views];
    for (i, seen) in all.iter().enumerate() {
        let EndObservation { view, observation } = seen.get();
        let of_view = found.get_mut(*view).ok_or_else(|| {
            let reason = format!("expected the number of one of {views} views, got {view}");
            PyValueError::new_err(format!("end_observations[{i}]: {reason}"))
        })?;
        of_view.push(*observation);
    }
    Ok(found)
}

/// Returns the foot points of an earlier fit to the same points.
fn earlier(previous: &Bound<'_, TubeFit>, tubes: &[Tube], count: usize) -> PyResult<Vec<Option<OnCurve>>> {
    let (py, fit) = (previous.py(), previous.get());
    let (curves, before) = (fit.curves.len(), fit.points.bind(py).shape()[0]);
    let alike =
        |(curve, tube): (&Py<PyArray2<f64>>, &Tube)| curve.bind(py).shape()[0] == tube.curve.control.len();
    if curves != tubes.len() || before != count || !fit.curves.iter().zip(tubes).all(alike) {
        return Err(PyValueError::new_err(format!(
            "previous: expected a fit of {} curves of as many control points as these to {count} points, \
             got one of {curves} to {before}",
            tubes.len()
        )));
    }
    fit.foot_points(py)
}

/// Cut fitted curves to the part that points support.
///
/// Let n be the number of points for each metre of rope, and m the number of points past L0 - r, where the points end
/// at about L0. The end is at L0 - r + m / n. This estimate is unbiased, unlike a threshold on the density.
///
/// Parameters
/// ----------
/// fit : TubeFit
/// surface_tolerance : sequence of float, optional
///     For each curve, the largest distance of its points from a surface at which they count as on it, metres. Near an
///     end, points on another curve's surface too are then skipped, because they say nothing about the end. By default all
///     points count.
///
/// Returns
/// -------
/// list of ((float, float) or None)
///     The first and the last parameter of each rope; None if fewer than eight points support the curve.
#[pyfunction]
#[pyo3(signature = (fit, surface_tolerance = None))]
pub(super) fn find_extents(
    py: Python<'_>,
    fit: &Bound<'_, TubeFit>,
    surface_tolerance: Option<Vec<f64>>,
) -> PyResult<Vec<Option<[f64; 2]>>> {
    let fit = fit.get();
    if let Some(tolerance) = &surface_tolerance
        && tolerance.len() != fit.curves.len()
    {
        let reason = format!("expected one for each of {} curves, got {}", fit.curves.len(), tolerance.len());
        return Err(PyValueError::new_err(format!("surface_tolerance: {reason}")));
    }
    let classes = Array::<i64>::exactly("radius_classes", fit.radius_classes.bind(py), 1)?;
    let tubes: Vec<Tube> = (fit.curves.iter().zip(classes.slice()))
        .map(|(curve, &class)| {
            let curve = checked_spline("curves", curve.bind(py).as_any())?;
            Ok(Tube { curve, radius_class: class as usize })
        })
        .collect::<PyResult<_>>()?;
    let radii = FloatArray::new("radii", fit.radii.bind(py))?;
    let points = Points::new("points", fit.points.bind(py), "(N, 3)")?;
    let to_camera = Points::new("to_camera", fit.to_camera.bind(py), "(N, 3)")?;
    let curve = Array::<i64>::exactly("curve", fit.curve.bind(py), 1)?;
    let parameter = FloatArray::new("parameter", fit.parameter.bind(py))?;
    let inlier = Array::flags("inlier", fit.inlier.bind(py), 1)?;
    Ok(released_if_many(py, points.len() / CHEAP, move || {
        let on_tubes = OnTubes {
            inlier: inlier.slice(),
            curve: curve.slice(),
            parameter: parameter.slice(),
            position: &points,
            to_camera: &to_camera,
        };
        ends::rope_extents(&tubes, radii.slice(), &on_tubes, surface_tolerance.as_deref())
    })??)
}

/// Average the residuals of a fit's inliers in each view along stretches of the curves.
///
/// Parameters
/// ----------
/// fit : TubeFit
/// length : float
///     Of a stretch, spans of the curve.
///
/// Returns
/// -------
/// count : (K,) ndarray of int64
///     Number of points. Stretches of a curve follow each other, and curves of a view.
/// mean, square : (K,) ndarray
///     Mean residual, metres, and mean square; 0 without points.
#[pyfunction]
pub(super) fn average_residuals<'py>(
    py: Python<'py>,
    fit: &Bound<'py, TubeFit>,
    length: f64,
) -> PyResult<StretchAverages<'py>> {
    let fit = fit.get();
    let spans = fit.curves.iter().map(|curve| curve.bind(py).shape()[0]).max().unwrap_or(0);
    if !(length > 0.0 && length.is_finite() && spans as f64 / length < MAX_STRETCHES) {
        let reason = format!("length: expected spans for at most {MAX_STRETCHES} stretches, got {length}");
        return Err(PyValueError::new_err(reason));
    }
    let (curves, stretches) = (fit.curves.len(), (spans as f64 / length) as usize + 1);
    let groups = fit.motions.bind(py).shape()[0] * curves * stretches;
    let view = Array::<i64>::exactly("view", fit.view.bind(py), 1)?;
    let curve = Array::<i64>::exactly("curve", fit.curve.bind(py), 1)?;
    let parameter = FloatArray::new("parameter", fit.parameter.bind(py))?;
    let residual = FloatArray::new("residual", fit.residual.bind(py))?;
    let inlier = Array::flags("inlier", fit.inlier.bind(py), 1)?;
    let (count, mean, square) = released_if_many(py, view.slice().len() / CHEAP + groups, move || {
        let number = |k: usize| {
            let stretch = ((parameter.slice()[k] / length) as usize).min(stretches - 1);
            let course =
                (view.slice()[k] as usize).checked_mul(curves)?.checked_add(curve.slice()[k] as usize)?;
            course.checked_mul(stretches)?.checked_add(stretch)
        };
        let inliers = (0..view.slice().len()).filter(|&k| inlier.slice()[k]);
        average_groups(inliers.filter_map(|k| Some((number(k)?, residual.slice()[k]))), groups)
    })?;
    Ok((list(py, count)?, list(py, mean)?, list(py, square)?))
}
