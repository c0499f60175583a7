//! Checked arguments of fits to images.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::checks::{check_positive, check_unit};
use crate::clouds::depth::Pinhole;
use crate::geometry::{Point, RigidMotion};
use crate::images::imagefit::{Plane, Sensor};
use crate::python::arguments::{Array, FloatArray, Points, motions, require_same_length, wrong_shape};

const MAX_LENGTH: f64 = 1e5; // length of a polyline at most, pixels or radii
const MAX_COORDINATE: f64 = 1e6; // size of a coordinate at most, pixels or metres
const MAX_STEPS: usize = 100; // steps of a fit at most
const MAX_BIAS: f64 = 100.0; // size of a depth bias at most, radii

/// Errors of a sensor: standard deviation of depth, radii, if known; its correlation length, radii; standard deviation
/// of edges, pixels; depth bias, radii.
pub type Errors = (Option<f64>, f64, f64, f64);

/// A view with a mask, as [`crate::images::imagefit::Prepared`] takes it.
pub struct MaskedView {
    pub depth: FloatArray,
    pub mask: Array<bool>,
    pub size: [usize; 2],
    pub pinhole: Pinhole,
    pub pose: RigidMotion,
    pub mask_px: Option<f64>,
}

/// Takes views with masks.
pub fn views_of(
    depths: Vec<Bound<'_, PyAny>>,
    masks: &[Bound<'_, PyAny>],
    cameras: Vec<[[f64; 2]; 2]>,
    poses: &[Bound<'_, PyAny>],
    mask_radii: Option<Vec<Option<f64>>>,
) -> PyResult<Vec<MaskedView>> {
    let mask_radii = mask_radii.unwrap_or_else(|| vec![None; depths.len()]);
    for (name, got) in [
        ("masks", masks.len()),
        ("cameras", cameras.len()),
        ("poses", poses.len()),
        ("mask_radii", mask_radii.len()),
    ] {
        require_same_length(name, got, depths.len())?;
    }
    if !cameras.iter().flatten().flatten().all(|x| x.is_finite()) {
        return Err(PyValueError::new_err("cameras: expected finite numbers"));
    }
    for pixels in mask_radii.iter().flatten() {
        check_positive("mask_radii", *pixels)?;
    }
    let (depths, poses) = (FloatArray::all("depths", &depths)?, motions("poses", poses)?);
    let mut views = Vec::new();
    for ((((depth, mask), [focal, center]), pose), mask_px) in
        depths.into_iter().zip(masks).zip(cameras).zip(poses).zip(mask_radii)
    {
        let ([height, width], mask) = (depth.image_shape("depths")?, Array::mask("masks", mask)?);
        if mask.shape() != [height, width] {
            return Err(wrong_shape("masks", &format!("({height}, {width})"), mask.shape()));
        }
        let pinhole = Pinhole { focal, center };
        views.push(MaskedView { depth, mask, size: [width, height], pinhole, pose, mask_px });
    }
    Ok(views)
}

pub fn sensor((noise, correlation, lateral, bias): Errors) -> Sensor {
    Sensor { noise, correlation, lateral, bias: [bias, Sensor::DEFAULT.bias[1]], ..Sensor::DEFAULT }
}

/// Takes the nodes of ropes, (M, 3) each.
pub fn nodes_of(name: &str, chains: &[Bound<'_, PyAny>], radius: f64) -> PyResult<Vec<Vec<Point>>> {
    (chains.iter().enumerate())
        .map(|(i, nodes)| {
            let nodes = Points::new(&format!("{name}[{i}]"), nodes, "(M, 3)")?.to_vec();
            check_course(name, &nodes, MAX_LENGTH * radius)?;
            Ok(nodes)
        })
        .collect()
}

pub fn places(array: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 2]>> {
    let places = FloatArray::new("hypotheses", array)?;
    match places.shape() {
        [count, 2] if *count >= 2 => {
            let places = places.slice().as_chunks().0.to_vec();
            check_course("hypotheses", &places, MAX_LENGTH)?;
            Ok(places)
        }
        other => Err(wrong_shape("hypotheses", "(M, 2), M >= 2", other)),
    }
}

/// Refuses polylines that are longer, or farther away, than any in an image.
fn check_course<const D: usize>(name: &str, course: &[[f64; D]], longest: f64) -> PyResult<()> {
    let length: f64 = course
        .windows(2)
        .map(|pair| pair[0].iter().zip(pair[1]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt())
        .sum();
    // false for NaN too
    if length < longest && course.iter().flatten().all(|x| x.abs() < MAX_COORDINATE) {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name}: expected finite polylines up to {longest:.0e} long")))
}

/// Refuses settings that no fit can use.
pub fn check_fit(pose_sd: [f64; 2], errors: Errors, iterations: usize) -> PyResult<()> {
    let (noise, correlation, lateral, bias) = errors;
    for (name, value) in [
        ("pose_sd", pose_sd[0]),
        ("pose_sd", pose_sd[1]),
        ("errors", noise.unwrap_or(1.0)),
        ("errors", correlation),
        ("errors", lateral),
    ] {
        check_positive(name, value)?;
    }
    // fits of ropes that are moved out of sight take long and give nothing
    if bias.is_nan() || bias.abs() > MAX_BIAS {
        return Err(PyValueError::new_err(format!("errors: expected a bias of at most {MAX_BIAS} radii")));
    }
    if iterations > MAX_STEPS {
        return Err(PyValueError::new_err(format!("iterations: expected at most {MAX_STEPS}")));
    }
    Ok(())
}

pub fn check_corrections(name: &str, corrections: &[[f64; 6]]) -> PyResult<()> {
    if corrections.iter().flatten().all(|x| x.abs() < MAX_COORDINATE) {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name}: expected finite corrections")))
}

pub fn plane_of((normal, offset): (Point, f64)) -> PyResult<Plane> {
    check_unit("plane", normal)?;
    if offset.abs() < MAX_COORDINATE {
        return Ok(Plane { normal, offset });
    }
    Err(PyValueError::new_err("plane: expected a finite distance"))
}
