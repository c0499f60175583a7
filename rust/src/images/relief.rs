//! The depth of the ropes across an image: smooth, so that it is known beside the masks too.

use crate::clouds::depth::has_return;
use crate::geometry::cut_off;
use crate::geometry::median::upper_median;
use crate::parallel;
use crate::simd::{LANES, kernel};

const MAX_PIXELS: usize = 4000; // pixels that the plane is fitted to at most
const ROUNDS: usize = 6; // rounds of the plane's fit
const CELL: f64 = 4.0; // side of a cell, image radii
const MIN_AREA: f64 = 2.0; // pixels that a cell needs, squared image radii

/// Depth of the ropes' surface across an image: a fitted plane, and the residual in each cell.
#[derive(Debug, Clone)]
pub struct Relief {
    /// 1/z is linear across the image of a plane: its slopes along columns and rows, and its value at `middle`.
    plane: [f64; 3],
    middle: [f64; 2],
    low: [f64; 2],
    cell: f64,
    size: [usize; 2],
    /// The residual of 1/z in each cell.
    rest: Vec<f64>,
    /// Least 1/z; the plane does not hold far beyond the ropes.
    least: f64,
}

impl Relief {
    /// Keeps the pixels of ropes with depth, given by their columns, rows and depths; None if they are too few.
    pub fn keep_seen(ropes: impl Iterator<Item = [f64; 3]>, radius_px: f64) -> Option<Vec<[f64; 3]>> {
        let seen: Vec<[f64; 3]> = ropes.filter(|&[.., z]| has_return(z)).collect();
        (seen.len() as f64 >= MIN_AREA * radius_px * radius_px).then_some(seen)
    }

    /// Fits such pixels, row by row, in a range of columns and rows; None if they do not fix a plane.
    pub fn new(seen: &[[f64; 3]], low: [usize; 2], high: [usize; 2], radius_px: f64) -> Option<Self> {
        let middle = [0, 1].map(|c| 0.5 * (low[c] + high[c]) as f64);
        let step = seen.len().div_ceil(MAX_PIXELS);
        let some: Vec<[f64; 3]> = seen.iter().step_by(step).map(|&[x, y, z]| [x, y, 1.0 / z]).collect();
        let plane = fit_plane(&some, middle, radius_px)?;
        let on = |x: f64, y: f64| plane[0] * (x - middle[0]) + plane[1] * (y - middle[1]) + plane[2];
        let cell = CELL * radius_px;
        let size = [0, 1].map(|c| ((high[c] - low[c]) as f64 / cell).ceil().max(1.0) as usize);
        let corner = low.map(|l| l as f64);
        let mut own: Vec<Vec<f64>> = vec![Vec::new(); size[0] * size[1]];
        for &[x, y, w] in &some {
            let i = (cut_off((x - corner[0]) / cell) as usize).min(size[0] - 1);
            let j = (cut_off((y - corner[1]) / cell) as usize).min(size[1] - 1);
            own[j * size[0] + i].push(w - on(x, y));
        }
        let fewest = MIN_AREA * radius_px * radius_px / step as f64;
        // also of the cells around a cell: pixels of other things are the minority there
        let beside = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        let rest = parallel::map(&(0..own.len()).collect::<Vec<_>>(), |&number| {
            let (columns, rows) = (beside(number % size[0], size[0]), beside(number / size[0], size[1]));
            let around = || rows.clone().flat_map(|row| &own[row * size[0]..][columns.clone()]);
            let count: usize = around().map(Vec::len).sum();
            if count as f64 >= fewest {
                upper_median(&around().flatten().copied().collect::<Vec<_>>())
            } else {
                None
            }
        });
        let least = 0.1 * upper_median(&some.iter().map(|s| s[2]).collect::<Vec<_>>())?;
        Some(Self { plane, middle, low: corner, cell, size, rest: fill(rest, size), least })
    }

    /// Returns the cells before and after a column or a row of the image, and the second one's weight.
    #[inline(always)]
    fn between(&self, x: f64, axis: usize) -> (usize, usize, f64) {
        let last = self.size[axis] - 1;
        let t = ((x - self.low[axis]) / self.cell - 0.5).clamp(0.0, last as f64);
        let first = cut_off(t).min((last as u32).saturating_sub(1));
        (first as usize, (first as usize + 1).min(last), t - f64::from(first))
    }

    /// Returns the residual at a column in a row of cells.
    #[inline(always)]
    fn rest_across(&self, row: usize, (first, second, share): (usize, usize, f64)) -> f64 {
        let rests = &self.rest[row * self.size[0]..];
        (1.0 - share) * rests[first] + share * rests[second]
    }

    /// Returns the depth of the ropes' surface at a place, metres.
    pub fn depth(&self, [u, v]: [f64; 2]) -> f64 {
        let (across, (above, below, share)) = (self.between(u, 0), self.between(v, 1));
        let rests = [above, below].map(|row| self.rest_across(row, across));
        self.surface(self.plane[0] * (u - self.middle[0]), self.plane[1] * (v - self.middle[1]), rests, share)
    }

    /// Returns the depth where the plane rises by some nearness along the columns and rows, between two residuals.
    #[inline(always)]
    fn surface(&self, across: f64, down: f64, [above, below]: [f64; 2], share: f64) -> f64 {
        let plane = across + down + self.plane[2];
        1.0 / (plane + (1.0 - share) * above + share * below).max(self.least)
    }

    /// Returns the same at all places of some columns and rows of the image, row by row.
    pub fn depths(&self, columns: &[usize], rows: &[usize]) -> Vec<f64> {
        let places: Vec<_> = columns.iter().map(|&x| self.between(x as f64, 0)).collect();
        let wide: Vec<Vec<f64>> = (0..self.size[1])
            .map(|row| places.iter().map(|&across| self.rest_across(row, across)).collect())
            .collect();
        let rises: Vec<f64> = columns.iter().map(|&x| self.plane[0] * (x as f64 - self.middle[0])).collect();
        let mut found = vec![0.0; columns.len() * rows.len()];
        for (to, &y) in found.chunks_exact_mut(columns.len().max(1)).zip(rows) {
            let (above, below, share) = self.between(y as f64, 1);
            let down = self.plane[1] * (y as f64 - self.middle[1]);
            fill_row(self, &rises, down, [&wide[above], &wide[below]], share, to);
        }
        found
    }
}

kernel! {
    /// Fills the depths of the ropes' surface in a row, see [`Relief::surface`].
    fn fill_row<S>(
        _,
        relief: &Relief,
        rises: &[f64],
        down: f64,
        rests: [&[f64]; 2],
        share: f64,
        to: &mut [f64],
    ) {
        for (((to, &rise), &above), &below) in to.iter_mut().zip(rises).zip(rests[0]).zip(rests[1]) {
            *to = relief.surface(rise, down, [above, below], share);
        }
    }
}

/// Fits a plane by least absolute residuals.
fn fit_plane(seen: &[[f64; 3]], middle: [f64; 2], radius_px: f64) -> Option<[f64; 3]> {
    // whole registers of numbers; those beyond the pixels have no weight
    let count = seen.len().next_multiple_of(LANES);
    let mut pixels = [vec![0.0; count], vec![0.0; count], vec![0.0; count]];
    for (n, s) in seen.iter().enumerate() {
        pixels[0][n] = (s[0] - middle[0]) / radius_px;
        pixels[1][n] = (s[1] - middle[1]) / radius_px;
        pixels[2][n] = s[2];
    }
    let mut weights = vec![0.0; count];
    weights[..seen.len()].fill(1.0);
    let mut rests = vec![0.0; count];
    let mut plane = nalgebra::Vector3::zeros();
    for _ in 0..ROUNDS {
        let [xx, xy, yy, x, y, one, xw, yw, w] = sum_products(&pixels, &weights);
        // pixels on a line do not fix the slope across it
        let (xx, yy) = (xx + 1e-6 * one, yy + 1e-6 * one);
        let matrix = nalgebra::Matrix3::new(xx, xy, x, xy, yy, y, x, y, one);
        plane = matrix.cholesky()?.solve(&nalgebra::Vector3::new(xw, yw, w));
        measure_rests(&pixels, plane.into(), &mut rests);
        let scale = upper_median(&rests[..seen.len()])?.max(1e-9);
        for (weight, rest) in weights.iter_mut().zip(&rests[..seen.len()]) {
            *weight = scale / rest.max(0.3 * scale);
        }
    }
    let found = [plane[0] / radius_px, plane[1] / radius_px, plane[2]];
    found.iter().all(|x| x.is_finite()).then_some(found)
}

kernel! {
    /// Sums weighted products of pixels' columns, rows and 1/z: x², xy, y², x, y, 1, x/z, y/z and 1/z.
    fn sum_products<S>(_, pixels: &[Vec<f64>; 3], weights: &[f64]) -> [f64; 9] {
        let [x, y, w] = pixels.each_ref().map(|values| values.as_chunks::<LANES>().0);
        let mut sums = [[0.0; LANES]; 9];
        for (((x, y), w), weights) in x.iter().zip(y).zip(w).zip(weights.as_chunks::<LANES>().0) {
            for l in 0..LANES {
                let (across, down) = (weights[l] * x[l], weights[l] * y[l]);
                sums[0][l] += across * x[l];
                sums[1][l] += across * y[l];
                sums[2][l] += down * y[l];
                sums[3][l] += across;
                sums[4][l] += down;
                sums[5][l] += weights[l];
                sums[6][l] += across * w[l];
                sums[7][l] += down * w[l];
                sums[8][l] += weights[l] * w[l];
            }
        }
        sums.map(|sum| sum.iter().sum())
    }
}

kernel! {
    /// Measures how far 1/z of pixels is from a plane.
    fn measure_rests<S>(_, pixels: &[Vec<f64>; 3], plane: [f64; 3], rests: &mut [f64]) {
        let [x, y, w] = pixels;
        for (((rest, x), y), w) in rests.iter_mut().zip(x).zip(y).zip(w) {
            *rest = (w - plane[0] * x - plane[1] * y - plane[2]).abs();
        }
    }
}

/// Fills cells without a value from their neighbours, ring by ring.
fn fill(mut cells: Vec<Option<f64>>, size: [usize; 2]) -> Vec<f64> {
    while cells.iter().any(Option::is_none) {
        let mut next = cells.clone();
        for j in 0..size[1] {
            for i in 0..size[0] {
                if cells[j * size[0] + i].is_some() {
                    continue;
                }
                let near: Vec<f64> = (j.saturating_sub(1)..(j + 2).min(size[1]))
                    .flat_map(|l| (i.saturating_sub(1)..(i + 2).min(size[0])).map(move |k| (k, l)))
                    .filter_map(|(k, l)| cells[l * size[0] + k])
                    .collect();
                if !near.is_empty() {
                    next[j * size[0] + i] = Some(near.iter().sum::<f64>() / near.len() as f64);
                }
            }
        }
        if next == cells {
            break;
        }
        cells = next;
    }
    cells.into_iter().map(|cell| cell.unwrap_or(0.0)).collect()
}
