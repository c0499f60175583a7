//! Bindings of views: depth images and the extraction range.

use numpy::PyArray1;
use pyo3::prelude::*;

use super::arguments::{Array, FloatArray, Points, motion, motions, require_same_length, wrong_shape};
use super::arrays::{PointsArray, constant, constant_points, list, points_array};
use super::released::{CHEAP, released, released_if_many};
use crate::checks::check_finite;
use crate::clouds::crop::DepthView;
use crate::clouds::depth::Pinhole;
use crate::clouds::{crop, depth};
use crate::geometry::{self, Point};
use crate::parallel;

/// Copy a depth image, and count its pixels that are not finite; see `strand.View.from_depth`.
///
/// With a `scale`, the image holds uint16, and each unit is that many metres.
#[pyfunction]
#[pyo3(signature = (depth, farthest, scale=None))]
pub(super) fn copy_depth<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    farthest: f64,
    scale: Option<f64>,
) -> PyResult<(PointsArray<'py>, usize)> {
    let (shape, image) = match scale {
        Some(scale) => {
            let units = Array::<u16>::exactly("depth", depth, 2)?;
            let metres = units.slice().iter().map(|&z| f64::from(z) * scale).collect();
            (units.image_shape("depth")?, metres)
        }
        None => {
            let metres = FloatArray::new("depth", depth)?;
            (metres.image_shape("depth")?, metres.into_values())
        }
    };
    let (copy, dropped) =
        released_if_many(py, image.len() / CHEAP, move || depth::cleaned(image, farthest))??;
    Ok((constant(py, copy, shape)?, dropped))
}

/// Copy points into an array that nobody can write to, so that kernels need no copy of their own.
#[pyfunction]
pub(super) fn copy_constant<'py>(py: Python<'py>, points: &Bound<'py, PyAny>) -> PyResult<PointsArray<'py>> {
    let points = FloatArray::new("points", points)?;
    let &[rows, 3] = points.shape() else { return Err(wrong_shape("points", "(N, 3)", points.shape())) };
    constant(py, points.into_values(), [rows, 3])
}

/// Return the (K, 3) mean points of clouds; the origin for one without points.
///
/// `clouds` is a sequence of (N, 3) array_like of float.
#[pyfunction]
pub(super) fn find_centroids<'py>(
    py: Python<'py>,
    clouds: Vec<Bound<'py, PyAny>>,
) -> PyResult<PointsArray<'py>> {
    let clouds = Points::all("clouds", &clouds)?;
    let count: usize = clouds.iter().map(|cloud| cloud.len()).sum();
    points_array(
        py,
        released_if_many(py, count / CHEAP, move || {
            clouds.iter().map(|cloud| geometry::centroid(cloud)).collect()
        })?,
    )
}

/// Return how far a change of the motions of some clouds moves one of their points at most, metres.
///
/// Parameters
/// ----------
/// clouds : sequence of (N, 3) array_like of float
/// before, after : sequence of (4, 4) array_like of float
///     The motion of each cloud.
#[pyfunction]
pub(super) fn measure_shift(
    py: Python<'_>,
    clouds: Vec<Bound<'_, PyAny>>,
    before: Vec<Bound<'_, PyAny>>,
    after: Vec<Bound<'_, PyAny>>,
) -> PyResult<f64> {
    let clouds = Points::all("clouds", &clouds)?;
    let (before, after) = (motions("before", &before)?, motions("after", &after)?);
    for (name, motions) in [("before", &before), ("after", &after)] {
        require_same_length(name, motions.len(), clouds.len())?;
    }
    for cloud in &clouds {
        check_finite("clouds", cloud)?;
    }
    let count: usize = clouds.iter().map(|cloud| cloud.len()).sum();
    released_if_many(py, count / CHEAP, move || {
        let each = clouds.iter().zip(&before).zip(&after);
        each.map(|((cloud, before), after)| geometry::measure_shift(cloud, before, after)).fold(0.0, f64::max)
    })
}

/// Return the points of a depth image, those inside a mask (H, W) if there is one; see `strand.View.from_depth`.
#[pyfunction]
#[pyo3(signature = (depth, focal, center, mask=None))]
pub(super) fn unproject<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    focal: [f64; 2],
    center: [f64; 2],
    mask: Option<Bound<'py, PyAny>>,
) -> PyResult<PointsArray<'py>> {
    let image = FloatArray::new("depth", depth)?;
    let ([height, width], camera) = (image.image_shape("depth")?, Pinhole { focal, center });
    let mask = mask.map(|mask| Array::mask("mask", &mask)).transpose()?;
    if let Some(mask) = mask.as_ref().filter(|mask| mask.shape() != [height, width]) {
        return Err(wrong_shape("mask", &format!("({height}, {width})"), mask.shape()));
    }
    let pixels = image.slice().len();
    let points = released_if_many(py, pixels / CHEAP, move || match mask {
        Some(mask) => depth::unproject_masked(image.slice(), mask.slice(), width, camera),
        None => depth::unproject(image.slice(), width, camera),
    })?;
    constant_points(py, points)
}

/// Return the points of depth images in an extraction range; see `strand.view.cropped`.
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
    let images = FloatArray::all("depths", &depths)?;
    let widths =
        images.iter().map(|image| Ok(image.image_shape("depths")?[1])).collect::<PyResult<Vec<_>>>()?;
    let poses = motions("poses", &poses)?;
    let found = released(py, move || {
        let views: Vec<DepthView> = (images.iter().zip(widths).zip(cameras).zip(poses))
            .map(|(((image, width), [focal, center]), pose)| DepthView {
                depth: image.slice(),
                width,
                camera: Pinhole { focal, center },
                pose,
            })
            .collect();
        crate::crop_images(&views, [low, high])
    })?;
    found.into_iter().map(|points| constant_points(py, points)).collect()
}

/// Return for each view the medians of second differences of its depths, in every `every`-th row and at its points.
#[pyfunction]
pub(super) fn measure_depth_bends(
    py: Python<'_>,
    depths: Vec<Bound<'_, PyAny>>,
    cameras: Vec<[[f64; 2]; 2]>,
    points: Vec<Bound<'_, PyAny>>,
    every: usize,
) -> PyResult<Vec<[f64; 2]>> {
    require_same_length("cameras", cameras.len(), depths.len())?;
    require_same_length("points", points.len(), depths.len())?;
    let (images, clouds) = (FloatArray::all("depths", &depths)?, Points::all("points", &points)?);
    let views = (images.into_iter().zip(cameras).zip(clouds))
        .map(|((image, camera), points)| Ok((image.image_shape("depths")?[1], image, camera, points)))
        .collect::<PyResult<Vec<_>>>()?;
    released(py, move || {
        parallel::map(&views, |(width, image, [focal, center], points)| {
            depth::bends(image.slice(), *width, Pinhole { focal: *focal, center: *center }, points, every)
        })
    })
}

/// Return how much farther along the camera's axis an image saw a surface than each of some points, metres.
#[pyfunction]
pub(super) fn measure_behind<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    camera: [[f64; 2]; 2],
    pose: &Bound<'py, PyAny>,
    points: &Bound<'py, PyAny>,
    nearest: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let image = FloatArray::new("depth", depth)?;
    let ([_, width], [focal, center]) = (image.image_shape("depth")?, camera);
    let (pose, points) = (motion("pose", pose)?, Points::new("points", points, "(N, 3)")?);
    list(
        py,
        released_if_many(py, points.len(), move || {
            depth::seen_behind(image.slice(), width, Pinhole { focal, center }, &pose, &points, nearest)
        })?,
    )
}

/// Keep the points in an extraction range; see `strand.View.crop`.
#[pyfunction]
#[pyo3(signature = (points, pose, low, high, colors = None))]
pub(super) fn crop_points<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    pose: &Bound<'py, PyAny>,
    low: Point,
    high: Point,
    colors: Option<&Bound<'py, PyAny>>,
) -> PyResult<(PointsArray<'py>, Option<PointsArray<'py>>)> {
    let (points, pose) = (Points::new("points", points, "(N, 3)")?, motion("pose", pose)?);
    let colors = colors.map(|colors| Points::new("colors", colors, "(N, 3)")).transpose()?;
    if let Some(colors) = &colors {
        require_same_length("colors", colors.len(), points.len())?;
    }
    let (points, colors) = released(py, move || {
        let kept = crop::crop(&points, &pose, [low, high]);
        let only = |rows: &[Point]| kept.iter().map(|&i| rows[i]).collect();
        (only(&points), colors.map(|colors| only(&colors)))
    })?;
    Ok((constant_points(py, points)?, colors.map(|colors| constant_points(py, colors)).transpose()?))
}
