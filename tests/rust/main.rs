//! The kernels against brute force, known truth and invariances: one binary, so that it links once.

mod fixtures;
mod fuzz;
mod icp;
mod normals;
mod tubes;

mod clouds {
    mod filter;
}

mod published {
    mod centerline;
    mod chain;
}
