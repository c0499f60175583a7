//! Bindings of queries against tubes.

use std::sync::Arc;

use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::arguments::{FloatArray, Points, number, require_same_length, wrong_shape};
use super::arrays::{PointsArray, list, points_array};
use super::released::{released_if_long, released_if_many};
use crate::error::Error;
use crate::geometry::{Point, RigidMotion};
use crate::queries::{self, Path, Place, Sweep};

const PER_POINT: usize = 400; // usual time of a point's query, nanoseconds
const PER_RAY: usize = 100; // usual time of a ray, nanoseconds
const PER_SPHERE: usize = 1500; // usual time of a moving sphere, nanoseconds
const PER_BOX: usize = 30_000; // usual time of a moving box, which is examined at many times, nanoseconds

/// The tubes of several chains. They are built once; each query then takes microseconds.
///
/// Parameters
/// ----------
/// nodes : sequence of (M, 3) array_like of float
///     Each chain's nodes in order, metres; a closed chain repeats its first node at the end.
/// arc_lengths : sequence of (M,) array_like of float
///     Each chain's arc length at its nodes, metres.
/// radii : sequence of float
///     Each chain's radius, metres.
#[pyclass(frozen, module = "strand._core")]
pub(super) struct TubeQueries {
    queries: Arc<queries::TubeQueries>,
    nodes: Vec<Points>,
    arc_lengths: Vec<FloatArray>,
    radii: Vec<f64>,
}

/// Chain numbers, −1 for none, and arc lengths.
type Places<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>);
/// The same, with places on the axis and distances from it.
type Nearest<'py> =
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>, PointsArray<'py>, Bound<'py, PyArray1<f64>>);
/// Distances along rays, chain numbers, arc lengths and normals.
type Hits<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>, PointsArray<'py>);
/// First times of contact, clearances, chain numbers and arc lengths.
type Sweeps<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
);

#[pymethods]
impl TubeQueries {
    #[new]
    fn new(
        py: Python<'_>,
        nodes: Vec<Bound<'_, PyAny>>,
        arc_lengths: Vec<Bound<'_, PyAny>>,
        radii: Vec<f64>,
    ) -> PyResult<Self> {
        require_same_length("arc_lengths", arc_lengths.len(), nodes.len())?;
        require_same_length("radii", radii.len(), nodes.len())?;
        let nodes = Points::all("nodes", &nodes)?;
        let arc_lengths = FloatArray::all("arc_lengths", &arc_lengths)?;
        let (places, arcs, widths) = (nodes.clone(), arc_lengths.clone(), radii.clone());
        let count = nodes.iter().map(|nodes| nodes.len()).sum();
        let queries = released_if_many(py, count, move || {
            let paths: Vec<Path<'_>> = (places.iter().zip(&arcs).zip(widths))
                .map(|((nodes, arcs), radius)| Path { nodes, arc_length: arcs.slice(), radius })
                .collect();
            queries::TubeQueries::new(&paths)
        })??;
        Ok(Self { queries: Arc::new(queries), nodes, arc_lengths, radii })
    }

    /// Arguments from which a pickle is restored.
    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let nodes: Vec<_> =
            self.nodes.iter().map(|nodes| points_array(py, nodes.to_vec())).collect::<PyResult<_>>()?;
        let arcs: Vec<_> =
            self.arc_lengths.iter().map(|arcs| list(py, arcs.slice().to_vec())).collect::<PyResult<_>>()?;
        (nodes, arcs, self.radii.clone()).into_pyobject(py)
    }

    /// Return (N,) least distances from a tube's surface: negative inside, infinite without chains.
    fn signed_distances<'py>(&self, points: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (py, queries) = (points.py(), self.queries.clone());
        let points = Points::new("points", points, "(N, 3)")?;
        list(py, released_if_long(py, PER_POINT * points.len(), move || queries.signed_distances(&points))??)
    }

    /// Return chain number, arc length and place on the axis of the nearest tube, and the distance from the axis; −1,
    /// NaN and infinite without chains.
    fn nearest<'py>(&self, points: &Bound<'py, PyAny>) -> PyResult<Nearest<'py>> {
        let (py, queries) = (points.py(), self.queries.clone());
        let points = Points::new("points", points, "(N, 3)")?;
        let found = released_if_long(py, PER_POINT * points.len(), move || queries.nearest(&points))??;
        let distances =
            found.iter().map(|near| near.map_or(f64::INFINITY, |(_, distance)| distance)).collect();
        let found: Vec<Option<Place>> = found.iter().map(|near| near.map(|(place, _)| place)).collect();
        let points = found.iter().map(|place| place.map_or([f64::NAN; 3], |place| place.point)).collect();
        let (chains, s) = places(py, &found)?;
        Ok((chains, s, points_array(py, points)?, list(py, distances)?))
    }

    /// Return the distance along each ray to its first tube, and that hit's chain number, arc length and normal;
    /// infinite, −1 and NaN if it meets none.
    fn ray_hits<'py>(
        &self,
        origins: &Bound<'py, PyAny>,
        directions: &Bound<'py, PyAny>,
    ) -> PyResult<Hits<'py>> {
        let (py, queries) = (origins.py(), self.queries.clone());
        let origins = Points::new("origins", origins, "(N, 3)")?;
        let directions = FloatArray::of_numbers("directions", directions)?.points("directions", "(N, 3)")?;
        let nanoseconds = PER_RAY * origins.len();
        let found = released_if_long(py, nanoseconds, move || queries.ray_hits(&origins, &directions))??;
        let distances = found.iter().map(|hit| hit.map_or(f64::INFINITY, |hit| hit.distance)).collect();
        let normals = found.iter().map(|hit| hit.map_or([f64::NAN; 3], |hit| hit.normal)).collect();
        let place: Vec<Option<Place>> = found.iter().map(|hit| hit.map(|hit| hit.place)).collect();
        let (chains, s) = places(py, &place)?;
        Ok((list(py, distances)?, chains, s, points_array(py, normals)?))
    }

    /// Return times of contact, clearances, chain numbers and arc lengths of spheres that move straight and evenly.
    fn swept_spheres<'py>(
        &self,
        starts: &Bound<'py, PyAny>,
        ends: &Bound<'py, PyAny>,
        radius: &Bound<'py, PyAny>,
    ) -> PyResult<Sweeps<'py>> {
        let (py, queries) = (starts.py(), self.queries.clone());
        let starts = Points::new("starts", starts, "(N, 3)")?;
        let ends = Points::new("ends", ends, "(N, 3)")?;
        let radii = FloatArray::of_numbers("radius", radius)?;
        let radii = match radii.shape() {
            [] => vec![number("radius", radius)?; starts.len()],
            [_] => radii.into_values(),
            other => return Err(wrong_shape("radius", "() or (N,)", other)),
        };
        let nanoseconds = PER_SPHERE * starts.len();
        let work = move || queries.swept_spheres(&starts, &ends, &radii);
        sweeps(py, &released_if_long(py, nanoseconds, work)??)
    }

    /// Return the same for boxes that move and turn from one pose to another.
    fn swept_boxes<'py>(
        &self,
        starts: &Bound<'py, PyAny>,
        ends: &Bound<'py, PyAny>,
        half_sizes: &Bound<'py, PyAny>,
    ) -> PyResult<Sweeps<'py>> {
        let (py, queries) = (starts.py(), self.queries.clone());
        let (starts, ends) = (poses("starts", starts)?, poses("ends", ends)?);
        let halves = FloatArray::of_numbers("half_sizes", half_sizes)?;
        let halves: Vec<Point> = match halves.shape() {
            [3] => vec![[halves.slice()[0], halves.slice()[1], halves.slice()[2]]; starts.len()],
            _ => halves.points("half_sizes", "(3,) or (N, 3)")?.to_vec(),
        };
        let nanoseconds = PER_BOX * starts.len();
        let work = move || queries.swept_boxes(&starts, &ends, &halves);
        sweeps(py, &released_if_long(py, nanoseconds, work)??)
    }
}

fn places<'py>(py: Python<'py>, found: &[Option<Place>]) -> PyResult<Places<'py>> {
    let chains = found.iter().map(|place| place.map_or(-1, |place| place.chain as i64)).collect();
    let s = found.iter().map(|place| place.map_or(f64::NAN, |place| place.s)).collect();
    Ok((list(py, chains)?, list(py, s)?))
}

fn sweeps<'py>(py: Python<'py>, found: &[Option<Sweep>]) -> PyResult<Sweeps<'py>> {
    let times = found.iter().map(|sweep| sweep.map_or(f64::INFINITY, |sweep| sweep.time)).collect();
    let clearances = found.iter().map(|sweep| sweep.map_or(f64::INFINITY, |sweep| sweep.clearance)).collect();
    let chains = found.iter().map(|sweep| sweep.map_or(-1, |sweep| sweep.place.chain as i64)).collect();
    let s = found.iter().map(|sweep| sweep.map_or(f64::NAN, |sweep| sweep.place.s)).collect();
    Ok((list(py, times)?, list(py, clearances)?, list(py, chains)?, list(py, s)?))
}

/// Takes the rigid motions of an (N, 4, 4) array.
fn poses(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<RigidMotion>> {
    let array = FloatArray::of_numbers(name, value)?;
    let [_, 4, 4] = array.shape() else { return Err(wrong_shape(name, "(N, 4, 4)", array.shape())) };
    let rows = array.slice().as_chunks::<4>().0.as_chunks::<4>().0;
    let motion = |(i, rows)| {
        let named = |error: Error| error.to_string().replacen("pose", &format!("{name}[{i}]"), 1);
        RigidMotion::from_rows(rows).map_err(|error| PyValueError::new_err(named(error)))
    };
    rows.iter().enumerate().map(motion).collect()
}
