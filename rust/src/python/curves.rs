//! Bindings of curves: splines, where strings end along them, polylines and bridges between these.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use super::arguments::{FloatArray, PointsArray, points_array, require_same_length};
use crate::{ByLength, OnTube, Point, Spline, Tube};

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
    let spline = py.detach(|| crate::Spline::through(nodes, spacing, extension))?;
    points_array(py, spline.control)
}

/// Positions and first two derivatives of a spline at parameters; see `strand.curve.evaluate`.
#[pyfunction]
pub(super) fn spline_places<'py>(
    py: Python<'py>,
    control: &Bound<'py, PyAny>,
    parameters: &Bound<'py, PyAny>,
) -> PyResult<(PointsArray<'py>, PointsArray<'py>, PointsArray<'py>)> {
    let (spline, parameters) = (spline("control", control)?, FloatArray::new("parameter", parameters)?);
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
    let spline = spline("control", control)?;
    Ok(PyArray1::from_vec(py, ByLength::new(&spline, start, stop).into_table()))
}

/// Cut curves to the stretch that points support; see `strand.ends.string_parts`.
///
/// `slack` is None, or how far from each curve's surface its points may be.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(super) fn string_parts<'py>(
    py: Python<'py>,
    curves: Vec<Bound<'py, PyAny>>,
    ropes: Vec<usize>,
    radii: Vec<f64>,
    counted: PyReadonlyArray1<'py, bool>,
    curve: PyReadonlyArray1<'py, i64>,
    parameter: PyReadonlyArray1<'py, f64>,
    points: &Bound<'py, PyAny>,
    to_camera: &Bound<'py, PyAny>,
    slack: Option<Vec<f64>>,
) -> PyResult<Vec<Option<[f64; 2]>>> {
    let (points, to_camera) = (FloatArray::new("points", points)?, FloatArray::new("to_camera", to_camera)?);
    let (points, to_camera) = (points.rows("points", "(N, 3)")?, to_camera.rows("to_camera", "(N, 3)")?);
    let (counted, curve, parameter) = (counted.as_slice()?, curve.as_slice()?, parameter.as_slice()?);
    for (name, length) in [
        ("to_camera", to_camera.len()),
        ("counted", counted.len()),
        ("curve", curve.len()),
        ("parameter", parameter.len()),
    ] {
        require_same_length(name, length, points.len())?;
    }
    let tubes: Vec<Tube> = curves
        .iter()
        .zip(ropes)
        .map(|(curve, rope)| Ok(Tube { curve: spline("curves", curve)?, rope }))
        .collect::<PyResult<_>>()?;
    Ok(py.detach(|| {
        let on_tubes: Vec<OnTube> = (0..points.len())
            .filter(|&i| counted[i])
            .map(|i| OnTube {
                curve: curve[i] as usize,
                parameter: parameter[i],
                position: points[i],
                to_camera: to_camera[i],
            })
            .collect();
        crate::string_parts(&tubes, &radii, &on_tubes, slack.as_deref())
    }))
}

/// Which places of strands, given with their strands' numbers and the arc lengths there, crowd others.
#[pyfunction]
pub(super) fn crowded<'py>(
    py: Python<'py>,
    places: &Bound<'py, PyAny>,
    strands: PyReadonlyArray1<'py, i64>,
    lengths: PyReadonlyArray1<'py, f64>,
    contact: f64,
    own: f64,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let places = FloatArray::new("places", places)?;
    let (places, strands, lengths) =
        (places.rows("places", "(N, 3)")?, strands.as_slice()?, lengths.as_slice()?);
    require_same_length("strands", strands.len(), places.len())?;
    require_same_length("lengths", lengths.len(), places.len())?;
    let nodes: Vec<(Point, usize, f64)> =
        (0..places.len()).map(|i| (places[i], strands[i] as usize, lengths[i])).collect();
    Ok(PyArray1::from_vec(py, py.detach(|| crate::crowded(&nodes, contact, own))))
}

/// Arc length from the first of ordered nodes to each, metres.
#[pyfunction]
pub(super) fn path_length<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let nodes = FloatArray::new("nodes", nodes)?;
    Ok(PyArray1::from_vec(py, crate::arc_length(nodes.rows("nodes", "(M, 3)")?)))
}

/// The unit vector out of the last of ordered nodes; see `strand.topology.end_direction`.
#[pyfunction]
pub(super) fn end_direction<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
    skip: f64,
    span: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let nodes = FloatArray::new("nodes", nodes)?;
    Ok(PyArray1::from_slice(py, &crate::end_direction(nodes.rows("nodes", "(M, 3)")?, skip, span)))
}

/// Nodes of the cubic from one stretch to the next; see `strand.strings.bridge`.
#[pyfunction]
pub(super) fn bridge<'py>(
    py: Python<'py>,
    before: &Bound<'py, PyAny>,
    after: &Bound<'py, PyAny>,
    span: f64,
    spacing: f64,
    reach: [f64; 2],
) -> PyResult<PointsArray<'py>> {
    let (before, after) = (FloatArray::new("before", before)?, FloatArray::new("after", after)?);
    let (before, after) = (before.rows("before", "(K, 3)")?, after.rows("after", "(K, 3)")?);
    points_array(py, crate::bridge(before, after, span, spacing, reach))
}

/// Undo what an average does to bends; see `strand.strings.straighten`.
#[pyfunction]
pub(super) fn straighten<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
    radius: f64,
    span: f64,
) -> PyResult<PointsArray<'py>> {
    let nodes = FloatArray::new("nodes", nodes)?;
    points_array(py, crate::straighten(nodes.rows("nodes", "(M, 3)")?, radius, span))
}

/// Bending energy of a polyline, 1/m.
#[pyfunction]
pub(super) fn bending(nodes: &Bound<'_, PyAny>) -> PyResult<f64> {
    Ok(crate::bending(FloatArray::new("nodes", nodes)?.rows("nodes", "(M, 3)")?))
}

/// Cost of joining two ends; see `strand.linking.join_cost`.
#[pyfunction]
pub(super) fn join_cost(
    p: &Bound<'_, PyAny>,
    leave: &Bound<'_, PyAny>,
    q: &Bound<'_, PyAny>,
    arrive: &Bound<'_, PyAny>,
    radius: f64,
) -> PyResult<f64> {
    let [p, leave, q, arrive] = [("p", p), ("leave", leave), ("q", q), ("arrive", arrive)]
        .map(|(name, value)| super::arguments::point(name, value));
    Ok(crate::join_cost(p?, leave?, q?, arrive?, radius))
}

/// A spline of checked control points.
fn spline(name: &str, control: &Bound<'_, PyAny>) -> PyResult<Spline> {
    Ok(Spline { control: FloatArray::new(name, control)?.rows(name, "(n, 3)")?.to_vec() })
}
