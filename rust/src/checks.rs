//! Checks of arguments that several kernels share.

use crate::error::{Error, Result};

const LARGEST: f64 = 1e100; // coordinates and lengths stay below this, so that squared distances stay well inside f64

/// Refuses coordinates that are NaN, infinite or so large that their squares overflow.
pub(crate) fn check_finite(name: &'static str, points: &[[f64; 3]]) -> Result<()> {
    let fine = |p: &[f64; 3]| (p[0].abs() < LARGEST) & (p[1].abs() < LARGEST) & (p[2].abs() < LARGEST);
    // many at a time: wide instructions have no early exit
    if points.chunks(64).all(|points| points.iter().fold(true, |all, p| all & fine(p))) {
        return Ok(());
    }
    match points.iter().position(|p| !fine(p)) {
        None => Ok(()),
        Some(row) => Err(Error::invalid(
            name,
            format!("expected finite coordinates below {LARGEST:e}, but row {row} is {:?}", points[row]),
        )),
    }
}

/// Refuses a length unless it is above zero and below the limit of coordinates.
pub(crate) fn check_positive(name: &'static str, value: f64) -> Result<()> {
    if value > 0.0 && value < LARGEST {
        Ok(())
    } else {
        Err(Error::invalid(name, format!("expected a positive number below {LARGEST:e}, got {value:?}")))
    }
}

/// Refuses a direction that is not of unit length.
pub(crate) fn check_unit(name: &'static str, direction: [f64; 3]) -> Result<()> {
    let length = squared_length(direction).sqrt();
    if (length - 1.0).abs() <= 1e-6 {
        Ok(())
    } else {
        Err(Error::invalid(name, format!("expected a vector of unit length, got one of length {length}")))
    }
}

/// Refuses normals that are neither of unit length, to single precision and a little more, nor zero.
pub(crate) fn check_normals(name: &'static str, normals: &[[f64; 3]]) -> Result<()> {
    check_finite(name, normals)?;
    match normals.iter().position(|&n| n != [0.0; 3] && (squared_length(n) - 1.0).abs() >= 1e-3) {
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

/// x² + y² + z².
fn squared_length([x, y, z]: [f64; 3]) -> f64 {
    x * x + y * y + z * z
}
