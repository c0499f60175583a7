//! Stages that only the published method uses.

pub mod centerline;
pub mod chain;
