//! Checked arguments of fits to images.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::checks::{check_positive, check_unit};
use crate::geometry::Point;
use crate::images::imagefit::{Plane, Sensor};
use crate::python::arguments::{FloatArray, Points, wrong_shape};

/// Longest polyline, pixels or radii, farthest coordinate, pixels or metres, and most steps of a fit.
const LONGEST: f64 = 1e5;
const FARTHEST: f64 = 1e6;
const MOST_STEPS: usize = 100;
/// How much too far away, or too near, ropes may be seen, radii.
const MOST_BIAS: f64 = 100.0;

/// Standard deviation of depth, radii, if it is known, its correlation, radii, standard deviation of edges, pixels, and bias,
/// radii.
pub type Errors = (Option<f64>, f64, f64, f64);

pub fn sensor((noise, correlation, lateral, bias): Errors) -> Sensor {
    Sensor { noise, correlation, lateral, bias: [bias, Sensor::DEFAULT.bias[1]], ..Sensor::DEFAULT }
}

/// Ropes' nodes, (M, 3) each.
pub fn nodes_of(name: &str, chains: &[Bound<'_, PyAny>], radius: f64) -> PyResult<Vec<Vec<Point>>> {
    (chains.iter().enumerate())
        .map(|(i, nodes)| {
            let nodes = Points::new(&format!("{name}[{i}]"), nodes, "(M, 3)")?.to_vec();
            check_course(name, &nodes, LONGEST * radius)?;
            Ok(nodes)
        })
        .collect()
}

pub fn places(array: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 2]>> {
    let places = FloatArray::new("hypotheses", array)?;
    match places.shape() {
        [count, 2] if *count >= 2 => {
            let places = places.slice().as_chunks().0.to_vec();
            check_course("hypotheses", &places, LONGEST)?;
            Ok(places)
        }
        other => Err(wrong_shape("hypotheses", "(M, 2), M >= 2", other)),
    }
}

/// Refuses polylines that are longer, or farther away, than any that an image shows.
fn check_course<const D: usize>(name: &str, course: &[[f64; D]], longest: f64) -> PyResult<()> {
    let length: f64 = course
        .windows(2)
        .map(|pair| pair[0].iter().zip(pair[1]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt())
        .sum();
    // false for NaN too
    if length < longest && course.iter().flatten().all(|x| x.abs() < FARTHEST) {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name}: expected finite polylines up to {longest:.0e} long")))
}

/// Refuses what no fit can work with.
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
    // fits of ropes that are moved out of all sight take long, and say nothing
    if bias.is_nan() || bias.abs() > MOST_BIAS {
        return Err(PyValueError::new_err(format!("errors: expected a bias of at most {MOST_BIAS} radii")));
    }
    if iterations > MOST_STEPS {
        return Err(PyValueError::new_err(format!("iterations: expected at most {MOST_STEPS}")));
    }
    Ok(())
}

pub fn check_corrections(name: &str, corrections: &[[f64; 6]]) -> PyResult<()> {
    if corrections.iter().flatten().all(|x| x.abs() < FARTHEST) {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name}: expected finite corrections")))
}

pub fn plane_of((normal, offset): (Point, f64)) -> PyResult<Plane> {
    check_unit("plane", normal)?;
    if offset.abs() < FARTHEST {
        return Ok(Plane { normal, offset });
    }
    Err(PyValueError::new_err("plane: expected a finite distance"))
}
