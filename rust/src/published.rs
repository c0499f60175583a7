//! The stages of the published method that only it uses.

pub mod centerline;
pub mod chain;
