//! Bindings of heights above a table.

use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{Array, FloatArray, Points, motion, require_same_length, wrong_shape};
use super::arrays::constant;
use super::released::{CHEAP, released, released_if_many};
use crate::clouds::depth::Pinhole;
use crate::geometry::median::median_of_many;
use crate::geometry::{Point, RigidMotion};
use crate::images::heights::{self, AxisBox, DepthPixels, Side, Standing};
use crate::images::planes;

/// A box along the axes of a pose: low and high corner, and the pose.
type Within<'py> = (Point, Point, Bound<'py, PyAny>);
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
    let (above, counts, middle) = released(py, move || {
        let camera = Pinhole { focal, center };
        let seen = DepthPixels { depth: image.slice(), width: shape[1].max(1), camera, pose };
        let (above, counts) = heights::measure_heights(&seen, plane, within.as_ref());
        let depths = || seen.depth.iter().zip(&counts).filter(|(_, counts)| **counts).map(|(z, _)| *z);
        let middle = median_of_many(depths);
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
    let found = released(py, move || {
        let limits = Standing { range, kernel: &kernel, edge, share };
        heights::find_standing(above.slice(), counts.slice(), width, &limits)
    })?;
    constant(py, found, [height, width])
}

/// Return the number of the plane, of normals (N, 3) and offsets, that most points (M, 3) are nearer to than a width.
/// The first of equal ones counts.
#[pyfunction]
pub(super) fn find_fullest_plane(
    py: Python<'_>,
    normals: &Bound<'_, PyAny>,
    offsets: Vec<f64>,
    points: &Bound<'_, PyAny>,
    width: f64,
) -> PyResult<usize> {
    let normals = Points::new("normals", normals, "(N, 3)")?;
    let points = Points::new("points", points, "(M, 3)")?;
    require_same_length("offsets", offsets.len(), normals.len())?;
    let items = normals.len() * points.len() / CHEAP;
    let found =
        released_if_many(py, items, move || planes::find_fullest(&normals, &offsets, &points, width))?;
    found.ok_or_else(|| PyValueError::new_err("normals: expected at least one"))
}
