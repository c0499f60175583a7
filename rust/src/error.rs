//! What can go wrong, and the checks that all kernels share.

use crate::Point;
use crate::geometry::dot;

/// Why a kernel gives no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument is outside what the function accepts.
    #[error("{name}: {reason}")]
    InvalidArgument {
        /// The argument's name.
        name: &'static str,
        /// What was wrong and what is accepted.
        reason: String,
    },
    /// The arguments are well formed, but the data cannot support an answer.
    #[error("{name}: {reason}")]
    NotEnoughData {
        /// The argument that holds too little.
        name: &'static str,
        /// What is missing.
        reason: String,
    },
}

impl Error {
    pub(crate) fn invalid(name: &'static str, reason: impl Into<String>) -> Self {
        Self::InvalidArgument { name, reason: reason.into() }
    }

    pub(crate) fn not_enough(name: &'static str, reason: impl Into<String>) -> Self {
        Self::NotEnoughData { name, reason: reason.into() }
    }
}

/// The result of a kernel.
pub type Result<T> = std::result::Result<T, Error>;

/// Coordinates and lengths stay below this, so that squared distances stay well inside f64.
const LARGEST: f64 = 1e100;

/// Refuses coordinates that are NaN, infinite or so large that their squares overflow.
pub(crate) fn check_finite(name: &'static str, points: &[Point]) -> Result<()> {
    match points.iter().position(|p| !p.iter().all(|x| x.abs() < LARGEST)) {
        None => Ok(()),
        Some(row) => Err(Error::invalid(
            name,
            format!("expected finite coordinates below {LARGEST:e}, but row {row} is {:?}", points[row]),
        )),
    }
}

/// Refuses a length that is not above zero, or as large as no coordinate may be.
pub(crate) fn check_positive(name: &'static str, value: f64) -> Result<()> {
    if value > 0.0 && value < LARGEST {
        Ok(())
    } else {
        Err(Error::invalid(name, format!("expected a positive number below {LARGEST:e}, got {value:?}")))
    }
}

/// Refuses normals that are neither of unit length, to single precision and a little more, nor zero.
pub(crate) fn check_normals(name: &'static str, normals: &[Point]) -> Result<()> {
    check_finite(name, normals)?;
    match normals.iter().position(|&n| n != [0.0; 3] && (dot(n, n) - 1.0).abs() >= 1e-3) {
        None => Ok(()),
        Some(row) => Err(Error::invalid(
            name,
            format!("expected unit or zero vectors, but row {row} is {:?}", normals[row]),
        )),
    }
}

/// Refuses two arrays that belong together but differ in length.
pub(crate) fn check_same_length(name: &'static str, got: usize, other: &str, want: usize) -> Result<()> {
    if got == want {
        Ok(())
    } else {
        Err(Error::invalid(name, format!("expected one row for each of the {want} {other}, got {got}")))
    }
}
