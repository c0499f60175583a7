//! Neighbour search: the only place that knows a grid or a tree.
//!
//! Three structures. What lies around every point of a cloud is asked of batches of points at once:
//! [`cells::Cells`] sorts the points by cell, and [`around::Around`] gathers what a batch needs in single precision.
//! What lies within a radius of single points, [`Grid`] tells in double precision. Where neighbours have no known
//! scale, [`Tree`], a k-d tree, finds the nearest.

pub mod around;
pub mod bounds;
pub mod cells;
mod grid;
pub mod reach;
mod sort;
mod tree;

pub use grid::Grid;
pub use tree::Tree;

/// Points of a part of a parallel pass over a cloud.
const POINTS_PER_PART: usize = 1 << 15;
/// Distances below this count as this: their squares are lost in double precision.
const SHORTEST: f64 = 1e-150;
