//! Source points and their nearest target points, kept from pose to pose.
//!
//! A search at a place of a source point, its anchor, finds the nearest target point (the partner), a short list of near
//! points, and a bound: all unlisted points are farther. Until the source point has moved too far from its anchor, only
//! the list is compared. A partner stays without that while the source point has not moved farther than the next
//! listed point allows. Bounds and lists are in single precision; where it cannot tell two points apart, double
//! precision decides.

mod choice;
mod lists;
mod near;
mod partners;
mod search;
mod sums;

use nalgebra::SMatrix;
use rayon::prelude::*;

use crate::geometry::{Point, RigidMotion, squared_distance};
use crate::parallel::go_on;
use crate::simd::{BATCH, LANES, kernel};
use choice::{choose, is_same};
use lists::List;
use near::Near;
use partners::Batch;
pub use partners::Pairing;
use search::search;
pub use sums::Pairs;
use sums::{TERMS, add_pairs};

/// Batches that one task works on; fixed, so that sums do not depend on the number of threads.
const BATCHES_PER_TASK: usize = 16;
/// Batches, at most, for which threads cost more time than they save.
const MAX_IN_TURN: usize = 128;
/// Lanes of a batch, at most, that are searched alone; if more need a search, all are searched.
const MAX_ALONE: u32 = 1;

impl Pairing {
    /// Finds the pairs at a pose.
    pub fn pair(&mut self, pose: &RigidMotion) -> Pairs {
        self.pose = *pose;
        let origin = pose.apply(self.center);
        let (mut batches, mut lists) = (std::mem::take(&mut self.batches), std::mem::take(&mut self.lists));
        let mut sums = [0.0; TERMS];
        let mut add = |part: [f64; TERMS]| {
            for (sum, part) in sums.iter_mut().zip(part) {
                *sum += part;
            }
        };
        if batches.len() <= MAX_IN_TURN {
            let mut buffers = std::mem::take(&mut self.buffers);
            let tasks = batches.chunks_mut(BATCHES_PER_TASK).zip(lists.chunks_mut(BATCHES_PER_TASK));
            for (batches, lists) in tasks {
                go_on();
                add(pair(self, batches, lists, origin, &mut buffers));
            }
            self.buffers = buffers;
        } else {
            let tasks = batches.par_chunks_mut(BATCHES_PER_TASK).zip(lists.par_chunks_mut(BATCHES_PER_TASK));
            let parts: Vec<[f64; TERMS]> = tasks
                .map_init(Near::default, |buffers, (batches, lists)| {
                    go_on();
                    pair(self, batches, lists, origin, buffers)
                })
                .collect();
            parts.into_iter().for_each(add);
        }
        (self.batches, self.lists) = (batches, lists);
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
                    let moved = moved_to(&batch.points, &self.pose);
                    for l in 0..batch.count {
                        let moved = moved.map(|values| values[l]);
                        let target = batch.targets.map(|values| values[l]);
                        if squared_distance(target, moved) <= self.reach * self.reach {
                            sum += term(
                                moved,
                                target,
                                self.cells.input_index(batch.partners[l].to_bits() as usize),
                            );
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
        lists: &mut [List],
        origin: Point,
        buffers: &mut Near,
    ) -> [f64; TERMS] {
        let limit = pairing.reach * pairing.reach;
        let mut sums = [[0.0; LANES]; TERMS];
        for (batch, list) in batches.iter_mut().zip(lists) {
            let moved = moved_to(&batch.points, &pairing.pose);
            let all = (1u32 << batch.count) - 1;
            let left = all & !is_same(simd, pairing, batch, &moved);
            if left != 0 {
                let mut open = choose(simd, pairing, batch, list, &moved, left);
                let mut changed = left;
                if open != 0 {
                    if open.count_ones() > MAX_ALONE {
                        // then search all lanes: the others would follow soon, and cost little more now
                        (open, changed) = (all, all);
                    }
                    search(simd, pairing, batch, list, &moved, open, buffers);
                }
                pairing.take_targets(batch, changed);
            }
            for half in 0..BATCH / LANES {
                add_pairs(&mut sums, half, &moved, &batch.targets, origin, limit);
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
