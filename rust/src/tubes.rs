//! Ropes as tubes: traced through a cloud, then fitted together with the poses of the cameras.

pub mod ends;
pub mod tracing;
pub mod tubefit;
mod tubelet;
