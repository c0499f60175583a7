//! The result of the joint fit.

use numpy::ndarray::Dimension;
use numpy::{
    Element, PyArray, PyArray1, PyArray2, PyArray3, PyArray4, PyArrayMethods, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::python::arguments::{Array, FloatArray, count, number, require_same_length, wrong_shape};
use crate::python::arrays::{Constant, array, constant};
use crate::python::called::called_method;
use crate::python::plain::refuse_masks_and_units;
use crate::tubes::tubefit::{OnCurve, deviations};

/// The result of `strand.fit_tubes`; its arrays are read-only.
#[pyclass(frozen, get_all, module = "strand")]
pub struct TubeFit {
    /// list of (n, 3) ndarray: control points of uniform cubic B-splines, metres.
    pub(super) curves: Vec<Py<PyArray2<f64>>>,
    /// (V, 4, 4) ndarray: for each view, the rigid motion of the world frame that corrects its reported pose.
    pub(super) motions: Py<PyArray3<f64>>,
    /// (C,) ndarray of int64: for each curve, the number of its radius.
    pub(super) radius_classes: Py<PyArray1<i64>>,
    /// (K,) ndarray: the radii, metres.
    pub(super) radii: Py<PyArray1<f64>>,
    /// (K,) ndarray: standard deviations of the radii, metres, 0 for held radii; empty without `uncertainty`.
    pub(super) radii_sd: Py<PyArray1<f64>>,
    /// float: robust standard deviation of the residuals, metres.
    pub(super) sigma: f64,
    /// (K,) ndarray: for each radius, Tukey's last limit, metres.
    pub(super) bands: Py<PyArray1<f64>>,
    /// (N, 3) ndarray: all views' points, moved by the corrections of the poses, metres.
    pub(super) points: Py<PyArray2<f64>>,
    /// (N, 3) ndarray: the unit vectors from the points to their cameras.
    pub(super) to_camera: Py<PyArray2<f64>>,
    /// (N,) ndarray of int64: the view that saw each point.
    pub(super) view: Py<PyArray1<i64>>,
    /// (N,) ndarray of int64: the curve that explains each point best.
    pub(super) curve: Py<PyArray1<i64>>,
    /// (N,) ndarray: the parameter of that curve at the foot point.
    pub(super) parameter: Py<PyArray1<f64>>,
    /// (N,) ndarray: the distance from the surface, metres; infinite if no tube is near.
    pub(super) residual: Py<PyArray1<f64>>,
    /// (N,) ndarray: cosine between the surface normal and the direction to the camera.
    pub(super) facing: Py<PyArray1<f64>>,
    /// (N,) ndarray: the weight in the fit.
    pub(super) weight: Py<PyArray1<f64>>,
    /// (N,) ndarray of bool: whether the camera could have seen the tube at the point.
    pub(super) explained: Py<PyArray1<bool>>,
    /// (N,) ndarray of bool: whether the point is explained and its residual is within the last limit.
    pub(super) inlier: Py<PyArray1<bool>>,
    /// (V, 6, 6) ndarray: covariance of each correction: rotation vector, radians, and translation of the points'
    /// centroid, metres; 0 for a view that was held; (0, 6, 6) without `uncertainty`.
    pub(super) pose_covariance: Py<PyArray3<f64>>,
    /// list of (n, 4, 3, 3) ndarray: covariance of each control point with itself and the next three, m^2; empty for
    /// held curves and without `uncertainty`.
    pub(super) covariances: Vec<Py<PyArray4<f64>>>,
}

#[pymethods]
impl TubeFit {
    #[new]
    #[pyo3(signature = (*, curves, motions, radius_classes, radii, radii_sd, sigma, bands, points, to_camera, view, curve,
                        parameter, residual, facing, weight, explained, inlier, pose_covariance, covariances))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        curves: Vec<Py<PyArray2<f64>>>,
        motions: Py<PyArray3<f64>>,
        radius_classes: Py<PyArray1<i64>>,
        radii: Py<PyArray1<f64>>,
        radii_sd: Py<PyArray1<f64>>,
        sigma: &Bound<'_, PyAny>,
        bands: Py<PyArray1<f64>>,
        points: Py<PyArray2<f64>>,
        to_camera: Py<PyArray2<f64>>,
        view: Py<PyArray1<i64>>,
        curve: Py<PyArray1<i64>>,
        parameter: Py<PyArray1<f64>>,
        residual: Py<PyArray1<f64>>,
        facing: Py<PyArray1<f64>>,
        weight: Py<PyArray1<f64>>,
        explained: Py<PyArray1<bool>>,
        inlier: Py<PyArray1<bool>>,
        pose_covariance: Py<PyArray3<f64>>,
        covariances: Vec<Py<PyArray4<f64>>>,
    ) -> PyResult<Self> {
        let all = |name: &str, arrays: Vec<Py<PyArray2<f64>>>| {
            arrays.into_iter().map(|array| own(py, name, array)).collect::<PyResult<_>>()
        };
        let fit = Self {
            curves: all("curves", curves)?,
            motions: own(py, "motions", motions)?,
            radius_classes: own(py, "radius_classes", radius_classes)?,
            radii: own(py, "radii", radii)?,
            radii_sd: own(py, "radii_sd", radii_sd)?,
            sigma: number("sigma", sigma)?,
            bands: own(py, "bands", bands)?,
            points: own(py, "points", points)?,
            to_camera: own(py, "to_camera", to_camera)?,
            view: own(py, "view", view)?,
            curve: own(py, "curve", curve)?,
            parameter: own(py, "parameter", parameter)?,
            residual: own(py, "residual", residual)?,
            facing: own(py, "facing", facing)?,
            weight: own(py, "weight", weight)?,
            explained: own_flags(py, "explained", explained)?,
            inlier: own_flags(py, "inlier", inlier)?,
            pose_covariance: own(py, "pose_covariance", pose_covariance)?,
            covariances: covariances
                .into_iter()
                .map(|array| own(py, "covariances", array))
                .collect::<PyResult<_>>()?,
        };
        fit.check(py)?;
        Ok(fit)
    }

    /// (V, 6) ndarray: standard deviations of the corrections.
    #[getter]
    fn pose_sd<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let covariances = FloatArray::new("pose_covariance", self.pose_covariance.bind(py))?;
        let (rows, _) = covariances.slice().as_chunks::<6>();
        let found: Vec<[f64; 6]> = rows.as_chunks::<6>().0.iter().map(deviations).collect();
        let views = found.len();
        array(py, found.into_flattened(), [views, 6])
    }

    /// Return the radius of a curve, metres.
    ///
    /// Raises
    /// ------
    /// TypeError, ValueError
    ///     If `curve` is not the number of a curve.
    fn radius(&self, py: Python<'_>, curve: &Bound<'_, PyAny>) -> PyResult<f64> {
        self.of_class(py, &self.radii, curve)
    }

    /// Return Tukey's last limit for a curve, metres.
    ///
    /// Raises
    /// ------
    /// TypeError, ValueError
    ///     If `curve` is not the number of a curve.
    fn band(&self, py: Python<'_>, curve: &Bound<'_, PyAny>) -> PyResult<f64> {
        self.of_class(py, &self.bands, curve)
    }

    /// Return the same fit with other values of some attributes.
    #[pyo3(signature = (**changes))]
    fn replace<'py>(
        slf: &Bound<'py, Self>,
        changes: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (_, fields) = Self::__getnewargs_ex__(slf)?;
        if let Some(changes) = changes {
            fields.update(changes.as_mapping())?;
        }
        slf.get_type().call((), Some(&fields))
    }

    /// Arguments from which a pickle is restored.
    fn __getnewargs_ex__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let fields = PyDict::new(slf.py());
        for name in FIELDS {
            fields.set_item(name, slf.getattr(name)?)?;
        }
        Ok((PyTuple::empty(slf.py()), fields))
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        format!(
            "TubeFit(curves={}, views={}, points={}, sigma={:.3e})",
            self.curves.len(),
            self.motions.bind(py).shape()[0],
            self.points.bind(py).shape()[0],
            self.sigma
        )
    }
}

/// The constructor's arguments.
const FIELDS: [&str; 19] = [
    "curves",
    "motions",
    "radius_classes",
    "radii",
    "radii_sd",
    "sigma",
    "bands",
    "points",
    "to_camera",
    "view",
    "curve",
    "parameter",
    "residual",
    "facing",
    "weight",
    "explained",
    "inlier",
    "pose_covariance",
    "covariances",
];

impl TubeFit {
    /// Refuses arrays that do not match: numbers of curves, radii and points.
    fn check(&self, py: Python<'_>) -> PyResult<()> {
        let (curves, radii) = (self.curves.len(), self.radii.bind(py).len());
        let points = self.points.bind(py).shape()[0];
        let refuse =
            |name: &str, want: String| Err(PyValueError::new_err(format!("{name}: expected {want}")));
        let numbers = |name: &str, array: &Py<PyArray1<i64>>| Array::<i64>::exactly(name, array.bind(py), 1);
        if self.radius_classes.bind(py).len() != curves {
            return refuse("radius_classes", format!("the number of one of {radii} radii for each curve"));
        }
        in_range(
            "radius_classes",
            numbers("radius_classes", &self.radius_classes)?.slice(),
            radii,
            "radii for each curve",
        )?;
        if self.bands.bind(py).len() != radii {
            return refuse("bands", format!("one for each of {radii} radii"));
        }
        for (name, array) in [("points", &self.points), ("to_camera", &self.to_camera)] {
            if array.bind(py).shape() != [points, 3] {
                return Err(wrong_shape(name, &format!("({points}, 3)"), array.bind(py).shape()));
            }
        }
        for (name, count) in [
            ("view", self.view.bind(py).len()),
            ("curve", self.curve.bind(py).len()),
            ("parameter", self.parameter.bind(py).len()),
            ("residual", self.residual.bind(py).len()),
            ("facing", self.facing.bind(py).len()),
            ("weight", self.weight.bind(py).len()),
            ("explained", self.explained.bind(py).len()),
            ("inlier", self.inlier.bind(py).len()),
        ] {
            require_same_length(name, count, points)?;
        }
        in_range("curve", numbers("curve", &self.curve)?.slice(), curves, "curves for each point")?;
        match self.pose_covariance.bind(py).shape() {
            [_, 6, 6] => {}
            other => return Err(wrong_shape("pose_covariance", "(V, 6, 6)", other)),
        }
        Ok(())
    }

    /// Returns the value for the class of a curve's radius.
    fn of_class(
        &self,
        py: Python<'_>,
        values: &Py<PyArray1<f64>>,
        curve: &Bound<'_, PyAny>,
    ) -> PyResult<f64> {
        let classes = Array::<i64>::exactly("radius_classes", self.radius_classes.bind(py), 1)?;
        let (curve, curves) = (count("curve", curve)?, classes.slice().len());
        let class = classes.slice().get(curve).copied().ok_or_else(|| {
            PyValueError::new_err(format!(
                "curve: expected the number of one of {curves} curves, got {curve}"
            ))
        })?;
        Ok(FloatArray::new("radii", values.bind(py))?.slice()[class as usize])
    }

    /// Returns the foot point of each point; None where no tube is near.
    pub(super) fn foot_points(&self, py: Python<'_>) -> PyResult<Vec<Option<OnCurve>>> {
        let curve = Array::<i64>::exactly("curve", self.curve.bind(py), 1)?;
        let parameter = FloatArray::new("parameter", self.parameter.bind(py))?;
        let residual = FloatArray::new("residual", self.residual.bind(py))?;
        let all = curve.slice().iter().zip(parameter.slice()).zip(residual.slice());
        let foot_point = |((&curve, &parameter), residual): ((&i64, &f64), &f64)| {
            let place = OnCurve { curve: usize::try_from(curve).ok()?, parameter };
            residual.is_finite().then_some(place)
        };
        Ok(all.map(foot_point).collect())
    }
}

/// Makes an array read-only.
fn own<T: Element + Copy + 'static, D: Dimension>(
    py: Python<'_>,
    name: &str,
    array: Py<PyArray<T, D>>,
) -> PyResult<Py<PyArray<T, D>>> {
    kept(py, name, array, |values, dimensions| Array::exactly(name, values, dimensions))
}

/// Makes an array of flags read-only.
fn own_flags(py: Python<'_>, name: &str, array: Py<PyArray1<bool>>) -> PyResult<Py<PyArray1<bool>>> {
    kept(py, name, array, |values, dimensions| Array::flags(name, values, dimensions))
}

/// Returns the array if nobody can write to it, or a read-only array of its values that `taken` returns in C order.
fn kept<T: Element + Copy + 'static, D: Dimension>(
    py: Python<'_>,
    name: &str,
    array: Py<PyArray<T, D>>,
    taken: impl FnOnce(&Bound<'_, PyAny>, usize) -> PyResult<Array<T>>,
) -> PyResult<Py<PyArray<T, D>>> {
    let given = array.bind(py);
    refuse_masks_and_units(name, given)?;
    if Constant::of(given).is_some() {
        return Ok(array);
    }
    let values = taken(&called_method(given, "copy", ("C",))?, given.ndim())?;
    Ok(constant(py, values.into_values(), given.dims())?.unbind())
}

/// Refuses numbers that are negative or not below `count`; `things` names what they count.
fn in_range(name: &str, numbers: &[i64], count: usize, things: &str) -> PyResult<()> {
    if numbers.iter().all(|number| (0..count as i64).contains(number)) {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name}: expected the number of one of {count} {things}")))
}
