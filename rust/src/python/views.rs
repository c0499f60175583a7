//! Bindings of views: depth images and the extraction range.

use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::arguments::{
    FloatArray, PointsArray, motion, motions, points_array, require_same_length, wrong_shape,
};
use crate::{DepthView, Pinhole, Point, crop, depth};

/// A copy of a depth image, and how many pixels are not finite; see `strand.View.from_depth`.
#[pyfunction]
pub(super) fn copy_depth<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    farthest: f64,
) -> PyResult<(PointsArray<'py>, usize)> {
    let array = FloatArray::new("depth", depth)?;
    let (shape, image) = (image_shape("depth", &array)?, array.slice()?);
    let (copy, dropped) = py.detach(|| depth::copy_depth(image, farthest))?;
    Ok((PyArray1::from_vec(py, copy).reshape(shape)?, dropped))
}

/// The points of a depth image; see `strand.View.from_depth`.
#[pyfunction]
pub(super) fn unproject<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    focal: [f64; 2],
    center: [f64; 2],
) -> PyResult<PointsArray<'py>> {
    let array = FloatArray::new("depth", depth)?;
    let ([_, width], image) = (image_shape("depth", &array)?, array.slice()?);
    let points = py.detach(|| depth::unproject(image, width, Pinhole { focal, center }));
    points_array(py, points)
}

pub(super) fn image_shape(name: &str, depth: &FloatArray) -> PyResult<[usize; 2]> {
    depth.0.shape().try_into().map_err(|_| wrong_shape(name, "(H, W)", depth.0.shape()))
}

/// The points of depth images in an extraction range; see `strand.view.cropped`.
#[pyfunction]
pub(super) fn crop_images<'py>(
    py: Python<'py>,
    depths: Vec<Bound<'py, PyAny>>,
    cameras: Vec<[[f64; 2]; 2]>,
    poses: Vec<Bound<'py, PyAny>>,
    low: Point,
    high: Point,
) -> PyResult<Vec<PointsArray<'py>>> {
    require_same_length("cameras", cameras.len(), depths.len())?;
    require_same_length("poses", poses.len(), depths.len())?;
    let depths = FloatArray::all("depths", &depths)?;
    let views = depths
        .iter()
        .zip(cameras)
        .zip(motions("poses", &poses)?)
        .map(|((depth, [focal, center]), pose)| {
            let [_, width] = image_shape("depths", depth)?;
            Ok(DepthView { depth: depth.slice()?, width, camera: Pinhole { focal, center }, pose })
        })
        .collect::<PyResult<Vec<_>>>()?;
    let found = py.detach(|| crate::crop_images(&views, [low, high]));
    found.into_iter().map(|points| points_array(py, points)).collect()
}

/// Keep the points in an extraction range; see `strand.View.crop`.
#[pyfunction]
#[pyo3(name = "crop", signature = (points, pose, low, high, colors = None))]
pub(super) fn crop_points<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    pose: &Bound<'py, PyAny>,
    low: Point,
    high: Point,
    colors: Option<&Bound<'py, PyAny>>,
) -> PyResult<(PointsArray<'py>, Option<PointsArray<'py>>)> {
    let points = FloatArray::new("points", points)?;
    let (points, pose) = (points.rows("points", "(N, 3)")?, motion("pose", pose)?);
    let kept = py.detach(|| crop::crop(points, &pose, [low, high]));
    let only = |rows: &[Point]| points_array(py, kept.iter().map(|&i| rows[i]).collect());
    let colors = colors.map(|colors| FloatArray::new("colors", colors)).transpose()?;
    let colors = colors.map(|colors| {
        let colors = colors.rows("colors", "(N, 3)")?;
        require_same_length("colors", colors.len(), points.len())?;
        only(colors)
    });
    Ok((only(points)?, colors.transpose()?))
}
