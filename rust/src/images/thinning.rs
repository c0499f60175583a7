//! Thinning of masks to lines one pixel wide, 64 pixels at a time.

use crate::images::bits::{Bits, TOGETHER, WORD_PIXELS};
use crate::images::image::Image;
use crate::simd::kernel;

impl Bits {
    /// Returns which neighbours of a word's pixels are set, clockwise from above.
    fn around(&self, word: usize) -> [u64; 8] {
        let row = |word: usize| [self.words[word - 1], self.words[word], self.words[word + 1]];
        around([row(word - self.stride), row(word), row(word + self.stride)])
    }

    /// Removes pixels until none can be removed; with `whole`, diagonals keep their length.
    fn thin(&mut self, whole: bool) {
        let height = (self.words.len() - 2) / self.stride.max(1);
        let mut gone = vec![0; self.words.len()];
        // whether rows changed in this half round and in the one before
        let mut changed = vec![[true; 2]; height];
        for half in 0.. {
            // rows whose surroundings changed since the last half round of this kind
            let open: Vec<usize> = (1..height.saturating_sub(1))
                .filter(|&row| changed[row - 1..row + 2].as_flattened().contains(&true))
                .collect();
            if open.is_empty() {
                return;
            }
            changed.iter_mut().for_each(|changed| *changed = [false, changed[0]]);
            find_removable(&self.words, self.stride, &open, half % 2 == 1, whole, &mut gone);
            remove(&mut self.words, self.stride, &open, &gone, &mut changed);
        }
    }

    /// Thins, as [`Bits::thin`] does, and returns the remaining pixels, ascending.
    fn into_skeleton(mut self, whole: bool) -> Vec<usize> {
        self.thin(whole);
        self.smooth();
        self.pixels()
    }

    /// Removes the corners of staircases.
    fn smooth(&mut self) {
        for k in self.pixels() {
            let (word, bit) = self.word(k);
            let p = self.around(word).map(|near| near >> bit & 1 != 0);
            if p.iter().filter(|&&set| set).count() >= 2 && is_simple(&p) {
                self.set(k, false);
            }
        }
    }
}

/// Returns which neighbours of a word's pixels are set, clockwise from above, given three words of three rows.
#[inline(always)]
fn around([above, row, below]: [[u64; 3]; 3]) -> [u64; 8] {
    let ([nw, n, ne], [w, _, e], [sw, s, se]) = (beside(above), beside(row), beside(below));
    [n, ne, e, se, s, sw, w, nw]
}

/// Returns the left neighbours of the middle of three words' pixels, these, and their right neighbours.
#[inline(always)]
fn beside([before, own, after]: [u64; 3]) -> [u64; 3] {
    [own << 1 | before >> (WORD_PIXELS - 1), own, own >> 1 | after << (WORD_PIXELS - 1)]
}

/// Returns which pixels may be removed in the first or the second half of a round, given their neighbours.
#[inline(always)]
fn removable(p: [u64; 8], second: bool) -> u64 {
    // from an empty neighbour to a set one: once, and more than once
    let (mut once, mut again) = (0, 0);
    // pairs of adjacent neighbours that are both set, and both empty: if the empty ones are connected, two to six
    // neighbours are set
    let (mut set, mut empty) = (0, 0);
    for i in 0..8 {
        let (a, b) = (p[i], p[(i + 1) % 8]);
        let rises = !a & b;
        again |= once & rises;
        once |= rises;
        set |= a & b;
        empty |= !(a | b);
    }
    let [n, _, e, _, s, _, w, _] = p;
    let side = if second { n & w & (e | s) } else { e & s & (n | w) };
    once & !again & set & empty & !side
}

/// Returns the same by the rules of Guo and Hall, which keep diagonals whole.
#[inline(always)]
fn removable_whole([n, ne, e, se, s, sw, w, nw]: [u64; 8], second: bool) -> u64 {
    let rises = [!n & (ne | e), !e & (se | s), !s & (sw | w), !w & (nw | n)];
    let once = (rises[0] | rises[1] | rises[2] | rises[3]) & !two_of(rises);
    let (some, others) = ([nw | n, ne | e, se | s, sw | w], [n | ne, e | se, s | sw, w | nw]);
    let full = some[0] & some[1] & some[2] & some[3] & others[0] & others[1] & others[2] & others[3];
    let side = if second { (s | sw | !nw) & w } else { (n | ne | !se) & e };
    once & two_of(some) & two_of(others) & !full & !side
}

/// Returns which pixels are set in two of four masks at least.
#[inline(always)]
fn two_of([a, b, c, d]: [u64; 4]) -> u64 {
    a & b | c & d | (a | b) & (c | d)
}

kernel! {
    /// Fills which pixels of some rows of words may be removed.
    fn find_removable<S>(
        _,
        words: &[u64],
        stride: usize,
        rows: &[usize],
        second: bool,
        whole: bool,
        to: &mut [u64],
    ) {
        for first in rows.iter().map(|row| 1 + row * stride) {
            let parts = to[first..first + stride].as_chunks_mut::<TOGETHER>().0;
            for (part, first) in parts.iter_mut().zip((first..).step_by(TOGETHER)) {
                let row = |first: usize| &words[first - 1..][..TOGETHER + 2];
                let rows = [row(first - stride), row(first), row(first + stride)];
                if rows[1][1..=TOGETHER].iter().fold(0, |any, word| any | word) == 0 {
                    part.fill(0);
                    continue;
                }
                for (k, to) in part.iter_mut().enumerate() {
                    let near = around([
                        [rows[0][k], rows[0][k + 1], rows[0][k + 2]],
                        [rows[1][k], rows[1][k + 1], rows[1][k + 2]],
                        [rows[2][k], rows[2][k + 1], rows[2][k + 2]],
                    ]);
                    let own = if whole { removable_whole(near, second) } else { removable(near, second) };
                    *to = rows[1][k + 1] & own;
                }
            }
        }
    }
}

kernel! {
    /// Removes pixels from some rows of words, and notes which rows change.
    fn remove<S>(_, words: &mut [u64], stride: usize, rows: &[usize], gone: &[u64], changed: &mut [[bool; 2]]) {
        for &row in rows {
            let own = 1 + row * stride..1 + (row + 1) * stride;
            let mut any = 0;
            for (word, gone) in words[own.clone()].iter_mut().zip(&gone[own]) {
                any |= gone;
                *word &= !gone;
            }
            changed[row][0] = any != 0;
        }
    }
}

/// Returns whether a pixel's removal keeps connections and holes, given its neighbours clockwise from above.
///
/// It is the connectivity number of Yokoi, Toriwaki and Fukumura, *An analysis of topological properties of digitized
/// binary pictures using local features*, with connected diagonals.
fn is_simple(p: &[bool; 8]) -> bool {
    let empty = |i: usize| !p[i % 8];
    (0..8).step_by(2).filter(|&i| empty(i) && !(empty(i + 1) && empty(i + 2))).count() == 1
}

/// Thins chosen pixels of an image to lines one pixel wide, which keep their connections and holes.
///
/// Returns the remaining pixels, ascending. No chosen pixel may be on the border. The method is that of Zhang and Suen,
/// *A fast parallel algorithm for thinning digital patterns*.
pub fn thinned(pixels: impl IntoIterator<Item = usize>, width: usize, height: usize) -> Vec<usize> {
    let mut bits = Bits::new(width, height);
    for k in pixels {
        bits.set(k, true);
    }
    bits.into_skeleton(false)
}

/// Returns the skeleton of a mask with an empty border: pixels, ascending.
pub fn find_skeleton(mask: &Bits) -> Vec<usize> {
    mask.clone().into_skeleton(false)
}

/// Returns the skeleton of a mask with an empty border, whose diagonals keep their length: pixels, ascending.
///
/// The method is that of Guo and Hall, *Parallel thinning with two-subiteration algorithms*.
pub fn find_whole_skeleton(mask: &Image<bool>) -> Vec<usize> {
    Bits::pack(&mask.values, mask.width).into_skeleton(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Thins by the rounds of Zhang and Suen, pixel by pixel.
    fn by_pixel(mask: &Image<bool>) -> Vec<bool> {
        let (w, mut values) = (mask.width, mask.values.clone());
        loop {
            let mut changed = false;
            for second in [false, true] {
                let gone: Vec<usize> = (0..values.len())
                    .filter(|&k| {
                        values[k] && {
                            let p = [k - w, k - w + 1, k + 1, k + w + 1, k + w, k + w - 1, k - 1, k - w - 1]
                                .map(|n| values[n]);
                            let count = p.iter().filter(|&&set| set).count();
                            let rises = (0..8).filter(|&i| !p[i] && p[(i + 1) % 8]).count();
                            let [n, _, e, _, s, _, w, _] = p;
                            let side = if second { n && w && (e || s) } else { e && s && (n || w) };
                            (2..=6).contains(&count) && rises == 1 && !side
                        }
                    })
                    .collect();
                gone.iter().for_each(|&k| values[k] = false);
                changed |= !gone.is_empty();
            }
            if !changed {
                return values;
            }
        }
    }

    #[test]
    fn words_are_thinned_as_pixels_are() {
        let mut state = 7u64;
        for (width, height, blobs) in [(40, 30, 6), (64, 25, 8), (150, 90, 40), (129, 60, 25)] {
            let mut mask = Image::filled(width, height, false);
            for _ in 0..blobs {
                let mut drawn = |most: usize| {
                    state =
                        state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 33) as usize % most
                };
                let (x, y, r) = (drawn(width), drawn(height), 2 + drawn(9));
                for k in 0..width * height {
                    let (u, v) = (k % width, k / width);
                    let inside = u > 0 && v > 0 && u + 1 < width && v + 1 < height;
                    mask.values[k] |= inside && u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2) <= r * r;
                }
            }
            let mut bits = Bits::new(width, height);
            (0..width * height).filter(|&k| mask.values[k]).for_each(|k| bits.set(k, true));
            bits.thin(false);
            let left: Vec<usize> =
                by_pixel(&mask).iter().enumerate().filter(|(_, v)| **v).map(|(k, _)| k).collect();
            assert!(!left.is_empty());
            assert_eq!(bits.pixels(), left, "{width} x {height}");
        }
    }

    #[test]
    fn a_diagonal_of_even_width_keeps_its_length() {
        let (width, height) = (120, 120);
        let diagonal = Image {
            width,
            height,
            values: (0..width * height)
                .map(|k| {
                    let (x, y) = (k % width, k / width);
                    (10..110).contains(&x)
                        && (10..110).contains(&y)
                        && (-3..=4).contains(&(x as i64 - y as i64))
                })
                .collect(),
        };
        assert!(find_skeleton(&Bits::pack(&diagonal.values, width)).len() < 10);
        assert!(find_whole_skeleton(&diagonal).len() > 95);
    }

    #[test]
    fn a_ring_stays_a_ring_and_a_bar_becomes_a_line() {
        let (width, height) = (90, 70);
        let away = |k: usize| ((k % width) as f64 - 45.0).hypot((k / width) as f64 - 35.0);
        let ring: Vec<usize> = (0..width * height).filter(|&k| (16.0..24.0).contains(&away(k))).collect();
        let left = thinned(ring, width, height);
        assert!(left.iter().all(|&k| (away(k) - 20.0).abs() < 2.0));
        // in a closed line, each pixel touches two others
        let touching = |k: usize| {
            let near = |n: &&usize| {
                **n != k && (**n % width).abs_diff(k % width) <= 1 && (**n / width).abs_diff(k / width) <= 1
            };
            left.iter().filter(near).count()
        };
        assert!(left.len() > 90 && left.iter().all(|&k| touching(k) == 2));
        let bar = (0..width * height)
            .filter(|&k| (30..37).contains(&(k / width)) && (10..80).contains(&(k % width)));
        let left = thinned(bar, width, height);
        assert!(left.len() > 60 && left.iter().all(|&k| k / width == 33));
    }
}
