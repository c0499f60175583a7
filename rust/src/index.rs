//! Neighbour search: the only room that knows grids and trees.
//!
//! There are four structures:
//! - [`cells::Cells`] sorts points by cell, and [`around::Around`] gathers the neighbours of a batch of points in
//!   single precision. They serve searches around every point of a cloud.
//! - [`Grid`] finds the points within a radius of single points, in double precision.
//! - [`Tree`], a k-d tree, finds nearest points where no scale is known.
//! - [`hierarchy::Hierarchy`], a tree of boxes, counts and sums where cells are crowded, or wide because a cloud
//!   reaches far.
//!
//! [`halves::halve`] groups near points into batches.

pub mod around;
pub mod bounds;
pub mod cells;
mod grid;
pub mod halves;
pub mod hierarchy;
mod limits;
pub mod reach;
mod sort;
mod tree;

pub use grid::Grid;
pub use tree::Tree;
