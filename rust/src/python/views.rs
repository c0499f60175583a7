//! Bindings of what concerns views: depth images, the extraction range, how densely points lie, what cameras saw of places.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::arguments::{
    FloatArray, PointsArray, motion, point, points_array, require_same_length, wrong_shape,
};
use crate::{Point, Result, Saw, Seen, SightView};

/// A copy of a depth image, and how many pixels are not finite; see `strand.View.from_depth`.
#[pyfunction]
pub(super) fn copy_depth<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    farthest: f64,
) -> PyResult<(PointsArray<'py>, usize)> {
    let depth = FloatArray::new("depth", depth)?;
    let (shape, image) = (image_shape(&depth)?, depth.slice()?);
    let (copy, dropped) = py.detach(|| crate::copy_depth(image, farthest))?;
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
    let depth = FloatArray::new("depth", depth)?;
    let ([_, width], image) = (image_shape(&depth)?, depth.slice()?);
    let points = py.detach(|| crate::unproject(image, width, crate::Pinhole { focal, center }));
    points_array(py, points)
}

fn image_shape(depth: &FloatArray) -> PyResult<[usize; 2]> {
    depth.0.shape().try_into().map_err(|_| wrong_shape("depth", "(H, W)", depth.0.shape()))
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
        .zip(&poses)
        .map(|((depth, [focal, center]), pose)| {
            Ok(crate::DepthView {
                depth: depth.slice()?,
                width: image_shape(depth)?[1],
                camera: crate::Pinhole { focal, center },
                pose: motion("poses", pose)?,
            })
        })
        .collect::<PyResult<Vec<_>>>()?;
    let found = py.detach(|| crate::crop_images(&views, [low, high]));
    found.into_iter().map(|points| points_array(py, points)).collect()
}

/// Keep the points in an extraction range; see `strand.View.crop`.
#[pyfunction]
#[pyo3(signature = (points, pose, low, high, colors=None))]
pub(super) fn crop<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    pose: &Bound<'py, PyAny>,
    low: Point,
    high: Point,
    colors: Option<&Bound<'py, PyAny>>,
) -> PyResult<(PointsArray<'py>, Option<PointsArray<'py>>)> {
    let points = FloatArray::new("points", points)?;
    let (points, pose) = (points.rows("points", "(N, 3)")?, motion("pose", pose)?);
    let kept = py.detach(|| crate::crop(points, &pose, [low, high]));
    let only = |rows: &[Point]| points_array(py, kept.iter().map(|&i| rows[i]).collect());
    let colors = colors.map(|colors| FloatArray::new("colors", colors)).transpose()?;
    let colors = colors.map(|colors| {
        let colors = colors.rows("colors", "(N, 3)")?;
        require_same_length("colors", colors.len(), points.len())?;
        only(colors)
    });
    Ok((only(points)?, colors.transpose()?))
}

/// The usual number of other points within a radius of a point.
#[pyfunction]
pub(super) fn usual_neighbors(py: Python<'_>, points: &Bound<'_, PyAny>, radius: f64) -> PyResult<usize> {
    let points = FloatArray::new("points", points)?;
    let points = points.rows("points", "(N, 3)")?;
    Ok(py.detach(|| crate::usual_neighbors(points, radius))?)
}

/// How many cubes of an even lattice hold points of some clouds.
#[pyfunction]
pub(super) fn occupied_cubes(py: Python<'_>, points: Vec<Bound<'_, PyAny>>, side: f64) -> PyResult<usize> {
    let arrays = FloatArray::all("points", &points)?;
    let points: Vec<&[Point]> = arrays.iter().map(|a| a.rows("points", "(N, 3)")).collect::<PyResult<_>>()?;
    Ok(py.detach(|| crate::occupied_cubes(&points, side))?)
}

/// Whether places hide a stretch of string from a camera.
#[pyfunction]
pub(super) fn hides(
    others: &Bound<'_, PyAny>,
    stretch: &Bound<'_, PyAny>,
    camera: &Bound<'_, PyAny>,
    distance: f64,
) -> PyResult<bool> {
    let (others, stretch) = (FloatArray::new("others", others)?, FloatArray::new("stretch", stretch)?);
    let (others, stretch) = (others.rows("others", "(N, 3)")?, stretch.rows("stretch", "(M, 3)")?);
    Ok(crate::hides(others, stretch, point("camera", camera)?, distance))
}

/// An answer for each of several places.
fn each<'py>(
    places: &Bound<'py, PyAny>,
    ask: impl FnOnce(&[Point]) -> Result<Vec<bool>>,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let array = FloatArray::new("places", places)?;
    Ok(PyArray1::from_vec(places.py(), ask(array.rows("places", "(N, 3)")?)?))
}

/// What all views saw, for questions about places; see `strand.visibility.Sight`.
#[pyclass(frozen, module = "strand._core")]
pub(super) struct Sight(crate::Sight);

#[pymethods]
impl Sight {
    #[new]
    fn new(
        py: Python<'_>,
        saw: Vec<Bound<'_, PyAny>>,
        about: Vec<Bound<'_, PyAny>>,
        poses: Vec<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        require_same_length("about", about.len(), saw.len())?;
        require_same_length("poses", poses.len(), saw.len())?;
        // a depth image with its camera, or points
        let saw = saw
            .iter()
            .map(|saw| match saw.extract::<(Bound<'_, PyAny>, [f64; 2], [f64; 2])>() {
                Ok((depth, focal, center)) => {
                    Ok((FloatArray::new("saw", &depth)?, Some(crate::Pinhole { focal, center })))
                }
                Err(_) => Ok((FloatArray::new("saw", saw)?, None)),
            })
            .collect::<PyResult<Vec<_>>>()?;
        let about = FloatArray::all("about", &about)?;
        let views: Vec<SightView> = (saw.iter().zip(&about).zip(&poses))
            .map(|(((saw, camera), about), pose)| {
                Ok(SightView {
                    saw: match *camera {
                        Some(camera) => Saw::Image(saw.slice()?, image_shape(saw)?[1], camera),
                        None => Saw::Points(saw.rows("saw", "(N, 3)")?),
                    },
                    about: about.rows("about", "(N, 3)")?,
                    pose: motion("poses", pose)?,
                })
            })
            .collect::<PyResult<_>>()?;
        Ok(Self(py.detach(|| crate::Sight::new(&views))?))
    }

    /// (V, N) What each view saw of tubes about places: 0 unknown, 1 hidden, 2 supported, 3 empty.
    fn states<'py>(
        &self,
        py: Python<'py>,
        places: &Bound<'py, PyAny>,
        radius: f64,
    ) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let places = FloatArray::new("places", places)?;
        let places = places.rows("places", "(N, 3)")?;
        let mut states = Vec::with_capacity(self.0.views() * places.len());
        for view in 0..self.0.views() {
            states.extend(self.0.seen(view, places, radius)?.into_iter().map(|seen| match seen {
                Seen::Unknown => 0,
                Seen::Hidden => 1,
                Seen::Supported => 2,
                Seen::Empty => 3,
            }));
        }
        PyArray1::from_vec(py, states).reshape([self.0.views(), places.len()])
    }

    /// (N,) Whether the views say that there is no string.
    fn empty<'py>(&self, places: &Bound<'py, PyAny>, radius: f64) -> PyResult<Bound<'py, PyArray1<bool>>> {
        each(places, |places| self.0.empty(places, radius))
    }

    /// (N,) Whether some view saw through the facing side of a tube.
    fn seen_through<'py>(
        &self,
        places: &Bound<'py, PyAny>,
        direction: Point,
        radius: f64,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        each(places, |places| self.0.seen_through(places, direction, radius))
    }

    /// (N,) Whether no view could have seen a string there.
    fn hidden<'py>(&self, places: &Bound<'py, PyAny>, radius: f64) -> PyResult<Bound<'py, PyArray1<bool>>> {
        each(places, |places| self.0.hidden(places, radius))
    }
}
