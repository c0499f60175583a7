//! Means of colours over chosen pixels of squares, from sums over all cells above and to the left.

use super::{Planes, size};

const UNITS: f32 = 64.0; // units of a whole number for each unit of colour

/// Sums of three numbers and counts of chosen pixels, over square cells.
///
/// The sums are whole numbers that wrap: differences of them are exact.
pub struct Sums {
    cell: usize,
    columns: usize,
    rows: usize,
    sums: Vec<[i32; 4]>,
}

impl Sums {
    /// Sums all pixels over cells with a side in pixels.
    pub fn of_all(planes: &Planes, cell: usize) -> Self {
        let [width, height] = size(planes);
        let mut sums = Self::empty(planes, cell);
        let mut row = vec![0i32; width];
        for j in 0..sums.rows {
            let own = j * cell * width..((j + 1) * cell).min(height) * width;
            let cells = &mut sums.sums[(j + 1) * (sums.columns + 1) + 1..][..sums.columns];
            for (n, plane) in planes.iter().enumerate() {
                row.fill(0);
                for values in plane.values[own.clone()].chunks_exact(width) {
                    for (sum, value) in row.iter_mut().zip(values) {
                        *sum = sum.wrapping_add((UNITS * value) as i32);
                    }
                }
                for (to, part) in cells.iter_mut().zip(row.chunks(cell)) {
                    to[n] = part.iter().fold(0, |sum: i32, value| sum.wrapping_add(*value));
                }
            }
            let tall = (own.len() / width) as i32;
            for (i, to) in cells.iter_mut().enumerate() {
                to[3] = tall * ((i + 1) * cell).min(width).wrapping_sub(i * cell) as i32;
            }
        }
        sums.add_up()
    }

    /// Sums some pixels over cells with a side in pixels.
    pub fn of_some(planes: &Planes, cell: usize, chosen: impl Iterator<Item = usize>) -> Self {
        let width = planes[0].width;
        let mut sums = Self::empty(planes, cell);
        let columns = sums.columns + 1;
        for k in chosen {
            let to = &mut sums.sums[(k / width / cell + 1) * columns + k % width / cell + 1];
            for (sum, plane) in to.iter_mut().zip(planes) {
                *sum = sum.wrapping_add((UNITS * plane.values[k]) as i32);
            }
            to[3] += 1;
        }
        sums.add_up()
    }

    /// Returns the sums of the pixels that others do not hold.
    pub fn without(&self, others: &Self) -> Self {
        let pairs = self.sums.iter().zip(&others.sums);
        let sums = pairs.map(|(all, some)| [0, 1, 2, 3].map(|n| all[n].wrapping_sub(some[n]))).collect();
        Self { sums, ..*self }
    }

    fn empty(planes: &Planes, cell: usize) -> Self {
        let [columns, rows] = size(planes).map(|side| side.div_ceil(cell));
        Self { cell, columns, rows, sums: vec![[0; 4]; (columns + 1) * (rows + 1)] }
    }

    /// Turns sums of single cells into those of all cells above and to the left.
    fn add_up(mut self) -> Self {
        for j in 1..=self.rows {
            let (above, here) = self.sums[(j - 1) * (self.columns + 1)..].split_at_mut(self.columns + 1);
            let mut row = [0i32; 4];
            for (to, above) in here.iter_mut().zip(above) {
                for n in 0..4 {
                    row[n] = row[n].wrapping_add(to[n]);
                    to[n] = row[n].wrapping_add(above[n]);
                }
            }
        }
        self
    }

    /// Returns the number of columns and rows of cells.
    pub fn size(&self) -> [usize; 2] {
        [self.columns, self.rows]
    }

    /// Returns the mean over the chosen pixels of the cells whose middles are at most `reach` pixels from a cell's, along
    /// rows and columns, and the share of chosen pixels.
    pub fn mean(&self, column: usize, row: usize, reach: f64) -> ([f32; 3], f32) {
        let cells = (reach / self.cell as f64).round() as usize;
        let (left, right) = (column.saturating_sub(cells), (column + cells + 1).min(self.columns));
        let (top, bottom) = (row.saturating_sub(cells), (row + cells + 1).min(self.rows));
        self.mean_of([left, right], [top, bottom])
    }

    /// Returns the mean over all chosen pixels.
    pub fn total(&self) -> [f32; 3] {
        let last = |j: usize| self.sums[j * (self.columns + 1) + self.columns];
        let mut sum = [0i64; 4];
        for j in 0..self.rows {
            // only sums of single rows are sure to fit
            for n in 0..4 {
                sum[n] += i64::from(last(j + 1)[n].wrapping_sub(last(j)[n]));
            }
        }
        [0, 1, 2].map(|n| (sum[n] as f64 / f64::from(UNITS) / (sum[3].max(1) as f64)) as f32)
    }

    fn mean_of(&self, [left, right]: [usize; 2], [top, bottom]: [usize; 2]) -> ([f32; 3], f32) {
        let at = |x: usize, y: usize| self.sums[y * (self.columns + 1) + x];
        let (a, b, c, d) = (at(left, top), at(right, top), at(left, bottom), at(right, bottom));
        let sum = [0, 1, 2, 3].map(|n| d[n].wrapping_sub(b[n]).wrapping_sub(c[n]).wrapping_add(a[n]) as f32);
        let area = ((right - left) * (bottom - top) * self.cell * self.cell).max(1) as f32;
        ([0, 1, 2].map(|n| sum[n] / UNITS / sum[3].max(1e-6)), sum[3] / area)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::image::Image;

    #[test]
    fn means_are_those_of_brute_force() {
        let (width, height) = (9, 7);
        let planes = [3usize, 5, 7].map(|step| Image {
            width,
            height,
            values: (0..width * height).map(|k| (k * step % 11) as f32).collect(),
        });
        let chosen = |k: usize| k % 3 != 1;
        for cell in [1, 2] {
            let rest = (0..width * height).filter(|&k| !chosen(k));
            let sums = Sums::of_all(&planes, cell).without(&Sums::of_some(&planes, cell, rest));
            assert_eq!(sums.size(), [9usize.div_ceil(cell), 7usize.div_ceil(cell)]);
            for (x, y, reach) in [(0, 0, 2), (4, 3, 1), (3, 2, 3), (1, 2, 20)] {
                let own: Vec<usize> = (0..width * height)
                    .filter(|&k| {
                        let (i, j) = (k % width / cell, k / width / cell);
                        i.abs_diff(x) <= reach && j.abs_diff(y) <= reach && chosen(k)
                    })
                    .collect();
                let (mean, _) = sums.mean(x, y, (reach * cell) as f64);
                for (plane, mean) in planes.iter().zip(mean) {
                    let brute = own.iter().map(|&k| plane.values[k]).sum::<f32>() / own.len() as f32;
                    assert!((brute - mean).abs() < 1e-4);
                }
            }
        }
    }
}
