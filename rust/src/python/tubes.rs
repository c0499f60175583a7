//! Bindings of the tube kernels.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arguments::{
    FloatArray, PointsArray, Rows, count, motion, number, points_array, require_same_length, viewpoints,
    wrong_shape,
};
use crate::{Error, OnCurve, Point, RigidMotion, Viewpoints};

/// Estimate a string's radius at places of what one camera saw, from how wide it looks.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     Surface points of strings, metres, any frame.
/// viewpoint : (3,) array_like of float
///     The camera's centre, metres, in the points' frame.
/// largest : float
///     Wider strips are left out, metres.
/// seeds : int
///     At how many points at most, spread over the cloud.
///
/// Returns
/// -------
/// (K, 2) ndarray
///     For each seed whose surroundings are a strip, half the strip's width, and the side of the square that each of
///     its points stands for, metres. Strands side by side look like one strip.
///
/// Raises
/// ------
/// TypeError
///     If `points` does not hold floating point numbers.
/// ValueError
///     If `points` is not (N, 3), a coordinate is not finite, or `largest` is not positive.
#[pyfunction]
pub(super) fn strip_radii<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    viewpoint: Point,
    largest: f64,
    seeds: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let array = FloatArray::new("points", points)?;
    let points = array.rows("points", "(N, 3)")?;
    let strips = py.detach(|| crate::strip_radii(points, viewpoint, largest, seeds))?;
    let rows: Vec<[f64; 2]> = strips.iter().map(|strip| [strip.radius, strip.footprint]).collect();
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), 2])
}

/// Trace arcs of tubes through surface points.
///
/// Short bent tubes are fitted to the points that face their cameras, with none inside, and followed both ways from
/// the best: neither bends nor strands that touch are smeared.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     Surface points of strings, metres, any frame.
/// viewpoint : (3,) or (N, 3) array_like of float
///     The camera's centre, or one for each point, metres, in the points' frame.
/// radius : float
///     The strings' radius, metres.
/// min_nodes : int
///     Arcs with fewer nodes are left out.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or leave them out.
///
/// Returns
/// -------
/// list of ((M, 3) ndarray, (M,) ndarray)
///     For each arc its nodes on the axis in order, half a radius apart, metres, and how many points support each:
///     on the surface, facing their camera, within a radius ahead of it. Where strands cross or hide each other
///     an arc ends; the best supported arcs come first.
///
/// Raises
/// ------
/// TypeError
///     If an array does not hold floating point numbers.
/// ValueError
///     If a shape is wrong, a coordinate is not finite, `radius` is not positive, or `min_nodes` is negative.
#[pyfunction]
#[pyo3(signature = (points, viewpoint, radius, *, min_nodes = None, nonfinite = "raise"),
       text_signature = "(points, viewpoint, radius, *, min_nodes=4, nonfinite='raise')")]
pub(super) fn trace_tubes<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    viewpoint: &Bound<'py, PyAny>,
    radius: &Bound<'py, PyAny>,
    min_nodes: Option<&Bound<'py, PyAny>>,
    nonfinite: &str,
) -> PyResult<Vec<(PointsArray<'py>, Bound<'py, PyArray1<f64>>)>> {
    let array = FloatArray::new("points", points)?;
    let points = array.rows("points", "(N, 3)")?;
    let radius = number("radius", radius)?;
    let min_nodes = min_nodes.map_or(Ok(4), |value| count("min_nodes", value))?;
    let array = FloatArray::new("viewpoint", viewpoint)?;
    let (one, each) = viewpoints(&array, points.len())?;
    let rows = Rows::new(nonfinite, &[points, each.unwrap_or(points)])?;
    let arcs = py.detach(|| {
        let each = each.map(|each| rows.select(each));
        let viewpoints = each.as_deref().map_or(Viewpoints::One(one), Viewpoints::Each);
        crate::trace_tubes(&rows.select(points), viewpoints, radius, min_nodes)
    })?;
    arcs.into_iter()
        .map(|arc| Ok((points_array(py, arc.nodes)?, PyArray1::from_vec(py, arc.support))))
        .collect()
}

/// Fit curves, poses and radii to the points of all views; see `strand.fit_tubes`.
#[pyfunction]
#[pyo3(signature = (points, viewpoints, curves, ropes, motions, radii, *, fit_curves = true, radius_prior = None, reference,
                    pose_sd, along_ray = false, band = [0.6, 0.4], iterations = 12, tolerance = 0.1, min_bend = 1.5, noise = None,
                    bounds = None, ends, feet = None, uncertainty = true),
       text_signature = "(points, viewpoints, curves, ropes, motions, radii, *, fit_curves=True, radius_prior=None, \
                         reference, pose_sd, along_ray=False, band=(0.6, 0.4), iterations=12, tolerance=0.1, \
                         min_bend=1.5, noise=None, bounds=None, ends, feet=None, uncertainty=True)")]
#[allow(clippy::too_many_arguments)]
pub(super) fn fit_tubes<'py>(
    py: Python<'py>,
    points: Vec<Bound<'py, PyAny>>,
    viewpoints: &Bound<'py, PyAny>,
    curves: Vec<Bound<'py, PyAny>>,
    ropes: Vec<usize>,
    motions: Vec<Bound<'py, PyAny>>,
    radii: Vec<f64>,
    fit_curves: bool,
    radius_prior: Option<Vec<[f64; 2]>>,
    reference: Option<usize>,
    pose_sd: [f64; 2],
    along_ray: bool,
    band: [f64; 2],
    iterations: usize,
    tolerance: f64,
    min_bend: f64,
    noise: Option<f64>,
    bounds: Option<[Point; 2]>,
    ends: Vec<(usize, usize, Point, Point, f64)>,
    feet: Option<(PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, f64>)>,
    uncertainty: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let arrays = FloatArray::all("points", &points)?;
    let points: Vec<&[Point]> = arrays.iter().map(|a| a.rows("points", "(N, 3)")).collect::<PyResult<_>>()?;
    let viewpoints = FloatArray::new("viewpoints", viewpoints)?;
    let viewpoints = viewpoints.rows("viewpoints", "(V, 3)")?;
    if viewpoints.len() != points.len() {
        return Err(wrong_shape("viewpoints", &format!("({}, 3)", points.len()), &[viewpoints.len(), 3]));
    }
    let tubes: Vec<crate::Tube> = curves
        .iter()
        .zip(ropes)
        .map(|(curve, rope)| {
            let control = FloatArray::new("curves", curve)?.rows("curves", "(n, 3)")?.to_vec();
            Ok(crate::Tube { curve: crate::Spline { control }, rope })
        })
        .collect::<PyResult<_>>()?;
    let motions: Vec<RigidMotion> = motions.iter().map(|m| motion("motions", m)).collect::<PyResult<_>>()?;
    let options = crate::TubeFitOptions {
        fit_curves,
        radius_prior,
        reference,
        pose_sd,
        residual: if along_ray { crate::Residual::Ray } else { crate::Residual::Distance },
        band,
        iterations,
        tolerance,
        min_bend,
        noise,
        bounds,
        uncertainty,
    };
    let mut sightings = vec![Vec::new(); points.len()];
    for (view, end, place, outward, sd) in ends {
        let seen = sightings
            .get_mut(view)
            .ok_or_else(|| PyValueError::new_err(format!("ends: there is no view {view}")))?;
        seen.push(crate::EndSighting { end, place, outward, sd });
    }
    let feet = feet.as_ref().map_or(Ok(Vec::new()), |(curve, parameter)| {
        let (curve, parameter) = (curve.as_slice()?, parameter.as_slice()?);
        require_same_length("feet", parameter.len(), curve.len())?;
        let foot = |(&curve, &parameter): (&i64, &f64)| {
            usize::try_from(curve).ok().map(|curve| OnCurve { curve, parameter })
        };
        Ok::<Vec<Option<OnCurve>>, PyErr>(curve.iter().zip(parameter).map(foot).collect())
    })?;
    let (fit, (placed, to_camera)) = py.detach(|| {
        let mut feet = &feet[..];
        let views: Vec<crate::TubeView> = (points.iter().zip(viewpoints).zip(&sightings))
            .map(|((&points, &viewpoint), ends)| {
                let feet = feet.split_off(..points.len().min(feet.len())).unwrap_or_default();
                crate::TubeView { points, viewpoint, ends, feet }
            })
            .collect();
        let fit = crate::fit_tubes(&views, &tubes, &motions, &radii, &options)?;
        let placed = crate::placed(&views, &fit.motions);
        Ok::<_, Error>((fit, placed))
    })?;
    let result = PyDict::new(py);
    result.set_item("points", points_array(py, placed)?)?;
    result.set_item("to_camera", points_array(py, to_camera)?)?;
    let view = points.iter().enumerate().flat_map(|(view, points)| points.iter().map(move |_| view as i64));
    result.set_item("view", PyArray1::from_iter(py, view))?;
    let curves: Vec<_> =
        fit.curves.into_iter().map(|curve| points_array(py, curve.control)).collect::<PyResult<_>>()?;
    result.set_item("curves", curves)?;
    let rows: Vec<[[f64; 4]; 4]> = fit.motions.iter().map(RigidMotion::to_rows).collect();
    let motions = PyArray1::from_slice(py, rows.as_flattened().as_flattened());
    result.set_item("motions", motions.reshape([rows.len(), 4, 4])?)?;
    result.set_item("radii", PyArray1::from_vec(py, fit.radii))?;
    result.set_item("sigma", fit.sigma)?;
    result.set_item("bands", PyArray1::from_vec(py, fit.bands))?;
    let feet: Vec<&crate::Foot> = fit.feet.iter().flatten().collect();
    result.set_item("curve", PyArray1::from_iter(py, feet.iter().map(|foot| foot.curve as i64)))?;
    result.set_item("parameter", PyArray1::from_iter(py, feet.iter().map(|foot| foot.parameter)))?;
    result.set_item("residual", PyArray1::from_iter(py, feet.iter().map(|foot| foot.residual)))?;
    result.set_item("facing", PyArray1::from_iter(py, feet.iter().map(|foot| foot.facing)))?;
    result.set_item("weight", PyArray1::from_iter(py, feet.iter().map(|foot| foot.weight)))?;
    result.set_item("explained", PyArray1::from_iter(py, feet.iter().map(|foot| foot.explained)))?;
    result.set_item("inlier", PyArray1::from_iter(py, feet.iter().map(|foot| foot.inlier)))?;
    let uncertainty = fit.uncertainty.unwrap_or_default();
    let poses = PyArray1::from_slice(py, uncertainty.poses.as_flattened().as_flattened());
    result.set_item("pose_covariance", poses.reshape([uncertainty.poses.len(), 6, 6])?)?;
    result.set_item("radii_sd", PyArray1::from_vec(py, uncertainty.radii))?;
    let covariances: Vec<_> = uncertainty
        .curves
        .iter()
        .map(|curve| {
            let flat = curve.as_flattened().as_flattened().as_flattened();
            PyArray1::from_slice(py, flat).reshape([curve.len(), 4, 3, 3])
        })
        .collect::<PyResult<_>>()?;
    result.set_item("covariances", covariances)?;
    Ok(result)
}
