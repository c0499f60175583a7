//! Calls of Python code out of Rust, which the end of the interpreter may cut off.
//!
//! A daemon thread that asks for the GIL while Python exits is ended there. Before Python 3.14, `pthread_exit` unwinds its
//! stack. PyO3 declares that Python's functions never unwind, so a Rust frame below one aborts the whole process. Python
//! code asks for the GIL now and then, and so does NumPy after a long loop. A thread that waits for ever does no harm: the
//! process ends without it. PyO3 hangs threads in the same way where it asks for the GIL itself.

use std::hint::black_box;
use std::mem::{forget, transmute};

use pyo3::ffi::{self, PyObject};
use pyo3::prelude::*;
use pyo3::types::{PyString, PyTuple};

type Plain = unsafe extern "C" fn(*mut PyObject, *mut PyObject, *mut PyObject) -> *mut PyObject;
type Unwinding = unsafe extern "C-unwind" fn(*mut PyObject, *mut PyObject, *mut PyObject) -> *mut PyObject;

/// Hangs its thread where it is dropped.
struct Hang;

impl Drop for Hang {
    fn drop(&mut self) {
        loop {
            std::thread::park();
        }
    }
}

/// Calls what may run Python code, or NumPy's loops; hangs if the interpreter ends meanwhile.
///
/// # Errors
/// The exception that the call raises.
pub(super) fn called<'py>(
    callable: &Bound<'py, PyAny>,
    arguments: impl IntoPyObject<'py, Target = PyTuple, Output = Bound<'py, PyTuple>, Error: Into<PyErr>>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = callable.py();
    let arguments = arguments.into_pyobject(py).map_err(Into::into)?;
    // the compiler must not see which function it is, as it believes that this one never unwinds
    let call: Plain = black_box(ffi::PyObject_Call);
    let hang = Hang;
    // SAFETY: the types differ only in whether the function may unwind, which a function of C may; both objects are alive,
    // and the GIL is held. The call returns a new reference, or NULL with an exception set
    let answer = unsafe {
        let call = transmute::<Plain, Unwinding>(call);
        Bound::from_owned_ptr_or_err(py, call(callable.as_ptr(), arguments.as_ptr(), std::ptr::null_mut()))
    };
    forget(hang);
    answer
}

/// Calls a method as [`called`] does.
///
/// # Errors
/// As [`called`].
pub(super) fn called_method<'py>(
    owner: &Bound<'py, PyAny>,
    name: &str,
    arguments: impl IntoPyObject<'py, Target = PyTuple, Output = Bound<'py, PyTuple>, Error: Into<PyErr>>,
) -> PyResult<Bound<'py, PyAny>> {
    called(&owner.getattr(name)?, arguments)
}

/// Returns the text of an object whose class may be written in Python.
pub(super) fn text_of(value: &Bound<'_, PyAny>) -> String {
    let text = called(value.py().get_type::<PyString>().as_any(), (value,));
    text.map_or_else(|_| "an object without text".to_owned(), |text| text.to_string())
}
