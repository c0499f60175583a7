//! From depth-camera point clouds of strings, ropes, cables and hoses to ordered 3D centrelines.
//!
//! The kernels of the pipeline, each usable alone, in the order in which data flow through them:
//! [`radius_outlier_mask`] → [`estimate_normals`] → [`icp`] → [`centerline`] → [`trace_chains`] for the published
//! method, [`trace_tubes`] → [`fit_tubes`] for tubes fitted together with the cameras' poses.
//! Slices go in and values come out; nothing is printed, read from files or kept between calls.
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

mod arclength;
mod banded;
mod bridge;
mod centerline;
mod chain;
mod crop;
mod density;
mod depth;
mod ends;
mod error;
mod filter;
mod geometry;
mod icp;
mod index;
mod normals;
mod parallel;
#[cfg(feature = "python")]
mod python;
mod sight;
mod simd;
mod spline;
mod straighten;
mod strips;
mod tubefit;
mod tubelet;
mod tubes;

/// A point or vector: x, y, z.
pub type Point = [f64; 3];

pub use arclength::ByLength;
pub use bridge::{bending, bridge, end_direction, join_cost};
pub use centerline::{Centerline, centerline};
pub use chain::trace_chains;
pub use crop::{DepthView, crop, crop_images};
pub use density::{occupied_cubes, usual_neighbors};
pub use depth::{Pinhole, copy_depth, unproject};
pub use ends::{OnTube, crowded, string_parts};
pub use error::{Error, Result};
pub use filter::{count_neighbors, radius_outlier_mask};
pub use geometry::RigidMotion;
pub use icp::{IcpOptions, IcpResult, Objective, Stop, icp, register_in_turn};
pub use normals::{Neighbors, Normals, Viewpoints, estimate_normals};
pub use parallel::{num_threads, set_num_threads};
pub use sight::{Saw, Seen, Sight, SightView, hides};
pub use spline::{Spline, arc_length};
pub use straighten::straighten;
pub use strips::{Strip, strip_radii};
pub use tubefit::{
    EndSighting, Foot, OnCurve, Residual, Tube, TubeFit, TubeFitOptions, TubeView, fit_tubes, placed,
};
pub use tubes::{Arc, trace_tubes};
