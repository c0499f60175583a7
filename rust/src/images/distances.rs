//! Distances of an image's pixels from the nearest pixel of the other value.
//!
//! The method is exact (Felzenszwalb and Huttenlocher, *Distance transforms of sampled functions*): first along columns,
//! then by the lower envelope of parabolas along each run of a row. Rows are worked on in bands, so that no image of the
//! distances along columns is kept.

use std::ops::Range;

use super::bits::Bits;
use super::image::{Image, find_next};
use super::runs::Mask;
use crate::parallel;
use crate::simd::kernel;

const PIXELS_PER_TASK: usize = 1024; // chosen pixels that one task works on

/// Returns the distance of each `of` pixel to the nearest other pixel, between pixel centres; 0 for the other pixels.
///
/// Distances above `most` may be wrong, but stay above `most`. So may those of over 65,000 pixels.
pub fn measure_distances(image: &Image<bool>, of: bool, most: usize) -> Image<f32> {
    let (w, h) = (image.width, image.height);
    let mut found = Image::filled(w, h, 0.0f32);
    if found.values.is_empty() {
        return found;
    }
    let (many, bands) = list_bands(image);
    let columns = Columns::new(image, of, most, &bands);
    parallel::rows(&mut found.values, w, |first, part| columns.measure(first / many, part));
    found
}

/// Returns the distance of chosen pixels of a mask to the nearest pixel outside it.
pub fn measure_depths(mask: &Bits, pixels: &[usize]) -> Vec<f32> {
    let [w, h] = mask.size();
    let parts: Vec<&[usize]> = pixels.chunks(PIXELS_PER_TASK).collect();
    let found = parallel::map(&parts, |part| {
        let depths = part.iter().map(|&k| {
            let (x, y) = (k % w, k / w);
            let mut least = usize::MAX;
            for down in 0..h {
                if down * down >= least {
                    break;
                }
                for row in [y.checked_sub(down), Some(y + down).filter(|&row| row < h)].into_iter().flatten()
                {
                    if let Some(across) = mask.measure_across(row, x) {
                        least = least.min(across * across + down * down);
                    }
                }
            }
            (least as f32).sqrt()
        });
        depths.collect::<Vec<f32>>()
    });
    found.concat()
}

/// Returns the distances of [`measure_distances`], row by row, but finds them on this thread alone.
pub fn measure_alone(image: &Image<bool>, of: bool, most: usize) -> Vec<f32> {
    let mut found = vec![0.0; image.values.len()];
    let (many, bands) = list_bands(image);
    let columns = Columns::new(image, of, most, &bands);
    for (band, part) in found.chunks_mut((many * image.width).max(1)).enumerate() {
        columns.measure(band, part);
    }
    found
}

/// Returns the number of rows of a band, and the bands of an image.
fn list_bands(image: &Image<bool>) -> (usize, Vec<Range<usize>>) {
    let (many, height) = (parallel::count_rows(image.width), image.height);
    (many, (0..height).step_by(many).map(|first| first..(first + many).min(height)).collect())
}

/// Distances of `of` pixels along the columns of an image to the nearest other pixel, at most `far`, band by band.
struct Columns<'a> {
    image: &'a Image<bool>,
    of: bool,
    far: u16,
    bands: &'a [Range<usize>],
    /// The distances to pixels above, in the row before each band, and to pixels below, in the row after it.
    beside: Vec<[Vec<u16>; 2]>,
}

impl<'a> Columns<'a> {
    /// Prepares bands of rows, which ascend and may overlap.
    fn new(image: &'a Image<bool>, of: bool, most: usize, bands: &'a [Range<usize>]) -> Self {
        let far = most.clamp(1, usize::from(u16::MAX) - 2) as u16 + 1;
        let mut beside = vec![[vec![far; image.width], vec![far; image.width]]; bands.len()];
        let (firsts, lasts) = (bands.iter().map(|band| band.start), bands.iter().map(|band| band.end));
        let mut states: [Vec<(usize, &mut Vec<u16>)>; 2] = [Vec::new(), Vec::new()];
        for ((first, last), [above, below]) in firsts.zip(lasts).zip(&mut beside) {
            if first > 0 {
                states[0].push((first - 1, above));
            }
            if last < image.height {
                states[1].push((last, below));
            }
        }
        let [mut above, mut below] = states;
        below.reverse();
        sweep(image, of, far, false, &mut above);
        sweep(image, of, far, true, &mut below);
        Self { image, of, far, bands, beside }
    }

    /// Returns the distances along columns in a band.
    fn along(&self, band: usize) -> Vec<u16> {
        let mut found = vec![0; self.bands[band].len() * self.image.width];
        along_columns(
            self.image,
            self.of,
            self.far,
            self.bands[band].clone(),
            &self.beside[band],
            &mut found,
        );
        found
    }

    /// Finds the distances of a band's `of` pixels, and leaves the others as they are.
    fn measure(&self, band: usize, to: &mut [f32]) {
        let along = self.along(band);
        find_nearest(self.image, &along, self.of, self.far, self.bands[band].start, to);
    }
}

kernel! {
    /// Goes down or up the columns, and notes the distances in rows, which are in this order.
    fn sweep<S>(_, image: &Image<bool>, of: bool, far: u16, up: bool, rows: &mut [(usize, &mut Vec<u16>)]) {
        let (w, h) = (image.width, image.height);
        let mut state = vec![far; w];
        let mut next = if up { h } else { 0 };
        for (row, to) in rows {
            while if up { next > *row } else { next <= *row } {
                let y = if up { next - 1 } else { next };
                for (to, &value) in state.iter_mut().zip(&image.values[y * w..]) {
                    *to = if value == of { (*to + 1).min(far) } else { 0 };
                }
                next = if up { next - 1 } else { next + 1 };
            }
            to.copy_from_slice(&state);
        }
    }
}

kernel! {
    /// Finds the distance of each `of` pixel of some rows to the nearest other pixel of its column, at most `far`, from
    /// those in the rows beside them.
    fn along_columns<S>(
        _,
        image: &Image<bool>,
        of: bool,
        far: u16,
        rows: Range<usize>,
        beside: &[Vec<u16>; 2],
        along: &mut [u16],
    ) {
        let (w, [above, below]) = (image.width, beside);
        let values = &image.values[rows.start * w..rows.end * w];
        for n in 0..rows.len() {
            let (done, here) = along.split_at_mut(n * w);
            let before = if n > 0 { &done[(n - 1) * w..] } else { above };
            for ((to, &before), &value) in here[..w].iter_mut().zip(before).zip(&values[n * w..]) {
                *to = if value == of { (before + 1).min(far) } else { 0 };
            }
        }
        for n in (0..rows.len()).rev() {
            let (here, done) = along.split_at_mut((n + 1) * w);
            let before = if n + 1 < rows.len() { &done[..w] } else { below };
            for (to, &before) in here[n * w..].iter_mut().zip(before) {
                *to = (*to).min(before + 1);
            }
        }
    }
}

kernel! {
    /// Finds the distances of the `of` pixels of rows, from row `first` on, from those along the columns.
    fn find_nearest<S>(_, image: &Image<bool>, along: &[u16], of: bool, far: u16, first: usize, to: &mut [f32]) {
        let w = image.width;
        let (mut sites, mut starts) = (Vec::new(), Vec::new());
        let rows = image.values[first * w..].chunks_exact(w).zip(along.chunks_exact(w));
        for ((values, along), to) in rows.zip(to.chunks_exact_mut(w)) {
            find_nearest_of_row(values, along, of, far, to, &mut sites, &mut starts);
        }
    }
}

/// Finds the distances of a row's `of` pixels from those along the columns.
#[inline(always)]
fn find_nearest_of_row(
    values: &[bool],
    from: &[u16],
    of: bool,
    far: u16,
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
            to[begin..end].fill(f32::from(far));
        }
        let mut first = begin;
        for (k, &site) in sites.iter().enumerate() {
            let last = starts.get(k + 1).map_or(end, |next| (next.ceil().max(0.0) as usize).min(end));
            let down = f32::from(from[site as usize]);
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
fn find_envelope(g: &[u16], begin: usize, end: usize, far: u16, sites: &mut Vec<u32>, starts: &mut Vec<f32>) {
    sites.clear();
    starts.clear();
    for i in (begin..end).filter(|&i| g[i] < far) {
        let square = |g: u16| i64::from(g) * i64::from(g);
        loop {
            let Some(&last) = sites.last() else {
                sites.push(i as u32);
                starts.push(f32::NEG_INFINITY);
                break;
            };
            // squares of columns of a wide image are too large for single precision, their difference mostly is not
            let (apart, middle) = (i as i64 - i64::from(last), i as i64 + i64::from(last));
            let higher = square(g[i]) - square(g[last as usize]);
            let meet = (apart * middle + higher) as f32 / (2 * apart) as f32;
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
    fn distances_in_wide_images_are_exact() {
        let width = 24_000;
        let mut image = Image::filled(width, 3, true);
        let others: Vec<usize> = (0..).map(|k| 40 + k * k / 7 + 5 * k).take_while(|&x| x < width).collect();
        others.iter().for_each(|&x| image.values[x % 3 * width + x] = false);
        let found = measure_distances(&image, true, width);
        for (k, &away) in found.values.iter().enumerate().step_by(11) {
            let square = |&x: &usize| (k % width).abs_diff(x).pow(2) + (k / width).abs_diff(x % 3).pow(2);
            let expected = others.iter().map(square).min().unwrap();
            assert!((away - (expected as f32).sqrt()).abs() < 1e-3, "{k}: {away}");
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
    fn bands_and_chosen_pixels_have_the_distances_of_the_whole_image() {
        let image = drawn(900, 300, 3);
        let whole = measure_distances(&image, true, 300);
        for bands in [&[(0, 300)][..], &[(0, 7), (4, 150), (147, 300)]] {
            let bands: Vec<Range<usize>> = bands.iter().map(|&(first, end)| first..end).collect();
            let columns = Columns::new(&image, true, 300, &bands);
            for (k, rows) in bands.iter().enumerate() {
                let mut found = vec![0.0; rows.len() * 900];
                columns.measure(k, &mut found);
                assert_eq!(found, whole.values[rows.start * 900..rows.end * 900]);
            }
        }
        let chosen: Vec<usize> = (0..image.values.len()).filter(|&k| image.values[k] && k % 7 == 0).collect();
        let depths: Vec<f32> = chosen.iter().map(|&k| whole.values[k]).collect();
        assert_eq!(measure_depths(&Bits::pack(&image.values, image.width), &chosen), depths);
    }
}
