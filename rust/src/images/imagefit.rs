//! Ropes fitted to images: polylines in one view's image become curves in space that agree with the masks and the depth
//! of all views.
//!
//! The noise of depth cameras is wide and correlated. Their masks show where a rope is to a fraction of a pixel, but
//! their depth only to about a radius. So masks come first, and depth decides the rest:
//! - [`lift()`] gives an image's polylines their depth, and decides which strand is on top at crossings.
//! - [`fit`] moves splines, poses and a depth bias for each view until the tubes fill the masks. It also measures what
//!   the fit leaves unexplained.

mod camera;
mod cost;
mod crossings;
mod curves;
mod equations;
mod evidence;
mod grid;
mod lift;
mod medians;
mod order;
mod outcome;
mod places;
mod prepared;
mod rendering;
mod residuals;
mod search;
mod smoothing;
mod stretches;
mod support;
#[cfg(test)]
mod tests;

pub use camera::{Plane, RopeView, Sensor};
pub use lift::lift;
pub use outcome::ImageFit;
pub use places::OnChain;
pub use prepared::Prepared;
pub use rendering::DepthScene;
pub use search::{ImageFitOptions, count_far, fit};
pub use support::count_support;
