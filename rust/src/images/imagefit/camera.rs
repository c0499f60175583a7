//! One camera's data, the errors of its depth, and the plane that it sees.

use super::medians::Medians;
use super::places::Place2;
use crate::clouds::depth::Pinhole;
use crate::geometry::{Point, RigidMotion, cross, dot, sub};
use crate::images::silhouette::Silhouette;

/// One camera's data.
#[derive(Debug, Clone)]
pub struct RopeView<'a> {
    pub silhouette: &'a Silhouette,
    /// Its depth on the mask.
    pub medians: &'a Medians,
    pub pinhole: Pinhole,
    /// Camera to world.
    pub pose: RigidMotion,
    /// Columns and rows of its image.
    pub size: [usize; 2],
}

impl RopeView<'_> {
    /// Moves a point of the world to the camera frame.
    #[inline]
    pub(super) fn seen(&self, x: Point) -> Point {
        let d = sub(x, self.pose.translation.into());
        let r = &self.pose.rotation;
        std::array::from_fn(|k| r[(0, k)] * d[0] + r[(1, k)] * d[1] + r[(2, k)] * d[2])
    }

    /// Moves a point of the world to the corrected camera frame.
    #[inline]
    pub(super) fn corrected(&self, [wx, wy, wz, tx, ty, tz]: &[f64; 6], x: Point) -> Point {
        let y = self.seen(x);
        let turn = cross([*wx, *wy, *wz], y);
        [y[0] + turn[0] + tx, y[1] + turn[1] + ty, y[2] + turn[2] + tz]
    }

    /// Turns a direction of the camera frame to the world frame.
    #[inline]
    pub(super) fn turned(&self, y: Point) -> Point {
        let r = &self.pose.rotation;
        std::array::from_fn(|k| r[(k, 0)] * y[0] + r[(k, 1)] * y[1] + r[(k, 2)] * y[2])
    }

    /// Projects a point of the camera frame into the image.
    #[inline]
    pub(super) fn projected(&self, y: Point) -> Place2 {
        self.pinhole.pixel(y)
    }
}

/// Errors of the depth camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Standard deviation of the depth of a disc in the rope's middle, radii; the lift estimates it if None.
    pub noise: Option<f64>,
    /// Correlation length of depth errors along the rope, radii.
    pub correlation: f64,
    /// Standard deviation of the mask's edge, pixels.
    pub lateral: f64,
    /// Distance of the axis behind the depth of such a disc, radii.
    pub surface: f64,
    /// Mean distance by which ropes appear too far away, radii, and a view's standard deviation about it.
    pub bias: [f64; 2],
}

impl Sensor {
    /// A stereo camera near its best distance.
    pub const DEFAULT: Self =
        Self { noise: None, correlation: 3.0, lateral: 0.3, surface: 0.85, bias: [0.0, 0.3] };
}

/// A plane that nothing lies below: its unit normal n, towards the cameras, and n·x on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// n.
    pub normal: Point,
    /// n·x.
    pub offset: f64,
}

impl Plane {
    /// Returns a point's height above it.
    #[inline]
    pub(super) fn height(&self, x: Point) -> f64 {
        dot(self.normal, x) - self.offset
    }
}
