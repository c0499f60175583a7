//! Signed distances from a mask's edge, in tiles that are found when somebody asks for them.
//!
//! Callers ask only for pixels near ropes. A tile sees the mask in a window around it, and the whole
//! mask if the edge is not in that. Threads that ask for the same tile get the same numbers.

use std::ops::Range;
use std::sync::OnceLock;

use super::bits::{Bits, WORD_PIXELS, select};
use super::distances::measure_alone;
use super::image::{Image, smooth_row, smoothing_kernel};
use super::runs::Mask;
use crate::geometry::cut_off;
use crate::parallel;
use crate::simd::kernel;

const SHIFT: u32 = 5; // logarithm of a tile's side, pixels
pub const SIDE: usize = 1 << SHIFT;
const STRIDE: usize = SIDE + 1; // of a tile's rows: tiles overlap by a pixel, so that four neighbours are in one
const SMOOTHING: f64 = 1.0; // standard deviation of the smoothing, pixels
const HALO: usize = 3; // reach of the smoothing, pixels
const WIDE: usize = 48; // a tile's side with the halo, in whole registers
const NEAR: usize = 64; // distances that are sought in the first window, pixels: enough for tiles 10 pixels from an edge
const FAR: u8 = NEAR as u8 + 1; // farther pixels count as this far
const WINDOW: usize = WIDE + 2 * NEAR; // columns of this window
const TOGETHER: usize = 8; // columns to each side that are looked at between checks

/// A tile's numbers, row by row.
type Numbers = [f32; STRIDE * STRIDE];
/// The distances of a tile and its halo.
type Patch = [[f32; WIDE]; STRIDE + 2 * HALO];

/// The distances of a tile's pixels, and the same slightly smoothed, for gradients.
#[derive(Debug)]
struct Tile {
    signed: Numbers,
    smooth: Numbers,
}

/// Signed distances of a magnified mask's pixels from its edge, positive inside, original pixels.
#[derive(Debug)]
pub struct EdgeDistances {
    inside: Bits,
    size: [usize; 2],
    scale: usize,
    /// Outside, farther pixels count as this far, magnified pixels.
    most: usize,
    kernel: [f32; HALO + 1],
    /// Tiles in a row of them.
    across: usize,
    tiles: Vec<OnceLock<Box<Tile>>>,
    /// Distances of all pixels outside the mask and inside it, magnified pixels: tiles far from an edge need them.
    whole: [OnceLock<Vec<f32>>; 2],
}

impl EdgeDistances {
    /// Prepares a mask magnified by `scale`; pixels outside it count as at most `most` magnified pixels away.
    pub fn new(inside: Bits, scale: usize, most: usize) -> Self {
        let size = inside.size();
        let [across, down] = size.map(|n| n.div_ceil(SIDE));
        let tiles = (0..across * down).map(|_| OnceLock::new()).collect();
        let kernel = smoothing_kernel(SMOOTHING);
        let kernel = std::array::from_fn(|k| kernel[k]);
        Self { inside, size, scale, most, kernel, across, tiles, whole: Default::default() }
    }

    /// The magnified mask.
    pub fn mask(&self) -> &Bits {
        &self.inside
    }

    /// Returns a pixel's tile, and its place there.
    #[inline(always)]
    fn find(&self, x: usize, y: usize) -> (&Tile, usize) {
        let number = self.number(x, y);
        let tile = match self.tiles[number].get() {
            Some(tile) => tile,
            None => self.make(number),
        };
        (tile, (y & (SIDE - 1)) * STRIDE + (x & (SIDE - 1)))
    }

    /// Returns the number of a pixel's tile.
    #[inline(always)]
    pub fn number(&self, x: usize, y: usize) -> usize {
        (y >> SHIFT) * self.across + (x >> SHIFT)
    }

    /// Returns the distance of a pixel.
    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        let (tile, k) = self.find(x, y);
        tile.signed[k]
    }

    /// Interpolates between pixels; distances beyond the border equal those on it.
    #[inline]
    pub fn between(&self, x: f64, y: f64) -> f64 {
        self.interpolate(x, y, |tile| &tile.signed)
    }

    /// Interpolates so between smoothed distances.
    #[inline]
    pub fn between_smooth(&self, x: f64, y: f64) -> f64 {
        self.interpolate(x, y, |tile| &tile.smooth)
    }

    /// Returns whether a place is inside the mask, where `between` is positive. Far from edges, no tile is made.
    #[inline]
    pub fn holds(&self, x: f64, y: f64) -> bool {
        let ([i, j], _) = self.cell(x, y);
        let [first, others @ ..] =
            [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)].map(|(i, j)| self.inside.at(i, j));
        if others.iter().all(|&other| other == first) { first } else { self.between(x, y) > 0.0 }
    }

    /// Returns the first of the four pixels around a place, and the place's offset from it.
    #[inline(always)]
    fn cell(&self, x: f64, y: f64) -> ([usize; 2], [f64; 2]) {
        let at = [x.clamp(0.0, (self.size[0] - 1) as f64), y.clamp(0.0, (self.size[1] - 1) as f64)];
        let first = [0, 1].map(|c| cut_off(at[c]).min(self.size[c] as u32 - 2));
        (first.map(|i| i as usize), [0, 1].map(|c| at[c] - f64::from(first[c])))
    }

    #[inline(always)]
    fn interpolate(&self, x: f64, y: f64, of: impl Fn(&Tile) -> &Numbers) -> f64 {
        let ([i, j], [a, b]) = self.cell(x, y);
        let (tile, k) = self.find(i, j);
        let v = of(tile);
        let above = f64::from(v[k]) * (1.0 - a) + f64::from(v[k + 1]) * a;
        let below = f64::from(v[k + STRIDE]) * (1.0 - a) + f64::from(v[k + STRIDE + 1]) * a;
        above * (1.0 - b) + below * b
    }

    /// Finds the tiles with an edge in them or at most `margin` pixels from them, and tells which tiles these are.
    pub fn find_edges(&self, margin: usize) -> Vec<bool> {
        let [w, h] = self.size;
        let bands: Vec<usize> = (0..h).step_by(SIDE).collect();
        let rows = parallel::map(&bands, |&top| {
            // columns with pixels in the mask, and with others
            let mut marked = [vec![0; self.inside.stride], vec![0; self.inside.stride]];
            let [some, others] = &mut marked;
            for row in top.saturating_sub(margin)..(top + SIDE + margin).min(h) {
                for ((some, others), word) in some.iter_mut().zip(&mut *others).zip(self.inside.row(row)) {
                    *some |= word;
                    *others |= !word;
                }
            }
            let edge = |left: usize| {
                let columns = left.saturating_sub(margin)..(left + SIDE + margin).min(w);
                let words = columns.start / WORD_PIXELS..columns.end.div_ceil(WORD_PIXELS);
                let holds = |marked: &[u64]| words.clone().any(|k| marked[k] & select(k, &columns) != 0);
                marked.iter().all(|marked| holds(marked))
            };
            (0..w).step_by(SIDE).map(edge).collect::<Vec<bool>>()
        });
        let edges = rows.concat();
        let numbers: Vec<usize> = (0..edges.len()).filter(|&k| edges[k]).collect();
        parallel::map(&numbers, |&number| {
            self.make(number);
        });
        edges
    }

    /// Returns a tile, and makes it if it is not known.
    #[cold]
    fn make(&self, number: usize) -> &Tile {
        self.tiles[number].get_or_init(|| Box::new(self.measure(number)))
    }

    /// Finds the distances of a tile, on this thread alone: others may wait for it.
    fn measure(&self, number: usize) -> Tile {
        let (left, top) = (number % self.across * SIDE, number / self.across * SIDE);
        let around =
            |first: usize, size: usize| first.saturating_sub(HALO)..(first + STRIDE + HALO).min(size);
        let columns = around(left, self.size[0]);
        let rows = around(top, self.size[1]);
        let mut patch = [[0.0; WIDE]; STRIDE + 2 * HALO];
        if !fill_near(&self.inside, self.scale as f32, &columns, &rows, &mut patch) {
            self.fill_far(&columns, &rows, &mut patch);
        }
        let mut tile = Tile { signed: [0.0; STRIDE * STRIDE], smooth: [0.0; STRIDE * STRIDE] };
        let corner = [left - columns.start, top - rows.start];
        let size = [columns.end - left, rows.end - top].map(|n| n.min(STRIDE));
        for (to, from) in tile.signed.chunks_exact_mut(STRIDE).zip(&patch[corner[1]..]).take(size[1]) {
            to[..size[0]].copy_from_slice(&from[corner[0]..][..size[0]]);
        }
        smooth(&patch, [columns.len(), rows.len()], corner, size, &self.kernel, &mut tile.smooth);
        tile
    }

    /// Fills distances of any size, from those of the whole image.
    fn fill_far(&self, columns: &Range<usize>, rows: &Range<usize>, patch: &mut Patch) {
        let (width, scale, most) = (self.size[0], self.scale as f32, self.most as f32);
        for (y, to) in rows.clone().zip(patch) {
            for (x, to) in columns.clone().zip(to) {
                let own = self.inside.at(x, y);
                let away = self.whole(own)[y * width + x];
                *to = if own { join_sides(away, 0.0, scale) } else { join_sides(0.0, away.min(most), scale) };
            }
        }
    }

    /// Returns the distances of all pixels inside the mask, or outside it, from others.
    fn whole(&self, of: bool) -> &[f32] {
        self.whole[usize::from(of)].get_or_init(|| {
            let [width, height] = self.size;
            let mut bytes = vec![0; width];
            let mut image = Image { width, height, values: Vec::with_capacity(width * height) };
            for row in 0..height {
                self.inside.unpack(row, 0, &mut bytes);
                image.values.extend(bytes.iter().map(|&byte| byte != 0));
            }
            measure_alone(&image, of, width + height)
        })
    }
}

/// Returns the signed distance, original pixels, by the distances from the other side, of which one is 0.
#[inline(always)]
fn join_sides(inner: f32, outer: f32, scale: f32) -> f32 {
    // the edge runs between the pixels
    let inner = (inner - 0.5).max(0.0) / scale;
    if inner > 0.0 { inner } else { (0.5 - outer) / scale }
}

/// A row of a tile's first window.
type Row<T> = [T; WINDOW];

kernel! {
    /// Fills the distances of some columns and rows, and returns whether the edge is near enough to all of them.
    fn fill_near<S>(
        _,
        mask: &Bits,
        scale: f32,
        columns: &Range<usize>,
        rows: &Range<usize>,
        patch: &mut Patch,
    ) -> bool {
        const BEYOND: u16 = (NEAR as u16 + 1) * (NEAR as u16 + 1);
        let wide = columns.len();
        let [width, height] = mask.size();
        // the window's columns in the image, and their places in its rows
        let across = columns.start.saturating_sub(NEAR)..(columns.end + NEAR).min(width);
        let places = across.start + NEAR - columns.start..across.end + NEAR - columns.start;
        let down = rows.start.saturating_sub(NEAR)..(rows.end + NEAR).min(height);
        let mut window = [[0u8; WINDOW]; STRIDE + 2 * (HALO + NEAR)];
        for (to, y) in window.iter_mut().zip(down.clone()) {
            let mut own = [0; WINDOW.next_multiple_of(WORD_PIXELS)];
            mask.unpack(y, across.start, &mut own);
            to[places.clone()].copy_from_slice(&own[..across.len()]);
        }
        let seen = |y: usize| &window[y - down.start];
        // the distance of each pixel from the nearest other one above it, then below it too
        let mut along = [[0u8; WINDOW]; STRIDE + 2 * HALO];
        let mut state = [FAR; WINDOW];
        for y in down.start..rows.end {
            step(seen(y), seen(y.saturating_sub(1).max(down.start)), &mut state);
            if y >= rows.start {
                along[y - rows.start] = state;
            }
        }
        state = [FAR; WINDOW];
        for y in (rows.start..down.end).rev() {
            step(seen(y), seen((y + 1).min(down.end - 1)), &mut state);
            if y < rows.end {
                for (along, &state) in along[y - rows.start].iter_mut().zip(&state) {
                    *along = (*along).min(state);
                }
            }
        }
        for ((y, along), to) in rows.clone().zip(&along).zip(patch.iter_mut()) {
            let own = seen(y);
            let mut squares = [0u16; WIDE];
            for of in [0, 1] {
                let mut from = [0u16; WINDOW];
                for ((from, &own), &along) in from.iter_mut().zip(own).zip(along) {
                    *from = if own == of { u16::from(along) * u16::from(along) } else { 0 };
                }
                // no pixel is beyond the border
                from[..places.start].fill(BEYOND);
                from[places.end..].fill(BEYOND);
                let mut least = [0u16; WIDE];
                for ((least, &own), &from) in least.iter_mut().zip(&own[NEAR..]).zip(&from[NEAR..]) {
                    *least = if own == of { from } else { 0 };
                }
                least[wide..].fill(0);
                for first in (1..=NEAR).step_by(TOGETHER) {
                    let known = (first * first) as u16;
                    if least.iter().fold(0, |any, &one| any | one.saturating_sub(known)) == 0 {
                        break;
                    }
                    for k in first..first + TOGETHER {
                        let square = (k * k) as u16;
                        let (left, right): (&[u16; WIDE], &[u16; WIDE]) =
                            (from[NEAR - k..].first_chunk().unwrap(), from[NEAR + k..].first_chunk().unwrap());
                        let sides = left.iter().zip(right);
                        for (least, (&left, &right)) in least.iter_mut().zip(sides) {
                            *least = (*least).min(left.min(right) + square);
                        }
                    }
                }
                for (to, &least) in squares.iter_mut().zip(&least) {
                    *to |= least;
                }
            }
            if squares.iter().fold(0, |most, &one| most.max(one)) > (NEAR * NEAR) as u16 {
                return false;
            }
            let away = to.iter_mut().zip(&squares).zip(&own[NEAR..]);
            for ((to, &square), &own) in away {
                let away = f32::from(square).sqrt();
                let inner = (away - 0.5) / scale;
                let outer = (0.5 - away) / scale;
                *to = if own != 0 { inner } else { outer };
            }
        }
        true
    }
}

/// Goes to the next pixel of each column: one farther from the last other pixel, or beside it.
#[inline(always)]
fn step(own: &Row<u8>, before: &Row<u8>, state: &mut Row<u8>) {
    for ((state, own), before) in state.iter_mut().zip(own).zip(before) {
        *state = if own == before { (*state + 1).min(FAR) } else { 1 };
    }
}

kernel! {
    /// Smooths a part of a patch of some columns and rows; its border is repeated.
    fn smooth<S>(
        _,
        patch: &Patch,
        whole: [usize; 2],
        corner: [usize; 2],
        size: [usize; 2],
        kernel: &[f32; HALO + 1],
        to: &mut Numbers,
    ) {
        let mut rows = [[0.0f32; WIDE]; STRIDE + 2 * HALO];
        for (row, from) in rows.iter_mut().zip(patch).take(whole[1]) {
            let mut padded = [0.0f32; WIDE + 2 * HALO];
            padded[HALO..HALO + WIDE].copy_from_slice(from);
            padded[..HALO].fill(from[0]);
            padded[HALO + whole[0]..].fill(from[whole[0] - 1]);
            smooth_row(kernel, |i| [&padded[HALO - i..][..WIDE], &padded[HALO + i..][..WIDE]], row);
        }
        for (n, to) in to.chunks_exact_mut(STRIDE).take(size[1]).enumerate() {
            let y = corner[1] + n;
            let mut sums = [0.0f32; WIDE];
            smooth_row(kernel, |i| [&rows[y.saturating_sub(i)], &rows[(y + i).min(whole[1] - 1)]], &mut sums);
            to[..size[0]].copy_from_slice(&sums[corner[0]..][..size[0]]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::distances::measure_distances;

    /// Returns the distances and the smoothed ones of all pixels.
    fn measure_whole(inside: &Image<bool>, scale: f32, most: f32) -> [Image<f32>; 2] {
        let [inner, outer] = [true, false].map(|of| measure_distances(inside, of, 5000));
        let joined = inner.values.iter().zip(&outer.values);
        let values = joined.map(|(&inner, &outer)| join_sides(inner, outer.min(most), scale)).collect();
        let signed = Image { values, ..inner };
        let smooth = signed.smoothed(SMOOTHING);
        [signed, smooth]
    }

    #[test]
    fn tiles_near_an_edge_need_no_distances_of_the_whole_image() {
        let (width, height) = (200, 170);
        for corner in 0..SIDE * SIDE / 7 {
            // the corner of a wide mask, or of what it leaves out, anywhere in a tile
            let (x, y) = (64 + 7 * corner % SIDE, 64 + 7 * corner / SIDE);
            let outside = corner % 2 == 0;
            let value = |k: usize| (k % width < x || k / width < y) != outside;
            let values: Vec<bool> = (0..width * height).map(value).collect();
            let found = EdgeDistances::new(Bits::pack(&values, width), 3, 400);
            found.find_edges(10);
            assert!(found.whole.iter().all(|whole| whole.get().is_none()), "{x}, {y}");
        }
    }

    #[test]
    fn tiles_have_the_distances_of_the_whole_image() {
        let (width, height) = (700, 330);
        for (radius, most) in [(3.0, 400), (70.0, 90), (140.0, 5000)] {
            let near = |k: usize, x: f64, y: f64| ((k % width) as f64 - x).hypot((k / width) as f64 - y);
            let values = (0..width * height)
                .map(|k| near(k, 200.3, 150.8) < radius || (near(k, 660.0, 40.0) - 30.0).abs() < 2.5)
                .collect();
            let inside = Image { width, height, values };
            let [signed, smooth] = measure_whole(&inside, 3.0, most as f32);
            let found = EdgeDistances::new(Bits::pack(&inside.values, inside.width), 3, most);
            let edges = found.find_edges(2);
            assert!(edges.contains(&true) && edges.contains(&false));
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                assert_eq!(found.at(x, y), signed.at(x, y), "{x}, {y}");
                if x + 1 < width && y + 1 < height {
                    assert_eq!(found.between_smooth(x as f64, y as f64), f64::from(smooth.at(x, y)));
                }
                if signed.at(x, y).abs() < 1.0 {
                    assert!(edges[found.number(x, y)]);
                }
            }
            assert_eq!(found.between(1e9, -3.0), f64::from(signed.at(width - 1, 0)));
            let expected = 0.5 * (f64::from(signed.at(63, 20)) + f64::from(signed.at(64, 20)));
            assert!((found.between(63.5, 20.0) - expected).abs() < 1e-5);
        }
    }
}
