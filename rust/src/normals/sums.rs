//! Sums over the neighbours of a batch of points.

use crate::geometry::{Point, Symmetric3, sub};
use crate::index::around::{Around, Frame, squared_distances};
use crate::index::cells::Cells;
use crate::simd::{BATCH, LANES, Simd, Singles};

/// Sums over the neighbours of each point of a batch, relative to a place near them.
#[derive(Default)]
pub struct Sums {
    /// Squared distances from each point around to each point of the batch.
    squares: Vec<Singles>,
    count: usize,
    /// Coordinates of the points around.
    near: Vec<Point>,
    pub counts: Singles,
    /// Sums of x, y, z, xx, xy, xz, yy, yz and zz.
    sums: [[f64; BATCH]; 9],
    /// Neighbourhoods with a smaller squared size lose too much precision in these sums.
    smallest: f64,
}

impl Sums {
    /// Computes the distances.
    #[inline(always)]
    pub fn measure<S: Simd>(&mut self, simd: S, around: &Around, lanes: &[Singles; 3]) {
        let lanes = [simd.load(&lanes[0]), simd.load(&lanes[1]), simd.load(&lanes[2])];
        let [x, y, z] = around.axes();
        if self.squares.len() < x.len() {
            self.squares.resize(2 * x.len(), [0.0; BATCH]);
        }
        self.count = x.len();
        for (((&x, &y), &z), squares) in x.iter().zip(y).zip(z).zip(&mut self.squares) {
            *squares = simd.store(squared_distances(simd, x, y, z, lanes));
        }
    }

    /// Counts the squared distances within each lane's limit.
    #[inline(always)]
    pub fn count_below<S: Simd>(&self, simd: S, limits: &Singles) -> Singles {
        let (limits, one) = (simd.load(limits), simd.splat(1.0));
        // several sums, so that none waits for another
        let mut counts = [simd.splat(0.0); 4];
        let (fours, rest) = self.squares[..self.count].as_chunks::<4>();
        for four in fours {
            for i in 0..4 {
                counts[i] =
                    simd.select(simd.le(simd.load(&four[i]), limits), simd.add(counts[i], one), counts[i]);
            }
        }
        for squares in rest {
            counts[0] = simd.select(simd.le(simd.load(squares), limits), simd.add(counts[0], one), counts[0]);
        }
        simd.store(simd.add(simd.add(counts[0], counts[1]), simd.add(counts[2], counts[3])))
    }

    /// Adds the points around whose squared distances are within each lane's limit.
    #[inline(always)]
    pub fn add<S: Simd>(&mut self, simd: S, cells: &Cells, around: &Around, frame: &Frame, limits: &Singles) {
        self.near.clear();
        self.near.extend(around.positions().map(|position| sub(cells.point(position), frame.origin)));
        self.counts = self.count_below(simd, limits);
        if S::MANY_REGISTERS {
            self.add_terms::<S, true, true, 0, 9>(simd, limits);
        } else {
            // few sums at a time, so that all stay in registers
            self.add_terms::<S, true, false, 0, 5>(simd, limits);
            self.add_terms::<S, true, false, 5, 9>(simd, limits);
            self.add_terms::<S, false, true, 0, 5>(simd, limits);
            self.add_terms::<S, false, true, 5, 9>(simd, limits);
        }
        self.smallest = 1e-3 * frame.extent * frame.extent;
    }

    /// Adds the terms `FROM..TO` of all near points, in the first half of the lanes, the second half, or both.
    #[inline(always)]
    fn add_terms<S: Simd, const FIRST: bool, const SECOND: bool, const FROM: usize, const TO: usize>(
        &mut self,
        simd: S,
        limits: &Singles,
    ) {
        let limits = simd.load(limits);
        let (mut first, mut second) = ([simd.splat_half(0.0); 9], [simd.splat_half(0.0); 9]);
        for (&[x, y, z], squares) in self.near.iter().zip(&self.squares[..self.count]) {
            let mask = simd.le(simd.load(squares), limits);
            let terms = [x, y, z, x * x, x * y, x * z, y * y, y * z, z * z];
            for i in FROM..TO {
                let term = simd.splat_half(terms[i]);
                if FIRST {
                    first[i] = simd.add_half_if(simd.half::<false>(mask), first[i], term);
                }
                if SECOND {
                    second[i] = simd.add_half_if(simd.half::<true>(mask), second[i], term);
                }
            }
        }
        for i in FROM..TO {
            if FIRST {
                self.sums[i][..LANES].copy_from_slice(&simd.store_half(first[i]));
            }
            if SECOND {
                self.sums[i][LANES..].copy_from_slice(&simd.store_half(second[i]));
            }
        }
    }

    /// Returns the covariance of a lane's neighbourhood, zeros if it is too small for a plane; None if precision is
    /// lost.
    pub fn covariance(&self, lane: usize) -> Option<Symmetric3> {
        let n = f64::from(self.counts[lane]);
        if n < 3.0 {
            return Some([0.0; 6]);
        }
        let [x, y, z, xx, xy, xz, yy, yz, zz] = self.sums.each_ref().map(|sums| sums[lane] / n);
        let covariance = [xx - x * x, xy - x * y, xz - x * z, yy - y * y, yz - y * z, zz - z * z];
        (covariance[0] + covariance[3] + covariance[5] > self.smallest).then_some(covariance)
    }
}
