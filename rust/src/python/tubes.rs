//! Bindings of tubes: apparent radii, and traced arcs.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use super::arguments::{
    FloatArray, Given, Points, Rows, Viewpoint, count, number, point, require_same_length,
};
use super::arrays::{PointsArray, array, list, points_array};
use super::released::{CHEAP, released, released_if_many};
use crate::clouds::apparent_radius;
use crate::error::Error;
use crate::tubes::ends;
use crate::tubes::tracing::MIN_NODES;

// the text signature of `trace_tubes` repeats this number
const _: () = assert!(MIN_NODES == 4);

/// Estimate a rope's radius at places seen by one camera, from its apparent width.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     Surface points of ropes, metres, any frame.
/// viewpoint : (3,) array_like of float
///     The camera's centre, metres, in the points' frame.
/// largest : float
///     Wider ropes are skipped, metres.
/// seeds : int
///     Number of places at most, spread over the cloud.
///
/// Returns
/// -------
/// (K, 2) ndarray
///     For each seed on a stretch of rope, half the rope's apparent width, and the side of the square that each of its
///     points stands for, metres. Strands side by side look like one wide rope.
#[pyfunction]
pub(super) fn estimate_radii<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    viewpoint: &Bound<'py, PyAny>,
    largest: f64,
    seeds: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let viewpoint = point("viewpoint", viewpoint)?;
    let found = released(py, move || apparent_radius::apparent_radii(&points, viewpoint, largest, seeds))??;
    let rows: Vec<[f64; 2]> = found.iter().map(|found| [found.radius, found.footprint]).collect();
    array(py, rows.into_flattened(), [found.len(), 2])
}

/// Trace arcs of tubes through surface points.
///
/// Short bent tubes, without points inside them, are fitted to the points that face their cameras. From the best tubes
/// on, arcs follow the rope both ways. Bends and touching strands stay sharp.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     Surface points of ropes, metres, any frame.
/// viewpoint : (3,) or (N, 3) array_like of float
///     The camera's centre, or one for each point, metres, in the points' frame.
/// radius : float
///     The ropes' radius, metres.
/// min_nodes : int
///     Arcs with fewer nodes are dropped.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or drop them.
///
/// Returns
/// -------
/// list of ((M, 3) ndarray, (M,) ndarray)
///     For each arc its nodes on the axis in order, half a radius apart, metres, and the number of points that support each
///     node: on the surface, facing their camera, within a radius ahead of it. Arcs end where strands cross or hide each
///     other; the best supported arcs come first.
///
/// Raises
/// ------
/// TypeError
///     If an array does not hold floating point numbers.
/// ValueError
///     If a shape is wrong, a coordinate is not finite, `radius` is not positive, or `min_nodes` is negative.
#[pyfunction]
#[pyo3(signature = (points, viewpoint, radius, *, min_nodes = Given(None), nonfinite = "raise"),
       text_signature = "(points, viewpoint, radius, *, min_nodes=4, nonfinite='raise')")]
pub(super) fn trace_tubes<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    viewpoint: &Bound<'py, PyAny>,
    radius: &Bound<'py, PyAny>,
    min_nodes: Given<'py>,
    nonfinite: &str,
) -> PyResult<Vec<(PointsArray<'py>, Bound<'py, PyArray1<f64>>)>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let radius = number("radius", radius)?;
    let min_nodes = min_nodes.or(MIN_NODES, |value| count("min_nodes", value))?;
    let viewpoint = Viewpoint::new(viewpoint, points.len())?;
    let rows = Rows::new(nonfinite, &[&points, viewpoint.each().unwrap_or(&points)])?;
    let arcs = released(py, move || {
        let points = rows.select(&points);
        viewpoint.of(&rows, |of| crate::trace_tubes(&points, of, radius, min_nodes))
    })??;
    arcs.into_iter().map(|arc| Ok((points_array(py, arc.nodes)?, list(py, arc.support)?))).collect()
}

/// Find where views see an end of a rope, by the weight of the points past a place inside.
///
/// Parameters
/// ----------
/// inwards, weights : (N,) array_like of float
///     How far inside the expected end each point lies, metres, and its weight; view by view.
/// starts : sequence of int
///     The number of each view's first point, and N.
/// inside : (float, float)
///     Distances inside the end between which the weight per length is taken, metres.
/// most : float
///     Ends farther from the expected place are not found, metres.
/// fewest : int
///     Points that a view must see between these distances.
///
/// Returns
/// -------
/// list of ((float, int, float) or None)
///     For each view how far outside the expected place the rope ends, metres, and the points between the two distances
///     and how long that stretch is, metres.
#[pyfunction]
pub(super) fn find_seen_ends(
    py: Python<'_>,
    inwards: &Bound<'_, PyAny>,
    weights: &Bound<'_, PyAny>,
    starts: Vec<usize>,
    inside: [f64; 2],
    most: f64,
    fewest: usize,
) -> PyResult<Vec<Option<(f64, usize, f64)>>> {
    let (inwards, weights) = (FloatArray::new("inwards", inwards)?, FloatArray::new("weights", weights)?);
    let count = inwards.slice().len();
    require_same_length("weights", weights.slice().len(), count)?;
    if !starts.is_sorted() || starts.last().is_some_and(|&last| last > count) {
        let reason = format!("expected ascending numbers up to {count}, got {starts:?}");
        return Err(Error::invalid("starts", reason).into());
    }
    released_if_many(py, count / CHEAP, move || {
        let find = |ends: &[usize]| {
            let points = ends[0]..ends[1];
            let (inwards, weights) = (&inwards.slice()[points.clone()], &weights.slice()[points]);
            let end = ends::find_seen_end(inwards, weights, inside, most, fewest)?;
            Some((end.offset, end.count, end.length))
        };
        starts.windows(2).map(find).collect()
    })
}
