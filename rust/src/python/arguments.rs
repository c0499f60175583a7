//! Python arguments, checked and converted to slices.

use std::borrow::Cow;
use std::convert::Infallible;
use std::ops::Deref;

use numpy::ndarray::Dimension;
use numpy::{Element, PyArray, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::Borrowed;
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;

use super::arrays::Constant;
use super::called::{called_method, text_of};
use super::plain::refuse_masks_and_units;
pub(super) use super::plain::{count, number};
use crate::geometry::{Point, RigidMotion};
use crate::normals::Viewpoints;

/// A C-ordered array argument.
#[derive(Clone)]
pub(super) struct Array<T> {
    values: Values<T>,
    shape: Vec<usize>,
}

/// The numbers of an argument: a copy if other threads may write to the caller's memory while kernels run.
#[derive(Clone)]
enum Values<T> {
    Copy(Vec<T>),
    Constant(Constant<T>),
}

impl<T: Element + Copy + 'static> Deref for Values<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match self {
            Self::Copy(values) => values,
            Self::Constant(values) => values.slice(),
        }
    }
}

/// A double-precision array, converted from any kind of float.
pub(super) type FloatArray = Array<f64>;

impl<T: Element + Copy + 'static> Array<T> {
    pub(super) fn slice(&self) -> &[T] {
        &self.values
    }

    pub(super) fn shape(&self) -> &[usize] {
        &self.shape
    }

    pub(super) fn into_values(self) -> Vec<T> {
        match self.values {
            Values::Copy(values) => values,
            Values::Constant(values) => values.slice().to_vec(),
        }
    }

    /// Returns the height and width of an image.
    pub(super) fn image_shape(&self, name: &str) -> PyResult<[usize; 2]> {
        self.shape[..].try_into().map_err(|_| wrong_shape(name, "(H, W)", &self.shape))
    }
}

impl<T: Element + Copy + 'static> Array<T> {
    /// Takes an array that already has this type, with a number of dimensions.
    pub(super) fn exactly(name: &str, value: &Bound<'_, PyAny>, dimensions: usize) -> PyResult<Self> {
        refuse_masks_and_units(name, value)?;
        let refuse = || {
            let (wanted, got) = (T::get_dtype(value.py()), value.get_type());
            let got = value.getattr("dtype").map_or_else(|_| got.to_string(), |dtype| text_of(&dtype));
            PyTypeError::new_err(format!("{name}: expected a C-ordered array of {wanted}, got {got}"))
        };
        let array = value.cast::<PyArrayDyn<T>>().map_err(|_| refuse())?;
        if array.ndim() != dimensions {
            let axes = ["()", "(N,)", "(H, W)"].get(dimensions).copied().unwrap_or("another");
            return Err(wrong_shape(name, axes, array.shape()));
        }
        let values = taken(name, array)?;
        let values = values.ok_or_else(|| PyValueError::new_err(format!("{name}: expected C order")))?;
        Ok(Self { values, shape: array.shape().to_vec() })
    }
}

impl Array<bool> {
    /// Takes a mask (H, W).
    pub(super) fn mask(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::flags(name, value, 2)
    }

    /// Takes a boolean array with a number of dimensions.
    pub(super) fn flags(name: &str, value: &Bound<'_, PyAny>, dimensions: usize) -> PyResult<Self> {
        refuse_masks_and_units(name, value)?;
        if let Ok(array) = value.cast::<PyArrayDyn<bool>>()
            && array.ndim() == dimensions
            && let Some(flags) = Constant::of(array)
        {
            return Ok(Self { values: Values::Constant(flags), shape: array.shape().to_vec() });
        }
        if value.getattr("dtype").is_ok_and(|dtype| dtype.eq("bool").unwrap_or(false)) {
            // a byte that another thread writes need not be 0 or 1
            let bytes = called_method(value, "view", ("uint8",))?;
            let Array { values, shape } = Array::<u8>::exactly(name, &bytes, dimensions)?;
            let flags = values.iter().map(|&byte| byte != 0).collect();
            return Ok(Self { values: Values::Copy(flags), shape });
        }
        Self::exactly(name, value, dimensions)
    }
}

/// Memory that a kernel needs, about, multiples of its argument. It is reserved before the work begins, because running
/// out of memory inside Rust ends the process.
const WORK: usize = 8;
const LARGE: usize = 1 << 18; // smallest argument for which memory is reserved, bytes
/// Least memory that is reserved, bytes. Once it is freed, glibc keeps twice as much between calls: else even small depth
/// images could get all their pages anew in each call.
const LEAST: usize = 1 << 24;

/// Returns an array's numbers; None if they are not in C order.
fn taken<T: Element + Copy + 'static, D: Dimension>(
    name: &str,
    array: &Bound<'_, PyArray<T, D>>,
) -> PyResult<Option<Values<T>>> {
    if !array.is_c_contiguous() || !array.data().is_aligned() {
        return Ok(None);
    }
    let count = array.len();
    if size_of::<T>() * count > LARGE {
        drop(reserved::<T>(name, (WORK * count).max(LEAST / size_of::<T>()))?);
    }
    if let Some(values) = Constant::of(array) {
        return Ok(Some(Values::Constant(values)));
    }
    let mut values = reserved(name, count)?;
    // SAFETY: the array holds this many numbers from its first one on, and they stay allocated: this holds a reference, and
    // the GIL if there is one; without it, the caller may not resize the array without a check. No reference is made to memory
    // that other threads may write. Every bit pattern is a number of these types
    unsafe {
        std::ptr::copy_nonoverlapping(array.data().cast_const(), values.as_mut_ptr(), count);
        values.set_len(count);
    }
    Ok(Some(Values::Copy(values)))
}

/// Reserves room for the values of an argument.
fn reserved<T>(name: &str, count: usize) -> PyResult<Vec<T>> {
    let mut values = Vec::new();
    let short = || PyMemoryError::new_err(format!("{name}: no memory for {count} values"));
    values.try_reserve_exact(count).map_err(|_| short())?;
    Ok(values)
}

impl FloatArray {
    /// Takes an array of lengths; refuses integers, which have no unit.
    pub(super) fn new(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::of_kind(name, value, "f")
    }

    /// Takes a small array of numbers without unit, which may be integers.
    pub(super) fn of_numbers(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::of_kind(name, value, "fiu")
    }

    fn of_kind(name: &str, value: &Bound<'_, PyAny>, kinds: &str) -> PyResult<Self> {
        let py = value.py();
        refuse_masks_and_units(name, value)?;
        if let Ok(array) = value.cast::<PyArrayDyn<f64>>() {
            let values = match taken(name, array)? {
                None => {
                    let numpy = py.import("numpy")?;
                    let ordered = called_method(&numpy, "ascontiguousarray", (array,))?;
                    taken(name, ordered.cast::<PyArrayDyn<f64>>()?)?
                }
                values => values,
            };
            if let Some(values) = values {
                return Ok(Self { values, shape: array.shape().to_vec() });
            }
        }
        let numpy = py.import("numpy")?;
        let array = called_method(&numpy, "asarray", (value,)).map_err(|error| named(py, name, error))?;
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
                "{name}: expected {wanted}, got dtype {}{reason}",
                text_of(&dtype)
            )));
        }
        let array = called_method(&numpy, "require", (array, "float64", "CA"))?;
        let array = array.cast_into::<PyArrayDyn<f64>>()?;
        let shape = array.shape().to_vec();
        let values =
            taken(name, &array)?.ok_or_else(|| PyValueError::new_err(format!("{name}: no order")))?;
        Ok(Self { values, shape })
    }

    /// Takes the arrays of a sequence; errors give an array's number.
    pub(super) fn all(name: &str, values: &[Bound<'_, PyAny>]) -> PyResult<Vec<Self>> {
        values.iter().enumerate().map(|(i, value)| Self::new(&format!("{name}[{i}]"), value)).collect()
    }

    /// Returns the array as rows of three; error messages say that `shape` is expected.
    pub(super) fn points(self, name: &str, shape: &str) -> PyResult<Points> {
        match self.shape[..] {
            [_, 3] => Ok(Points(self.values)),
            _ => Err(wrong_shape(name, shape, &self.shape)),
        }
    }
}

/// An (N, 3) array argument.
#[derive(Clone)]
pub(super) struct Points(Values<f64>);

impl Points {
    /// Takes an array; error messages say that `shape` is expected.
    pub(super) fn new(name: &str, value: &Bound<'_, PyAny>, shape: &str) -> PyResult<Self> {
        FloatArray::new(name, value)?.points(name, shape)
    }

    /// Takes the clouds of a sequence; errors give a cloud's number.
    pub(super) fn all(name: &str, values: &[Bound<'_, PyAny>]) -> PyResult<Vec<Self>> {
        let cloud = |(i, value)| Self::new(&format!("{name}[{i}]"), value, "(N, 3)");
        values.iter().enumerate().map(cloud).collect()
    }
}

impl Deref for Points {
    type Target = [Point];

    fn deref(&self) -> &[Point] {
        self.0.as_chunks().0
    }
}

/// Returns the points of several clouds as slices.
pub(super) fn slices(clouds: &[Points]) -> Vec<&[Point]> {
    clouds.iter().map(|cloud| &**cloud).collect()
}

pub(super) fn wrong_shape(name: &str, want: &str, got: &[usize]) -> PyErr {
    let sizes: Vec<String> = got.iter().map(usize::to_string).collect();
    let comma = if got.len() == 1 { "," } else { "" };
    PyValueError::new_err(format!("{name}: expected shape {want}, got ({}{comma})", sizes.join(", ")))
}

/// Adds the argument's name to an error of NumPy about its value.
pub(super) fn named(py: Python<'_>, name: &str, error: PyErr) -> PyErr {
    if error.is_instance_of::<PyValueError>(py) {
        PyValueError::new_err(format!("{name}: {}", error.value(py)))
    } else {
        error
    }
}

pub(super) fn numbers<const N: usize>(name: &str, value: &Bound<'_, PyAny>) -> PyResult<[f64; N]> {
    let array = FloatArray::of_numbers(name, value)?;
    let found = array.slice().try_into().ok().filter(|_| array.shape.len() == 1);
    found.ok_or_else(|| wrong_shape(name, &format!("({N},)"), &array.shape))
}

pub(super) fn point(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Point> {
    numbers(name, value)
}

pub(super) fn motion(name: &str, value: &Bound<'_, PyAny>) -> PyResult<RigidMotion> {
    let array = FloatArray::of_numbers(name, value)?;
    let rows: Option<[[f64; 4]; 4]> = array.slice().as_chunks().0.try_into().ok();
    let rows =
        rows.filter(|_| array.shape == [4, 4]).ok_or_else(|| wrong_shape(name, "(4, 4)", &array.shape))?;
    RigidMotion::from_rows(&rows)
        .map_err(|error| PyValueError::new_err(error.to_string().replacen("pose", name, 1)))
}

/// Takes the rigid motions of a sequence; errors give a motion's number.
pub(super) fn motions(name: &str, values: &[Bound<'_, PyAny>]) -> PyResult<Vec<RigidMotion>> {
    values.iter().enumerate().map(|(i, value)| motion(&format!("{name}[{i}]"), value)).collect()
}

/// An optional argument; the core defines its default.
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

/// The rows of the arguments that a kernel sees.
pub(super) struct Rows {
    /// Indices of the kept rows; None if all are kept.
    pub(super) kept: Option<Vec<usize>>,
    total: usize,
}

impl Rows {
    /// Finds rows with NaN or infinity in any of `arrays`, which have one length. `"raise"` keeps them, for the kernel
    /// to refuse; `"drop"` drops them.
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

    /// Returns values of the kept rows, with `fill` at the other rows.
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

    /// Converts indices among the kept rows to indices of the argument's rows.
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

/// The camera centre of all points, or one for each point.
pub(super) enum Viewpoint {
    One(Point),
    Each(Points),
}

impl Viewpoint {
    const SHAPE: &'static str = "(3,) or (N, 3)";

    /// Takes the camera centres of `count` points.
    pub(super) fn new(value: &Bound<'_, PyAny>, count: usize) -> PyResult<Self> {
        let array = FloatArray::of_numbers("viewpoint", value)?;
        if array.shape.len() == 2 {
            let each = Points::new("viewpoint", value, Self::SHAPE)?;
            require_same_length("viewpoint", each.len(), count)?;
            return Ok(Self::Each(each));
        }
        let one = array.slice().try_into().ok().filter(|_| array.shape.len() == 1);
        one.map(Self::One).ok_or_else(|| wrong_shape("viewpoint", Self::SHAPE, &array.shape))
    }

    /// Returns the centre of each point; None if all share one.
    pub(super) fn each(&self) -> Option<&[Point]> {
        match self {
            Self::One(_) => None,
            Self::Each(each) => Some(each),
        }
    }

    /// Runs `ask` with the centres of the kept rows.
    pub(super) fn of<T>(&self, rows: &Rows, ask: impl FnOnce(Viewpoints) -> T) -> T {
        match self {
            Self::One(one) => ask(Viewpoints::One(*one)),
            Self::Each(each) => ask(Viewpoints::Each(&rows.select(each))),
        }
    }
}
