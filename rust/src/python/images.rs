//! Bindings of ropes in images: readings of masks, and fits to masks and depth.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{number, require_same_length};
use super::arrays::{array, list};
use super::errors::NotEnoughDataError;
use super::image_fit::ImageFit;
use super::released::released;
use crate::checks::check_positive;
use crate::geometry::Point;
use crate::images::imagefit::{self, DepthScene, ImageFitOptions, OnChain, Plane, Prepared, RopeView};
use crate::images::readings;
use crate::parallel;
use checks::{Errors, check_corrections, check_fit, nodes_of, places, plane_of, sensor, views_of};

mod checks;

/// A polyline in an image, (M, 2).
type PlacesArray<'py> = Bound<'py, PyArray2<f64>>;
/// The view of a reading, and the columns and rows of its ropes' nodes.
type Hypothesis<'py> = (usize, Vec<Bound<'py, PyAny>>);

/// Views with masks of ropes of one radius.
///
/// Parameters
/// ----------
/// depths : sequence of (H, W) ndarray
///     Depth along each camera's z axis, metres; 0 or NaN where there is no return.
/// masks : sequence of (H, W) ndarray of bool
///     The ropes' pixels.
/// cameras : sequence of (2, 2) sequence of float
///     Focal lengths and principal point of each, pixels.
/// poses : sequence of (4, 4) ndarray
///     Camera to world.
/// radius : float
///     The ropes' radius, metres.
/// mask_radii : sequence of (float or None), optional
///     The radii of masks that are wider than the ropes, pixels.
#[pyclass(frozen, module = "strand._core")]
pub(super) struct RopeImages(Arc<Prepareds>);

/// Prepared views, shared by work without the GIL.
struct Prepareds {
    views: Vec<Prepared>,
    radius: f64,
}

#[pymethods]
impl RopeImages {
    #[new]
    #[pyo3(signature = (depths, masks, cameras, poses, radius, mask_radii=None))]
    fn new(
        py: Python<'_>,
        depths: Vec<Bound<'_, PyAny>>,
        masks: Vec<Bound<'_, PyAny>>,
        cameras: Vec<[[f64; 2]; 2]>,
        poses: Vec<Bound<'_, PyAny>>,
        radius: &Bound<'_, PyAny>,
        mask_radii: Option<Vec<Option<f64>>>,
    ) -> PyResult<Self> {
        let radius = number("radius", radius)?;
        check_positive("radius", radius)?;
        let inputs = views_of(depths, &masks, cameras, &poses, mask_radii)?;
        let views = released(py, move || {
            parallel::map(&inputs, |v| {
                Prepared::new(v.depth.slice(), v.mask.slice(), v.size, v.pinhole, v.pose, radius, v.mask_px)
            })
        })?;
        let views: Option<Vec<Prepared>> = views.into_iter().collect();
        let views =
            views.ok_or_else(|| NotEnoughDataError::new_err("masks: no pixels of a rope with depth"))?;
        Ok(Self(Arc::new(Prepareds { views, radius })))
    }

    /// (V,) radii that the masks show, whatever the ropes' are, pixels.
    #[getter]
    fn shown<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        list(py, self.0.views.iter().map(|v| v.silhouette.shown_px).collect())
    }

    /// (V,) radii of the ropes in each image, corrected by the mask, pixels.
    #[getter]
    fn radii<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        list(py, self.0.views.iter().map(|v| v.silhouette.radius_px).collect())
    }

    /// Find likely courses of the ropes through each mask.
    ///
    /// Parameters
    /// ----------
    /// ropes : int, optional
    ///     The number of ropes.
    /// most : int
    ///     Readings of each view at most.
    /// views : sequence of int
    ///     The views to read.
    ///
    /// Returns
    /// -------
    /// list of (float, int, list of (M, 2) ndarray, int)
    ///     For each reading: its cost, its view, the columns and rows of its ropes' nodes, pixels, and the number of ropes
    ///     that were rings. The best of each view come first.
    #[allow(clippy::type_complexity)]
    fn find_readings<'py>(
        &self,
        py: Python<'py>,
        ropes: Option<usize>,
        most: usize,
        views: Vec<usize>,
    ) -> PyResult<Vec<(f64, usize, Vec<PlacesArray<'py>>, usize)>> {
        let of = self.0.clone();
        if let Some(view) = views.iter().find(|&&view| view >= of.views.len()) {
            return Err(PyValueError::new_err(format!("views: there is no view {view}")));
        }
        let found = released(py, move || {
            let found = parallel::map(&views, |&view| {
                let view = &of.views[view];
                let found = readings::find_readings(&view.silhouette, ropes, most);
                parallel::map(&found, |r| (r.cost, readings::extend(&view.silhouette, &r.chains), r.rings))
            });
            views.into_iter().zip(found).collect::<Vec<_>>()
        })?;
        let mut answer = Vec::new();
        for (view, found) in found {
            for (cost, chains, rings) in found {
                let chains = chains
                    .into_iter()
                    .map(|c| array(py, c.concat(), [c.len(), 2]))
                    .collect::<PyResult<Vec<_>>>()?;
                answer.push((cost, view, chains, rings));
            }
        }
        Ok(answer)
    }

    /// Return the cost of a view's reading with these polylines, (M, 2), pixels, without ends, kisses and gaps.
    fn price_reading(&self, py: Python<'_>, view: usize, chains: Vec<Bound<'_, PyAny>>) -> PyResult<f64> {
        let of = self.0.clone();
        if view >= of.views.len() {
            return Err(PyValueError::new_err(format!("view: there is no view {view}")));
        }
        let chains = chains.iter().map(places).collect::<PyResult<Vec<_>>>()?;
        released(py, move || {
            let seen = &of.views[view];
            let step = 0.5 * seen.silhouette.radius_px;
            let chains: Vec<_> = chains.iter().map(|c| readings::resampled(c, step)).collect();
            readings::price(&seen.silhouette, &chains)
        })
    }

    /// Fit ropes to masks and depth of all views, starting from polylines in one view's image.
    ///
    /// Parameters
    /// ----------
    /// hypotheses : sequence of (int, sequence of (M, 2) ndarray)
    ///     The view and its polylines, pixels.
    /// plane : ((3,), float) or None
    ///     The table: n and n.x.
    /// held : int
    ///     The view whose pose is held.
    /// pose_sd : (float, float)
    ///     Standard deviations of the other poses: radians, metres.
    /// errors : (float or None, float, float, float)
    ///     Standard deviation of the depth of a disc in the rope's middle, radii, None to estimate it; correlation length of
    ///     its errors along the rope, radii; standard deviation of the mask's edge, pixels; distance by which ropes appear too
    ///     far away, radii.
    /// iterations : int
    /// uncertainty : bool
    ///     Whether to compute covariances.
    /// among : sequence of int, optional
    ///     The views that count, with those of the hypotheses and the held one; all by default. Others get no corrections.
    ///
    /// Returns
    /// -------
    /// list of (ImageFit or None)
    ///     None for a hypothesis without depth.
    #[allow(clippy::too_many_arguments)]
    #[pyo3(signature = (hypotheses, plane, held, pose_sd, errors, iterations, uncertainty, among=None))]
    fn fit(
        &self,
        py: Python<'_>,
        hypotheses: Vec<Hypothesis<'_>>,
        plane: Option<(Point, f64)>,
        held: usize,
        pose_sd: [f64; 2],
        errors: Errors,
        iterations: usize,
        uncertainty: bool,
        among: Option<Vec<usize>>,
    ) -> PyResult<Vec<Option<ImageFit>>> {
        let among = among.unwrap_or_else(|| (0..self.0.views.len()).collect());
        if let Some(view) = among.iter().find(|&&view| view >= self.0.views.len()) {
            return Err(PyValueError::new_err(format!("among: there is no view {view}")));
        }
        let place = |name: &str, view: usize| {
            let place = among.iter().position(|&other| other == view);
            place.ok_or_else(|| PyValueError::new_err(format!("{name}: there is no view {view} among them")))
        };
        let held = place("held", held)?;
        let hypotheses = hypotheses
            .iter()
            .map(|(view, chains)| {
                let chains = chains.iter().map(places).collect::<PyResult<Vec<_>>>()?;
                Ok((place("hypotheses", *view)?, chains))
            })
            .collect::<PyResult<Vec<_>>>()?;
        check_fit(pose_sd, errors, iterations)?;
        let plane = plane.map(plane_of).transpose()?;
        let (sensor, of) = (sensor(errors), self.0.clone());
        released(py, move || {
            let views: Vec<RopeView> = among.iter().map(|&view| of.views[view].rope_view()).collect();
            parallel::map(&hypotheses, |(reference, chains)| {
                let lifted = imagefit::lift(&views[*reference], chains, of.radius, plane, &sensor)?;
                let options = ImageFitOptions {
                    iterations,
                    far: imagefit::count_far(iterations),
                    reference: *reference,
                    held: Some(held),
                    pose_sd,
                    noise: lifted.sigma,
                    uncertainty,
                };
                let pairs: Vec<Vec<[OnChain; 2]>> =
                    lifted.crossings.iter().map(|c| c.ordered().collect()).collect();
                let margins = lifted.crossings.iter().map(|c| c.margin).collect();
                let fit = imagefit::fit(&views, &lifted.nodes, of.radius, plane, &pairs, &sensor, &options)?;
                Some(ImageFit {
                    fit: Arc::new(fit.among(&among, of.views.len())),
                    reference: among[*reference],
                    noise: lifted.sigma,
                    pairs,
                    margins,
                })
            })
        })
    }

    /// Fit again from the end of a fit, by votes near it, with covariances; arguments as in `fit`. Return None if that
    /// fails.
    #[allow(clippy::too_many_arguments)]
    fn refit(
        &self,
        py: Python<'_>,
        before: &ImageFit,
        plane: Option<(Point, f64)>,
        held: usize,
        pose_sd: [f64; 2],
        errors: Errors,
        iterations: usize,
    ) -> PyResult<Option<ImageFit>> {
        check_fit(pose_sd, errors, iterations)?;
        let plane = plane.map(plane_of).transpose()?;
        let sensor = sensor(errors);
        let options = ImageFitOptions {
            iterations,
            far: 0,
            reference: before.reference,
            held: Some(held),
            pose_sd,
            noise: errors.0.unwrap_or(before.noise),
            uncertainty: true,
        };
        let (of, from, pairs) = (self.0.clone(), before.fit.clone(), before.pairs.clone());
        let fitted = released(py, move || {
            let fit =
                imagefit::fit(&of.rope_views(), &from.nodes, of.radius, plane, &pairs, &sensor, &options);
            fit.map(|fit| (fit, pairs))
        })?;
        Ok(fitted.map(|(fit, pairs)| ImageFit {
            fit: Arc::new(fit),
            reference: before.reference,
            noise: before.noise,
            pairs,
            margins: before.margins.clone(),
        }))
    }

    /// Return a fit whose ropes have other nodes; everything else stays.
    ///
    /// Parameters
    /// ----------
    /// before : ImageFit
    /// nodes : sequence of (M, 3) ndarray
    ///     Nodes of the same number of ropes, world frame, metres.
    ///
    /// Returns
    /// -------
    /// ImageFit
    fn replace_nodes(
        &self,
        py: Python<'_>,
        before: &ImageFit,
        nodes: Vec<Bound<'_, PyAny>>,
    ) -> PyResult<ImageFit> {
        require_same_length("nodes", nodes.len(), before.fit.nodes.len())?;
        let nodes = nodes_of("nodes", &nodes, self.0.radius)?;
        if nodes.iter().any(|nodes| nodes.len() < 2) {
            return Err(PyValueError::new_err("nodes: expected two of each rope at least"));
        }
        let (from, pairs, radius) = (before.fit.clone(), before.pairs.clone(), self.0.radius);
        let (fit, pairs) = released(py, move || from.through(&nodes, &pairs, radius))?;
        Ok(ImageFit {
            fit: Arc::new(fit),
            pairs,
            reference: before.reference,
            noise: before.noise,
            margins: before.margins.clone(),
        })
    }

    /// Return how much better depth agrees with ropes on a plane than with the bare plane.
    ///
    /// Parameters
    /// ----------
    /// hypotheses : sequence of (sequence of (M, 3) ndarray, (V, 6) ndarray)
    ///     The nodes of each hypothesis' ropes, world frame, metres, and the corrections of the views' camera frames.
    /// plane : ((3,), float)
    ///     The table: n and n.x.
    /// noise : float
    ///     Standard deviation of depth, metres.
    ///
    /// Returns
    /// -------
    /// list of float
    ///     For each hypothesis, twice the log of how much more likely the depths of all views are, with independent errors.
    #[allow(clippy::type_complexity)]
    fn measure_depth_gains(
        &self,
        py: Python<'_>,
        hypotheses: Vec<(Vec<Bound<'_, PyAny>>, Vec<[f64; 6]>)>,
        plane: (Point, f64),
        noise: f64,
    ) -> PyResult<Vec<f64>> {
        check_positive("noise", noise)?;
        let plane = plane_of(plane)?;
        let mut ropes = Vec::new();
        let of = self.0.clone();
        for (chains, corrections) in hypotheses {
            require_same_length("hypotheses", corrections.len(), of.views.len())?;
            check_corrections("hypotheses", &corrections)?;
            ropes.push((nodes_of("hypotheses", &chains, of.radius)?, corrections));
        }
        released(py, move || {
            let views = of.rope_views();
            parallel::map(&ropes, |(chains, corrections)| {
                let seen = of.depth_scenes(&views, corrections, plane, noise);
                seen.map(|scene| scene.gain(chains)).sum::<f64>()
            })
        })
    }

    /// Return the same for several ends of one rope, up to a common constant.
    ///
    /// Parameters
    /// ----------
    /// chains : sequence of (M, 3) ndarray
    ///     The ropes' nodes without that end.
    /// ends : sequence of (M, 3) ndarray
    ///     Nodes of each end, from the last node before it.
    /// corrections : (V, 6) ndarray
    /// plane : ((3,), float)
    /// noise : float
    ///
    /// Returns
    /// -------
    /// list of float
    fn measure_end_gains(
        &self,
        py: Python<'_>,
        chains: Vec<Bound<'_, PyAny>>,
        ends: Vec<Bound<'_, PyAny>>,
        corrections: Vec<[f64; 6]>,
        plane: (Point, f64),
        noise: f64,
    ) -> PyResult<Vec<f64>> {
        let of = self.0.clone();
        require_same_length("corrections", corrections.len(), of.views.len())?;
        check_positive("noise", noise)?;
        check_corrections("corrections", &corrections)?;
        let plane = plane_of(plane)?;
        let (chains, ends) = (nodes_of("chains", &chains, of.radius)?, nodes_of("ends", &ends, of.radius)?);
        released(py, move || {
            let views = of.rope_views();
            let scenes: Vec<_> = of.depth_scenes(&views, &corrections, plane, noise).collect();
            let found = parallel::map(&scenes, |scene| scene.gains_of_ends(&chains, &ends));
            (0..ends.len()).map(|way| found.iter().map(|gains| gains[way]).sum()).collect()
        })
    }

    /// Count the pixels with depth that support each rope's nodes, and their views.
    ///
    /// Returns
    /// -------
    /// list of ((M,) ndarray of int, (M,) ndarray of int)
    #[allow(clippy::type_complexity)]
    fn count_support<'py>(
        &self,
        py: Python<'py>,
        fit: &ImageFit,
    ) -> PyResult<Vec<(Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>)>> {
        let (of, fit) = (self.0.clone(), fit.fit.clone());
        let counted = released(py, move || imagefit::count_support(&of.views, &fit, of.radius))?;
        counted.into_iter().map(|(counts, views)| Ok((list(py, counts)?, list(py, views)?))).collect()
    }
}

impl Prepareds {
    /// Returns each view's depth with what it is compared with.
    fn depth_scenes<'a>(
        &'a self,
        views: &'a [RopeView<'a>],
        corrections: &'a [[f64; 6]],
        plane: Plane,
        noise: f64,
    ) -> impl Iterator<Item = DepthScene<'a>> {
        views.iter().zip(&self.views).zip(corrections).map(move |((view, own), correction)| DepthScene {
            view,
            depth: &own.depth,
            correction,
            radius: self.radius,
            plane,
            noise,
        })
    }

    fn rope_views(&self) -> Vec<RopeView<'_>> {
        self.views.iter().map(Prepared::rope_view).collect()
    }
}
