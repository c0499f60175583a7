//! Bindings of masks: silhouettes and their readings.

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::number;
use crate::readings;
use crate::silhouette;

/// An image's polyline, (M, 2).
type PlacesArray<'py> = Bound<'py, numpy::PyArray2<f64>>;

/// One view's mask, prepared.
///
/// Parameters
/// ----------
/// mask : (H, W) ndarray of bool
///     The rope's pixels.
/// radius : float
///     The rope's radius in the image, pixels.
///
/// Raises
/// ------
/// ValueError
///     If the radius is not above half a pixel, or nothing of the mask is rope.
#[pyclass(frozen, module = "strand._core")]
pub(super) struct Silhouette(pub(super) silhouette::Silhouette);

#[pymethods]
impl Silhouette {
    #[new]
    fn new(py: Python<'_>, mask: PyReadonlyArray2<'_, bool>, radius: &Bound<'_, PyAny>) -> PyResult<Self> {
        let radius = number("radius", radius)?;
        if !(radius >= 0.5 && radius.is_finite()) {
            return Err(PyValueError::new_err(format!("radius: expected at least 0.5 pixels, got {radius}")));
        }
        let (width, pixels) = (mask.shape()[1], mask.as_slice()?);
        let made = py.detach(|| silhouette::Silhouette::of_rope(pixels, width, radius));
        made.map(Self).ok_or_else(|| PyValueError::new_err("mask: expected pixels of a rope, got none"))
    }

    /// The rope's radius in the image as the mask shows it, pixels.
    #[getter]
    fn radius(&self) -> f64 {
        self.0.radius_px
    }

    /// Likely ways of ropes through the mask, the best first.
    ///
    /// Parameters
    /// ----------
    /// ropes : int, optional
    ///     How many ropes there are.
    /// most : int
    ///     How many readings to return at most.
    ///
    /// Returns
    /// -------
    /// list of (float, list of (M, 2) ndarray, int)
    ///     What each costs, the columns and rows of its ropes' nodes, pixels, and how many of them were rings.
    fn readings<'py>(
        &self,
        py: Python<'py>,
        ropes: Option<usize>,
        most: usize,
    ) -> PyResult<Vec<(f64, Vec<PlacesArray<'py>>, usize)>> {
        let found = py.detach(|| {
            readings::readings(&self.0, ropes, most)
                .into_iter()
                .map(|r| (r.cost, readings::extended(&self.0, &r.chains), r.rings))
                .collect::<Vec<_>>()
        });
        found
            .into_iter()
            .map(|(cost, chains, rings)| {
                let chains = chains
                    .into_iter()
                    .map(|c| PyArray1::from_vec(py, c.concat()).reshape([c.len(), 2]))
                    .collect::<PyResult<Vec<_>>>()?;
                Ok((cost, chains, rings))
            })
            .collect()
    }
}
