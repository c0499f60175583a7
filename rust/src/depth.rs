//! Depth images as points.

use crate::Point;
use crate::error::{Error, Result};

/// A pinhole camera, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    /// Focal lengths.
    pub focal: [f64; 2],
    /// Where the optical axis meets the image; an integer pixel is a pixel's middle.
    pub center: [f64; 2],
}

impl Pinhole {
    /// The point in the camera frame that a pixel of column `u` and row `v` sees at the depth `z`.
    #[inline(always)]
    pub(crate) fn point(&self, u: f64, v: f64, z: f64) -> Point {
        [(u - self.center[0]) * z / self.focal[0], (v - self.center[1]) * z / self.focal[1], z]
    }
}

/// Whether a pixel has a return.
#[inline(always)]
pub(crate) fn has_return(z: f64) -> bool {
    z > 0.0 && z < f64::INFINITY
}

/// A depth image with 0 where pixels are NaN or infinite, as they have no return either; and how many are.
///
/// # Errors
/// [`Error::InvalidArgument`] if a depth is negative or above `farthest`.
pub(crate) fn cleaned(mut depth: Vec<f64>, farthest: f64) -> Result<(Vec<f64>, usize)> {
    let (mut dropped, mut outside) = (0, false);
    for part in depth.chunks_mut(1024) {
        dropped += part.iter().filter(|z| !z.is_finite()).count();
        // infinities are dropped
        outside |= part.iter().fold(false, |out, &z| out | (((z < 0.0) | (z > farthest)) & z.is_finite()));
        for z in part {
            *z = if z.is_finite() { *z } else { 0.0 };
        }
    }
    if outside {
        let reason = format!("expected depths from 0 to {farthest:.3e}, where points are finite");
        return Err(match depth.iter().find(|&&z| z < 0.0 && z.is_finite()) {
            Some(z) => Error::invalid("depth", format!("expected depths >= 0, got {z}")),
            None => Error::invalid("depth", reason),
        });
    }
    Ok((depth, dropped))
}

/// The points of a depth image in the camera frame, row by row, x = (u − cx) z / fx and y = (v − cy) z / fy.
pub(crate) fn unproject(depth: &[f64], width: usize, camera: Pinhole) -> Vec<Point> {
    let mut points = Vec::with_capacity(depth.len());
    for (v, row) in depth.chunks_exact(width.max(1)).enumerate() {
        for (u, &z) in row.iter().enumerate() {
            if has_return(z) {
                points.push(camera.point(u as f64, v as f64, z));
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_without_a_return_make_no_points() {
        let camera = Pinhole { focal: [2.0, 4.0], center: [1.0, 0.0] };
        let depth = [0.0, 2.0, f64::NAN, 4.0, f64::INFINITY, 0.0];
        assert_eq!(unproject(&depth, 3, camera), [[0.0, 0.0, 2.0], [-2.0, 1.0, 4.0]]);
        assert_eq!(cleaned(depth.to_vec(), 4.0).unwrap(), (vec![0.0, 2.0, 0.0, 4.0, 0.0, 0.0], 2));
        assert!(cleaned(depth.to_vec(), 3.9).is_err());
        assert!(cleaned(vec![-1.0], 4.0).is_err());
        assert!(unproject(&[], 0, camera).is_empty());
    }
}
