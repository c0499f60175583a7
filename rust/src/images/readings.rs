//! Readings of a mask: possible courses of the ropes through it, without depth.
//!
//! A mask's skeleton consists of segments, with one strand each, and zones, where strands merge. A segment meets a zone
//! at a port. Curves through a zone join its ports in pairs. A reading chooses the pairs of all zones. It costs its
//! bending, its tube outside the mask, and the mask that it leaves uncovered.

mod ends;
mod gaps;
mod links;
mod lookup;
mod network;
mod pairings;
mod planar;
mod refine;
mod region;
mod search;
mod skeleton;
mod stiffness;
#[cfg(test)]
mod tests;
mod widths;

pub use ends::extend;
pub use planar::resampled;
pub use search::{find_readings, price};
pub use skeleton::trace;
pub use widths::measure_strands;
