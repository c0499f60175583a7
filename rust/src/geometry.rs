//! Vectors, rigid motions, curves, boxes and plans.

pub mod arclength;
pub mod averages;
pub mod band;
pub mod bordered;
pub mod boxes;
pub mod bridge;
pub mod contacts;
pub mod disc;
mod eigen;
pub mod linear;
pub mod median;
mod moments;
mod motion;
pub mod overlap;
pub mod plan;
pub mod polyline;
pub mod schur;
mod slabs;
pub mod spline;
pub mod straighten;
mod vector;

pub use eigen::{Symmetric3, eigen_symmetric, least_eigenvectors};
pub use moments::Moments;
pub use motion::{RigidMotion, measure_shift};
pub use vector::{Point, advance, cell_of, centroid, cross, cut_off, dot, normalized, squared_distance, sub};
