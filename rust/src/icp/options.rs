//! The start and the limits of a registration.

use crate::geometry::RigidMotion;

/// The start and the limits of a registration.
///
/// By default it starts at the identity. The caller must set the correspondence distance: no default suits all data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IcpOptions {
    /// Start pose: source frame to target frame.
    pub start: RigidMotion,
    /// Largest distance between the points of a correspondence, metres.
    pub max_correspondence_distance: f64,
    /// Updates of the pose at most.
    pub max_iterations: usize,
    /// The registration ends when an update changes the fitness by at most this, and the inlier RMSE by at most this
    /// times the correspondence distance.
    pub tolerance: f64,
}

impl IcpOptions {
    /// The default of `max_iterations`.
    pub const MAX_ITERATIONS: usize = 30;
    /// The default of `tolerance`.
    pub const TOLERANCE: f64 = 1e-6;
}

impl Default for IcpOptions {
    fn default() -> Self {
        Self {
            start: RigidMotion::identity(),
            max_correspondence_distance: 0.0,
            max_iterations: Self::MAX_ITERATIONS,
            tolerance: Self::TOLERANCE,
        }
    }
}
