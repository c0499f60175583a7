//! Depth images and point clouds: cropping, filtering, density, visibility.

pub mod apparent_radius;
pub mod crop;
pub mod density;
pub mod depth;
pub mod filter;
pub mod proximity;
pub mod visibility;
