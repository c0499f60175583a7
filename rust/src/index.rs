//! Neighbour search: the only room that knows grids and trees.
//!
//! There are four structures:
//! - [`cells::Cells`] sorts points by cell, and [`around::Around`] gathers the neighbours of a batch of points in
//!   single precision. They serve searches around every point of a cloud.
//! - [`Grid`] finds the points within a radius of single points, in double precision.
//! - [`Tree`], a k-d tree, finds nearest points where no scale is known.
//! - [`hierarchy::Hierarchy`], a tree of boxes, counts and sums where cells are crowded, or wide because a cloud
//!   reaches far.

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

const POINTS_PER_PART: usize = 1 << 15; // points that one task of a parallel pass over a cloud works on
/// The hierarchy takes over where the cells around a batch of points, or a point, hold more points than this.
const CROWDED: usize = 1 << 14;
const WIDE: f64 = 16.0; // the hierarchy also takes over where cells are this many times as wide as the caller asked for
const SHORTEST: f64 = 1e-150; // shorter distances count as this, metres: double precision loses their squares
