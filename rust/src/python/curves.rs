//! Bindings of curves: splines, polylines and bridges between these.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{FloatArray, PointsArray, point, points_array, require_same_length};
use crate::arclength::ByLength;
use crate::overlap::{self, Along};
use crate::{Point, Spline, bridge, polyline, straighten};

/// Fit a uniform cubic B-spline through ordered nodes by least squares.
///
/// Parameters
/// ----------
/// nodes : (M, 3) array_like of float
///     Ordered nodes, metres.
/// spacing : float
///     About how long the spline's spans are, metres.
/// extension : float
///     The curve is carried on straight by this at both ends, metres.
///
/// Returns
/// -------
/// (n, 3) ndarray
///     Control points, metres, n >= 4; the parameter runs from 0 to n - 3.
///
/// Raises
/// ------
/// TypeError
///     If `nodes` does not hold floating point numbers.
/// ValueError
///     If `nodes` is not (M, 3) or not finite, or a length is out of range.
/// strand.NotEnoughDataError
///     If there are fewer than two different nodes.
#[pyfunction]
pub(super) fn spline_through<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
    spacing: f64,
    extension: f64,
) -> PyResult<PointsArray<'py>> {
    let nodes = FloatArray::new("nodes", nodes)?;
    let nodes = nodes.rows("nodes", "(M, 3)")?;
    let spline = py.detach(|| Spline::through(nodes, spacing, extension))?;
    points_array(py, spline.control)
}

/// Positions and first two derivatives of a spline at parameters; see `strand.curve.evaluate`.
#[pyfunction]
pub(super) fn spline_places<'py>(
    py: Python<'py>,
    control: &Bound<'py, PyAny>,
    parameters: &Bound<'py, PyAny>,
) -> PyResult<(PointsArray<'py>, PointsArray<'py>, PointsArray<'py>)> {
    let (spline, parameters) =
        (checked_spline("control", control)?, FloatArray::new("parameters", parameters)?);
    let parameters = parameters.slice()?;
    let mut places: [Vec<Point>; 3] = std::array::from_fn(|_| Vec::with_capacity(parameters.len()));
    for place in parameters.iter().map(|&u| spline.at(u)) {
        for (all, one) in places.iter_mut().zip([place.position, place.first, place.second]) {
            all.push(one);
        }
    }
    let [position, first, second] = places;
    Ok((points_array(py, position)?, points_array(py, first)?, points_array(py, second)?))
}

/// Arc length from one parameter of a spline to places evenly spaced up to another, metres.
#[pyfunction]
pub(super) fn arc_lengths<'py>(
    py: Python<'py>,
    control: &Bound<'py, PyAny>,
    start: f64,
    stop: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let spline = checked_spline("control", control)?;
    Ok(PyArray1::from_vec(py, ByLength::new(&spline, start, stop).into_table()))
}

/// Which places of curves lie nearer than `distance` to another curve, or to their own at least `apart` along it.
///
/// `curve` is the number of each place's curve, `arc_length` where along that it is, metres.
#[pyfunction]
pub(super) fn overlapping<'py>(
    py: Python<'py>,
    places: &Bound<'py, PyAny>,
    curve: PyReadonlyArray1<'py, i64>,
    arc_length: PyReadonlyArray1<'py, f64>,
    distance: f64,
    apart: f64,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let places = FloatArray::new("places", places)?;
    let (places, curve, arc_length) =
        (places.rows("places", "(N, 3)")?, curve.as_slice()?, arc_length.as_slice()?);
    require_same_length("curve", curve.len(), places.len())?;
    require_same_length("arc_length", arc_length.len(), places.len())?;
    let places: Vec<Along> = (places.iter().zip(curve).zip(arc_length))
        .map(|((&position, &curve), &arc_length)| Along { curve: curve as usize, arc_length, position })
        .collect();
    Ok(PyArray1::from_vec(py, py.detach(|| overlap::overlapping(&places, distance, apart))))
}

/// Arc length from the first of ordered nodes to each, metres.
#[pyfunction]
pub(super) fn path_length<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let nodes = FloatArray::new("nodes", nodes)?;
    Ok(PyArray1::from_vec(py, polyline::arc_length(nodes.rows("nodes", "(M, 3)")?)))
}

/// The unit vector out of the last of ordered nodes, over `span` of arc length, `skip` before it; metres.
#[pyfunction]
pub(super) fn end_direction<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
    skip: f64,
    span: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let nodes = FloatArray::new("nodes", nodes)?;
    Ok(PyArray1::from_slice(py, &bridge::end_direction(nodes.rows("nodes", "(M, 3)")?, skip, span)))
}

/// Nodes of the cubic that goes on from the last node of one stretch to the first of the next, without these.
///
/// `span` is the stretch of each over which its direction is taken, `spacing` that between nodes, metres; `reach` are the
/// lengths of the tangents at the two ends as parts of the gap.
#[pyfunction]
#[pyo3(name = "bridge", signature = (before, after, span, spacing, reach = [1.0, 1.0]))]
pub(super) fn bridge_nodes<'py>(
    py: Python<'py>,
    before: &Bound<'py, PyAny>,
    after: &Bound<'py, PyAny>,
    span: f64,
    spacing: f64,
    reach: [f64; 2],
) -> PyResult<PointsArray<'py>> {
    let (before, after) = (FloatArray::new("before", before)?, FloatArray::new("after", after)?);
    let (before, after) = (before.rows("before", "(K, 3)")?, after.rows("after", "(K, 3)")?);
    points_array(py, bridge::bridge(before, after, span, spacing, reach))
}

/// Undo what the average over two radii does to the bends of a chain of axis points.
///
/// `span` is how far along the chain the bend at a node is taken from, metres.
#[pyfunction]
#[pyo3(name = "straighten")]
pub(super) fn straightened<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
    radius: f64,
    span: f64,
) -> PyResult<PointsArray<'py>> {
    let nodes = FloatArray::new("nodes", nodes)?;
    points_array(py, straighten::straighten(nodes.rows("nodes", "(M, 3)")?, radius, span))
}

/// Bending energy of a polyline, 1/m.
#[pyfunction]
pub(super) fn bending(nodes: &Bound<'_, PyAny>) -> PyResult<f64> {
    Ok(bridge::bending(FloatArray::new("nodes", nodes)?.rows("nodes", "(M, 3)")?))
}

/// Cost of the curve that leaves the end `p` along `leave` and meets the end `q`, which points along `arrive`.
///
/// Grows with its bends, and with the gap over the rope's radius; infinite where the curve would have to turn back.
#[pyfunction]
pub(super) fn join_cost(
    p: &Bound<'_, PyAny>,
    leave: &Bound<'_, PyAny>,
    q: &Bound<'_, PyAny>,
    arrive: &Bound<'_, PyAny>,
    radius: f64,
) -> PyResult<f64> {
    let [p, leave, q, arrive] =
        [("p", p), ("leave", leave), ("q", q), ("arrive", arrive)].map(|(name, value)| point(name, value));
    Ok(bridge::join_cost(p?, leave?, q?, arrive?, radius))
}

/// A spline of checked control points.
pub(super) fn checked_spline(name: &str, control: &Bound<'_, PyAny>) -> PyResult<Spline> {
    let array = FloatArray::new(name, control)?;
    let control = array.rows(name, "(n, 3)")?.to_vec();
    if control.len() < 4 {
        let reason = format!("{name}: expected at least four control points, got {}", control.len());
        return Err(PyValueError::new_err(reason));
    }
    Ok(Spline { control })
}
