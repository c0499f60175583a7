//! Bindings of space as the cameras saw it.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use super::arguments::{FloatArray, Points, motions, point, require_same_length};
use super::arrays::{array, list};
use super::released::{released, released_if_many};
use crate::clouds::depth::Pinhole;
use crate::clouds::visibility::{self, Observed, Occupancy, VisibilityView};
use crate::error::{Error, Result};
use crate::geometry::Point;

/// Return whether any of `others` occludes a stretch of rope from a camera.
///
/// It does if it lies within `distance` of a line of sight, in front of the stretch or beside it.
#[pyfunction]
pub(super) fn occludes(
    py: Python<'_>,
    others: &Bound<'_, PyAny>,
    stretch: &Bound<'_, PyAny>,
    camera: &Bound<'_, PyAny>,
    distance: f64,
) -> PyResult<bool> {
    let (others, stretch) =
        (Points::new("others", others, "(N, 3)")?, Points::new("stretch", stretch, "(M, 3)")?);
    let camera = point("camera", camera)?;
    // every pair
    let effort = others.len().saturating_mul(stretch.len()) / 16;
    released_if_many(py, effort, move || visibility::occludes(&others, &stretch, camera, distance))
}

/// Free and occupied space as all views saw it.
///
/// Parameters
/// ----------
/// observed : sequence of (N, 3) array_like or (depth, focal, center)
///     All data of each view: points in the camera frame, metres; or a depth image (H, W), metres, with the focal lengths
///     and the principal point of its camera, pixels.
/// about : sequence of (M, 3) array_like of float
///     For each view, points in the camera frame near all places that callers will ask about, metres.
/// poses : sequence of (4, 4) array_like of float
///     Camera to world.
#[pyclass(frozen, module = "strand._core")]
pub(super) struct Visibility(Arc<visibility::Visibility>);

/// The data of a view, as passed by the caller.
enum Saw {
    Points(Points),
    Image(FloatArray, usize, Pinhole),
}

#[pymethods]
impl Visibility {
    /// The view has no points in that direction.
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
                    let image = FloatArray::new("observed", &depth)?;
                    let [_, width] = image.image_shape("observed")?;
                    Ok(Saw::Image(image, width, Pinhole { focal, center }))
                }
                Err(_) => Ok(Saw::Points(Points::new("observed", saw, "(N, 3)")?)),
            })
            .collect::<PyResult<Vec<_>>>()?;
        let points = |(i, value)| Points::new(&format!("about[{i}]"), value, "(M, 3)");
        let about = about.iter().enumerate().map(points).collect::<PyResult<Vec<_>>>()?;
        let poses = motions("poses", &poses)?;
        let found = released(py, move || {
            let views: Vec<VisibilityView> = (observed.iter().zip(&about).zip(poses))
                .map(|((observed, about), pose)| {
                    let observed = match observed {
                        Saw::Image(image, width, camera) => Observed::Image(image.slice(), *width, *camera),
                        Saw::Points(points) => Observed::Points(points),
                    };
                    VisibilityView { observed, about, pose }
                })
                .collect();
            visibility::Visibility::new(&views)
        })??;
        Ok(Self(Arc::new(found)))
    }

    /// Return (V, N) states of tubes around places: UNKNOWN, OCCLUDED, OCCUPIED or FREE.
    fn states<'py>(
        &self,
        py: Python<'py>,
        places: &Bound<'py, PyAny>,
        radius: f64,
    ) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let places = Points::new("places", places, "(N, 3)")?;
        let (seen, shape) = (self.0.clone(), [self.0.views(), places.len()]);
        let states = released_if_many(py, places.len(), move || {
            let mut states = Vec::with_capacity(seen.views() * places.len());
            for view in 0..seen.views() {
                states.extend(seen.states(view, &places, radius)?.into_iter().map(|state| match state {
                    Occupancy::Unknown => Self::UNKNOWN,
                    Occupancy::Occluded => Self::OCCLUDED,
                    Occupancy::Occupied => Self::OCCUPIED,
                    Occupancy::Free => Self::FREE,
                }));
            }
            Ok::<_, Error>(states)
        })??;
        array(py, states, shape)
    }

    /// Return (N,) whether the space at places is free: more views saw it free than occupied.
    fn free<'py>(&self, places: &Bound<'py, PyAny>, radius: f64) -> PyResult<Bound<'py, PyArray1<bool>>> {
        self.each(places, move |seen, places| seen.free(places, radius))
    }

    /// Return (N,) whether places are occluded in all views or outside their images.
    fn occluded<'py>(&self, places: &Bound<'py, PyAny>, radius: f64) -> PyResult<Bound<'py, PyArray1<bool>>> {
        self.each(places, move |seen, places| seen.occluded(places, radius))
    }

    /// Return (N,) whether a view saw through the near side of a tube along `direction`, a unit vector.
    fn seen_through<'py>(
        &self,
        places: &Bound<'py, PyAny>,
        direction: &Bound<'py, PyAny>,
        radius: f64,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let direction = point("direction", direction)?;
        self.each(places, move |seen, places| seen.seen_through(places, direction, radius))
    }
}

impl Visibility {
    /// Answers for each of several places.
    fn each<'py>(
        &self,
        places: &Bound<'py, PyAny>,
        ask: impl FnOnce(&visibility::Visibility, &[Point]) -> Result<Vec<bool>> + Send + 'static,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let (py, seen) = (places.py(), self.0.clone());
        let places = Points::new("places", places, "(N, 3)")?;
        list(py, released_if_many(py, places.len(), move || ask(&seen, &places))??)
    }
}
