//! What Python hands in, checked and made into slices; what Rust hands back, made into arrays.

use std::borrow::Cow;
use std::convert::Infallible;

use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::Borrowed;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::{Point, RigidMotion};

/// An (N, 3) array that is handed back.
pub(super) type PointsArray<'py> = Bound<'py, PyArray2<f64>>;

/// A C-ordered float64 array made of an argument; borrowed where it already is one.
pub(super) struct FloatArray<'py>(pub(super) PyReadonlyArrayDyn<'py, f64>);

impl<'py> FloatArray<'py> {
    /// An array of lengths, which whole numbers are not: they have no unit.
    pub(super) fn new(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Self> {
        Self::of_kind(name, value, "f")
    }

    /// A small array that can mean only numbers; these may be whole.
    pub(super) fn of_numbers(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Self> {
        Self::of_kind(name, value, "fiu")
    }

    fn of_kind(name: &str, value: &Bound<'py, PyAny>, kinds: &str) -> PyResult<Self> {
        let py = value.py();
        if let Ok(array) = value.cast::<PyArrayDyn<f64>>()
            && array.is_c_contiguous()
            && array.data().is_aligned()
        {
            return Ok(Self(array.readonly()));
        }
        let numpy = py.import("numpy")?;
        let array = numpy.call_method1("asarray", (value,)).map_err(|error| named(py, name, error))?;
        let dtype = array.getattr("dtype")?;
        let kind: String = dtype.getattr("kind")?.extract()?;
        if !kinds.contains(&kind) {
            let wanted = if kinds == "f" { "floating point numbers" } else { "numbers" };
            let reason = match kind.as_str() {
                "i" | "u" => {
                    ": whole numbers have no unit, convert them to metres with astype(float) and a scale"
                }
                _ => "",
            };
            return Err(PyTypeError::new_err(format!(
                "{name}: expected {wanted}, got dtype {dtype}{reason}"
            )));
        }
        // C order and alignment, copied only where the array lacks either
        let array = numpy.call_method1("require", (array, "float64", "CA"))?;
        Ok(Self(array.extract()?))
    }

    /// The arrays of a sequence, each with its number in errors.
    pub(super) fn all(name: &str, values: &[Bound<'py, PyAny>]) -> PyResult<Vec<Self>> {
        values.iter().enumerate().map(|(i, value)| Self::new(&format!("{name}[{i}]"), value)).collect()
    }

    /// The array as rows of three; `shape` is what the error message asks for.
    pub(super) fn rows(&self, name: &str, shape: &str) -> PyResult<&[Point]> {
        match self.0.shape() {
            [_, 3] => Ok(self.slice()?.as_chunks().0),
            other => Err(wrong_shape(name, shape, other)),
        }
    }

    pub(super) fn slice(&self) -> PyResult<&[f64]> {
        // numpy.require made it so; as_slice alone would accept Fortran order too
        debug_assert!(self.0.is_c_contiguous());
        self.0.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))
    }
}

pub(super) fn wrong_shape(name: &str, want: &str, got: &[usize]) -> PyErr {
    let sizes: Vec<String> = got.iter().map(usize::to_string).collect();
    let comma = if got.len() == 1 { "," } else { "" };
    PyValueError::new_err(format!("{name}: expected shape {want}, got ({}{comma})", sizes.join(", ")))
}

/// An error of NumPy about an argument's value, with the argument's name.
pub(super) fn named(py: Python<'_>, name: &str, error: PyErr) -> PyErr {
    if error.is_instance_of::<PyValueError>(py) {
        PyValueError::new_err(format!("{name}: {}", error.value(py)))
    } else {
        error
    }
}

/// The points of several clouds.
pub(super) fn rows_of<'a>(name: &str, clouds: &'a [FloatArray]) -> PyResult<Vec<&'a [Point]>> {
    clouds.iter().enumerate().map(|(i, cloud)| cloud.rows(&format!("{name}[{i}]"), "(N, 3)")).collect()
}

/// So many numbers.
pub(super) fn numbers<const N: usize>(name: &str, value: &Bound<'_, PyAny>) -> PyResult<[f64; N]> {
    let array = FloatArray::of_numbers(name, value)?;
    let found = array.slice()?.try_into().ok().filter(|_| array.0.ndim() == 1);
    found.ok_or_else(|| wrong_shape(name, &format!("({N},)"), array.0.shape()))
}

/// A place or a vector.
pub(super) fn point(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Point> {
    numbers(name, value)
}

/// A real number.
pub(super) fn number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().map_err(|_| PyTypeError::new_err(format!("{name}: expected a number, got {value}")))
}

/// A whole number that is not negative.
pub(super) fn count(name: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let number: i64 = value
        .extract()
        .map_err(|_| PyTypeError::new_err(format!("{name}: expected a whole number, got {value}")))?;
    usize::try_from(number)
        .map_err(|_| PyValueError::new_err(format!("{name}: expected a number >= 0, got {number}")))
}

/// A rigid motion.
pub(super) fn motion(name: &str, value: &Bound<'_, PyAny>) -> PyResult<RigidMotion> {
    let array = FloatArray::of_numbers(name, value)?;
    if array.0.shape() != [4, 4] {
        return Err(wrong_shape(name, "(4, 4)", array.0.shape()));
    }
    let rows: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| array.0.as_array()[[i, j]]));
    RigidMotion::from_rows(&rows)
        .map_err(|error| PyValueError::new_err(error.to_string().replacen("pose", name, 1)))
}

/// The rigid motions of a sequence, each with its number in errors.
pub(super) fn motions(name: &str, values: &[Bound<'_, PyAny>]) -> PyResult<Vec<RigidMotion>> {
    values.iter().enumerate().map(|(i, value)| motion(&format!("{name}[{i}]"), value)).collect()
}

/// An argument that the caller may leave out; the core says what holds then.
pub(super) struct Given<'py>(pub(super) Option<Bound<'py, PyAny>>);

impl<'py> FromPyObject<'_, 'py> for Given<'py> {
    type Error = Infallible;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self, Infallible> {
        Ok(Self(Some(value.to_owned())))
    }
}

impl<'py> Given<'py> {
    pub(super) fn or<T>(
        &self,
        default: T,
        read: impl FnOnce(&Bound<'py, PyAny>) -> PyResult<T>,
    ) -> PyResult<T> {
        self.0.as_ref().map_or(Ok(default), read)
    }
}

/// Which rows of the arguments a kernel sees.
pub(super) struct Rows {
    /// Indices of the kept rows; none if all are kept.
    pub(super) kept: Option<Vec<usize>>,
    total: usize,
}

impl Rows {
    /// Decides on rows with NaN or infinity in any of `arrays`, which are of one length: `"raise"` leaves them for
    /// the kernel to refuse, `"drop"` leaves them out.
    pub(super) fn new(nonfinite: &str, arrays: &[&[Point]]) -> PyResult<Self> {
        let total = arrays[0].len();
        let finite = |i: &usize| arrays.iter().all(|rows| rows[*i].iter().all(|x| x.is_finite()));
        let kept = match nonfinite {
            "raise" => None,
            "drop" => Some((0..total).filter(finite).collect()),
            other => {
                return Err(PyValueError::new_err(format!(
                    "nonfinite: expected \"raise\" or \"drop\", got \"{other}\""
                )));
            }
        };
        Ok(Self { kept, total })
    }

    pub(super) fn select<'a>(&self, rows: &'a [Point]) -> Cow<'a, [Point]> {
        match &self.kept {
            None => Cow::Borrowed(rows),
            Some(kept) => Cow::Owned(kept.iter().map(|&i| rows[i]).collect()),
        }
    }

    /// Values of the kept rows, with `fill` at the others.
    pub(super) fn scatter<T: Copy>(&self, values: Vec<T>, fill: T) -> Vec<T> {
        match &self.kept {
            None => values,
            Some(kept) => {
                let mut all = vec![fill; self.total];
                for (&i, value) in kept.iter().zip(values) {
                    all[i] = value;
                }
                all
            }
        }
    }

    /// Indices among the kept rows, as indices of the argument's rows.
    pub(super) fn original(&self, indices: Vec<usize>) -> Vec<i64> {
        match &self.kept {
            None => indices.into_iter().map(|i| i as i64).collect(),
            Some(kept) => indices.into_iter().map(|i| kept[i] as i64).collect(),
        }
    }
}

pub(super) fn require_same_length(name: &str, got: usize, want: usize) -> PyResult<()> {
    if got == want {
        Ok(())
    } else {
        Err(PyValueError::new_err(format!(
            "{name}: expected one row for each of the {want} points, got {got}"
        )))
    }
}

/// One camera's centre, or one for each of several points.
pub(super) enum Viewpoint<'py> {
    One(Point),
    Each(FloatArray<'py>),
}

impl<'py> Viewpoint<'py> {
    const SHAPE: &'static str = "(3,) or (N, 3)";

    pub(super) fn new(value: &Bound<'py, PyAny>) -> PyResult<Self> {
        let array = FloatArray::of_numbers("viewpoint", value)?;
        if array.0.ndim() == 2 {
            return Ok(Self::Each(FloatArray::new("viewpoint", value)?));
        }
        let one = array.slice()?.try_into().ok().filter(|_| array.0.ndim() == 1);
        one.map(Self::One).ok_or_else(|| wrong_shape("viewpoint", Self::SHAPE, array.0.shape()))
    }

    /// Those of `count` points, if there is one for each.
    pub(super) fn each(&self, count: usize) -> PyResult<Option<&[Point]>> {
        let Self::Each(array) = self else { return Ok(None) };
        let rows = array.rows("viewpoint", Self::SHAPE)?;
        require_same_length("viewpoint", rows.len(), count)?;
        Ok(Some(rows))
    }

    /// That of all points; NaN if there is one for each.
    pub(super) fn one(&self) -> Point {
        match self {
            Self::One(one) => *one,
            Self::Each(_) => [f64::NAN; 3],
        }
    }
}

pub(super) fn points_array(py: Python<'_>, points: Vec<Point>) -> PyResult<PointsArray<'_>> {
    let rows = points.len();
    PyArray1::from_vec(py, points.into_flattened()).reshape([rows, 3])
}
