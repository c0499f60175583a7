//! The depth of the ropes across an image: smooth, so that it is known beside the masks too.

use crate::clouds::depth::has_return;
use crate::geometry::cut_off;
use crate::geometry::median::upper_median;
use crate::simd::kernel;

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
    /// Fits the pixels of ropes, their columns, rows and depths row by row, in a range of columns and rows; None if too
    /// few have depth.
    pub fn new(
        ropes: impl Iterator<Item = [f64; 3]>,
        low: [usize; 2],
        high: [usize; 2],
        radius_px: f64,
    ) -> Option<Self> {
        let seen: Vec<[f64; 3]> =
            ropes.filter(|&[.., z]| has_return(z)).map(|[x, y, z]| [x, y, 1.0 / z]).collect();
        if (seen.len() as f64) < MIN_AREA * radius_px * radius_px {
            return None;
        }
        let middle = [0, 1].map(|c| 0.5 * (low[c] + high[c]) as f64);
        let step = seen.len().div_ceil(MAX_PIXELS);
        let some: Vec<[f64; 3]> = seen.iter().step_by(step).copied().collect();
        let plane = fit_plane(&some, middle, radius_px)?;
        let on = |x: f64, y: f64| plane[0] * (x - middle[0]) + plane[1] * (y - middle[1]) + plane[2];
        let cell = CELL * radius_px;
        let size = [0, 1].map(|c| ((high[c] - low[c]) as f64 / cell).ceil().max(1.0) as usize);
        let corner = low.map(|l| l as f64);
        let mut rests: Vec<Vec<f64>> = vec![Vec::new(); size[0] * size[1]];
        for &[x, y, w] in &some {
            let i = (cut_off((x - corner[0]) / cell) as usize).min(size[0] - 1);
            let j = (cut_off((y - corner[1]) / cell) as usize).min(size[1] - 1);
            // also for the cells around it: pixels of other things are the minority there
            for l in j.saturating_sub(1)..(j + 2).min(size[1]) {
                for k in i.saturating_sub(1)..(i + 2).min(size[0]) {
                    rests[l * size[0] + k].push(w - on(x, y));
                }
            }
        }
        let fewest = MIN_AREA * radius_px * radius_px / step as f64;
        let rest: Vec<Option<f64>> = rests
            .into_iter()
            .map(|mut rest| (rest.len() as f64 >= fewest).then(|| upper_median(&mut rest)))
            .collect();
        let least = 0.1 * upper_median(&mut some.iter().map(|s| s[2]).collect::<Vec<_>>());
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
    let n = seen.len();
    let mut weights = vec![1.0; n];
    let mut found = [0.0; 3];
    for _ in 0..ROUNDS {
        let mut a = nalgebra::Matrix3::zeros();
        let mut b = nalgebra::Vector3::zeros();
        for (s, &weight) in seen.iter().zip(&weights) {
            let row =
                nalgebra::Vector3::new((s[0] - middle[0]) / radius_px, (s[1] - middle[1]) / radius_px, 1.0);
            a += weight * row * row.transpose();
            b += weight * s[2] * row;
        }
        // pixels on a line do not fix the slope across it
        for k in 0..2 {
            a[(k, k)] += 1e-6 * a[(2, 2)];
        }
        let x = a.cholesky()?.solve(&b);
        found = [x[0] / radius_px, x[1] / radius_px, x[2]];
        let rest: Vec<f64> = seen
            .iter()
            .map(|s| (s[2] - found[0] * (s[0] - middle[0]) - found[1] * (s[1] - middle[1]) - found[2]).abs())
            .collect();
        let scale = upper_median(&mut rest.clone()).max(1e-9);
        for (weight, rest) in weights.iter_mut().zip(rest) {
            *weight = 1.0 / rest.max(0.3 * scale);
        }
        let sum: f64 = weights.iter().sum::<f64>() / n as f64;
        weights.iter_mut().for_each(|w| *w /= sum);
    }
    found.iter().all(|x| x.is_finite()).then_some(found)
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
