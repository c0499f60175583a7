//! Sums over the neighbours of a batch of points.

use crate::geometry::Symmetric3;
use crate::index::around::{Around, Frame, squared_distances};
use crate::index::cells::Cells;
use crate::simd::{BATCH, LANES, Simd, Singles};

const ROWS: usize = 4; // rows of squared distances that are counted together

/// Squared distances from a point to each point of a batch. Aligned: no load reaches into two lines of the cache.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Squares(Singles);

/// Sums over the neighbours of each point of a batch, relative to the point.
#[derive(Default)]
pub struct Sums {
    /// Squared distances from each point around to each point of the batch, and the positions of the points around.
    squares: Vec<Squares>,
    positions: Vec<u32>,
    count: usize,
    /// Rows and positions of the points that are added in a lane of the first half, or of the second.
    near: [Vec<(u32, u32)>; 2],
    near_counts: [usize; 2],
    counts: Singles,
    /// Entries of the covariances.
    covariances: [[f64; BATCH]; 6],
    /// Neighbourhoods with a smaller squared size lose too much precision in these sums.
    smallest: f64,
}

impl Sums {
    /// Computes the distances, and forgets points whose squared distances are beyond a limit in all lanes. Returns how
    /// many are within it in each lane.
    #[inline(always)]
    pub fn measure<S: Simd>(
        &mut self,
        simd: S,
        around: &Around,
        lanes: &[Singles; 3],
        limit: f32,
    ) -> Singles {
        let lanes = [simd.load(&lanes[0]), simd.load(&lanes[1]), simd.load(&lanes[2])];
        let [x, y, z] = around.axes();
        let most = x.len() + ROWS;
        if self.squares.len() < most {
            self.squares.resize(2 * most, Squares([0.0; BATCH]));
            self.positions.resize(2 * most, 0);
        }
        let (rows, positions) = (&mut self.squares[..most], &mut self.positions[..most]);
        let (limit, one) = (simd.splat(limit), simd.splat(1.0));
        let (mut count, mut counts) = (0, simd.splat(0.0));
        for (((&x, &y), &z), position) in x.iter().zip(y).zip(z).zip(around.positions()) {
            let squares = squared_distances(simd, x, y, z, lanes);
            rows[count].0 = simd.store(squares);
            positions[count] = position as u32;
            let within = simd.le(squares, limit);
            counts = simd.select(within, simd.add(counts, one), counts);
            count += usize::from(simd.bits(within) != 0);
        }
        rows[count..count + ROWS].fill(Squares([f32::INFINITY; BATCH]));
        self.count = count;
        simd.store(counts)
    }

    /// Counts the squared distances within each lane's limit. Also finds the largest of these, or zero, and the least
    /// beyond the limit, or infinity.
    #[inline(always)]
    pub fn count_below<S: Simd>(&self, simd: S, limits: S::F) -> [S::F; 3] {
        let one = simd.splat(1.0);
        // several of each, so that none waits for another
        let mut counts = [simd.splat(0.0); ROWS];
        let mut largest = [simd.splat(0.0); ROWS];
        let mut least = [simd.splat(f32::INFINITY); ROWS];
        for rows in self.squares[..self.count.next_multiple_of(ROWS)].as_chunks::<ROWS>().0 {
            for (r, squares) in rows.iter().enumerate() {
                let squares = simd.load(&squares.0);
                let within = simd.le(squares, limits);
                counts[r] = simd.select(within, simd.add(counts[r], one), counts[r]);
                largest[r] = simd.select(within, simd.max(largest[r], squares), largest[r]);
                least[r] = simd.select(within, least[r], simd.min(least[r], squares));
            }
        }
        for r in 1..ROWS {
            counts[0] = simd.add(counts[0], counts[r]);
            largest[0] = simd.max(largest[0], largest[r]);
            least[0] = simd.min(least[0], least[r]);
        }
        [counts[0], largest[0], least[0]]
    }

    /// Adds the points around whose squared distances are within each lane's limit. Returns how many they are.
    #[inline(always)]
    pub fn add<S: Simd>(
        &mut self,
        simd: S,
        cells: &Cells,
        frame: &Frame,
        places: &[[f64; BATCH]; 3],
        limits: &Singles,
    ) -> Singles {
        let counts = self.find_near(simd, limits);
        // of x, y, z, xx, xy, xz, yy, yz and zz
        let mut sums = [[0.0; BATCH]; 9];
        if S::MANY_REGISTERS {
            self.add_terms::<S, false, 0, 9>(simd, cells, places, limits, &mut sums);
            self.add_terms::<S, true, 0, 9>(simd, cells, places, limits, &mut sums);
        } else {
            // few sums at a time, so that all stay in registers
            self.add_terms::<S, false, 0, 5>(simd, cells, places, limits, &mut sums);
            self.add_terms::<S, false, 5, 9>(simd, cells, places, limits, &mut sums);
            self.add_terms::<S, true, 0, 5>(simd, cells, places, limits, &mut sums);
            self.add_terms::<S, true, 5, 9>(simd, cells, places, limits, &mut sums);
        }
        for l in 0..BATCH {
            let n = f64::from(counts[l]);
            let [x, y, z, xx, xy, xz, yy, yz, zz] = sums.each_ref().map(|sums| sums[l] / n);
            let entries = [xx - x * x, xy - x * y, xz - x * z, yy - y * y, yz - y * z, zz - z * z];
            for (list, entry) in self.covariances.iter_mut().zip(entries) {
                list[l] = entry;
            }
        }
        self.counts = counts;
        self.smallest = 1e-3 * frame.extent * frame.extent;
        counts
    }

    /// Finds the points that are within the limit in some lane, and counts them in each lane.
    #[inline(always)]
    fn find_near<S: Simd>(&mut self, simd: S, limits: &Singles) -> Singles {
        let (limits, one) = (simd.load(limits), simd.splat(1.0));
        let mut counts = simd.splat(0.0);
        for near in &mut self.near {
            if near.len() < self.count {
                near.resize(2 * self.count, (0, 0));
            }
        }
        let [first, second] = &mut self.near;
        let (first, second) = (&mut first[..self.count], &mut second[..self.count]);
        let mut near = [0; 2];
        let rows = self.squares[..self.count].iter().zip(&self.positions[..self.count]);
        for (row, (squares, &position)) in rows.enumerate() {
            let row = row as u32;
            let within = simd.le(simd.load(&squares.0), limits);
            counts = simd.select(within, simd.add(counts, one), counts);
            let bits = simd.bits(within);
            first[near[0]] = (row, position);
            near[0] += usize::from(bits as u8 != 0);
            second[near[1]] = (row, position);
            near[1] += usize::from(bits >> LANES != 0);
        }
        self.near_counts = near;
        simd.store(counts)
    }

    /// Adds the terms `FROM..TO` of the near points in the first or the second half of the lanes.
    #[inline(always)]
    fn add_terms<S: Simd, const SECOND: bool, const FROM: usize, const TO: usize>(
        &mut self,
        simd: S,
        cells: &Cells,
        places: &[[f64; BATCH]; 3],
        limits: &Singles,
        all: &mut [[f64; BATCH]; 9],
    ) {
        let half = usize::from(SECOND);
        let limits = simd.load(limits);
        let [a, b, c] = places.each_ref().map(|lanes| &lanes.as_chunks().0[half]);
        let (a, b, c) = (simd.load_half(a), simd.load_half(b), simd.load_half(c));
        let mut sums = [simd.splat_half(0.0); 9];
        for &(row, position) in &self.near[half][..self.near_counts[half]] {
            let mask = simd.half::<SECOND>(simd.le(simd.load(&self.squares[row as usize].0), limits));
            let point = cells.point(position as usize);
            let x = simd.sub_half(simd.splat_half(point[0]), a);
            let y = simd.sub_half(simd.splat_half(point[1]), b);
            let z = simd.sub_half(simd.splat_half(point[2]), c);
            let terms = [
                x,
                y,
                z,
                simd.mul_half(x, x),
                simd.mul_half(x, y),
                simd.mul_half(x, z),
                simd.mul_half(y, y),
                simd.mul_half(y, z),
                simd.mul_half(z, z),
            ];
            for i in FROM..TO {
                sums[i] = simd.add_half_if(mask, sums[i], terms[i]);
            }
        }
        for i in FROM..TO {
            all[i].as_chunks_mut().0[half] = simd.store_half(sums[i]);
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
