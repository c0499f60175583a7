//! Bindings of the results of a fit to images.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

use super::arrays::{PointsArray, array, list, points_array};
use crate::geometry::Point;
use crate::images::imagefit::{self, OnChain};

/// Ropes fitted to masks and depth.
#[pyclass(frozen, module = "strand._core")]
pub(super) struct ImageFit {
    pub(super) fit: Arc<imagefit::ImageFit>,
    pub(super) reference: usize,
    pub(super) noise: f64,
    pub(super) pairs: Vec<Vec<[OnChain; 2]>>,
    pub(super) margins: Vec<f64>,
}

#[pymethods]
impl ImageFit {
    /// Control points (n, 3) of each rope's uniform cubic B-spline, metres.
    #[getter]
    fn controls<'py>(&self, py: Python<'py>) -> PyResult<Vec<PointsArray<'py>>> {
        self.fit.curves.iter().map(|curve| points_array(py, curve.control.clone())).collect()
    }

    /// Nodes (M, 3) of each rope, half a radius apart, metres.
    #[getter]
    fn nodes<'py>(&self, py: Python<'py>) -> PyResult<Vec<PointsArray<'py>>> {
        self.fit.nodes.iter().map(|nodes| points_array(py, nodes.clone())).collect()
    }

    /// Covariances (M, 3, 3) of each rope's nodes, m²; empty without `uncertainty`.
    #[getter]
    fn covariances<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray3<f64>>>> {
        let flat = |c: &Vec<[Point; 3]>| array(py, c.concat().concat(), [c.len(), 3, 3]);
        self.fit.covariances.iter().map(flat).collect()
    }

    /// (V, 6) corrections of the cameras' frames: rotation vector, radians, and translation, metres.
    #[getter]
    fn corrections<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array(py, self.fit.corrections.concat(), [self.fit.corrections.len(), 6])
    }

    /// The view in which it began.
    #[getter]
    fn reference(&self) -> usize {
        self.reference
    }

    /// Noise of depth about a smooth rope, radii.
    #[getter]
    fn noise(&self) -> f64 {
        self.noise
    }

    /// Standard deviation of depth about the curves, and the correlation length of its errors, radii; None if there is
    /// too little depth.
    #[getter]
    fn scatter(&self) -> Option<(f64, f64)> {
        self.fit.depth.map(|depth| (depth.sd, depth.length))
    }

    /// Standard deviation of the masks' edges about the outline, pixels; None if there is too little edge.
    #[getter]
    fn lateral(&self) -> Option<f64> {
        self.fit.lateral
    }

    /// (V,) distances by which each view sees ropes too far away, radii.
    #[getter]
    fn biases<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        list(py, self.fit.biases.iter().map(|bias| -bias).collect())
    }

    /// What it leaves unexplained: areas of uncovered mask, of the tube's middle outside masks, and of its sides that
    /// spill over their edge, squared image radii; sum of squared depth residuals and number of independent ones;
    /// ∫κ² ds and ∫(dκ/ds)² ds, in radii.
    #[getter]
    fn misfit(&self) -> [f64; 7] {
        let m = self.fit.misfit;
        [m.uncovered, m.outside, m.spilled, m.depth, m.depths, m.bend, m.change]
    }

    /// (V, 3) areas of uncovered mask, of the tube's middle outside the mask, and of its sides that spill over its edge,
    /// in each view, squared image radii.
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array(py, self.fit.areas.concat(), [self.fit.areas.len(), 3])
    }

    /// Crossings in the view in which it began: positions, world frame, metres, and the extra cost of the opposite
    /// order.
    #[getter]
    fn crossings(&self) -> Vec<(Point, f64)> {
        let place = |on: OnChain| {
            let nodes = &self.fit.nodes[on.chain];
            nodes[(on.share * (nodes.len() - 1) as f64).round() as usize]
        };
        self.pairs
            .iter()
            .zip(&self.margins)
            .filter_map(|(pairs, &margin)| Some((place(pairs.get(pairs.len() / 2)?[0]), margin)))
            .collect()
    }
}
