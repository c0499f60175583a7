//! Depth-camera point clouds of ropes, cables and hoses become ordered 3D centrelines.
//!
//! Each kernel of the pipeline is usable alone. Data flow through them in this order:
//! - published method: [`radius_outlier_mask`] → [`estimate_normals`] → [`icp()`] → [`centerline()`] → [`trace_chains`];
//! - tubes fitted together with the cameras' poses: [`trace_tubes`] → [`fit_tubes`].
//!
//! Kernels take slices and return values. They print nothing, read no files and keep nothing between calls.
//!
//! The published method is that of *Shape Modeling of A String And Recognition Using Distance Sensor*. The
//! documentation cites that paper's sections, equations and figures.
//!
//! Lengths are in metres, frames are right-handed, and coordinates are finite. Results are equal bit for bit for any
//! number of threads ([`set_num_threads`]) and any instruction set. The program chooses the instruction set when it
//! runs: AVX-512, AVX2, or portable code.
//!
//! ```
//! // points on the upper half of a tube of radius 1 about the x axis, seen from above
//! let points: Vec<strand::Point> = (0..400)
//!     .map(|i| {
//!         let (x, angle) = ((i / 20) as f64 * 0.1, (i % 20) as f64 / 19.0 * std::f64::consts::PI);
//!         [x, angle.cos(), angle.sin()]
//!     })
//!     .collect();
//! let viewpoint = strand::Viewpoints::One([1.0, 0.0, 100.0]);
//! let surface = strand::estimate_normals(&points, strand::Neighbors::Within(0.4), viewpoint)?;
//! let axis = strand::centerline(&points, &surface.normals, 1.0, 10)?;
//! assert_eq!(axis.points.len(), points.len());
//! # Ok::<(), strand::Error>(())
//! ```
#![warn(missing_docs)]
// the bindings use more of the crate than it exports
#![cfg_attr(not(feature = "python"), allow(dead_code, unused_imports))]

mod checks;
mod clouds;
mod error;
#[cfg(any(fuzzing, test))]
pub mod fuzzing;
mod geometry;
mod icp;
mod images;
mod index;
mod knots;
mod normals;
mod parallel;
mod published;
#[cfg(feature = "python")]
mod python;
mod queries;
mod simd;
mod track;
mod tubes;

pub use clouds::crop::{DepthView, crop_images};
pub use clouds::depth::Pinhole;
pub use clouds::filter::{count_neighbors, radius_outlier_mask};
pub use error::{Error, Result};
pub use geometry::spline::{Place, Spline};
pub use geometry::{Point, RigidMotion};
pub use icp::{IcpOptions, IcpResult, Objective, Stop, icp, register_in_turn};
pub use normals::{Neighbors, Normals, Viewpoints, estimate_normals};
pub use parallel::{num_threads, set_num_threads};
pub use published::centerline::{Centerline, centerline};
pub use published::chain::trace_chains;
pub use tubes::tracing::{Arc, MIN_NODES, trace_tubes};
pub use tubes::tubefit::{
    EndObservation, FootPoint, OnCurve, Residual, Tube, TubeFit, TubeFitOptions, TubeView, Uncertainty,
    fit_tubes,
};
