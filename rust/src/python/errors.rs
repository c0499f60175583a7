//! The exceptions of Python, and how errors of the core become exceptions.

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;

use crate::error::Error;

create_exception!(strand, StrandError, PyException, "Base of the errors that strand raises of its own.");
create_exception!(strand, NotEnoughDataError, StrandError, "The data cannot support an answer.");

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        match error {
            Error::InvalidArgument { .. } => PyValueError::new_err(error.to_string()),
            Error::NotEnoughData { .. } => NotEnoughDataError::new_err(error.to_string()),
        }
    }
}
