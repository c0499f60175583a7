//! Depth images and point clouds: points cropped, filtered and measured.

pub mod apparent_radius;
pub mod crop;
pub mod density;
pub mod depth;
pub mod filter;
pub mod proximity;
pub mod visibility;
