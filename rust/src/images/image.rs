//! Images of numbers: smoothing and blobs.

use std::ops::Range;

use crate::images::bits::{Bits, WORD_PIXELS, pack};
use crate::images::runs::Mask;
use crate::parallel;
use crate::simd::kernel;

const MANY: usize = WORD_PIXELS; // pixels that are looked at together

/// An image of `width` columns, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Image<T> {
    pub width: usize,
    pub height: usize,
    pub values: Vec<T>,
}

impl<T: Copy> Image<T> {
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, values: vec![value; width * height] }
    }

    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> T {
        self.values[y * self.width + x]
    }
}

impl Image<f32> {
    /// Magnifies numbers of at least 0 by a whole number, bilinearly, and returns where the result is above a level of at
    /// least 0.
    pub fn magnified(&self, scale: usize, level: f32) -> Bits {
        let mut made = Bits::new(self.width * scale, self.height * scale);
        // a word has many pixels
        let (stride, many) = (made.stride, parallel::count_rows(self.width * scale));
        parallel::rows_by(made.rows_mut(), stride, many, |first, part| {
            magnify(self, scale, level, first, stride, part)
        });
        made
    }

    /// Smooths with a Gaussian of this standard deviation, pixels; the border is repeated.
    pub fn smoothed(&self, deviation: f64) -> Self {
        self.convolved(&smoothing_kernel(deviation))
    }

    /// Convolves along rows and columns with a symmetric kernel, given from its middle on; the border is repeated.
    pub fn convolved(&self, kernel: &[f32]) -> Self {
        let mut values = vec![0.0f32; self.values.len()];
        parallel::rows(&mut values, self.width, |first, part| smooth(self, kernel, first, part));
        Self { width: self.width, height: self.height, values }
    }
}

/// Returns the half of a Gaussian kernel from its middle on; its standard deviation is in pixels.
pub fn smoothing_kernel(deviation: f64) -> Vec<f32> {
    let reach = (3.0 * deviation).ceil() as usize;
    let mut kernel: Vec<f32> =
        (0..=reach).map(|i| (-0.5 * (i as f64 / deviation).powi(2)).exp() as f32).collect();
    let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
    kernel.iter_mut().for_each(|k| *k /= sum);
    kernel
}

kernel! {
    /// Fills rows of [`Image::magnified`], from row `first` on.
    fn magnify<S>(_, image: &Image<f32>, scale: usize, level: f32, first: usize, stride: usize, to: &mut [u64]) {
        let w = image.width * scale;
        // the first of two pixels, and the second one's weight
        let between = |i: usize, count: usize| {
            let x = ((i as f64 + 0.5) / scale as f64 - 0.5).clamp(0.0, (count - 1) as f64);
            let first = (x as usize).min(count - 2);
            (first, x - first as f64)
        };
        let columns: Vec<(usize, f64)> = (0..w).map(|x| between(x, image.width)).collect();
        let widen = |j: usize, wide: &mut [f64]| {
            let from = &image.values[j * image.width..(j + 1) * image.width];
            for (wide, columns) in wide.chunks_mut(MANY).zip(columns.chunks(MANY)) {
                let (first, last) = (columns[0].0, columns[columns.len() - 1].0 + 1);
                // most of a mask's box is empty
                if from[first..=last].iter().fold(false, |any, &value| any | (value > 0.0)) {
                    for (value, &(i, a)) in wide.iter_mut().zip(columns) {
                        *value = f64::from(from[i]) * (1.0 - a) + f64::from(from[i + 1]) * a;
                    }
                } else {
                    wide.fill(0.0);
                }
            }
        };
        let (mut above, mut below, mut current) = (vec![0.0; w], vec![0.0; w], usize::MAX);
        for (n, to) in to.chunks_exact_mut(stride).enumerate() {
            let (j, b) = between(first + n, image.height);
            if j != current {
                if current != usize::MAX && j == current + 1 {
                    std::mem::swap(&mut above, &mut below);
                } else {
                    widen(j, &mut above);
                }
                widen(j + 1, &mut below);
                current = j;
            }
            for ((word, above), below) in to.iter_mut().zip(above.chunks(MANY)).zip(below.chunks(MANY)) {
                if above.iter().zip(below).fold(false, |any, (&a, &b)| any | (a > 0.0) | (b > 0.0)) {
                    let mut values = [false; MANY];
                    for ((value, above), below) in values.iter_mut().zip(above).zip(below) {
                        *value = (above * (1.0 - b) + below * b) as f32 > level;
                    }
                    *word = pack(&values);
                }
            }
        }
    }
}

/// Smooths a row by half of a symmetric kernel, given the values before and after it at each distance.
#[inline(always)]
pub fn smooth_row<'a>(kernel: &[f32], beside: impl Fn(usize) -> [&'a [f32]; 2], to: &mut [f32]) {
    for (value, x) in to.iter_mut().zip(beside(0)[0]) {
        *value = kernel[0] * x;
    }
    for (i, k) in kernel.iter().enumerate().skip(1) {
        let [before, after] = beside(i);
        for ((value, a), b) in to.iter_mut().zip(before).zip(after) {
            *value += k * (a + b);
        }
    }
}

kernel! {
    /// Smooths rows of an image, from row `first` on, by half of a symmetric kernel; the border is repeated.
    fn smooth<S>(_, image: &Image<f32>, kernel: &[f32], first: usize, to: &mut [f32]) {
        let (w, h, reach) = (image.width, image.height, kernel.len() - 1);
        // smooth these rows, and the ones beside them that are needed, along themselves
        let from = first.saturating_sub(reach);
        let until = (first + to.len() / w + reach).min(h);
        let mut rows = vec![0.0f32; (until - from) * w];
        let mut padded = vec![0.0f32; w + 2 * reach];
        for (values, row) in image.values[from * w..].chunks_exact(w).zip(rows.chunks_exact_mut(w)) {
            padded[..reach].fill(values[0]);
            padded[reach..reach + w].copy_from_slice(values);
            padded[reach + w..].fill(values[w - 1]);
            smooth_row(kernel, |i| [&padded[reach - i..], &padded[reach + i..]], row);
        }
        for (n, to) in to.chunks_exact_mut(w).enumerate() {
            let row = |y: usize| &rows[(y - from) * w..][..w];
            let y = first + n;
            smooth_row(kernel, |i| [row(y.saturating_sub(i)), row((y + i).min(h - 1))], to);
        }
    }
}

impl Mask for Image<bool> {
    fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    #[inline]
    fn find_next(&self, row: usize, from: usize, value: bool) -> usize {
        find_next(&self.values[row * self.width..][..self.width], from, value)
    }

    fn fill(&mut self, row: usize, columns: Range<usize>, value: bool) {
        self.values[row * self.width..][columns].fill(value);
    }
}

/// Consecutive pixels of a row in one blob.
#[derive(Debug, Clone)]
pub struct Run {
    pub row: usize,
    /// The first column, and the one after the last.
    pub begin: usize,
    pub end: usize,
    pub blob: usize,
}

/// Connected pixels of one value, numbered in the order of their first pixels, row by row.
pub struct Blobs {
    pub runs: Vec<Run>,
    /// The number of pixels of each.
    pub sizes: Vec<usize>,
}

/// Finds the blobs of pixels with the value `of`; `diagonal` says whether diagonal neighbours are connected.
pub fn find_blobs(image: &impl Mask, of: bool, diagonal: bool) -> Blobs {
    let reach = usize::from(diagonal);
    let mut runs: Vec<Run> = Vec::new();
    // each run's parent in a tree of touching runs; roots are their own parents
    let mut parents: Vec<usize> = Vec::new();
    let mut above = 0..0;
    let [width, height] = image.size();
    for row in 0..height {
        let first = runs.len();
        let mut near = above.start;
        let mut begin = image.find_next(row, 0, of);
        while begin < width {
            let end = image.find_next(row, begin, !of);
            let number = runs.len();
            parents.push(number);
            while near < above.end && runs[near].end + reach <= begin {
                near += 1;
            }
            let mut touching = near;
            while touching < above.end && runs[touching].begin < end + reach {
                let (a, b) = (find_root(&mut parents, touching), find_root(&mut parents, number));
                parents[a.max(b)] = a.min(b);
                touching += 1;
            }
            runs.push(Run { row, begin, end, blob: 0 });
            begin = image.find_next(row, end, of);
        }
        above = first..runs.len();
    }
    let mut sizes = Vec::new();
    for i in 0..runs.len() {
        // the root is the first run of a tree
        runs[i].blob = match parents[i] {
            parent if parent == i => {
                sizes.push(0);
                sizes.len() - 1
            }
            parent => runs[parent].blob,
        };
        sizes[runs[i].blob] += runs[i].end - runs[i].begin;
    }
    Blobs { runs, sizes }
}

/// Returns the runs of true values.
pub fn find_runs(values: &[bool]) -> impl Iterator<Item = Range<usize>> {
    let mut end = 0;
    std::iter::from_fn(move || {
        let begin = find_next(values, end, true);
        end = find_next(values, begin, false);
        (begin < end).then_some(begin..end)
    })
}

/// Returns the first position from `from` on with a value, or the length if there is none.
pub fn find_next(values: &[bool], from: usize, value: bool) -> usize {
    const MANY: usize = 32; // values that are looked at together
    let mut at = from;
    // without an early exit, many at once
    while at + MANY <= values.len() && !values[at..at + MANY].iter().fold(false, |any, &v| any | (v == value))
    {
        at += MANY;
    }
    let flipped = if value { 0 } else { u64::from_ne_bytes([1; 8]) };
    let (eights, rest) = values[at..].as_chunks();
    for eight in eights {
        let found = u64::from_le_bytes(eight.map(u8::from)) ^ flipped;
        if found != 0 {
            return at + found.trailing_zeros() as usize / 8;
        }
        at += 8;
    }
    rest.iter().position(|&v| v == value).map_or(values.len(), |more| at + more)
}

/// Returns the root of a run's tree, and shortens the path to it.
fn find_root(parents: &mut [usize], mut i: usize) -> usize {
    while parents[i] != i {
        parents[i] = parents[parents[i]];
        i = parents[i];
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_the_marked_stretches() {
        let marked = |text: &str| text.chars().map(|c| c == 'x').collect::<Vec<bool>>();
        let runs = |text: &str| find_runs(&marked(text)).map(|run| [run.start, run.end]).collect::<Vec<_>>();
        assert!(runs("").is_empty());
        assert!(runs("...").is_empty());
        assert_eq!(runs("xx"), [[0, 2]]);
        assert_eq!(runs("x..xxx.x"), [[0, 1], [3, 6], [7, 8]]);
        assert_eq!(runs(".xx."), [[1, 3]]);
    }

    #[test]
    fn blobs_are_numbered_and_counted() {
        let rows = ["##...", "..#..", "....#", "#...#"];
        let values: Vec<bool> = rows.iter().flat_map(|row| row.chars().map(|c| c == '#')).collect();
        let image = Image { width: 5, height: 4, values };
        assert_eq!(find_blobs(&image, true, true).sizes, [3, 2, 1]);
        assert_eq!(find_blobs(&image, true, false).sizes, [2, 1, 2, 1]);
        let found = find_blobs(&image, true, true);
        let runs: Vec<_> = found.runs.iter().map(|r| (r.row, r.begin, r.end, r.blob)).collect();
        assert_eq!(runs, [(0, 0, 2, 0), (1, 2, 3, 0), (2, 4, 5, 1), (3, 0, 1, 2), (3, 4, 5, 1)]);
    }

    #[test]
    fn smoothing_keeps_the_sum_and_the_middle() {
        let mut image = Image::filled(41, 31, 0.0f32);
        image.values[15 * image.width + 20] = 1.0;
        let found = image.smoothed(2.0);
        let sum: f32 = found.values.iter().sum();
        assert!((sum - 1.0).abs() < 1e-5);
        assert!((found.at(18, 15) - found.at(22, 15)).abs() < 1e-7);
        assert!((found.at(20, 15) - 1.0 / (8.0 * std::f32::consts::PI)).abs() < 1e-3);
    }
}
