//! The kernels against brute force, known truth and invariances: one binary, so that it links once.

mod centerline;
mod chain;
mod clouds;
mod filter;
mod fuzz;
mod icp;
mod normals;
mod tubes;
