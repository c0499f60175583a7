//! The target points around some lanes of a batch, and those that are near each lane.

use super::lists::{LISTED, List};
use crate::index::around::{Around, squared_distances};
use crate::simd::{BATCH, Simd, Singles};

/// The points around some lanes, and buffers that a task reuses from batch to batch.
#[derive(Default)]
pub struct Near {
    pub around: Around,
    /// Points near some lanes, with the bits of these lanes.
    hits: Vec<(u32, u32)>,
    /// Each of these points with each of its lanes.
    pairs: Vec<(u32, u32)>,
}

impl Near {
    /// Returns the least squared distance from each lane to the points around.
    #[inline(always)]
    pub fn find_nearest<S: Simd>(&self, simd: S, points: &[Singles; 3]) -> Singles {
        let lanes = [simd.load(&points[0]), simd.load(&points[1]), simd.load(&points[2])];
        let [x, y, z] = self.around.axes();
        let mut least = simd.splat(f32::MAX);
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            least = simd.min(least, squared_distances(simd, x, y, z, lanes));
        }
        simd.store(least)
    }

    /// Lists the points around within a squared distance of each lane, the nearest ones if there are too many; returns
    /// the squared distances up to which all are listed.
    #[inline(always)]
    pub fn fill<S: Simd>(
        &mut self,
        simd: S,
        points: &[Singles; 3],
        limits: &Singles,
        list: &mut List,
    ) -> Singles {
        let Self { around, hits, pairs } = self;
        if hits.len() <= around.count() {
            hits.resize(2 * around.count() + 1, (0, 0));
        }
        let within = simd.load(limits);
        let places = [simd.load(&points[0]), simd.load(&points[1]), simd.load(&points[2])];
        let [x, y, z] = around.axes();
        // no loop has a branch that would often be mispredicted
        let (mut near, mut total) = (0, 0);
        for (number, ((&x, &y), &z)) in x.iter().zip(y).zip(z).enumerate() {
            let bits = simd.bits(simd.le(squared_distances(simd, x, y, z, places), within));
            hits[near] = (number as u32, bits);
            near += usize::from(bits != 0);
            total += bits.count_ones();
        }
        if pairs.len() < total as usize + 1 {
            pairs.resize(2 * total as usize + 1, (0, 0));
        }
        let mut next = 0;
        for &(number, mut bits) in &hits[..near] {
            while bits != 0 {
                // most points are near one to three lanes
                for _ in 0..3 {
                    pairs[next] = (number, bits.trailing_zeros());
                    next += usize::from(bits != 0);
                    bits &= bits.wrapping_sub(1);
                }
            }
        }
        let mut beyond = *limits;
        let mut counts = [0; BATCH];
        for &(number, l) in &pairs[..next] {
            let l = l as usize % BATCH;
            let Some((position, place)) = around.at(number as usize) else { break };
            let [x, y, z] = [place[0] - points[0][l], place[1] - points[1][l], place[2] - points[2][l]];
            let mut n = counts[l];
            if n == LISTED {
                // the farthest makes room
                let (farthest, most) = list.farthest(l);
                let square = x * x + y * y + z * z;
                beyond[l] = beyond[l].min(most.max(square));
                if square >= most {
                    continue;
                }
                n = farthest;
            } else {
                counts[l] += 1;
            }
            let row = &mut list.rows[n];
            row.numbers[l] = position;
            row.places[0][l] = x;
            row.places[1][l] = y;
            row.places[2][l] = z;
        }
        beyond
    }
}
