//! Numbers over an image that are kept in tiles: only near ropes, so that huge images take little memory.

use std::ops::Range;

const SHIFT: u32 = 6; // logarithm of a tile's side, pixels
const SIDE: usize = 1 << SHIFT;
const STRIDE: usize = SIDE + 1; // of a tile's rows: tiles overlap by a pixel, so that four neighbours are in one

/// A field of numbers; tiles that are not kept have one number.
#[derive(Debug, Clone)]
pub struct Field {
    width: usize,
    height: usize,
    /// Tiles in a row of them.
    across: usize,
    /// Where each tile's numbers start.
    starts: Vec<usize>,
    values: Vec<f32>,
}

/// Tiles of some rows of an image.
pub struct Tiles {
    /// The number of each tile that is kept, ascending.
    numbers: Vec<usize>,
    values: Vec<f32>,
}

impl Field {
    /// Returns the rows of an image in stretches of about `many` rows of whole tiles.
    pub fn list_rows(height: usize, many: usize) -> Vec<Range<usize>> {
        let step = many.next_multiple_of(SIDE).max(SIDE);
        (0..height).step_by(step).map(|first| first..(first + step).min(height)).collect()
    }

    /// Puts tiles together, from above to below; `other` is the number of those that were not kept.
    pub fn new(size: [usize; 2], parts: Vec<Tiles>, other: f32) -> Self {
        let [across, down] = size.map(|n| n.div_ceil(SIDE));
        let mut starts = vec![0; across * down];
        let mut values =
            Vec::with_capacity(STRIDE * STRIDE + parts.iter().map(|part| part.values.len()).sum::<usize>());
        values.resize(STRIDE * STRIDE, other);
        for part in parts {
            for (k, number) in part.numbers.into_iter().enumerate() {
                starts[number] = values.len() + k * STRIDE * STRIDE;
            }
            values.extend(part.values);
        }
        Self { width: size[0], height: size[1], across, starts, values }
    }

    /// Returns where a pixel's number is.
    #[inline(always)]
    fn index(&self, x: usize, y: usize) -> usize {
        let start = self.starts[(y >> SHIFT) * self.across + (x >> SHIFT)];
        start + (y & (SIDE - 1)) * STRIDE + (x & (SIDE - 1))
    }

    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.values[self.index(x, y)]
    }

    /// Interpolates between pixels; values beyond the border equal those on it.
    #[inline]
    pub fn between(&self, x: f64, y: f64) -> f64 {
        let x = x.clamp(0.0, (self.width - 1) as f64);
        let y = y.clamp(0.0, (self.height - 1) as f64);
        let (i, j) = ((x as usize).min(self.width - 2), (y as usize).min(self.height - 2));
        let (a, b) = (x - i as f64, y - j as f64);
        let k = self.index(i, j);
        let v = &self.values;
        let above = f64::from(v[k]) * (1.0 - a) + f64::from(v[k + 1]) * a;
        let below = f64::from(v[k + STRIDE]) * (1.0 - a) + f64::from(v[k + STRIDE + 1]) * a;
        above * (1.0 - b) + below * b
    }
}

impl Tiles {
    /// Takes tiles from rows of an image. `rows` start at a tile and are whole tiles, but for the last of the image;
    /// `values` has them and the row after them, if there is one.
    pub fn new(values: &[f32], width: usize, rows: Range<usize>, numbers: Vec<usize>) -> Self {
        let across = width.div_ceil(SIDE);
        let mut tiles = vec![0.0; numbers.len() * STRIDE * STRIDE];
        for (tile, number) in tiles.chunks_exact_mut(STRIDE * STRIDE).zip(&numbers) {
            let (left, top) = (number % across * SIDE, number / across * SIDE - rows.start);
            let wide = STRIDE.min(width - left);
            for (to, from) in tile.chunks_exact_mut(STRIDE).zip(values[top * width..].chunks_exact(width)) {
                to[..wide].copy_from_slice(&from[left..left + wide]);
            }
        }
        Self { numbers, values: tiles }
    }

    /// Returns the numbers of the tiles of such rows that hold a number above a limit.
    pub fn choose(values: &[f32], width: usize, rows: Range<usize>, limit: f32) -> Vec<usize> {
        let across = width.div_ceil(SIDE);
        let mut found = Vec::new();
        let stretches = values[..rows.len() * width].chunks(SIDE * width);
        for (stretch, first) in stretches.zip((rows.start / SIDE * across..).step_by(across)) {
            let mut kept = vec![false; across];
            for row in stretch.chunks_exact(width) {
                for (kept, part) in kept.iter_mut().zip(row.chunks(SIDE)) {
                    *kept = *kept || part.iter().fold(false, |any, &value| any | (value > limit));
                }
            }
            found.extend((0..across).filter(|&k| kept[k]).map(|k| first + k));
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_near_and_far_are_found_and_interpolated() {
        let (width, height) = (150, 200);
        // large near a corner
        let value = |x: usize, y: usize| 100.0 - (x as f32).hypot(y as f32);
        let values: Vec<f32> = (0..width * height).map(|k| value(k % width, k / width)).collect();
        let parts: Vec<Tiles> = Field::list_rows(height, 70)
            .into_iter()
            .map(|rows| {
                let values = &values[rows.start * width..(rows.end + 1).min(height) * width];
                let numbers = Tiles::choose(values, width, rows.clone(), 0.0);
                Tiles::new(values, width, rows, numbers)
            })
            .collect();
        assert_eq!(parts.iter().map(|part| part.numbers.len()).collect::<Vec<_>>(), [4, 0]);
        let field = Field::new([width, height], parts, -7.0);
        for (x, y) in [(0, 0), (63, 64), (64, 63), (99, 3), (3, 127)] {
            assert_eq!(field.at(x, y), value(x, y));
        }
        assert_eq!(field.at(140, 190), -7.0);
        assert_eq!(field.between(148.9, 1e9), -7.0);
        let expected = 0.5 * f64::from(value(63, 20) + value(64, 20));
        assert!((field.between(63.5, 20.0) - expected).abs() < 1e-5);
        let expected = 0.5 * f64::from(value(20, 63) + value(20, 64));
        assert!((field.between(20.0, 63.5) - expected).abs() < 1e-5);
    }
}
