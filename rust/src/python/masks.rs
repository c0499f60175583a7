//! Bindings of single images and masks: smoothing, blobs, outlines, the radius that a mask shows.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::image::{Image, blobs};
use crate::silhouette::Silhouette;
use crate::{outline, parallel};

/// An image (H, W) in single precision, convolved along rows and columns with a symmetric kernel that is given from its
/// middle on; beyond the border are zeros.
#[pyfunction]
pub(super) fn convolved<'py>(
    py: Python<'py>,
    image: PyReadonlyArray2<'_, f32>,
    kernel: Vec<f32>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let &[height, width] = image.shape() else { unreachable!("two dimensions") };
    let values = image.as_slice().map_err(|_| PyValueError::new_err("image: expected C order"))?;
    if kernel.is_empty() || values.is_empty() {
        return Err(PyValueError::new_err("image, kernel: expected at least one number"));
    }
    let found = py.detach(|| {
        let reach = kernel.len() - 1;
        let wide = width + 2 * reach;
        let mut padded = Image::filled(wide, height + 2 * reach, 0.0f32);
        for (row, from) in values.chunks_exact(width).enumerate() {
            padded.values[(row + reach) * wide + reach..][..width].copy_from_slice(from);
        }
        let found = padded.convolved(&kernel);
        let rows = found.values.chunks_exact(wide).skip(reach).take(height);
        rows.flat_map(|row| &row[reach..reach + width]).copied().collect::<Vec<f32>>()
    });
    PyArray1::from_vec(py, found).reshape([height, width])
}

/// How many pixels the largest blob of a mask has, diagonal neighbours connected.
#[pyfunction]
pub(super) fn largest_blob(py: Python<'_>, mask: PyReadonlyArray2<'_, bool>) -> PyResult<usize> {
    let [height, width] = [mask.shape()[0], mask.shape()[1]];
    let values = mask.as_slice().map_err(|_| PyValueError::new_err("mask: expected C order"))?;
    Ok(py.detach(|| {
        let image = Image { width, height, values: values.to_vec() };
        blobs(&image, true, true).sizes.into_iter().max().unwrap_or(0)
    }))
}

/// For each weight, the pixels (H, W) with the least sum of evidence against them and of the weight times the length of
/// their outline.
#[pyfunction]
pub(super) fn short_outlines<'py>(
    py: Python<'py>,
    evidence: PyReadonlyArray2<'_, f32>,
    weights: Vec<f32>,
    steps: usize,
) -> PyResult<Vec<Bound<'py, PyArray2<bool>>>> {
    let &[height, width] = evidence.shape() else { unreachable!("two dimensions") };
    let values = evidence.as_slice().map_err(|_| PyValueError::new_err("evidence: expected C order"))?;
    let evidence = Image { width, height, values: values.to_vec() };
    let found = py.detach(|| {
        parallel::map(&weights, |&weight| outline::short_outline(&evidence, weight, steps).values)
    });
    found.into_iter().map(|mask| PyArray1::from_vec(py, mask).reshape([height, width])).collect()
}

/// A rope's radius as the width of a mask shows it, pixels; None if it shows no rope.
#[pyfunction]
pub(super) fn shown_radius(py: Python<'_>, mask: PyReadonlyArray2<'_, bool>) -> PyResult<Option<f64>> {
    let width = mask.shape()[1];
    let mask = mask.as_slice().map_err(|_| PyValueError::new_err("mask: expected C order"))?;
    Ok(py.detach(|| Silhouette::shown_radius(mask, width)))
}
