//! Ropes in images: masks, how ropes may run through them, and curves fitted to masks and depth images.

pub mod image;
pub mod imagefit;
pub mod mending;
pub mod outline;
pub mod readings;
mod relief;
pub mod silhouette;
pub mod surroundings;
#[cfg(test)]
mod tests;
pub mod thinning;
