//! Bindings of curves: splines, polylines and bridges between these.

use numpy::{Element, PyArray1, PyArray2};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

use super::arguments::{Array, FloatArray, Points, point, require_same_length, wrong_shape};
use super::arrays::{PointsArray, array, list, points_array};
use super::released::{guarded, released_if_many};
use crate::geometry::arclength::ByLength;
use crate::geometry::overlap::{self, Along};
use crate::geometry::spline::Spline;
use crate::geometry::{Point, bridge, plan, polyline, straighten};

/// Numbers of both segments, shares along them, and turns.
type Crossings<'py> = (Bound<'py, PyArray2<i64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<i8>>);

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
    let nodes = Points::new("nodes", nodes, "(M, 3)")?;
    // the fit is dense
    let spans = polyline::arc_length(&nodes).last().map_or(0.0, |length| length / spacing);
    let effort = nodes.len().saturating_add((spans * spans) as usize);
    let spline = released_if_many(py, effort, move || Spline::through(&nodes, spacing, extension))??;
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
    let count = parameters.slice().len();
    let [position, first, second] = released_if_many(py, count, move || {
        let mut places: [Vec<Point>; 3] = std::array::from_fn(|_| Vec::with_capacity(count));
        for place in parameters.slice().iter().map(|&u| spline.at(u)) {
            for (all, one) in places.iter_mut().zip([place.position, place.first, place.second]) {
                all.push(one);
            }
        }
        places
    })?;
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
    for (name, value) in [("start", start), ("stop", stop)] {
        if !(0.0..=spline.end()).contains(&value) {
            let reason = format!("{name}: expected a parameter from 0 to {}, got {value}", spline.end());
            return Err(PyValueError::new_err(reason));
        }
    }
    let controls = spline.control.len();
    let table = released_if_many(py, controls, move || ByLength::new(&spline, start, stop).into_table())?;
    list(py, table)
}

/// Which places of curves lie nearer than `distance` to another curve, or to their own at least `apart` along it.
///
/// `curve` is the number of each place's curve, `arc_length` where along that it is, metres.
#[pyfunction]
pub(super) fn overlapping<'py>(
    py: Python<'py>,
    places: &Bound<'py, PyAny>,
    curve: &Bound<'py, PyAny>,
    arc_length: &Bound<'py, PyAny>,
    distance: f64,
    apart: f64,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let places = Points::new("places", places, "(N, 3)")?;
    let curve = Array::<i64>::exactly("curve", curve, 1)?;
    let arc_length = Array::<f64>::exactly("arc_length", arc_length, 1)?;
    require_same_length("curve", curve.slice().len(), places.len())?;
    require_same_length("arc_length", arc_length.slice().len(), places.len())?;
    let places: Vec<Along> = (places.iter().zip(curve.slice()).zip(arc_length.slice()))
        .map(|((&position, &curve), &arc_length)| Along { curve: curve as usize, arc_length, position })
        .collect();
    // each with each
    let effort = places.len().saturating_mul(places.len() / 64);
    list(py, released_if_many(py, effort, move || overlap::find_overlaps(&places, distance, apart))?)
}

/// Find all pairs of segments that cross in a plan, exactly.
///
/// A line that goes through a node of another crosses it once; one that touches it crosses it twice at the same place, or
/// never. Segments that share a node do not cross.
///
/// Parameters
/// ----------
/// nodes : (N, 2) ndarray of float64
///     Places in the plan.
/// segments : (S, 2) ndarray of int64
///     The nodes from which and to which each goes.
///
/// Returns
/// -------
/// pairs : (K, 2) ndarray of int64
///     Numbers of the segments, the less first, sorted.
/// shares : (K, 2) ndarray of float64
///     How far along each segment they cross, from 0 to 1.
/// turns : (K,) ndarray of int8
///     1 where the second crosses the first from its right to its left, else -1.
///
/// Raises
/// ------
/// TypeError
///     If an array holds anything else.
/// ValueError
///     If one has another shape, `nodes` is not finite, or a segment's node is not there.
/// MemoryError
///     If there are more pairs than memory holds.
#[pyfunction]
pub(super) fn crossed_segments<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
    segments: &Bound<'py, PyAny>,
) -> PyResult<Crossings<'py>> {
    let (places, segments) =
        (Array::<f64>::exactly("nodes", nodes, 2)?, Array::<i64>::exactly("segments", segments, 2)?);
    let (places, ends) = (in_pairs("nodes", places)?, in_pairs("segments", segments)?);
    if !places.as_flattened().iter().all(|x| x.is_finite()) {
        return Err(PyValueError::new_err("nodes: expected finite coordinates, got NaN or infinity"));
    }
    let there = |&k: &i64| usize::try_from(k).ok().filter(|&k| k < places.len());
    let segments = (ends.iter()).map(|[a, b]| Some([there(a)?, there(b)?])).collect::<Option<Vec<_>>>();
    let segments = segments.ok_or_else(|| {
        PyValueError::new_err(format!("segments: expected numbers of {} nodes", places.len()))
    })?;
    let found = released_if_many(py, segments.len(), move || plan::find_crossings(&places, &segments))?;
    let found = found.map_err(|_| PyMemoryError::new_err("segments: no memory for all that cross"))?;
    let pairs = found.iter().flat_map(|each| each.pair.map(|k| k as i64)).collect();
    let shares = found.iter().flat_map(|each| each.shares).collect();
    let shape = [found.len(), 2];
    Ok((
        array(py, pairs, shape)?,
        array(py, shares, shape)?,
        list(py, found.iter().map(|each| each.turn).collect())?,
    ))
}

/// The rows of an array of two columns.
fn in_pairs<T: Element + Copy + 'static>(name: &str, array: Array<T>) -> PyResult<Vec<[T; 2]>> {
    let [_, 2] = array.shape() else { return Err(wrong_shape(name, "(N, 2)", array.shape())) };
    Ok(array.slice().as_chunks().0.to_vec())
}

/// Arc length from the first of ordered nodes to each, metres.
#[pyfunction]
pub(super) fn path_length<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let nodes = Points::new("nodes", nodes, "(M, 3)")?;
    list(py, released_if_many(py, nodes.len(), move || polyline::arc_length(&nodes))?)
}

/// The unit vector out of the last of ordered nodes, over `span` of arc length, `skip` before it; metres.
#[pyfunction]
pub(super) fn end_direction<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
    skip: f64,
    span: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let nodes = Points::new("nodes", nodes, "(M, 3)")?;
    let direction =
        released_if_many(py, nodes.len(), move || bridge::find_end_direction(&nodes, skip, span))?;
    list(py, direction.to_vec())
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
    let (before, after) = (Points::new("before", before, "(K, 3)")?, Points::new("after", after, "(K, 3)")?);
    let effort = before.len() + after.len();
    let bridge = move || bridge::bridge(&before, &after, span, spacing, reach);
    points_array(py, released_if_many(py, effort, bridge)??)
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
    let nodes = Points::new("nodes", nodes, "(M, 3)")?;
    let straight = released_if_many(py, nodes.len(), move || straighten::straighten(&nodes, radius, span))??;
    points_array(py, straight)
}

/// Bending energy of a polyline, 1/m.
#[pyfunction]
pub(super) fn bending(py: Python<'_>, nodes: &Bound<'_, PyAny>) -> PyResult<f64> {
    let nodes = Points::new("nodes", nodes, "(M, 3)")?;
    released_if_many(py, nodes.len(), move || bridge::measure_bending(&nodes))
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
    let (p, leave, q, arrive) = (p?, leave?, q?, arrive?);
    guarded(|| bridge::price_join(p, leave, q, arrive, radius))
}

/// A spline of checked control points.
pub(super) fn checked_spline(name: &str, control: &Bound<'_, PyAny>) -> PyResult<Spline> {
    let control = Points::new(name, control, "(n, 3)")?.to_vec();
    if control.len() < 4 {
        let reason = format!("{name}: expected at least four control points, got {}", control.len());
        return Err(PyValueError::new_err(reason));
    }
    Ok(Spline { control })
}
