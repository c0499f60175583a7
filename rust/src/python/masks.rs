//! Bindings of single images and masks: smoothing, blobs, outlines, the radius that a mask shows.

use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::Array;
use super::arrays::array;
use super::released::released;
use crate::images::image::{Image, blobs, distances};
use crate::images::outline;
use crate::images::silhouette::Silhouette;
use crate::parallel;

/// Most steps of an outline: it is found in hundreds.
const MOST_STEPS: usize = 100_000;

/// An image (H, W) in single precision, convolved along rows and columns with a symmetric kernel that is given from its
/// middle on; beyond the border are zeros.
#[pyfunction]
pub(super) fn convolved<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    mut kernel: Vec<f32>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let image = Array::<f32>::exactly("image", image, 2)?;
    let ([height, width], values) = (image.image_shape("image")?, image.into_values());
    if kernel.is_empty() || values.is_empty() {
        return Err(PyValueError::new_err("image, kernel: expected at least one number"));
    }
    // what is farther away than the image is wide lies beyond the border
    kernel.truncate(width.max(height));
    let found = released(py, move || {
        let reach = kernel.len() - 1;
        let wide = width + 2 * reach;
        let mut padded = Image::filled(wide, height + 2 * reach, 0.0f32);
        for (row, from) in values.chunks_exact(width).enumerate() {
            padded.values[(row + reach) * wide + reach..][..width].copy_from_slice(from);
        }
        let found = padded.convolved(&kernel);
        let rows = found.values.chunks_exact(wide).skip(reach).take(height);
        rows.flat_map(|row| &row[reach..reach + width]).copied().collect::<Vec<f32>>()
    })?;
    array(py, found, [height, width])
}

/// How many pixels the largest blob of a mask has, diagonal neighbours connected.
#[pyfunction]
pub(super) fn largest_blob(py: Python<'_>, mask: &Bound<'_, PyAny>) -> PyResult<usize> {
    let mask = Array::mask("mask", mask)?;
    let [height, width] = mask.image_shape("mask")?;
    let image = Image { width, height, values: mask.into_values() };
    released(py, move || blobs(&image, true, true).sizes.into_iter().max().unwrap_or(0))
}

/// The number of each pixel's blob (H, W), from 1 on, diagonal neighbours connected; 0 outside of the mask.
#[pyfunction]
pub(super) fn blob_numbers<'py>(
    py: Python<'py>,
    mask: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<i64>>> {
    let mask = Array::mask("mask", mask)?;
    let [height, width] = mask.image_shape("mask")?;
    let image = Image { width, height, values: mask.into_values() };
    let found = released(py, move || {
        let mut numbers = vec![0i64; width * height];
        for run in blobs(&image, true, true).runs {
            numbers[run.row * width..][run.begin..run.end].fill(run.blob as i64 + 1);
        }
        numbers
    })?;
    array(py, found, [height, width])
}

/// The distance (H, W) of each pixel of a mask from the nearest one outside of it, pixels; 0 outside. What is beyond the border
/// counts as the mask, and distances above `most` may be found wrong, but not below it.
#[pyfunction]
pub(super) fn edge_distances<'py>(
    py: Python<'py>,
    mask: &Bound<'py, PyAny>,
    most: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let mask = Array::mask("mask", mask)?;
    let [height, width] = mask.image_shape("mask")?;
    let image = Image { width, height, values: mask.into_values() };
    let most = most.min(width + height);
    let found = released(py, move || distances(&image, true, most).values)?;
    array(py, found, [height, width])
}

/// For each weight, the pixels (H, W) with the least sum of evidence against them and of the weight times the length of
/// their outline.
#[pyfunction]
pub(super) fn short_outlines<'py>(
    py: Python<'py>,
    evidence: &Bound<'py, PyAny>,
    weights: Vec<f32>,
    steps: usize,
) -> PyResult<Vec<Bound<'py, PyArray2<bool>>>> {
    let evidence = Array::<f32>::exactly("evidence", evidence, 2)?;
    let [height, width] = evidence.image_shape("evidence")?;
    if steps > MOST_STEPS {
        return Err(PyValueError::new_err(format!("steps: expected at most {MOST_STEPS}, got {steps}")));
    }
    let evidence = Image { width, height, values: evidence.into_values() };
    let found = released(py, move || {
        parallel::map(&weights, |&weight| outline::short_outline(&evidence, weight, steps).values)
    })?;
    found.into_iter().map(|mask| array(py, mask, [height, width])).collect()
}

/// A rope's radius as the width of a mask shows it, pixels; None if it shows no rope.
#[pyfunction]
pub(super) fn shown_radius(py: Python<'_>, mask: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
    let mask = Array::mask("mask", mask)?;
    let [_, width] = mask.image_shape("mask")?;
    released(py, move || Silhouette::shown_radius(mask.slice(), width))
}
