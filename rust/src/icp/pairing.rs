//! Source points and their nearest target points, kept from pose to pose.
//!
//! A search at a place just ahead of a source point, its anchor, finds a short list of near target points, and a bound:
//! all unlisted points are farther. The listed point nearest to the source point is its partner. Until the source point
//! has moved too far from its anchor, only the list is compared. A partner stays without that while the source point has
//! not moved farther than the next listed point allows. Bounds and lists are in single precision; where it cannot tell
//! two points apart, double precision decides.

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
use crate::simd::{BATCH, LANES, kernel, prefetch};
use choice::{choose, is_same};
use near::Near;
pub use partners::Pairing;
use partners::{BATCHES_PER_TASK, Task};
use search::search;
pub use sums::Pairs;
use sums::{TERMS, add_pairs};

/// Stretches of tasks, at least, that a thread works on: fewer cost less than waking another thread.
const MIN_STRETCHES: usize = 2;

impl Pairing {
    /// Finds the pairs at a pose.
    pub fn pair(&mut self, pose: &RigidMotion) -> Pairs {
        self.before = std::mem::replace(&mut self.pose, *pose);
        let origin = pose.apply(self.center);
        let (mut tasks, mut buffers) = (std::mem::take(&mut self.tasks), std::mem::take(&mut self.buffers));
        let together = tasks.len().div_ceil(buffers.len());
        let stretches = tasks.par_chunks_mut(together).zip(&mut buffers).with_min_len(MIN_STRETCHES);
        stretches.for_each(|(tasks, near)| {
            for task in tasks {
                go_on();
                task.sums = pair(self, task, origin, near);
            }
        });
        let mut sums = [0.0; TERMS];
        for task in &tasks {
            for (sum, part) in sums.iter_mut().zip(task.sums) {
                *sum += part;
            }
        }
        (self.tasks, self.buffers) = (tasks, buffers);
        Pairs::new(sums, origin, self.source_points)
    }

    /// Sums a matrix over all pairs, computed from the moved source point, the target point and its index.
    pub fn sum<const R: usize, const C: usize>(
        &self,
        term: impl Fn(Point, Point, usize) -> SMatrix<f64, R, C> + Sync,
    ) -> SMatrix<f64, R, C> {
        let parts: Vec<SMatrix<f64, R, C>> = self
            .tasks
            .par_iter()
            .map(|task| {
                let mut sum = SMatrix::zeros();
                for batch in &task.batches {
                    let moved = batch.moved_to(&self.pose);
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
    /// Moves the points of a task, finds their partners and sums over the pairs.
    ///
    /// Lists and targets of large clouds are not in the cache: each pass asks for those that the next one needs.
    fn pair<S>(
        simd,
        pairing: &Pairing,
        task: &mut Task,
        origin: Point,
        near: &mut Near,
    ) -> [f64; TERMS] {
        let mut places = [[[0.0; BATCH]; 3]; BATCHES_PER_TASK];
        let mut changes = [0; BATCHES_PER_TASK];
        for (i, (batch, list)) in task.batches.iter().zip(&task.lists).enumerate() {
            places[i] = batch.moved_to(&pairing.pose);
            changes[i] = batch.lanes() & !is_same(simd, pairing, batch, &places[i]);
            if changes[i] != 0 && pairing.is_large {
                prefetch(list);
            }
        }
        for (i, (batch, list)) in task.batches.iter_mut().zip(&mut task.lists).enumerate() {
            if changes[i] != 0 {
                if choose(simd, pairing, batch, list, &places[i], changes[i]) != 0 {
                    // it searches all lanes: the others would follow soon, and cost little more now
                    search(simd, pairing, batch, list, &places[i], near);
                    changes[i] = batch.lanes();
                }
                if pairing.is_large {
                    pairing.prefetch_targets(batch, changes[i]);
                }
            }
        }
        let limit = pairing.reach * pairing.reach;
        let mut sums = [[0.0; LANES]; TERMS];
        for (i, batch) in task.batches.iter_mut().enumerate() {
            pairing.take_targets(batch, changes[i]);
            for half in 0..BATCH / LANES {
                add_pairs(&mut sums, half, &places[i], &batch.targets, origin, limit);
            }
        }
        sums.map(|sum| sum.iter().sum())
    }
}
