//! Places in images and on chains, and the distances at which strands affect each other.

pub const STEP: f64 = 0.5; // distance between samples along the rope, radii
pub const HIDES: f64 = 1.4; // strands nearer than this in the image hide each other, image radii between axes
/// Strands nearer than this mix their depths, image radii, and pixels in addition: a stereo matcher blurs them.
pub const MIXES: (f64, f64) = (2.0, 1.5);
pub const APART: f64 = 4.0; // places of one rope nearer than this along it count as one place, radii
pub const MIXED: f64 = 0.3; // weight of a depth that is mixed with another strand's
pub const TOUCHING: f64 = 1.9; // distance between the axes of touching strands, radii: ropes give a little

/// A place in an image: column and row, pixels.
pub type Place2 = [f64; 2];

/// A place on a chain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnChain {
    /// Number of the chain.
    pub chain: usize,
    /// Its share of the chain's arc length.
    pub share: f64,
}
