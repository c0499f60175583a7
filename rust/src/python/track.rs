//! Bindings of the tracker's frames.

use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{Array, FloatArray, Points, motion, require_same_length};
use super::arrays::{array, list, points_array};
use super::released::released;
use crate::clouds::depth::Pinhole;
use crate::geometry::Point;
use crate::track::camera::Camera;
use crate::track::openings::Table;
use crate::track::rope::{Hold, MIN_TRACKED, Rope};
use crate::track::update::{self, Found, Options};

/// Depth, mask, occluders, focal lengths and principal point, pose, time after the answer's, s, and bias, metres.
type CameraInput<'py> = (
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Option<Bound<'py, PyAny>>,
    [[f64; 2]; 2],
    Bound<'py, PyAny>,
    f64,
    f64,
);
/// Nodes, velocities, where last seen; variance, motion and age; radius and spacing; slide; covers; holds.
type RopeInput<'py> = (
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    [f64; 2],
    Option<f64>,
    [Option<f64>; 2],
    Vec<(f64, Point, f64)>,
);
type Nodes<'py> = Bound<'py, PyArray2<f64>>;
type RopeOutput<'py> = (
    Nodes<'py>,
    Nodes<'py>,
    Nodes<'py>,
    Nodes<'py>,
    Option<f64>,
    [Option<f64>; 2],
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    f64,
    Option<f64>,
);
type Answer<'py> = (Vec<RopeOutput<'py>>, Vec<f64>, Vec<f64>, f64, usize);

/// Move tracked ropes to where the images of one frame show them.
///
/// Parameters
/// ----------
/// cameras : list of tuple
///     Depth (H, W), metres, mask (H, W) and occluders (H, W) or None, ((fx, fy), (cx, cy)), pose (4, 4), the image's
///     time after that of the answer, s, and the depth that the camera adds, metres.
/// ropes : list of tuple
///     Nodes, velocities and where each was last seen (M, 3); variance, variance of motion and age (M, 3); radius and
///     spacing, metres; by how far the tips said that it slid, metres, or None; length of rope
///     that something covers at each end, or None; holds as place in steps between nodes, point
///     and standard deviation.
/// table : tuple, optional
///     Normal towards the cameras and offset of the table's plane.
/// elapsed : float
///     Time since the last frame, s.
/// steps : int
///     Steps of Gauss and Newton.
/// bias_gain : float
///     Share of a new bias of depth that is taken.
/// free : bool
///     Whether the ropes were laid anew, so that the prediction says little.
///
/// Returns
/// -------
/// ropes : list of tuple
///     As given, up to the covers; then covariances (M, 3, 3), the share of each node's samples that pixels support, which
///     nodes are hidden, the share of samples that a camera saw through, and by how much both tips say that the rope is
///     longer, metres, or None.
/// biases : list of float
///     Of the cameras, metres.
/// noise : list of float
///     Standard deviation of each camera's depth, radii.
/// unexplained : float
///     Share of the ropes' pixels that no rope explains.
/// pixels : int
#[pyfunction]
#[pyo3(signature = (cameras, ropes, table, elapsed, *, steps, bias_gain, free=false))]
#[allow(clippy::too_many_arguments)]
pub(super) fn track_frame<'py>(
    py: Python<'py>,
    cameras: Vec<CameraInput<'py>>,
    ropes: Vec<RopeInput<'py>>,
    table: Option<(Point, f64)>,
    elapsed: f64,
    steps: usize,
    bias_gain: f64,
    free: bool,
) -> PyResult<Answer<'py>> {
    if !(elapsed.is_finite() && elapsed > 0.0) || steps == 0 {
        return Err(PyValueError::new_err("elapsed, steps: expected numbers above 0"));
    }
    let images: Vec<Image> = cameras.iter().map(Image::new).collect::<PyResult<_>>()?;
    let mut states: Vec<Rope> = ropes.iter().map(rope_of).collect::<PyResult<_>>()?;
    let table = table.map(|(normal, offset)| Table { normal, offset });
    let options = Options { steps, elapsed, bias_gain, free };
    let (states, biases, outcome) = released(py, move || {
        let mut seen: Vec<Camera<'_>> = images.iter().map(Image::camera).collect();
        let outcome = update::update(&mut seen, &mut states, table, options);
        let biases: Vec<f64> = seen.iter().map(|camera| camera.bias).collect();
        (states, biases, outcome)
    })?;
    let ropes = states
        .into_iter()
        .zip(outcome.ropes)
        .map(|(state, found)| output(py, state, found))
        .collect::<PyResult<_>>()?;
    Ok((ropes, biases, outcome.noise, outcome.unexplained, outcome.pixels))
}

struct Image {
    depth: FloatArray,
    mask: Array<bool>,
    occluders: Option<Array<bool>>,
    width: usize,
    pinhole: Pinhole,
    pose: crate::geometry::RigidMotion,
    delay: f64,
    bias: f64,
}

impl Image {
    fn new((depth, mask, occluders, [focal, center], pose, delay, bias): &CameraInput<'_>) -> PyResult<Self> {
        let (depth, mask) = (FloatArray::new("depth", depth)?, Array::mask("mask", mask)?);
        let occluders = occluders.as_ref().map(|mask| Array::mask("occluders", mask)).transpose()?;
        let [_, width] = depth.image_shape("depth")?;
        let count = depth.slice().len();
        require_same_length("mask", mask.slice().len(), count)?;
        if let Some(occluders) = &occluders {
            require_same_length("occluders", occluders.slice().len(), count)?;
        }
        let pinhole = Pinhole { focal: *focal, center: *center };
        let pose = motion("pose", pose)?;
        Ok(Self { depth, mask, occluders, width, pinhole, pose, delay: *delay, bias: *bias })
    }

    fn camera(&self) -> Camera<'_> {
        Camera {
            depth: self.depth.slice(),
            mask: self.mask.slice(),
            occluders: self.occluders.as_ref().map(Array::slice),
            width: self.width,
            pinhole: self.pinhole,
            pose: self.pose,
            delay: self.delay,
            bias: self.bias,
        }
    }
}

fn rope_of(input: &RopeInput<'_>) -> PyResult<Rope> {
    let (nodes, velocities, last, scalars, [radius, spacing], slid, covers, holds) = input;
    let nodes = points_of("nodes", nodes)?;
    if nodes.len() < MIN_TRACKED || !(*radius > 0.0 && *spacing > 0.0) {
        return Err(PyValueError::new_err("nodes, radius, spacing: expected a rope of at least six nodes"));
    }
    let (velocities, last) = (points_of("velocities", velocities)?, points_of("last", last)?);
    let scalars = points_of("scalars", scalars)?;
    for (name, rows) in [("velocities", &velocities), ("last", &last), ("scalars", &scalars)] {
        require_same_length(name, rows.len(), nodes.len())?;
    }
    let column = |k: usize| scalars.iter().map(|row| row[k]).collect();
    Ok(Rope {
        variance: column(0),
        noise: column(1),
        age: column(2),
        nodes,
        velocities,
        last,
        radius: *radius,
        spacing: *spacing,
        slid: *slid,
        covers: *covers,
        holds: holds.iter().map(|&(at, point, sd)| Hold { at, point, sd }).collect(),
    })
}

fn points_of(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<Point>> {
    Ok(Points::new(name, value, "(M, 3)")?.to_vec())
}

fn output(py: Python<'_>, state: Rope, found: Found) -> PyResult<RopeOutput<'_>> {
    let count = state.nodes.len();
    let scalars = (0..count).map(|i| [state.variance[i], state.noise[i], state.age[i]]).collect();
    Ok((
        points_array(py, state.nodes)?,
        points_array(py, state.velocities)?,
        points_array(py, state.last)?,
        points_array(py, scalars)?,
        state.slid,
        state.covers,
        array(py, found.covariances.concat().concat(), [count, 3, 3])?,
        list(py, found.seen)?,
        list(py, found.hidden)?,
        found.through,
        found.longer,
    ))
}
