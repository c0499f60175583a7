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

mod apparent_radius;
mod arclength;
mod banded;
mod boxes;
mod bridge;
mod centerline;
mod chain;
mod checks;
mod crop;
mod density;
mod depth;
mod ends;
mod error;
mod filter;
mod geometry;
mod icp;
mod image;
mod imagefit;
mod index;
mod knots;
mod median;
mod mending;
mod normals;
mod outline;
mod overlap;
mod parallel;
mod plan;
mod polyline;
mod proximity;
#[cfg(feature = "python")]
mod python;
mod queries;
mod readings;
mod relief;
mod silhouette;
mod simd;
mod spline;
mod straighten;
mod surroundings;
mod tubefit;
mod tubelet;
mod tubes;
mod visibility;

/// A point or vector: x, y, z.
pub type Point = [f64; 3];

pub use centerline::{Centerline, centerline};
pub use chain::trace_chains;
pub use crop::{DepthView, crop_images};
pub use depth::Pinhole;
pub use error::{Error, Result};
pub use filter::{count_neighbors, radius_outlier_mask};
pub use geometry::RigidMotion;
pub use icp::{IcpOptions, IcpResult, Objective, Stop, icp, register_in_turn};
pub use normals::{Neighbors, Normals, Viewpoints, estimate_normals};
pub use parallel::{num_threads, set_num_threads};
pub use spline::{Place, Spline};
pub use tubefit::{
    EndObservation, FootPoint, OnCurve, Residual, Tube, TubeFit, TubeFitOptions, TubeView, Uncertainty,
    fit_tubes,
};
pub use tubes::{Arc, MIN_NODES, trace_tubes};
