//! The target points around some lanes of a batch, and those that are near each lane.

use super::lists::{LISTED, List};
use crate::index::around::{Around, squared_distances};
use crate::simd::{BATCH, Simd, Singles};

/// The points around some lanes, and buffers that a task reuses from batch to batch.
#[derive(Default)]
pub struct Near {
    pub around: Around,
    /// Squared distances of the points around, lane by lane.
    squares: Vec<Singles>,
    /// Points near some lanes, with the bits of these lanes.
    hits: Vec<(u32, u32)>,
}

impl Near {
    /// Measures the squared distances of the points around; returns the least of each lane.
    #[inline(always)]
    pub fn measure<S: Simd>(&mut self, simd: S, points: &[Singles; 3]) -> Singles {
        let lanes = [simd.load(&points[0]), simd.load(&points[1]), simd.load(&points[2])];
        let [x, y, z] = self.around.axes();
        if self.squares.len() < x.len() {
            self.squares.resize(2 * x.len(), [0.0; BATCH]);
            self.hits.resize(2 * x.len() + 1, (0, 0));
        }
        let mut least = simd.splat(f32::MAX);
        for (((&x, &y), &z), kept) in x.iter().zip(y).zip(z).zip(&mut self.squares) {
            let square = squared_distances(simd, x, y, z, lanes);
            *kept = simd.store(square);
            least = simd.min(least, square);
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
        lanes: &[usize; BATCH],
        limits: &Singles,
        list: &mut List,
    ) -> Singles {
        let Self { around, squares, hits } = self;
        let within = simd.load(limits);
        // neither loop has a branch that would often be mispredicted
        let (mut near, mut total) = (0, 0);
        for (number, square) in squares[..around.count()].iter().enumerate() {
            let bits = simd.bits(simd.le(simd.load(square), within));
            hits[near] = (number as u32, bits);
            near += usize::from(bits != 0);
            total += bits.count_ones();
        }
        let mut beyond = *limits;
        let mut counts = [0; BATCH];
        let (mut next, mut number, mut bits) = (0, 0, 0);
        for _ in 0..total {
            let done = bits == 0;
            let hit = hits[next];
            number = if done { hit.0 as usize } else { number };
            bits = if done { hit.1 } else { bits };
            next += usize::from(done);
            let i = bits.trailing_zeros() as usize % BATCH;
            bits &= bits - 1;
            let l = lanes[i] % BATCH;
            let mut n = counts[i];
            if n == LISTED {
                // the farthest makes room
                let (farthest, most) = list.farthest(l);
                let square = squares[number][i];
                beyond[i] = beyond[i].min(most.max(square));
                if square >= most {
                    continue;
                }
                n = farthest;
            } else {
                counts[i] += 1;
            }
            let Some((position, [x, y, z])) = around.at(number) else { break };
            let row = &mut list.rows[n];
            row.numbers[l] = position;
            row.places[0][l] = x - points[0][i];
            row.places[1][l] = y - points[1][i];
            row.places[2][l] = z - points[2][i];
        }
        beyond
    }
}
