//! Bindings of heights above a table.

use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{Array, FloatArray, Points, motion, wrong_shape};
use super::arrays::{array, constant, list};
use super::released::{released, released_if_long};
use crate::checks::check_positive;
use crate::clouds::depth::Pinhole;
use crate::geometry::median::median_of_many;
use crate::geometry::{Point, RigidMotion};
use crate::images::heights::{self, AxisBox, DepthPixels, Side, Smoothing, Standing};
use crate::images::image::find_runs;
use crate::images::plane_windows;
use crate::images::planes::{PlaneSearch, find_plane as find};
use crate::images::tabletop::find_tabletop as find_top;

const MAX_ROUNDS: usize = 100; // fits of a plane at most; it takes some

/// A box along the axes of a pose: low and high corner, and the pose.
type Within<'py> = (Point, Point, Bound<'py, PyAny>);
/// Normal and offset of a plane, and the share of the points that lie on it.
type FoundPlane<'py> = (Bound<'py, PyArray1<f64>>, f64, f64);
type Heights<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<bool>>, Option<f64>);

/// Return (H, W) heights of pixels above a plane normal @ x = offset, metres, which of them have depth and would be in a
/// box if they were a rope's, and the median depth of these. `height` is that of a rope's axis above the plane.
#[pyfunction]
pub(super) fn measure_heights<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    camera: [[f64; 2]; 2],
    pose: &Bound<'py, PyAny>,
    plane: (Point, f64),
    within: Option<Within<'py>>,
    height: f64,
) -> PyResult<Heights<'py>> {
    let image = FloatArray::new("depth", depth)?;
    let (shape, [focal, center]) = (image.image_shape("depth")?, camera);
    let pose = motion("pose", pose)?;
    let within = within.map(|(low, high, pose)| Ok::<_, PyErr>((low, high, motion("within", &pose)?)));
    let within = within.transpose()?.map(|(low, high, pose)| box_of(low, high, &pose, height));
    let (above, counts, middle) = released_if_long(py, 2 * shape[0] * shape[1], move || {
        let camera = Pinhole { focal, center };
        let seen = DepthPixels { depth: image.slice(), width: shape[1].max(1), camera, pose };
        let (above, counts) = heights::measure_heights(&seen, plane, within.as_ref());
        let mut own = Vec::with_capacity(counts.len());
        for run in find_runs(&counts) {
            own.extend_from_slice(&seen.depth[run]);
        }
        let middle = median_of_many(&own);
        (above, counts, middle)
    })?;
    Ok((constant(py, above, shape)?, constant(py, counts, shape)?, middle))
}

fn box_of(low: Point, high: Point, pose: &RigidMotion, height: f64) -> AxisBox {
    let sides = [0, 1, 2].map(|k| {
        let direction = pose.rotation.column(k).into_owned();
        let middle = direction.dot(&pose.translation);
        Side { direction: direction.into(), low: low[k] + middle, high: high[k] + middle }
    });
    AxisBox { sides, height }
}

/// Return (H, W) pixels around which the mean height of pixels that count is larger than `edge`. Heights are cut to a
/// range, and means are weighted by a symmetric kernel, given from its middle on; more than a share of its weight must
/// count.
#[pyfunction]
pub(super) fn find_standing<'py>(
    py: Python<'py>,
    above: &Bound<'py, PyAny>,
    counts: &Bound<'py, PyAny>,
    range: [f64; 2],
    mut kernel: Vec<f32>,
    edge: f32,
    share: f32,
) -> PyResult<Bound<'py, PyArray2<bool>>> {
    let (above, counts) = (FloatArray::new("above", above)?, Array::mask("counts", counts)?);
    let [height, width] = above.image_shape("above")?;
    if counts.shape() != [height, width] {
        return Err(wrong_shape("counts", &format!("({height}, {width})"), counts.shape()));
    }
    let [low, high] = range;
    if kernel.is_empty() || width * height == 0 || low.is_nan() || high.is_nan() || low > high {
        return Err(PyValueError::new_err("above, kernel, range: expected at least one number, low <= high"));
    }
    // entries farther out than the image is wide lie beyond the border
    kernel.truncate(width.max(height));
    let nanoseconds = (2 + kernel.len() / 4).saturating_mul(width * height);
    let found = released_if_long(py, nanoseconds, move || {
        let limits = Standing { smoothing: Smoothing { range, kernel: &kernel, share }, edge };
        heights::find_standing(above.slice(), counts.slice(), width, &limits)
    })?;
    constant(py, found, [height, width])
}

/// Find the plane that most of some points lie on, and fit it to these.
///
/// Parameters
/// ----------
/// points : (N, 3) ndarray
/// compared : (M, 3) ndarray
///     Points that planes are compared with.
/// corners : (3 K, 3) ndarray
///     Three points of each plane that is tried.
/// width : float
///     Points this near a plane lie on it at first.
/// least : (float, float)
///     Area of the parallelogram of three corners, and sine of its angle: with less, they fix no plane.
/// share : float
///     Share of the points that lie on the plane before it is fitted.
/// rounds : int
///     Fits by least squares.
/// fewest : int
///     Points that lie on the plane after each.
/// adaptive : (float, float) or None
///     Standard deviations, and a least width: points this near the plane lie on it after a fit. None: the width stays.
///
/// Returns
/// -------
/// (normal, offset, share) or None
///     The plane normal @ x = offset, and the share of the points that lie on it; None without one.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(super) fn find_plane<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    compared: &Bound<'py, PyAny>,
    corners: &Bound<'py, PyAny>,
    width: f64,
    least: [f64; 2],
    share: f64,
    rounds: usize,
    fewest: usize,
    adaptive: Option<[f64; 2]>,
) -> PyResult<Option<FoundPlane<'py>>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let compared = Points::new("compared", compared, "(M, 3)")?;
    let corners = Points::new("corners", corners, "(3 K, 3)")?;
    let search = PlaneSearch { width, least, share, rounds: rounds.min(MAX_ROUNDS), fewest, adaptive };
    let nanoseconds = corners.len() * compared.len() / 4 + 4 * search.rounds * points.len();
    let found =
        released_if_long(py, nanoseconds, move || find(&points, &compared, corners.as_chunks().0, &search))?;
    found.map(|plane| Ok((list(py, plane.normal.to_vec())?, plane.offset, plane.share))).transpose()
}

/// Return (K, 1600) residuals of 1 / z, in standard deviations, in windows of 40 times 40 pixels that show planes. Those
/// whose depth is nearest to `near`, metres, come first.
#[pyfunction]
pub(super) fn measure_plane_errors<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    near: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let image = FloatArray::new("depth", depth)?;
    let [_, width] = image.image_shape("depth")?;
    let found = released(py, move || plane_windows::measure_plane_errors(image.slice(), width, near))?;
    let rows = found.len() / plane_windows::PIXELS;
    array(py, found, [rows, plane_windows::PIXELS])
}

/// Return (H, W) heights of pixels above a table normal @ x = offset, metres, 0 without depth, and which of them stand out
/// of it. `distance` is the table's, metres.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub(super) fn find_tabletop<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    camera: [[f64; 2]; 2],
    pose: &Bound<'py, PyAny>,
    plane: (Point, f64),
    distance: f64,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<bool>>)> {
    let image = FloatArray::new("depth", depth)?;
    let (shape, [focal, center]) = (image.image_shape("depth")?, camera);
    let pose = motion("pose", pose)?;
    check_positive("distance", distance)?;
    let (above, standing) = released(py, move || {
        let camera = Pinhole { focal, center };
        let seen = DepthPixels { depth: image.slice(), width: shape[1].max(1), camera, pose };
        find_top(&seen, plane, distance)
    })?;
    Ok((constant(py, above, shape)?, constant(py, standing, shape)?))
}
