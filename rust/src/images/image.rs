//! Images of numbers: smoothing, blobs, distances.

use crate::parallel;
use crate::simd::kernel;

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
    /// Interpolates between pixels; values beyond the border equal those on it.
    #[inline]
    pub fn between(&self, x: f64, y: f64) -> f64 {
        let x = x.clamp(0.0, (self.width - 1) as f64);
        let y = y.clamp(0.0, (self.height - 1) as f64);
        let (i, j) = ((x as usize).min(self.width - 2), (y as usize).min(self.height - 2));
        let (a, b) = (x - i as f64, y - j as f64);
        let k = j * self.width + i;
        let v = &self.values;
        let above = f64::from(v[k]) * (1.0 - a) + f64::from(v[k + 1]) * a;
        let below = f64::from(v[k + self.width]) * (1.0 - a) + f64::from(v[k + self.width + 1]) * a;
        above * (1.0 - b) + below * b
    }

    /// Magnifies by a whole number, bilinearly, and returns where the result is above a level.
    pub fn magnified(&self, scale: usize, level: f32) -> Image<bool> {
        let (w, h) = (self.width * scale, self.height * scale);
        let mut made = Image::filled(w, h, false);
        parallel::rows(&mut made.values, w, |first, part| magnify(self, scale, level, first, part));
        made
    }

    /// Smooths with a Gaussian of this standard deviation, pixels; the border is repeated.
    pub fn smoothed(&self, deviation: f64) -> Self {
        let reach = (3.0 * deviation).ceil() as usize;
        let mut kernel: Vec<f32> =
            (0..=reach).map(|i| (-0.5 * (i as f64 / deviation).powi(2)).exp() as f32).collect();
        let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
        kernel.iter_mut().for_each(|k| *k /= sum);
        self.convolved(&kernel)
    }

    /// Convolves along rows and columns with a symmetric kernel, given from its middle on; the border is repeated.
    pub fn convolved(&self, kernel: &[f32]) -> Self {
        let mut values = vec![0.0f32; self.values.len()];
        parallel::rows(&mut values, self.width, |first, part| smooth(self, kernel, first, part));
        Self { width: self.width, height: self.height, values }
    }
}

kernel! {
    /// Fills rows of [`Image::magnified`], from row `first` on.
    fn magnify<S>(_, image: &Image<f32>, scale: usize, level: f32, first: usize, to: &mut [bool]) {
        let w = image.width * scale;
        // the first of two pixels, and the second one's weight
        let between = |i: usize, count: usize| {
            let x = ((i as f64 + 0.5) / scale as f64 - 0.5).clamp(0.0, (count - 1) as f64);
            let first = (x as usize).min(count - 2);
            (first, x - first as f64)
        };
        let columns: Vec<(usize, f64)> = (0..w).map(|x| between(x, image.width)).collect();
        let (mut above, mut below, mut current) = (vec![0.0; w], vec![0.0; w], usize::MAX);
        for (n, to) in to.chunks_exact_mut(w).enumerate() {
            let (j, b) = between(first + n, image.height);
            if j != current {
                for (row, wide) in [(j, &mut above), (j + 1, &mut below)] {
                    let from = &image.values[row * image.width..(row + 1) * image.width];
                    for (value, &(i, a)) in wide.iter_mut().zip(&columns) {
                        *value = f64::from(from[i]) * (1.0 - a) + f64::from(from[i + 1]) * a;
                    }
                }
                current = j;
            }
            for ((value, above), below) in to.iter_mut().zip(&above).zip(&below) {
                *value = (above * (1.0 - b) + below * b) as f32 > level;
            }
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
            for (value, x) in row.iter_mut().zip(&padded[reach..]) {
                *value = kernel[0] * x;
            }
            for (i, k) in kernel.iter().enumerate().skip(1) {
                for ((value, a), b) in row.iter_mut().zip(&padded[reach - i..]).zip(&padded[reach + i..]) {
                    *value += k * (a + b);
                }
            }
        }
        for (n, to) in to.chunks_exact_mut(w).enumerate() {
            let row = |y: usize| &rows[(y - from) * w..][..w];
            let y = first + n;
            for (value, x) in to.iter_mut().zip(row(y)) {
                *value = kernel[0] * x;
            }
            for (i, k) in kernel.iter().enumerate().skip(1) {
                let (above, below) = (row(y.saturating_sub(i)), row((y + i).min(h - 1)));
                for ((value, a), b) in to.iter_mut().zip(above).zip(below) {
                    *value += k * (a + b);
                }
            }
        }
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
pub fn find_blobs(image: &Image<bool>, of: bool, diagonal: bool) -> Blobs {
    let reach = usize::from(diagonal);
    let mut runs: Vec<Run> = Vec::new();
    // each run's parent in a tree of touching runs; roots are their own parents
    let mut parents: Vec<usize> = Vec::new();
    let mut above = 0..0;
    for (row, values) in image.values.chunks_exact(image.width.max(1)).enumerate() {
        let first = runs.len();
        let mut near = above.start;
        let mut begin = find_next(values, 0, of);
        while begin < values.len() {
            let end = find_next(values, begin, !of);
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
            begin = find_next(values, end, of);
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

/// Returns the first position from `from` on with a value, or the length if there is none.
fn find_next(values: &[bool], from: usize, value: bool) -> usize {
    const MANY: usize = 32; // values that are looked at together
    let mut at = from;
    // without an early exit, many at once
    while at + MANY <= values.len() && !values[at..at + MANY].iter().fold(false, |any, &v| any | (v == value))
    {
        at += MANY;
    }
    values[at..].iter().position(|&v| v == value).map_or(values.len(), |more| at + more)
}

/// Returns the root of a run's tree, and shortens the path to it.
fn find_root(parents: &mut [usize], mut i: usize) -> usize {
    while parents[i] != i {
        parents[i] = parents[parents[i]];
        i = parents[i];
    }
    i
}

/// Returns the distance of each `of` pixel to the nearest other pixel, between pixel centres; 0 for the other pixels.
///
/// The method is exact (Felzenszwalb and Huttenlocher, *Distance transforms of sampled functions*): first along
/// columns, then by the lower envelope of parabolas along each run of a row. Distances above `most` may be wrong, but
/// stay above `most`.
pub fn measure_distances(image: &Image<bool>, of: bool, most: usize) -> Image<f32> {
    let (w, h) = (image.width, image.height);
    let far = most.max(1) as u32 + 1;
    let mut found = Image::filled(w, h, 0.0f32);
    if found.values.is_empty() {
        return found;
    }
    // distance along the column, at most `far`
    let mut along = vec![0u32; w * h];
    along_columns(image, of, far, &mut along);
    parallel::rows(&mut found.values, w, |first, part| {
        find_nearest(image, &along, of, far, first, part);
    });
    found
}

kernel! {
    /// Finds the distance of each `of` pixel to the nearest other pixel of its column, at most `far`.
    fn along_columns<S>(_, image: &Image<bool>, of: bool, far: u32, along: &mut [u32]) {
        let (w, h) = (image.width, image.height);
        for (to, &value) in along[..w].iter_mut().zip(&image.values[..w]) {
            *to = if value == of { far } else { 0 };
        }
        for y in 1..h {
            let (above, here) = along[(y - 1) * w..(y + 1) * w].split_at_mut(w);
            for ((to, &before), &value) in here.iter_mut().zip(&*above).zip(&image.values[y * w..]) {
                *to = if value == of { (before + 1).min(far) } else { 0 };
            }
        }
        for y in (0..h.saturating_sub(1)).rev() {
            let (here, below) = along[y * w..(y + 2) * w].split_at_mut(w);
            for (to, &before) in here.iter_mut().zip(&*below) {
                *to = (*to).min(before + 1);
            }
        }
    }
}

kernel! {
    /// Finds the distances of the `of` pixels of rows, from row `first` on, from those along the columns.
    fn find_nearest<S>(
        _,
        image: &Image<bool>,
        along: &[u32],
        of: bool,
        far: u32,
        first: usize,
        to: &mut [f32],
    ) {
        let w = image.width;
        let (mut sites, mut starts) = (Vec::new(), Vec::new());
        for (n, to) in to.chunks_exact_mut(w).enumerate() {
            let row = (first + n) * w..(first + n + 1) * w;
            find_nearest_of_row(
                &image.values[row.clone()],
                &along[row],
                of,
                far,
                to,
                &mut sites,
                &mut starts,
            );
        }
    }
}

/// Finds the distances of a row's `of` pixels from those along the columns.
#[inline(always)]
fn find_nearest_of_row(
    values: &[bool],
    from: &[u32],
    of: bool,
    far: u32,
    to: &mut [f32],
    sites: &mut Vec<u32>,
    starts: &mut Vec<f32>,
) {
    let w = values.len();
    let mut begin = find_next(values, 0, of);
    while begin < w {
        let end = find_next(values, begin, !of);
        // the other pixels beside the run stand for all beyond them
        find_envelope(from, begin.saturating_sub(1), (end + 1).min(w), far, sites, starts);
        if sites.is_empty() {
            to[begin..end].fill(far as f32);
        }
        let mut first = begin;
        for (k, &site) in sites.iter().enumerate() {
            let last = starts.get(k + 1).map_or(end, |next| (next.ceil().max(0.0) as usize).min(end));
            let down = from[site as usize] as f32;
            let down = down * down;
            for (x, to) in (first as u32..).zip(&mut to[first..last.max(first)]) {
                let away = x.wrapping_sub(site) as i32 as f32;
                *to = (away * away + down).sqrt();
            }
            first = first.max(last);
        }
        begin = find_next(values, end, of);
    }
}

/// Finds the lower envelope of the parabolas (x − i)² + g(i)² over columns `begin` to `end`, and where each begins to
/// be lowest; skips those with g(i) = `far`.
#[inline(always)]
fn find_envelope(g: &[u32], begin: usize, end: usize, far: u32, sites: &mut Vec<u32>, starts: &mut Vec<f32>) {
    sites.clear();
    starts.clear();
    for i in (begin..end).filter(|&i| g[i] < far) {
        // whole numbers of an image's size are exact
        let (across, down) = (i as u32 as f32, g[i] as f32);
        let high = across * across + down * down;
        loop {
            let Some(&last) = sites.last() else {
                sites.push(i as u32);
                starts.push(f32::NEG_INFINITY);
                break;
            };
            let (across, down) = (last as f32, g[last as usize] as f32);
            let meet = (high - (across * across + down * down)) / (2 * (i as u32 - last)) as f32;
            if meet <= *starts.last().unwrap_or(&f32::NEG_INFINITY) {
                sites.pop();
                starts.pop();
                continue;
            }
            sites.push(i as u32);
            starts.push(meet);
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns random pixels, most of them set.
    fn drawn(width: usize, height: usize, seed: u64) -> Image<bool> {
        let mut state = seed;
        let mut image = Image::filled(width, height, true);
        for value in &mut image.values {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *value = state >> 33 & 31 != 0;
        }
        image
    }

    #[test]
    fn distances_are_those_of_brute_force() {
        for seed in 1..6 {
            let image = drawn(37, 23, seed);
            for of in [true, false] {
                let found = measure_distances(&image, of, 60);
                for k in 0..image.values.len() {
                    let (x, y) = (k % 37, k / 37);
                    let square = (0..image.values.len())
                        .filter(|&j| image.values[j] != of)
                        .map(|j| (j % 37).abs_diff(x).pow(2) + (j / 37).abs_diff(y).pow(2))
                        .min();
                    let expected = (square.unwrap() as f32).sqrt();
                    assert!((found.values[k] - expected).abs() < 1e-5, "{} for {expected}", found.values[k]);
                }
            }
        }
    }

    #[test]
    fn distances_above_the_most_are_not_found_below_it() {
        let mut image = Image::filled(50, 40, true);
        image.values[4 * image.width + 3] = false;
        let found = measure_distances(&image, true, 10);
        for k in 0..image.values.len() {
            let expected = ((k % 50) as f32 - 3.0).hypot((k / 50) as f32 - 4.0);
            let right = (found.values[k] - expected).abs() < 1e-4;
            assert!(right || (expected > 10.0 && found.values[k] >= 10.0));
        }
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
        assert!(
            (found.between(20.5, 15.0) - f64::from(found.at(20, 15) + found.at(21, 15)) / 2.0).abs() < 1e-7
        );
    }
}
