//! Bindings of what images say of ropes: readings of masks, and fits to masks and depth.

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{
    FloatArray, PointsArray, motions, number, points_array, require_same_length, wrong_shape,
};
use super::views::image_shape;
use crate::geometry::RigidMotion;
use crate::image::{Image, blobs};
use crate::imagefit::{self, DepthScene, ImageFitOptions, Medians, OnChain, Plane, RopeView, Sensor};
use crate::mending::mended;
use crate::silhouette::Silhouette;
use crate::surroundings::Surroundings;
use crate::{Pinhole, Point, outline, parallel, readings};

/// A polyline in an image, (M, 2).
type PlacesArray<'py> = Bound<'py, PyArray2<f64>>;
/// The view that a reading is of, and the columns and rows of its ropes' nodes.
type Hypothesis<'py> = (usize, Vec<PyReadonlyArray2<'py, f64>>);
/// Standard deviation of depth, radii, if it is known, its correlation, radii, standard deviation of edges, pixels, and bias,
/// radii.
type Errors = (Option<f64>, f64, f64, f64);

/// One view, prepared.
struct Prepared {
    silhouette: Silhouette,
    medians: Medians,
    pinhole: Pinhole,
    pose: RigidMotion,
    size: [usize; 2],
    /// Columns and rows of the mask's pixels with depth.
    covered: Vec<[f64; 2]>,
    /// Metres, of all pixels.
    depth: Image<f32>,
}

/// What views with masks show of ropes of one radius.
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
///
/// Raises
/// ------
/// ValueError
///     If the sequences differ in length, a shape is wrong, or a mask shows no rope with depth.
#[pyclass(frozen, module = "strand._core")]
pub(super) struct RopeImages {
    views: Vec<Prepared>,
    radius: f64,
}

#[pymethods]
impl RopeImages {
    #[new]
    fn new(
        py: Python<'_>,
        depths: Vec<Bound<'_, PyAny>>,
        masks: Vec<PyReadonlyArray2<'_, bool>>,
        cameras: Vec<[[f64; 2]; 2]>,
        poses: Vec<Bound<'_, PyAny>>,
        radius: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        for (name, got) in [("masks", masks.len()), ("cameras", cameras.len()), ("poses", poses.len())] {
            require_same_length(name, got, depths.len())?;
        }
        let radius = number("radius", radius)?;
        let depths = FloatArray::all("depths", &depths)?;
        let mut inputs = Vec::new();
        for (((depth, mask), camera), pose) in
            depths.iter().zip(&masks).zip(cameras).zip(motions("poses", &poses)?)
        {
            let [height, width] = image_shape("depths", depth)?;
            if mask.shape() != [height, width] {
                return Err(wrong_shape("masks", &format!("({height}, {width})"), mask.shape()));
            }
            let mask = mask.as_slice().map_err(|_| PyValueError::new_err("masks: expected C order"))?;
            let [focal, center] = camera;
            inputs.push((depth.slice()?, mask, [width, height], Pinhole { focal, center }, pose));
        }
        let views = py.detach(|| {
            parallel::each(&inputs, |&(depth, mask, size, pinhole, pose)| {
                Ok(prepared(depth, mask, size, pinhole, pose, radius))
            })
        })?;
        let views: Option<Vec<Prepared>> = views.into_iter().collect();
        let views =
            views.ok_or_else(|| PyValueError::new_err("masks: expected pixels of a rope with depth"))?;
        Ok(Self { views, radius })
    }

    /// (V,) The rope's radius in each image as the mask shows it, pixels.
    #[getter]
    fn radii<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.views.iter().map(|v| v.silhouette.radius_px))
    }

    /// Likely ways of ropes through each mask.
    ///
    /// Parameters
    /// ----------
    /// ropes : int, optional
    ///     How many ropes there are.
    /// most : int
    ///     How many readings of each view to return at most.
    /// views : sequence of int
    ///     Which views to read.
    ///
    /// Returns
    /// -------
    /// list of (float, int, list of (M, 2) ndarray, int)
    ///     What each costs, its view, the columns and rows of its ropes' nodes, pixels, and how many ropes were rings; of
    ///     each view the best first.
    #[allow(clippy::type_complexity)]
    fn readings<'py>(
        &self,
        py: Python<'py>,
        ropes: Option<usize>,
        most: usize,
        views: Vec<usize>,
    ) -> PyResult<Vec<(f64, usize, Vec<PlacesArray<'py>>, usize)>> {
        if let Some(view) = views.iter().find(|&&view| view >= self.views.len()) {
            return Err(PyValueError::new_err(format!("views: there is no view {view}")));
        }
        let found = py.detach(|| {
            parallel::each(&views, |&view| {
                let view = &self.views[view];
                let found = readings::readings(&view.silhouette, ropes, most);
                Ok(parallel::map(&found, |r| {
                    (r.cost, readings::extended(&view.silhouette, &r.chains), r.rings)
                }))
            })
        })?;
        let mut answer = Vec::new();
        for (view, found) in views.into_iter().zip(found) {
            for (cost, chains, rings) in found {
                let chains = chains
                    .into_iter()
                    .map(|c| PyArray1::from_vec(py, c.concat()).reshape([c.len(), 2]))
                    .collect::<PyResult<Vec<_>>>()?;
                answer.push((cost, view, chains, rings));
            }
        }
        Ok(answer)
    }

    /// What a reading of a view costs that has these polylines, (M, 2), pixels, but for ends, kisses and gaps.
    fn reading_cost(
        &self,
        py: Python<'_>,
        view: usize,
        chains: Vec<PyReadonlyArray2<'_, f64>>,
    ) -> PyResult<f64> {
        let Some(seen) = self.views.get(view) else {
            return Err(PyValueError::new_err(format!("view: there is no view {view}")));
        };
        let chains = chains.iter().map(places).collect::<PyResult<Vec<_>>>()?;
        Ok(py.detach(|| {
            let step = 0.5 * seen.silhouette.radius_px;
            let chains: Vec<_> = chains.iter().map(|c| readings::resampled(c, step)).collect();
            readings::cost(&seen.silhouette, &chains)
        }))
    }

    /// Fit ropes to masks and depth of all views, each beginning with polylines in one view's image.
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
    ///     Standard deviation of the depth that a disc of the rope's middle shows, radii, None for what the depths say; how
    ///     far along the rope its errors are alike, radii; standard deviation of the mask's edge, pixels; how much too far
    ///     away ropes are seen, radii.
    /// iterations : int
    /// uncertainty : bool
    ///     Whether to work out covariances.
    ///
    /// Returns
    /// -------
    /// list of (ImageFit or None)
    ///     None where nothing has depth.
    #[allow(clippy::too_many_arguments)]
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
    ) -> PyResult<Vec<Option<ImageFit>>> {
        let hypotheses = hypotheses
            .iter()
            .map(|(view, chains)| {
                if *view >= self.views.len() {
                    return Err(PyValueError::new_err(format!("hypotheses: there is no view {view}")));
                }
                let chains = chains.iter().map(places).collect::<PyResult<Vec<_>>>()?;
                Ok((*view, chains))
            })
            .collect::<PyResult<Vec<_>>>()?;
        let plane = plane.map(|(normal, offset)| Plane { normal, offset });
        let sensor = sensor(errors);
        let views = self.rope_views();
        py.detach(|| {
            parallel::each(&hypotheses, |(reference, chains)| {
                let Some(lifted) = imagefit::lift(&views[*reference], chains, self.radius, plane, &sensor)
                else {
                    return Ok(None);
                };
                let options = ImageFitOptions {
                    iterations,
                    reference: *reference,
                    held: Some(held),
                    pose_sd,
                    noise: lifted.sigma,
                    uncertainty,
                };
                let pairs: Vec<Vec<[OnChain; 2]>> =
                    lifted.crossings.iter().map(|c| c.ordered().collect()).collect();
                let margins = lifted.crossings.iter().map(|c| c.margin).collect();
                let fitted =
                    imagefit::fit(&views, &lifted.nodes, self.radius, plane, &pairs, &sensor, &options);
                Ok(fitted.map(|fit| ImageFit {
                    fit,
                    reference: *reference,
                    noise: lifted.sigma,
                    pairs,
                    margins,
                }))
            })
        })
        .map_err(PyErr::from)
    }

    /// Fit once more from where a fit ended, with covariances; arguments as those of `fit`. None if that fails.
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
    ) -> Option<ImageFit> {
        let plane = plane.map(|(normal, offset)| Plane { normal, offset });
        let sensor = sensor(errors);
        let options = ImageFitOptions {
            iterations,
            reference: before.reference,
            held: Some(held),
            pose_sd,
            noise: errors.0.unwrap_or(before.noise),
            uncertainty: true,
        };
        let fitted = py.detach(|| {
            let views = self.rope_views();
            imagefit::fit(&views, &before.fit.nodes, self.radius, plane, &before.pairs, &sensor, &options)
        });
        fitted.map(|fit| ImageFit {
            fit,
            reference: before.reference,
            noise: before.noise,
            pairs: before.pairs.clone(),
            margins: before.margins.clone(),
        })
    }

    /// How much better depth agrees with ropes on a plane than with the bare plane.
    ///
    /// Parameters
    /// ----------
    /// hypotheses : sequence of (sequence of (M, 3) ndarray, (V, 6) ndarray)
    ///     Each one's ropes' nodes, world frame, metres, and what corrects the views' camera frames.
    /// plane : ((3,), float)
    ///     The table: n and n.x.
    /// noise : float
    ///     Standard deviation of depth, metres.
    ///
    /// Returns
    /// -------
    /// list of float
    ///     For each, twice the log of how much likelier the depths of all views are, if errors are independent.
    #[allow(clippy::type_complexity)]
    fn depth_gains(
        &self,
        py: Python<'_>,
        hypotheses: Vec<(Vec<Bound<'_, PyAny>>, Vec<[f64; 6]>)>,
        plane: (Point, f64),
        noise: f64,
    ) -> PyResult<Vec<f64>> {
        let plane = Plane { normal: plane.0, offset: plane.1 };
        let mut ropes = Vec::new();
        for (chains, corrections) in &hypotheses {
            require_same_length("hypotheses", corrections.len(), self.views.len())?;
            ropes.push((nodes_of("hypotheses", chains)?, corrections));
        }
        let views = self.rope_views();
        Ok(py.detach(|| {
            parallel::map(&ropes, |(chains, corrections)| {
                let seen = self.depth_scenes(&views, corrections, plane, noise);
                seen.map(|scene| scene.gain(chains)).sum::<f64>()
            })
        }))
    }

    /// The same for ropes of which one ends in each of several ways, but for what is equal for all.
    ///
    /// Parameters
    /// ----------
    /// chains : sequence of (M, 3) ndarray
    ///     The ropes' nodes without that end.
    /// ends : sequence of (M, 3) ndarray
    ///     Nodes of each way, from the last one before.
    /// corrections : (V, 6) ndarray
    /// plane : ((3,), float)
    /// noise : float
    ///
    /// Returns
    /// -------
    /// list of float
    fn end_gains(
        &self,
        py: Python<'_>,
        chains: Vec<Bound<'_, PyAny>>,
        ends: Vec<Bound<'_, PyAny>>,
        corrections: Vec<[f64; 6]>,
        plane: (Point, f64),
        noise: f64,
    ) -> PyResult<Vec<f64>> {
        require_same_length("corrections", corrections.len(), self.views.len())?;
        let plane = Plane { normal: plane.0, offset: plane.1 };
        let (chains, ends) = (nodes_of("chains", &chains)?, nodes_of("ends", &ends)?);
        let views = self.rope_views();
        Ok(py.detach(|| {
            let scenes: Vec<_> = self.depth_scenes(&views, &corrections, plane, noise).collect();
            let found = parallel::map(&scenes, |scene| scene.gains_of_ends(&chains, &ends));
            (0..ends.len()).map(|way| found.iter().map(|gains| gains[way]).sum()).collect()
        }))
    }

    /// How many pixels with depth support each rope's nodes, and from how many views.
    ///
    /// Returns
    /// -------
    /// list of ((M,) ndarray of int, (M,) ndarray of int)
    #[allow(clippy::type_complexity)]
    fn support<'py>(
        &self,
        py: Python<'py>,
        fit: &ImageFit,
    ) -> Vec<(Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>)> {
        let counted = py.detach(|| self.counted(&fit.fit));
        counted
            .into_iter()
            .map(|(counts, views)| (PyArray1::from_vec(py, counts), PyArray1::from_vec(py, views)))
            .collect()
    }
}

impl RopeImages {
    /// For each rope's nodes, how many pixels with depth are nearest to them, and in how many views.
    fn counted(&self, fit: &imagefit::ImageFit) -> Vec<(Vec<i64>, Vec<i64>)> {
        let mut support: Vec<(Vec<i64>, Vec<i64>)> =
            fit.nodes.iter().map(|n| (vec![0; n.len()], vec![0; n.len()])).collect();
        for ((view, prepared), correction) in self.rope_views().iter().zip(&self.views).zip(&fit.corrections)
        {
            let counts = imagefit::seen_nodes(view, correction, &prepared.covered, &fit.nodes, self.radius);
            for ((counts, views), own) in support.iter_mut().zip(counts) {
                for ((count, views), own) in counts.iter_mut().zip(views).zip(own) {
                    *count += own;
                    *views += i64::from(own > 0);
                }
            }
        }
        support
    }

    /// Each view's depth, which ropes are compared with.
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
        self.views
            .iter()
            .map(|v| RopeView {
                silhouette: &v.silhouette,
                medians: &v.medians,
                pinhole: v.pinhole,
                pose: v.pose,
                size: v.size,
            })
            .collect()
    }
}

/// Masks more ragged than this are mended by depth.
const RAGGED: f64 = 0.25;

fn sensor((noise, correlation, lateral, bias): Errors) -> Sensor {
    Sensor { noise, correlation, lateral, bias: [bias, Sensor::DEFAULT.bias[1]], ..Sensor::DEFAULT }
}

/// One view's silhouette and depths; none if its mask shows no rope with depth.
fn prepared(
    depth: &[f64],
    mask: &[bool],
    size: [usize; 2],
    pinhole: Pinhole,
    pose: RigidMotion,
    radius: f64,
) -> Option<Prepared> {
    let pixels: Vec<usize> =
        (0..depth.len()).filter(|&k| mask[k] && depth[k] > 0.0 && depth[k].is_finite()).collect();
    if pixels.is_empty() {
        return None;
    }
    let mut seen: Vec<f64> = pixels.iter().map(|&k| depth[k]).collect();
    let covered = pixels.iter().map(|&k| [(k % size[0]) as f64, (k / size[0]) as f64]).collect();
    let middle = seen.len() / 2;
    let (_, &mut far, _) = seen.select_nth_unstable_by(middle, f64::total_cmp);
    let radius_px = pinhole.focal[0] * radius / far;
    let silhouette = Silhouette::of_rope(mask, size[0], radius_px)?;
    let (around, medians) = parallel::both(
        || Surroundings::new(depth, mask, size[0], &silhouette, radius),
        || Medians::new(depth, mask, size[0], &silhouette),
    );
    let ragged = around.as_ref().filter(|_| silhouette.ragged > RAGGED);
    let mended = ragged.and_then(|around| mended(depth, mask, size[0], &silhouette, around));
    let silhouette = match &mended {
        Some(mask) => Silhouette::of_rope(mask, size[0], radius_px)?,
        None => silhouette,
    };
    let (rope, hides) = (mended.as_deref().unwrap_or(mask), around.as_ref().filter(|around| around.hides()));
    let medians = match hides {
        // what hides the ropes is no part of them where a mask is too wide
        Some(around) => {
            let at = |k: usize| [(k % size[0]) as f64, (k / size[0]) as f64];
            let own = |k: usize| !(rope[k] && around.before(at(k), depth[k]));
            let seen: Vec<f64> = (0..depth.len()).map(|k| if own(k) { depth[k] } else { f64::NAN }).collect();
            Medians::new(&seen, rope, size[0], &silhouette)
        }
        None if mended.is_some() => Medians::new(depth, rope, size[0], &silhouette),
        None => medians,
    };
    let silhouette = silhouette.amid(around);
    let depth = Image { width: size[0], height: size[1], values: depth.iter().map(|&z| z as f32).collect() };
    Some(Prepared { silhouette, medians, pinhole, pose, size, covered, depth })
}

/// Ropes' nodes, (M, 3) each.
fn nodes_of(name: &str, chains: &[Bound<'_, PyAny>]) -> PyResult<Vec<Vec<Point>>> {
    let chains = FloatArray::all(name, chains)?;
    chains.iter().map(|nodes| Ok(nodes.rows(name, "(M, 3)")?.to_vec())).collect()
}

fn places(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
    if array.shape()[1] != 2 || array.shape()[0] < 2 {
        return Err(wrong_shape("hypotheses", "(M, 2), M >= 2", array.shape()));
    }
    Ok(array.as_array().rows().into_iter().map(|row| [row[0], row[1]]).collect())
}

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

/// Ropes fitted to masks and depth.
#[pyclass(frozen, module = "strand._core")]
pub(super) struct ImageFit {
    fit: imagefit::ImageFit,
    reference: usize,
    noise: f64,
    pairs: Vec<Vec<[OnChain; 2]>>,
    margins: Vec<f64>,
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
        let flat = |c: &Vec<[Point; 3]>| PyArray1::from_vec(py, c.concat().concat()).reshape([c.len(), 3, 3]);
        self.fit.covariances.iter().map(flat).collect()
    }

    /// (V, 6) What corrects each camera's frame: rotation vector, radians, and translation, metres.
    #[getter]
    fn corrections<'py>(&self, py: Python<'py>) -> PyResult<PlacesArray<'py>> {
        PyArray1::from_vec(py, self.fit.corrections.concat()).reshape([self.fit.corrections.len(), 6])
    }

    /// The view that it began in.
    #[getter]
    fn reference(&self) -> usize {
        self.reference
    }

    /// The depth's noise about a smooth rope, radii.
    #[getter]
    fn noise(&self) -> f64 {
        self.noise
    }

    /// Standard deviation of depth about the curves and the stretch of rope over which it is alike, radii; None if too
    /// little is seen.
    #[getter]
    fn scatter(&self) -> Option<(f64, f64)> {
        self.fit.depth.map(|depth| (depth.sd, depth.length))
    }

    /// Standard deviation of the masks' edges about the outline, pixels; None if too little is seen.
    #[getter]
    fn lateral(&self) -> Option<f64> {
        self.fit.lateral
    }

    /// (V,) How much too far away each view sees the ropes, radii.
    #[getter]
    fn biases<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.fit.biases.iter().map(|bias| -bias))
    }

    /// What it leaves unexplained: uncovered mask and tube outside masks, squared radii in the image; squares of depth's
    /// residuals and how many independent ones there are; ∫κ² ds and ∫(dκ/ds)² ds, in radii.
    #[getter]
    fn misfit(&self) -> [f64; 6] {
        let m = self.fit.misfit;
        [m.uncovered, m.outside, m.depth, m.depths, m.bend, m.change]
    }

    /// Crossings in the view that it began in: where, world frame, metres, and how much more the opposite order costs.
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
