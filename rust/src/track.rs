//! Ropes followed from frame to frame.
//!
//! A rope is a list of nodes at fixed arc lengths. Each frame predicts them, matches the images' pixels with samples
//! between them, and solves for the nodes by Gauss and Newton: across the rope and in depth by the pixels, along it by its
//! ends and its length, and where it is hidden by the motion of its neighbours.

mod bias;
pub(crate) mod camera;
mod evidence;
mod motion;
mod nearest;
pub(crate) mod openings;
pub(crate) mod rope;
mod slopes;
#[cfg(test)]
mod tests;
mod tips;
pub(crate) mod update;
mod view;
