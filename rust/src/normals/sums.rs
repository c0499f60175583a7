//! Sums over the neighbours of a batch of points.

use crate::geometry::{Symmetric3, sub};
use crate::index::around::{Around, Frame, squared_distances};
use crate::index::cells::Cells;
use crate::simd::{BATCH, LANES, Simd, Singles};

const ROWS: usize = 4; // rows of squared distances that are counted together

/// Squared distances from a point to each point of a batch. Aligned: no load reaches into two lines of the cache.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Squares(Singles);

/// Sums over the neighbours of each point of a batch, relative to a place near them.
#[derive(Default)]
pub struct Sums {
    /// Squared distances from each point around to each point of the batch, and the positions of the points around.
    squares: Vec<Squares>,
    positions: Vec<u32>,
    count: usize,
    /// Rows and positions of the points that are added in a lane of the first half, or of the second.
    near: [Vec<(u32, u32)>; 2],
    counts: Singles,
    /// Entries of the covariances.
    covariances: [[f64; BATCH]; 6],
    /// Neighbourhoods with a smaller squared size lose too much precision in these sums.
    smallest: f64,
}

impl Sums {
    /// Computes the distances, and forgets points whose squared distances are beyond a limit in all lanes.
    #[inline(always)]
    pub fn measure<S: Simd>(&mut self, simd: S, around: &Around, lanes: &[Singles; 3], limit: f32) {
        let lanes = [simd.load(&lanes[0]), simd.load(&lanes[1]), simd.load(&lanes[2])];
        let [x, y, z] = around.axes();
        let most = x.len() + ROWS;
        if self.squares.len() < most {
            self.squares.resize(2 * most, Squares([0.0; BATCH]));
            self.positions.resize(2 * most, 0);
        }
        let (rows, positions) = (&mut self.squares[..most], &mut self.positions[..most]);
        let limit = simd.splat(limit);
        let mut count = 0;
        for (((&x, &y), &z), position) in x.iter().zip(y).zip(z).zip(around.positions()) {
            let squares = squared_distances(simd, x, y, z, lanes);
            rows[count].0 = simd.store(squares);
            positions[count] = position as u32;
            count += usize::from(simd.bits(simd.le(squares, limit)) != 0);
        }
        rows[count..count + ROWS].fill(Squares([f32::INFINITY; BATCH]));
        self.count = count;
    }

    /// Counts the squared distances within each lane's limit.
    #[inline(always)]
    pub fn count_below<S: Simd>(&self, simd: S, limits: &Singles) -> Singles {
        let (limits, one) = (simd.load(limits), simd.splat(1.0));
        // several sums, so that none waits for another
        let mut counts = [simd.splat(0.0); ROWS];
        for rows in self.squares[..self.count.next_multiple_of(ROWS)].as_chunks::<ROWS>().0 {
            for (count, squares) in counts.iter_mut().zip(rows) {
                *count = simd.select(simd.le(simd.load(&squares.0), limits), simd.add(*count, one), *count);
            }
        }
        let [a, b, c, d] = counts;
        simd.store(simd.add(simd.add(a, b), simd.add(c, d)))
    }

    /// Adds the points around whose squared distances are within the first of each lane's limits. Returns how many are
    /// within each limit.
    #[inline(always)]
    pub fn add<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        cells: &Cells,
        frame: &Frame,
        limits: [&Singles; N],
    ) -> [Singles; N] {
        let counts = self.find_near(simd, limits);
        // of x, y, z, xx, xy, xz, yy, yz and zz
        let mut sums = [[0.0; BATCH]; 9];
        if S::MANY_REGISTERS {
            self.add_terms::<S, false, 0, 9>(simd, cells, frame, limits[0], &mut sums);
            self.add_terms::<S, true, 0, 9>(simd, cells, frame, limits[0], &mut sums);
        } else {
            // few sums at a time, so that all stay in registers
            self.add_terms::<S, false, 0, 5>(simd, cells, frame, limits[0], &mut sums);
            self.add_terms::<S, false, 5, 9>(simd, cells, frame, limits[0], &mut sums);
            self.add_terms::<S, true, 0, 5>(simd, cells, frame, limits[0], &mut sums);
            self.add_terms::<S, true, 5, 9>(simd, cells, frame, limits[0], &mut sums);
        }
        for l in 0..BATCH {
            let n = f64::from(counts[0][l]);
            let [x, y, z, xx, xy, xz, yy, yz, zz] = sums.each_ref().map(|sums| sums[l] / n);
            let entries = [xx - x * x, xy - x * y, xz - x * z, yy - y * y, yz - y * z, zz - z * z];
            for (list, entry) in self.covariances.iter_mut().zip(entries) {
                list[l] = entry;
            }
        }
        self.counts = counts[0];
        self.smallest = 1e-3 * frame.extent * frame.extent;
        counts
    }

    /// Finds the points that are within the first limit in some lane, and counts those within each limit.
    #[inline(always)]
    fn find_near<S: Simd, const N: usize>(&mut self, simd: S, limits: [&Singles; N]) -> [Singles; N] {
        let (limits, one) = (limits.map(|limits| simd.load(limits)), simd.splat(1.0));
        let mut counts = [simd.splat(0.0); N];
        let [first, second] = self.near.each_mut().map(|near| {
            near.resize(self.count, (0, 0));
            &mut near[..self.count]
        });
        let mut near = [0; 2];
        let rows = self.squares[..self.count].iter().zip(&self.positions[..self.count]);
        for (row, (squares, &position)) in rows.enumerate() {
            let row = row as u32;
            let squares = simd.load(&squares.0);
            for (counts, &limits) in counts.iter_mut().zip(&limits) {
                *counts = simd.select(simd.le(squares, limits), simd.add(*counts, one), *counts);
            }
            let bits = simd.bits(simd.le(squares, limits[0]));
            first[near[0]] = (row, position);
            near[0] += usize::from(bits as u8 != 0);
            second[near[1]] = (row, position);
            near[1] += usize::from(bits >> LANES != 0);
        }
        for (list, count) in self.near.iter_mut().zip(near) {
            list.truncate(count);
        }
        counts.map(|counts| simd.store(counts))
    }

    /// Adds the terms `FROM..TO` of the near points in the first or the second half of the lanes.
    #[inline(always)]
    fn add_terms<S: Simd, const SECOND: bool, const FROM: usize, const TO: usize>(
        &mut self,
        simd: S,
        cells: &Cells,
        frame: &Frame,
        limits: &Singles,
        all: &mut [[f64; BATCH]; 9],
    ) {
        let limits = simd.load(limits);
        let mut sums = [simd.splat_half(0.0); 9];
        for &(row, position) in &self.near[usize::from(SECOND)] {
            let mask = simd.half::<SECOND>(simd.le(simd.load(&self.squares[row as usize].0), limits));
            let [x, y, z] = sub(cells.point(position as usize), frame.origin);
            let terms = [x, y, z, x * x, x * y, x * z, y * y, y * z, z * z];
            for i in FROM..TO {
                sums[i] = simd.add_half_if(mask, sums[i], simd.splat_half(terms[i]));
            }
        }
        let first = if SECOND { LANES } else { 0 };
        for i in FROM..TO {
            all[i][first..first + LANES].copy_from_slice(&simd.store_half(sums[i]));
        }
    }

    /// Returns the covariance of a lane's neighbourhood, zeros if it is too small for a plane; None if precision is
    /// lost.
    pub fn covariance(&self, lane: usize) -> Option<Symmetric3> {
        if self.counts[lane] < 3.0 {
            return Some([0.0; 6]);
        }
        let covariance = self.covariances.each_ref().map(|entries| entries[lane]);
        (covariance[0] + covariance[3] + covariance[5] > self.smallest).then_some(covariance)
    }
}
