//! Bindings of curves: splines, polylines and bridges.

use numpy::{Element, PyArray1, PyArray2, PyArray3, PyArrayDyn};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

use super::arguments::{Array, FloatArray, Points, point, require_same_length, slices, wrong_shape};
use super::arrays::{PointsArray, array, list, points_array};
use super::released::{CHEAP, guarded, released_if_many};
use crate::geometry::arclength::{self, ByLength};
use crate::geometry::overlap::{self, Along};
use crate::geometry::spline::{self, Spline};
use crate::geometry::{Point, bridge, contacts, plan, polyline, straighten};
use crate::images::image;

/// Numbers of both segments, positions along them, and turns.
type Crossings<'py> = (Bound<'py, PyArray2<i64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<i8>>);

/// Fit a uniform cubic B-spline through ordered nodes by least squares.
///
/// Parameters
/// ----------
/// nodes : (M, 3) array_like of float
///     Ordered nodes, metres.
/// spacing : float
///     Approximate length of a span, metres.
/// extension : float
///     Length by which the curve continues straight at both ends, metres.
///
/// Returns
/// -------
/// (n, 3) ndarray
///     Control points, metres, n >= 4; the parameter runs from 0 to n - 3.
#[pyfunction]
pub(super) fn fit_spline<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
    spacing: f64,
    extension: f64,
) -> PyResult<PointsArray<'py>> {
    let nodes = Points::new("nodes", nodes, "(M, 3)")?;
    let spans = polyline::arc_length(&nodes).last().map_or(0.0, |length| length / spacing);
    let effort = nodes.len().saturating_add(spans as usize);
    let spline = released_if_many(py, effort, move || Spline::through(&nodes, spacing, extension))??;
    points_array(py, spline.control)
}

/// Return the positions, unit tangents and curvature vectors, 1/m, of a spline at parameters.
#[pyfunction]
pub(super) fn evaluate_spline<'py>(
    py: Python<'py>,
    control: &Bound<'py, PyAny>,
    parameters: &Bound<'py, PyAny>,
) -> PyResult<(PointsArray<'py>, PointsArray<'py>, PointsArray<'py>)> {
    let (spline, parameters) =
        (checked_spline("control", control)?, FloatArray::new("parameters", parameters)?);
    let count = parameters.slice().len();
    let [position, tangent, curvature] = released_if_many(py, count, move || {
        let mut places: [Vec<Point>; 3] = std::array::from_fn(|_| Vec::with_capacity(count));
        for place in parameters.slice().iter().map(|&u| spline.at(u)) {
            let [tangent, curvature] = place.tangent_and_curvature();
            for (all, one) in places.iter_mut().zip([place.position, tangent, curvature]) {
                all.push(one);
            }
        }
        places
    })?;
    Ok((points_array(py, position)?, points_array(py, tangent)?, points_array(py, curvature)?))
}

/// Return values at places, linear between those at known places.
///
/// Parameters
/// ----------
/// places : (...) array_like of float
///     Beyond the known ones, the outermost lines go on.
/// known : (M,) array_like of float
///     In order, M >= 2.
/// values : (M, ...) array_like of float
///
/// Returns
/// -------
/// ndarray
///     Of the shape of `places`, followed by that of one value.
#[pyfunction]
pub(super) fn interpolate<'py>(
    py: Python<'py>,
    places: &Bound<'py, PyAny>,
    known: &Bound<'py, PyAny>,
    values: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let [places, known, values] = [("places", places), ("known", known), ("values", values)]
        .map(|(name, value)| FloatArray::new(name, value));
    let (places, known, values) = (places?, known?, values?);
    let [(2..)] = known.shape()[..] else { return Err(wrong_shape("known", "(M,), M >= 2", known.shape())) };
    require_same_length("values", values.shape().first().copied().unwrap_or(0), known.slice().len())?;
    let shape = [places.shape(), &values.shape()[1..]].concat();
    let count = shape.iter().product();
    let found = released_if_many(py, count, move || {
        polyline::interpolate_rows(places.slice(), known.slice(), values.slice())
    })?;
    array(py, found, shape)
}

/// Return the arc lengths from one parameter of a spline to places evenly spaced up to another, metres.
#[pyfunction]
pub(super) fn tabulate_arc_length<'py>(
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

/// Return a spline's parameters at arc lengths, limited to those of a table.
///
/// Parameters
/// ----------
/// table : (n,) array_like of float
///     Arc lengths from `tabulate_arc_length` between the parameters `start` and `stop`, metres, n >= 2.
/// start, stop : float
/// arc_lengths : (...) array_like of float
///     Metres.
#[pyfunction]
pub(super) fn find_parameters<'py>(
    py: Python<'py>,
    table: &Bound<'py, PyAny>,
    start: f64,
    stop: f64,
    arc_lengths: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let places = FloatArray::new("arc_lengths", arc_lengths)?;
    look_up(py, table, [start, stop], places, arclength::find_parameter)
}

/// Return the arc lengths at a spline's parameters, metres, limited to those of a table as in `find_parameters`.
#[pyfunction]
pub(super) fn find_arc_lengths<'py>(
    py: Python<'py>,
    table: &Bound<'py, PyAny>,
    start: f64,
    stop: f64,
    parameters: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let places = FloatArray::new("parameters", parameters)?;
    look_up(py, table, [start, stop], places, arclength::find_arc_length)
}

/// Looks places up in a table of arc lengths between two parameters.
fn look_up<'py>(
    py: Python<'py>,
    table: &Bound<'py, PyAny>,
    range: [f64; 2],
    places: FloatArray,
    find: fn(&[f64], [f64; 2], f64) -> f64,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let table = FloatArray::new("table", table)?;
    let [(2..)] = table.shape()[..] else { return Err(wrong_shape("table", "(n,), n >= 2", table.shape())) };
    let (shape, count) = (places.shape().to_vec(), places.slice().len());
    let found = released_if_many(py, count / CHEAP, move || {
        places.slice().iter().map(|&place| find(table.slice(), range, place)).collect()
    })?;
    array(py, found, shape)
}

/// Return (M, 3, 3) covariances of a spline's places at parameters, m^2.
///
/// Parameters
/// ----------
/// covariances : (n, 4, 3, 3) array_like of float
///     Covariances of each control point with itself and the next three, m^2, n >= 4.
/// parameters : (M,) array_like of float
#[pyfunction]
pub(super) fn propagate_covariances<'py>(
    py: Python<'py>,
    covariances: &Bound<'py, PyAny>,
    parameters: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (covariances, parameters) =
        (FloatArray::new("covariances", covariances)?, FloatArray::new("parameters", parameters)?);
    let [(4..), 4, 3, 3] = covariances.shape()[..] else {
        return Err(wrong_shape("covariances", "(n, 4, 3, 3), n >= 4", covariances.shape()));
    };
    let &[count] = parameters.shape() else {
        return Err(wrong_shape("parameters", "(M,)", parameters.shape()));
    };
    let found = released_if_many(py, count, move || {
        let blocks = covariances.slice().as_chunks().0.as_chunks().0.as_chunks().0;
        spline::propagate_covariances(blocks, parameters.slice())
    })?;
    array(py, found.into_flattened().into_flattened(), [count, 3, 3])
}

/// Find where ends of polylines lie at another polyline, or at a far part of their own.
///
/// Parameters
/// ----------
/// polylines : sequence of (M, 3) array_like of float
///     Ordered nodes, metres.
/// distance : float
///     An end touches a polyline if its nearest node is less than this away, metres.
/// apart : float
///     Nodes of the end's own polyline count from here on along it, metres.
///
/// Returns
/// -------
/// list of (int, int, int)
///     The end, in order, the polyline that it touches, and the number of the nearest node there. End 2k is the first
///     node of polyline k, 2k + 1 its last.
#[pyfunction]
pub(super) fn find_contacts(
    py: Python<'_>,
    polylines: Vec<Bound<'_, PyAny>>,
    distance: f64,
    apart: f64,
) -> PyResult<Vec<(usize, usize, usize)>> {
    let polylines = Points::all("polylines", &polylines)?;
    let nodes: usize = polylines.iter().map(|polyline| polyline.len()).sum();
    // every end with every node
    let effort = nodes.saturating_mul(2 * polylines.len()) / CHEAP;
    let found =
        released_if_many(py, effort, move || contacts::find_contacts(&slices(&polylines), distance, apart))?;
    Ok(found.iter().map(|contact| (contact.end, contact.polyline, contact.node)).collect())
}

/// Return whether each place lies nearer than `distance` to another curve, or to its own curve at least `apart` along
/// it.
///
/// `curve` holds the number of each place's curve, `arc_length` its position along the curve, metres.
#[pyfunction]
pub(super) fn find_overlaps<'py>(
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
    // every pair
    let effort = places.len().saturating_mul(places.len() / 64);
    list(py, released_if_many(py, effort, move || overlap::find_overlaps(&places, distance, apart))?)
}

/// Find the pairs of segments that cross in a plan, exactly.
///
/// A line through a node of another crosses that line once. A line that touches another crosses it twice at the same
/// place, or never. Segments that share a node do not cross.
///
/// Parameters
/// ----------
/// nodes : (N, 2) ndarray of float64
///     Places in the plan.
/// segments : (S, 2) ndarray of int64
///     The first and the last node of each segment.
/// most : int, optional
///     Number of pairs after which the search stops; None finds all.
///
/// Returns
/// -------
/// pairs : (K, 2) ndarray of int64
///     Numbers of the segments, the lower first, sorted.
/// shares : (K, 2) ndarray of float64
///     Where they cross along each segment, from 0 to 1.
/// turns : (K,) ndarray of int8
///     1 if the second segment crosses the first from right to left, else -1.
#[pyfunction]
#[pyo3(signature = (nodes, segments, most = None))]
pub(super) fn find_crossed_segments<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
    segments: &Bound<'py, PyAny>,
    most: Option<usize>,
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
    let most = most.unwrap_or(usize::MAX);
    let found = released_if_many(py, segments.len(), move || plan::find_crossings(&places, &segments, most))?;
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

/// Returns the rows of an array of two columns.
fn in_pairs<T: Element + Copy + 'static>(name: &str, array: Array<T>) -> PyResult<Vec<[T; 2]>> {
    let [_, 2] = array.shape() else { return Err(wrong_shape(name, "(N, 2)", array.shape())) };
    Ok(array.slice().as_chunks().0.to_vec())
}

/// Return (K, 2) the first node of each marked stretch, and the one after its last.
#[pyfunction]
pub(super) fn find_runs<'py>(
    py: Python<'py>,
    marked: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<i64>>> {
    let marked = Array::flags("marked", marked, 1)?;
    let ends: Vec<i64> =
        image::find_runs(marked.slice()).flat_map(|run| [run.start as i64, run.end as i64]).collect();
    let count = ends.len() / 2;
    array(py, ends, [count, 2])
}

/// Return the arc length from the first of ordered nodes to each, metres.
#[pyfunction]
pub(super) fn path_length<'py>(
    py: Python<'py>,
    nodes: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let nodes = Points::new("nodes", nodes, "(M, 3)")?;
    list(py, released_if_many(py, nodes.len(), move || polyline::arc_length(&nodes))?)
}

/// Return the unit vector out of the last node, over `span` of arc length that ends `skip` before it, metres.
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

/// Return the inner nodes of the cubic from the last node of `before` to the first node of `after`.
///
/// The direction at each end is taken over `span` of its piece, metres. `spacing` is the distance between nodes,
/// metres. `reach` holds the lengths of the tangents at the two ends, as shares of the gap.
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

/// Move the nodes of a chain of axis points outwards in bends, by as much as the average over two radii moved them
/// inwards.
///
/// `span` is the reach along the chain over which a node's bend is measured, metres.
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

/// Return the bending energy of a polyline, 1/m.
#[pyfunction]
pub(super) fn measure_bending(py: Python<'_>, nodes: &Bound<'_, PyAny>) -> PyResult<f64> {
    let nodes = Points::new("nodes", nodes, "(M, 3)")?;
    released_if_many(py, nodes.len(), move || bridge::measure_bending(&nodes))
}

/// Return the cost of a curve that leaves the end `p` along `leave` and arrives at the end `q`, which points along
/// `arrive`.
///
/// It grows with the bends, and with the gap over the rope's radius. It is infinite if the curve would have to turn
/// back.
#[pyfunction]
pub(super) fn price_join(
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

/// Makes a spline of checked control points.
pub(super) fn checked_spline(name: &str, control: &Bound<'_, PyAny>) -> PyResult<Spline> {
    let control = Points::new(name, control, "(n, 3)")?.to_vec();
    if control.len() < 4 {
        let reason = format!("{name}: expected at least four control points, got {}", control.len());
        return Err(PyValueError::new_err(reason));
    }
    Ok(Spline { control })
}
