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

/// The points of a depth image in the camera frame, row by row, x = (u − cx) z / fx and y = (v − cy) z / fy, and how many
/// pixels are NaN or infinite. These and 0 are pixels without a return.
///
/// # Errors
/// [`Error::InvalidArgument`] if a depth is negative.
pub fn unproject(depth: &[f64], width: usize, camera: Pinhole) -> Result<(Vec<Point>, usize)> {
    let (mut points, mut dropped) = (Vec::with_capacity(depth.len()), 0);
    for (v, row) in depth.chunks_exact(width.max(1)).enumerate() {
        let y = v as f64 - camera.center[1];
        for (u, &z) in row.iter().enumerate() {
            if z > 0.0 && z < f64::INFINITY {
                points.push([
                    (u as f64 - camera.center[0]) * z / camera.focal[0],
                    y * z / camera.focal[1],
                    z,
                ]);
            } else if !z.is_finite() {
                dropped += 1;
            } else if z < 0.0 {
                return Err(Error::invalid("depth", "expected depths >= 0, got a negative one"));
            }
        }
    }
    Ok((points, dropped))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_without_a_return_make_no_points() {
        let camera = Pinhole { focal: [2.0, 4.0], center: [1.0, 0.0] };
        let depth = [0.0, 2.0, f64::NAN, 4.0, f64::INFINITY, 0.0];
        let (points, dropped) = unproject(&depth, 3, camera).unwrap();
        assert_eq!(points, [[0.0, 0.0, 2.0], [-2.0, 1.0, 4.0]]);
        assert_eq!(dropped, 2);
        assert!(unproject(&[-1.0], 1, camera).is_err());
        assert!(unproject(&[], 0, camera).unwrap().0.is_empty());
    }
}
