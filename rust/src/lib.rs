//! From depth-camera point clouds of ropes, cables and hoses to ordered 3D centrelines.
//!
//! The kernels of the pipeline, each usable alone, in the order in which data flow through them:
//! [`radius_outlier_mask`] → [`estimate_normals`] → [`icp`] → [`centerline`] → [`trace_chains`] for the published
//! method, [`trace_tubes`] → [`fit_tubes`] for tubes fitted together with the cameras' poses.
//! Slices go in and values come out; nothing is printed, read from files or kept between calls.
//!
//! The published method is that of *Shape Modeling of A String And Recognition Using Distance Sensor*; sections, equations
//! and figures that the documentation cites are of that paper.
//!
//! Lengths are in metres, frames right-handed, coordinates finite. Results are the same bits for any number of
//! threads ([`set_num_threads`]) and for any set of instructions, which is chosen when the program runs (AVX-512, AVX2,
//! or what every processor has).
//!
//! ```
//! // a ring of points on a tube of radius 1 about the x axis, seen from above
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
