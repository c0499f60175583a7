//! Bindings of space as the cameras saw it.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use super::arguments::{FloatArray, motions, point, require_same_length};
use super::views::image_shape;
use crate::visibility::{self, Observed, Occupancy, VisibilityView};
use crate::{Pinhole, Point, Result};

/// Whether any of `others` occludes a stretch of rope from a camera.
///
/// It does where it lies within `distance` of a line of sight, in front of the stretch or beside it.
#[pyfunction]
pub(super) fn occludes(
    others: &Bound<'_, PyAny>,
    stretch: &Bound<'_, PyAny>,
    camera: &Bound<'_, PyAny>,
    distance: f64,
) -> PyResult<bool> {
    let (others, stretch) = (FloatArray::new("others", others)?, FloatArray::new("stretch", stretch)?);
    let (others, stretch) = (others.rows("others", "(N, 3)")?, stretch.rows("stretch", "(M, 3)")?);
    Ok(visibility::occludes(others, stretch, point("camera", camera)?, distance))
}

/// What all views saw of space, for questions about places.
///
/// Parameters
/// ----------
/// observed : sequence of (N, 3) array_like or (depth, focal, center)
///     What each view saw, all of it: points in the camera frame, metres, or a depth image (H, W), metres, with the
///     focal lengths and the centre of its camera, pixels.
/// about : sequence of (M, 3) array_like of float
///     For each view, points in the camera frame near all places that will be asked about, metres.
/// poses : sequence of (4, 4) array_like of float
///     Camera to world.
///
/// Raises
/// ------
/// TypeError
///     If a cloud does not hold floating point numbers.
/// ValueError
///     If the sequences differ in length, a shape is wrong, a coordinate is not finite, or a pose is no rigid motion.
#[pyclass(frozen, module = "strand._core")]
pub(super) struct Visibility(visibility::Visibility);

#[pymethods]
impl Visibility {
    /// No points in that direction.
    #[classattr]
    const UNKNOWN: i64 = 0;
    /// All points in that direction lie in front of the place.
    #[classattr]
    const OCCLUDED: i64 = 1;
    /// Points lie where the surface of a tube around the place would be.
    #[classattr]
    const OCCUPIED: i64 = 2;
    /// All points in that direction lie behind the place.
    #[classattr]
    const FREE: i64 = 3;

    #[new]
    fn new(
        py: Python<'_>,
        observed: Vec<Bound<'_, PyAny>>,
        about: Vec<Bound<'_, PyAny>>,
        poses: Vec<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        require_same_length("about", about.len(), observed.len())?;
        require_same_length("poses", poses.len(), observed.len())?;
        // a depth image with its camera, or points
        let observed = observed
            .iter()
            .map(|saw| match saw.extract::<(Bound<'_, PyAny>, [f64; 2], [f64; 2])>() {
                Ok((depth, focal, center)) => {
                    Ok((FloatArray::new("observed", &depth)?, Some(Pinhole { focal, center })))
                }
                Err(_) => Ok((FloatArray::new("observed", saw)?, None)),
            })
            .collect::<PyResult<Vec<_>>>()?;
        let about = FloatArray::all("about", &about)?;
        let views: Vec<VisibilityView> = (observed.iter().zip(&about).zip(motions("poses", &poses)?))
            .map(|(((observed, camera), about), pose)| {
                let observed = match *camera {
                    Some(camera) => {
                        Observed::Image(observed.slice()?, image_shape("observed", observed)?[1], camera)
                    }
                    None => Observed::Points(observed.rows("observed", "(N, 3)")?),
                };
                Ok(VisibilityView { observed, about: about.rows("about", "(M, 3)")?, pose })
            })
            .collect::<PyResult<_>>()?;
        Ok(Self(py.detach(|| visibility::Visibility::new(&views))?))
    }

    /// (V, N) What each view saw of tubes around places: UNKNOWN, OCCLUDED, OCCUPIED or FREE.
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
            states.extend(self.0.states(view, places, radius)?.into_iter().map(|state| match state {
                Occupancy::Unknown => Self::UNKNOWN,
                Occupancy::Occluded => Self::OCCLUDED,
                Occupancy::Occupied => Self::OCCUPIED,
                Occupancy::Free => Self::FREE,
            }));
        }
        PyArray1::from_vec(py, states).reshape([self.0.views(), places.len()])
    }

    /// (N,) Whether the space at places is free: more views saw it free than occupied.
    fn free<'py>(&self, places: &Bound<'py, PyAny>, radius: f64) -> PyResult<Bound<'py, PyArray1<bool>>> {
        each(places, |places| self.0.free(places, radius))
    }

    /// (N,) Whether places are occluded from all views or outside what these saw.
    fn occluded<'py>(&self, places: &Bound<'py, PyAny>, radius: f64) -> PyResult<Bound<'py, PyArray1<bool>>> {
        each(places, |places| self.0.occluded(places, radius))
    }

    /// (N,) Whether some view saw through the near side of a tube along `direction`, a unit vector.
    fn seen_through<'py>(
        &self,
        places: &Bound<'py, PyAny>,
        direction: &Bound<'py, PyAny>,
        radius: f64,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let direction = point("direction", direction)?;
        each(places, |places| self.0.seen_through(places, direction, radius))
    }
}

/// An answer for each of several places.
fn each<'py>(
    places: &Bound<'py, PyAny>,
    ask: impl FnOnce(&[Point]) -> Result<Vec<bool>>,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let array = FloatArray::new("places", places)?;
    Ok(PyArray1::from_vec(places.py(), ask(array.rows("places", "(N, 3)")?)?))
}
