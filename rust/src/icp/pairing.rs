//! Source points and their nearest target points, kept from pose to pose.
//!
//! A search finds the nearest target point (the partner), a short list of near points, and two bounds. All points but
//! the partner are farther than the first bound, all unlisted points farther than the second. A partner stays while the
//! source point's motion leaves the first bound valid. After that only the list is compared, while the second is valid.
//! Then a new search is needed.

mod partners;
mod search;
mod sums;

use nalgebra::SMatrix;
use rayon::prelude::*;

use crate::geometry::{Point, RigidMotion, squared_distance};
use crate::index::around::Around;
use crate::parallel::go_on;
use crate::simd::{BATCH, LANES, kernel};
pub use partners::Pairing;
use partners::{Batch, NONE, is_below};
use search::search;
pub use sums::Pairs;
use sums::{TERMS, add_pairs};

/// Batches that one task works on; fixed, so that sums do not depend on the number of threads.
const BATCHES_PER_TASK: usize = 16;
/// Lanes of a batch, at most, that are searched alone; if more need a search, all are searched.
const MAX_ALONE: usize = 1;
const ALL: [usize; BATCH] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]; // the numbers of all lanes

impl Pairing {
    /// Finds the pairs at a pose.
    pub fn pair(&mut self, pose: &RigidMotion) -> Pairs {
        let origin = pose.apply(self.center);
        let mut batches = std::mem::take(&mut self.batches);
        let parts: Vec<[f64; TERMS]> = batches
            .par_chunks_mut(BATCHES_PER_TASK)
            .map_init(Around::default, |around, batches| {
                go_on();
                pair(self, batches, pose, origin, around)
            })
            .collect();
        self.batches = batches;
        let mut sums = [0.0; TERMS];
        for part in parts {
            for (sum, part) in sums.iter_mut().zip(part) {
                *sum += part;
            }
        }
        Pairs::new(sums, origin, self.source_points)
    }

    /// Sums a matrix over all pairs, computed from the moved source point, the target point and its index.
    pub fn sum<const R: usize, const C: usize>(
        &self,
        term: impl Fn(Point, Point, usize) -> SMatrix<f64, R, C> + Sync,
    ) -> SMatrix<f64, R, C> {
        let parts: Vec<SMatrix<f64, R, C>> = self
            .batches
            .par_chunks(BATCHES_PER_TASK)
            .map(|batches| {
                let mut sum = SMatrix::zeros();
                for batch in batches {
                    for l in 0..batch.count {
                        let moved = batch.moved.map(|values| values[l]);
                        if let Some(&target) = self.sorted.get(batch.partners[l] as usize)
                            && squared_distance(target, moved) <= self.reach * self.reach
                        {
                            sum += term(moved, target, self.cells.input_index(batch.partners[l] as usize));
                        }
                    }
                }
                sum
            })
            .collect();
        parts.iter().sum()
    }
}

kernel! {
    /// Moves the points of some batches, finds their partners and sums over the pairs.
    fn pair<S>(
        simd,
        pairing: &Pairing,
        batches: &mut [Batch],
        pose: &RigidMotion,
        origin: Point,
        around: &mut Around,
    ) -> [f64; TERMS] {
        let limit = pairing.reach * pairing.reach;
        let mut sums = [[0.0; LANES]; TERMS];
        for batch in batches {
            let moved = moved_to(&batch.points, pose);
            let steps = squares(&moved, &batch.moved).map(f64::sqrt);
            batch.moved = moved;
            let mut targets = [[0.0; BATCH]; 3];
            for l in 0..BATCH {
                let partner = pairing.sorted.get(batch.partners[l] as usize).unwrap_or(&origin);
                for k in 0..3 {
                    targets[k][l] = partner[k];
                }
            }
            let apart = squares(&moved, &targets);
            let mut same = [true; BATCH];
            for l in 0..BATCH {
                batch.others[l] -= steps[l] + pairing.rounding;
                batch.beyond[l] -= steps[l] + pairing.rounding;
                let nearest = is_below(apart[l], batch.others[l]);
                // then it does not matter which is the nearest
                let none =
                    ((apart[l] > limit) | (batch.partners[l] == NONE)) & (pairing.reach < batch.others[l]);
                same[l] = (nearest & (batch.partners[l] != NONE)) | none;
            }
            let mut left = [0; BATCH];
            let mut count = 0;
            for l in 0..batch.count {
                left[count] = l;
                count += usize::from(!same[l]);
            }
            let mut open = [0; BATCH];
            let mut open_count = 0;
            for &l in &left[..count] {
                open[open_count] = l;
                let sure = pairing.choose(batch, l, [moved[0][l], moved[1][l], moved[2][l]]);
                open_count += usize::from(!sure);
            }
            if open_count > MAX_ALONE {
                // then search all lanes: the others would follow soon, and cost little more now
                (left, count) = (ALL, batch.count);
                (open, open_count) = (left, count);
            }
            if open_count > 0 {
                search(simd, pairing, batch, &moved, &open[..open_count], around);
            }
            for &l in &left[..count] {
                if let Some(&partner) = pairing.sorted.get(batch.partners[l] as usize) {
                    for k in 0..3 {
                        targets[k][l] = partner[k];
                    }
                }
            }
            let paired: [bool; BATCH] = std::array::from_fn(|l| batch.partners[l] != NONE && l < batch.count);
            for half in 0..BATCH / LANES {
                add_pairs(&mut sums, half, &moved, &targets, &paired, origin, limit);
            }
        }
        sums.map(|sum| sum.iter().sum())
    }
}

/// Returns the points of a batch, moved by a pose.
#[inline(always)]
fn moved_to(points: &[[f64; BATCH]; 3], pose: &RigidMotion) -> [[f64; BATCH]; 3] {
    let (r, t) = (&pose.rotation, &pose.translation);
    let mut moved = [[0.0; BATCH]; 3];
    for k in 0..3 {
        let (r0, r1, r2, t) = (r[(k, 0)], r[(k, 1)], r[(k, 2)], t[k]);
        let [x, y, z] = points;
        let mut values = [0.0; BATCH];
        for l in 0..BATCH {
            values[l] = r0 * x[l] + r1 * y[l] + r2 * z[l] + t;
        }
        moved[k] = values;
    }
    moved
}

/// Returns the squared distances between the points of the lanes.
#[inline(always)]
fn squares(a: &[[f64; BATCH]; 3], b: &[[f64; BATCH]; 3]) -> [f64; BATCH] {
    let mut squares = [0.0; BATCH];
    for l in 0..BATCH {
        let d = [a[0][l] - b[0][l], a[1][l] - b[1][l], a[2][l] - b[2][l]];
        squares[l] = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    }
    squares
}
