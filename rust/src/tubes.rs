//! Ropes as tubes: traced through a cloud, then fitted together with the cameras' poses.

pub mod ends;
pub mod tracing;
pub mod tubefit;
mod tubelet;
