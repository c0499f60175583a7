//! Ropes in colour images: strips that differ from both sides, their regions, and what each piece looks like.
//!
//! A "half width" is that of a strip, pixels. Colours are in Lab.

pub mod drawing;
pub mod lab;
mod levels;
pub mod pieces;
pub mod region;
pub mod strips;
mod sums;

use crate::images::image::Image;

/// Three numbers for each pixel, one image for each.
pub type Planes = [Image<f32>; 3];

/// Returns the size of planes: width and height.
fn size(planes: &Planes) -> [usize; 2] {
    [planes[0].width, planes[0].height]
}

/// Returns a pixel's numbers.
#[inline(always)]
fn color(planes: &Planes, k: usize) -> [f32; 3] {
    [planes[0].values[k], planes[1].values[k], planes[2].values[k]]
}

/// Returns the squared difference of two colours.
#[inline(always)]
fn difference2(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

/// Returns the middle one of numbers, the upper one of two; 0 of none.
fn median(values: &mut [f32]) -> f32 {
    match values.len() {
        0 => 0.0,
        count => *values.select_nth_unstable_by(count / 2, f32::total_cmp).1,
    }
}
