//! Ropes in images: masks, the courses of ropes through them, and curves fitted to masks and depth images.
//!
//! A length in "image radii" is relative to `radius_px`, the rope's radius in the image; in "radii" it is relative to
//! the rope's radius in space.

pub mod beside;
pub mod bits;
pub mod color;
pub mod distances;
mod edge_distances;
pub mod heights;
pub mod image;
pub mod imagefit;
pub mod mending;
pub mod outline;
pub mod parts;
pub mod plane_windows;
pub mod planes;
pub mod readings;
mod relief;
pub mod rope_mask;
mod runs;
pub mod silhouette;
pub mod strips;
pub mod strokes;
pub mod surroundings;
pub mod tabletop;
#[cfg(test)]
mod tests;
pub mod thinning;
