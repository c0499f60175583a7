//! Neighbour search: the only place that knows a grid or a tree.
//!
//! Four structures. What lies around every point of a cloud is asked of batches of points at once:
//! [`cells::Cells`] sorts the points by cell, and [`around::Around`] gathers what a batch needs in single precision.
//! What lies within a radius of single points, [`Grid`] tells in double precision. Where neighbours have no known
//! scale, [`Tree`], a k-d tree, finds the nearest. Where cells are crowded, or wide because a cloud reaches far, a
//! [`hierarchy::Hierarchy`] of boxes counts and sums instead.

pub mod around;
pub mod bounds;
pub mod cells;
mod grid;
pub mod hierarchy;
pub mod reach;
mod sort;
mod tree;

pub use grid::Grid;
pub use tree::Tree;

/// Points of a part of a parallel pass over a cloud.
const POINTS_PER_PART: usize = 1 << 15;
/// Where more points than this are in the cells around a batch of points, or a point, the hierarchy takes over.
const CROWDED: usize = 1 << 14;
/// So does it where cells are this many times as wide as was asked for.
const WIDE: f64 = 16.0;
/// Distances below this count as this: their squares are lost in double precision.
const SHORTEST: f64 = 1e-150;
