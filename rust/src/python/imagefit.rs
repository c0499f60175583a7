//! Ropes fitted to images.

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{FloatArray, motions};
use super::views::image_shape;
use crate::imagefit::{ImageFitOptions, Medians, Plane, RopeView, Sensor, fit, lift};
use crate::silhouette::Silhouette;
use crate::{Pinhole, Point};

type Answer = (
    Vec<Vec<Point>>,
    Vec<Vec<[Point; 3]>>,
    Vec<[f64; 6]>,
    Vec<f64>,
    [f64; 6],
    f64,
    Vec<(bool, f64, f64, f64)>,
    [f64; 3],
);

/// Fits chains of one view's image to all views.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub(super) fn fit_image(
    depths: Vec<Bound<'_, PyAny>>,
    masks: Vec<PyReadonlyArray2<'_, bool>>,
    camera: [[f64; 2]; 2],
    poses: Vec<Bound<'_, PyAny>>,
    radii_px: Vec<f64>,
    hypotheses: Vec<(usize, Vec<Vec<[f64; 2]>>)>,
    radius: f64,
    plane: Option<(Point, f64)>,
    held: Option<usize>,
    iterations: usize,
    uncertainty: bool,
) -> PyResult<Vec<Option<Answer>>> {
    let depths = FloatArray::all("depths", &depths)?;
    let masks: Vec<&[bool]> = masks
        .iter()
        .map(|m| m.as_slice().map_err(|e| PyValueError::new_err(e.to_string())))
        .collect::<PyResult<_>>()?;
    let poses = motions("poses", &poses)?;
    let mut silhouettes = Vec::new();
    for ((depth, mask), rr) in depths.iter().zip(&masks).zip(radii_px) {
        let [_, width] = image_shape("depths", depth)?;
        silhouettes.push(
            Silhouette::new(mask, width, rr, 3).ok_or_else(|| PyValueError::new_err("mask: is empty"))?,
        );
    }
    let mut views = Vec::new();
    for (((depth, mask), pose), silhouette) in depths.iter().zip(&masks).zip(poses).zip(&silhouettes) {
        let [height, width] = image_shape("depths", depth)?;
        views.push(RopeView {
            silhouette,
            medians: Medians::new(depth.slice()?, mask, width, silhouette),
            pinhole: Pinhole { focal: camera[0], center: camera[1] },
            pose,
            size: [width, height],
        });
    }
    let _ = depths[0].0.shape();
    let plane = plane.map(|(normal, offset)| Plane { normal, offset });
    let sensor = Sensor::DEFAULT;
    Ok(hypotheses
        .iter()
        .map(|(reference, chains)| {
            let start = std::time::Instant::now();
            let lifted = lift(&views[*reference], chains, radius, plane, &sensor)?;
            let lifting = start.elapsed().as_secs_f64();
            let pairs: Vec<_> = lifted.crossings.iter().map(|c| c.ordered().collect()).collect();
            let options = ImageFitOptions {
                iterations,
                reference: *reference,
                held,
                pose_sd: [0.4f64.to_radians(), 1.5e-3],
                noise: lifted.sigma,
                uncertainty,
            };
            let fitted = fit(&views, &lifted.nodes, radius, plane, &pairs, &sensor, &options)?;
            let m = fitted.misfit;
            let crossings = lifted
                .crossings
                .iter()
                .map(|c| {
                    let middle = c.pairs[c.pairs.len() / 2];
                    (c.first_on_top, c.margin, middle[0].share, middle[1].share)
                })
                .collect();
            Some((
                fitted.nodes,
                fitted.covariances,
                fitted.corrections,
                fitted.biases,
                [m.uncovered, m.outside, m.depth, m.bend, m.change, m.depths],
                lifted.sigma,
                crossings,
                [lifting, start.elapsed().as_secs_f64() - lifting, fitted.iterations as f64],
            ))
        })
        .collect())
}
