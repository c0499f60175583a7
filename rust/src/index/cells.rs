//! Points sorted once by the cells of a uniform grid.
//!
//! Only cells with points are kept, in order of their keys. The high bits of a key are the number of a block of cells,
//! so points that are near in space are near in memory. The low bits are the cell's number in its block along the
//! cloud's longest axis, so neighbours along that axis are one run of points. Each axis has its own list of
//! coordinates, so the searches copy and test eight points of a run at a time.

pub mod batches;
pub mod sweep;

use rayon::prelude::*;

use super::bounds::bounds;
use super::limits::{POINTS_PER_PART, SHORTEST, WIDE};
use super::sort::sort_words;
use crate::geometry::{Point, cut_off};
use crate::simd::BATCH;

const AXIS_BITS: u32 = 19; // bits of a cell's coordinate along one axis at most; three coordinates make a key
const BLOCK_BITS: u32 = 5; // bits of the number of a cell inside a block
const IN_BLOCK: u64 = (1 << BLOCK_BITS) - 1; // mask of a cell's number inside its block
/// Bits of the number of a part of a cell along each axis, if the points of a cell are sorted by its parts.
const PART_BITS: u32 = 2;
const BATCH_CELLS: u64 = 4; // cells along an axis that a batch takes points from, at most
const BATCH_CELLS_IN_PARTS: u64 = 2; // the same if the points of a cell are sorted by its parts
/// Rows of cells for each point, at most, for which all rows are kept, even those without points.
const MAX_ROWS_PER_POINT: usize = 2;

/// Finite points in the order of their cells.
pub struct Cells {
    low: Point,
    size: f64,
    inverse: f64,
    /// Whether cells are much wider than the caller asked for.
    wide: bool,
    /// Cells along an axis that a batch takes points from, at most.
    batch_cells: u64,
    /// The axes in the order of the key, the longest last, and the last cell along each.
    axes: [usize; 3],
    last: [u64; 3],
    /// Bit positions in a key of the first two axes and the block.
    shifts: [u32; 3],
    /// Keys of the cells that hold points, ascending, and where the points of each start.
    keys: Vec<u64>,
    starts: Vec<u32>,
    /// All rows of cells, block by block; empty if there are too many.
    rows: Vec<Row>,
    /// Coordinates in the order of the cells, each list padded by one row of lanes, and each point's index in the
    /// input.
    pub coordinates: [Vec<f64>; 3],
    order: Vec<u32>,
}

impl Cells {
    /// Sorts finite points into cells that are `size` > 0 wide, or wider if there would be too many.
    pub fn new(points: &[Point], size: f64) -> Self {
        Self::with_parts::<0>(points, size)
    }

    /// As [`Cells::new`], with the points of a cell sorted by its parts: this makes batches smaller where cells are
    /// full.
    pub fn new_in_parts(points: &[Point], size: f64) -> Self {
        Self::with_parts::<PART_BITS>(points, size)
    }

    fn with_parts<const BITS: u32>(points: &[Point], size: f64) -> Self {
        let whole = bounds(points);
        let (low, sides, longest) = (whole.low, whole.sides(), whole.longest());
        let axes = [(longest + 1) % 3, (longest + 2) % 3, longest];
        let asked = size.max(SHORTEST);
        let size = asked.max(sides[longest] / f64::from(1u32 << (AXIS_BITS - 1)));
        let inverse = 1.0 / size;
        let last = axes.map(|k| (sides[k] * inverse) as u64);
        let bits = last.map(|last| u64::BITS - last.leading_zeros());
        let inside = bits[2].min(BLOCK_BITS);
        let shifts = [bits[1] + inside, inside, bits[0] + bits[1] + inside];
        let mut cells = Self {
            low,
            size,
            inverse,
            wide: size > WIDE * asked,
            batch_cells: if BITS > 0 { BATCH_CELLS_IN_PARTS } else { BATCH_CELLS },
            axes,
            last,
            shifts,
            keys: Vec::new(),
            starts: Vec::new(),
            rows: Vec::new(),
            coordinates: Default::default(),
            order: Vec::new(),
        };
        let key = |p: &Point| -> u64 {
            let fine = axes.map(|k| u64::from(cut_off((p[k] - low[k]) * (inverse * f64::from(1 << BITS)))));
            let [a, b, c] = fine.map(|fine| fine >> BITS);
            let key = ((c >> BLOCK_BITS) << shifts[2]) | (a << shifts[0]) | (b << shifts[1]) | (c & IN_BLOCK);
            let [a, b, c] = fine.map(spread);
            (key << (3 * BITS)) | ((c << 2) | (a << 1) | b) & ((1 << (3 * BITS)) - 1)
        };
        cells.sort::<BITS>(points, key, bits.iter().sum::<u32>());
        cells.number_rows();
        cells.coordinates = cells.gather_axes(|i| points[i]);
        cells
    }

    /// Finds the order of the points and the cells that hold them.
    fn sort<const BITS: u32>(&mut self, points: &[Point], key: impl Fn(&Point) -> u64 + Sync, key_bits: u32) {
        let index_bits = usize::BITS - points.len().leading_zeros();
        let key_bits = key_bits + 3 * BITS;
        if key_bits + index_bits <= u64::BITS {
            // a key and an index in one word
            let words = fill(points.len(), |i| (key(&points[i]) << index_bits) | i as u64);
            let words = sort_words(words, index_bits, key_bits);
            let mask = (1u64 << index_bits) - 1;
            self.number(&words, |&word| (word >> (index_bits + 3 * BITS), (word & mask) as u32));
        } else {
            let mut keyed: Vec<(u64, u32)> =
                points.par_iter().enumerate().map(|(i, p)| (key(p), i as u32)).collect();
            keyed.par_sort_unstable();
            self.number(&keyed, |&(key, index)| (key >> (3 * BITS), index));
        }
    }

    /// Fills `keys`, `starts` and `order` from sorted entries.
    fn number<T: Sync>(&mut self, sorted: &[T], split: impl Fn(&T) -> (u64, u32) + Sync) {
        let mut order = vec![0u32; sorted.len()];
        let parts: Vec<(Vec<u64>, Vec<u32>)> = order
            .par_chunks_mut(POINTS_PER_PART)
            .enumerate()
            .map(|(part, order)| {
                let first = part * POINTS_PER_PART;
                let mut before = first.checked_sub(1).map(|i| split(&sorted[i]).0);
                let (mut keys, mut starts) = (Vec::new(), Vec::new());
                for (i, order) in order.iter_mut().enumerate() {
                    let (key, index) = split(&sorted[first + i]);
                    *order = index;
                    if before != Some(key) {
                        before = Some(key);
                        keys.push(key);
                        starts.push((first + i) as u32);
                    }
                }
                (keys, starts)
            })
            .collect();
        self.order = order;
        for (keys, starts) in parts {
            self.keys.extend(keys);
            self.starts.extend(starts);
        }
        self.starts.push(sorted.len() as u32);
    }

    fn number_rows(&mut self) {
        let [a, b, c] = self.last.map(|last| last as usize + 1);
        let Some(count) = a
            .checked_mul(b)
            .and_then(|count| count.checked_mul(((c - 1) >> BLOCK_BITS) + 1))
            .filter(|&count| count <= MAX_ROWS_PER_POINT * self.order.len() + 1024)
        else {
            return;
        };
        self.rows = vec![Row::default(); count];
        for cell in 0..self.keys.len() {
            let [a, b, c] = self.numbers(self.keys[cell]);
            let index = self.row(c >> BLOCK_BITS, a, b);
            let row = &mut self.rows[index];
            if row.occupied == 0 {
                row.first = cell as u32;
            }
            row.occupied |= 1 << (c & IN_BLOCK);
        }
    }

    /// Returns the index of a row.
    #[inline(always)]
    fn row(&self, block: u64, a: u64, b: u64) -> usize {
        ((block * (self.last[0] + 1) + a) * (self.last[1] + 1) + b) as usize
    }

    /// Returns the numbers of a cell along the axes of its key.
    #[inline(always)]
    fn numbers(&self, key: u64) -> [u64; 3] {
        let part = |shift: u32, bits: u32| (key >> shift) & ((1 << bits) - 1);
        let [a, b, block] = self.shifts;
        [part(a, block - a), part(b, a - b), (part(block, u64::BITS - block - 1) << BLOCK_BITS) | part(0, b)]
    }

    pub fn len(&self) -> usize {
        self.order.len()
    }

    pub fn size(&self) -> f64 {
        self.size
    }

    /// Returns the index in the input of the point at a position in the cells' order.
    #[inline(always)]
    pub fn input_index(&self, position: usize) -> usize {
        self.order[position] as usize
    }

    /// Returns the point at a position in the cells' order.
    #[inline(always)]
    pub fn point(&self, position: usize) -> Point {
        std::array::from_fn(|k| self.coordinates[k][position])
    }

    /// Returns the points in the cells' order.
    pub fn sorted(&self) -> Vec<Point> {
        fill(self.len(), |position| self.point(position))
    }

    /// Puts three numbers of each point in the cells' order, each list padded by one row of lanes.
    pub fn gather_axes(&self, value: impl Fn(usize) -> Point + Sync) -> [Vec<f64>; 3] {
        let mut lists: [Vec<f64>; 3] = std::array::from_fn(|_| Vec::with_capacity(self.len() + BATCH));
        let [x, y, z] = lists
            .each_mut()
            .map(|list| list.spare_capacity_mut()[..self.len()].par_chunks_mut(POINTS_PER_PART));
        self.order.par_chunks(POINTS_PER_PART).zip(x).zip(y).zip(z).for_each(|(((order, x), y), z)| {
            for (((&i, x), y), z) in order.iter().zip(x).zip(y).zip(z) {
                let p = value(i as usize);
                x.write(p[0]);
                y.write(p[1]);
                z.write(p[2]);
            }
        });
        for list in &mut lists {
            // SAFETY: all of them were written
            unsafe { list.set_len(self.len()) };
            list.extend([0.0; BATCH]);
        }
        lists
    }

    /// Puts the points at some positions into the lanes of a batch; lanes without a point repeat the first one.
    #[inline(always)]
    pub fn batch(&self, positions: &[u32]) -> [[f64; BATCH]; 3] {
        let mut places = self.point(positions[0] as usize).map(|x| [x; BATCH]);
        for (l, &position) in positions.iter().enumerate().take(BATCH) {
            for k in 0..3 {
                places[k][l] = self.coordinates[k][position as usize];
            }
        }
        places
    }

    /// Returns the number of the cell at a distance from the lowest place along an axis of the key, limited to the
    /// grid.
    #[inline(always)]
    fn number_along(&self, axis: usize, from_low: f64) -> u64 {
        // a cast to an integer saturates
        ((from_low * self.inverse) as u64).min(self.last[axis])
    }
}

/// A row of the cells of a block.
#[derive(Clone, Copy, Default)]
struct Row {
    first: u32,
    /// A bit for each cell that holds points.
    occupied: u32,
}

/// Spreads the lowest three bits, leaving room for those of two other numbers between them.
fn spread(x: u64) -> u64 {
    (x & 1) | ((x & 2) << 2) | ((x & 4) << 4)
}

fn fill<T: Send>(count: usize, value: impl Fn(usize) -> T + Sync) -> Vec<T> {
    (0..count).into_par_iter().with_min_len(POINTS_PER_PART).map(&value).collect()
}
