//! Targets for coverage-guided fuzzing: each makes arguments of bytes, calls kernels, and checks their answers.
//!
//! An answer is finite and within limits, or an error. The program in `fuzz/` runs the targets with inputs that
//! libFuzzer makes. The tests here run the inputs that were found, and some at random.

mod bytes;
mod clouds;
mod drawing;
mod lines;
mod masks;
mod pixels;
mod ropes;
#[cfg(test)]
mod tests;

use bytes::Bytes;

type Target = (&'static str, fn(Bytes<'_>));

const TARGETS: [Target; 10] = [
    ("outliers", clouds::count_around),
    ("normals", clouds::estimate_surfaces),
    ("registration", clouds::register),
    ("curves", lines::follow_curves),
    ("queries", lines::query_tubes),
    ("knots", lines::name_knots),
    ("images", pixels::read_images),
    ("masks", masks::read_masks),
    ("tracking", ropes::track),
    ("fit", ropes::fit),
];

/// Runs a target; the calling thread does all the work.
///
/// # Panics
/// If there is no such target, or an answer is wrong.
pub fn run(name: &str, data: &[u8]) {
    let (_, target) = TARGETS.iter().find(|(own, _)| *own == name).expect("the name of a target");
    crate::parallel::alone(|| target(Bytes(data)));
}
