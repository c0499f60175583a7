//! Readings of a mask: which way ropes may run through it, before any depth is asked.
//!
//! A mask's skeleton falls into segments, where one strand is seen, and zones, where strands merge. Curves through a zone
//! join the segments' ports in pairs; a reading is a choice of pairs for all zones, and costs what it takes: bending, tube
//! outside the mask, mask that nothing covers.

mod ends;
mod gaps;
mod links;
mod lookup;
mod network;
mod pairings;
mod planar;
mod refine;
mod search;
mod skeleton;
#[cfg(test)]
mod tests;

pub use ends::extended;
pub use planar::resampled;
pub use search::{cost, readings};
