//! Points sorted once by the cells of a uniform grid, and what lies around a cell gathered in one sweep.
//!
//! Cells are kept sparse and in order of their key. Its least significant part is the number along the cloud's
//! longest axis inside a block of cells, so neighbours along it are one run of points, and its most significant part
//! the block, so what is near in space is near in memory. Coordinates are kept axis by axis, so that runs are copied
//! and tested eight at a time.

use std::ops::Range;

use rayon::prelude::*;

use crate::Point;
use crate::geometry::squared_distance;
use crate::parallel::Slots;
use crate::simd::{BATCH, LANES, kernel};

/// Most bits of a cell's coordinate along one axis; three of them make a key.
const AXIS_BITS: u32 = 19;
/// Bits of the number of a cell inside a block.
const BLOCK_BITS: u32 = 5;
const IN_BLOCK: u64 = (1 << BLOCK_BITS) - 1;
/// Bits of the part of a cell along each axis, where points of a cell are in order of its parts.
const PART_BITS: u32 = 2;
/// Most rows of cells for each point that are all kept.
const MOST_ROWS: usize = 2;
/// Most cells along an axis that a batch of points comes from.
const BATCH_CELLS: u64 = 4;
/// Batches that a task works through; fixed, so that results do not depend on the number of threads.
const BATCHES_PER_TASK: usize = 64;
/// Points of a part of a parallel sort.
const POINTS_PER_PART: usize = 1 << 15;
/// Most bits of a digit of the sort.
const DIGIT_BITS: u32 = 10;
/// Points from which distances between neighbours are estimated, and the part of the cloud that they are sought in: an
/// eighth, but at least and at most so many points.
const REACH_SEEDS: usize = 16;
const REACH_POINTS: [usize; 2] = [1024, 4096];
/// Distances below this count as this: their squares are lost in double precision.
const SHORTEST: f64 = 1e-150;

/// Finite points in the order of their cells.
pub struct Cells {
    low: Point,
    size: f64,
    inverse: f64,
    /// The axes of a key, the longest last, and the last cell along each.
    axes: [usize; 3],
    last: [u64; 3],
    /// Where the first two axes and the block are in a key.
    shifts: [u32; 3],
    /// Keys of the cells that hold points, ascending, and where each one's points start.
    keys: Vec<u64>,
    starts: Vec<u32>,
    /// All rows of cells of all blocks, those without points too; none where they are many more than the points.
    rows: Vec<Row>,
    /// Coordinates in order of the cells, each list longer than the points by a row of lanes, and each point's
    /// index in the input.
    pub coordinates: [Vec<f64>; 3],
    order: Vec<u32>,
}

impl Cells {
    /// Sorts finite points by cells that are `size` > 0 wide, or wider where that makes too many.
    pub fn new(points: &[Point], size: f64) -> Self {
        Self::with_parts::<0>(points, size)
    }

    /// The same, the points of a cell in order of its parts: batches are smaller where cells hold many of them.
    pub fn new_in_parts(points: &[Point], size: f64) -> Self {
        Self::with_parts::<PART_BITS>(points, size)
    }

    fn with_parts<const BITS: u32>(points: &[Point], size: f64) -> Self {
        let Bounds { low, high } = bounds(points);
        let sides: Point = std::array::from_fn(|k| high[k] - low[k]);
        let longest = (0..3).fold(0, |longest, k| if sides[k] > sides[longest] { k } else { longest });
        let axes = [(longest + 1) % 3, (longest + 2) % 3, longest];
        let size = size.max(sides[longest] / f64::from(1u32 << (AXIS_BITS - 1))).max(SHORTEST);
        let inverse = 1.0 / size;
        let last = axes.map(|k| (sides[k] * inverse) as u64);
        let bits = last.map(|last| u64::BITS - last.leading_zeros());
        let inside = bits[2].min(BLOCK_BITS);
        let shifts = [bits[1] + inside, inside, bits[0] + bits[1] + inside];
        let mut cells = Self {
            low,
            size,
            inverse,
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
            let fine = axes.map(|k| ((p[k] - low[k]) * (inverse * f64::from(1 << BITS))) as u64);
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

    /// Fills `rows`.
    fn number_rows(&mut self) {
        let [a, b, c] = self.last.map(|last| last as usize + 1);
        let Some(count) = a
            .checked_mul(b)
            .and_then(|count| count.checked_mul(((c - 1) >> BLOCK_BITS) + 1))
            .filter(|&count| count <= MOST_ROWS * self.order.len() + 1024)
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

    /// The index of a row.
    #[inline(always)]
    fn row(&self, block: u64, a: u64, b: u64) -> usize {
        ((block * (self.last[0] + 1) + a) * (self.last[1] + 1) + b) as usize
    }

    /// The numbers of a cell along the axes of its key.
    #[inline(always)]
    fn numbers(&self, key: u64) -> [u64; 3] {
        let part = |shift: u32, bits: u32| (key >> shift) & ((1 << bits) - 1);
        let [a, b, block] = self.shifts;
        [part(a, block - a), part(b, a - b), (part(block, u64::BITS - block - 1) << BLOCK_BITS) | part(0, b)]
    }

    /// How many points there are.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// The width of a cell.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// The index in the input of the point at a position of the cells' order.
    #[inline(always)]
    pub fn input_index(&self, position: usize) -> usize {
        self.order[position] as usize
    }

    /// The point at a position of the cells' order.
    #[inline(always)]
    pub fn point(&self, position: usize) -> Point {
        std::array::from_fn(|k| self.coordinates[k][position])
    }

    /// The points in the cells' order.
    pub fn sorted(&self) -> Vec<Point> {
        fill(self.len(), |position| self.point(position))
    }

    /// Three numbers of each point put in the cells' order, each list longer than the points by a row of lanes.
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

    /// All points in batches of at most [`BATCH`] that are near each other.
    pub fn batches(&self) -> Batches {
        // cells in order of cubes of eight along each axis, in a cube by the bits of their numbers, interleaved
        let bits = self.last.map(|last| (u64::BITS - last.leading_zeros()).saturating_sub(3));
        let index_bits = usize::BITS - self.keys.len().leading_zeros();
        let key_bits = bits.iter().sum::<u32>() + 9;
        let cells: Vec<u32> = if key_bits + index_bits <= u64::BITS {
            let words = fill(self.keys.len(), |i| {
                let [a, b, c] = self.numbers(self.keys[i]);
                let cube = ((((c >> 3) << bits[0]) | (a >> 3)) << bits[1]) | (b >> 3);
                let inside = (spread(a) << 2) | (spread(b) << 1) | spread(c);
                (((cube << 9) | inside) << index_bits) | i as u64
            });
            let mask = (1u64 << index_bits) - 1;
            sort_words(words, index_bits, key_bits).iter().map(|word| (word & mask) as u32).collect()
        } else {
            (0..self.keys.len() as u32).collect()
        };
        let (mut positions, mut starts) = (Vec::with_capacity(self.len()), vec![0u32]);
        let (mut low, mut high) = ([u64::MAX; 3], [0; 3]);
        for cell in cells {
            let cell = cell as usize;
            let number = self.numbers(self.keys[cell]);
            for k in 0..3 {
                low[k] = low[k].min(number[k]);
                high[k] = high[k].max(number[k]);
            }
            let mut filled = positions.len() - starts[starts.len() - 1] as usize;
            let far = (0..3).any(|k| high[k] - low[k] >= BATCH_CELLS);
            if filled > 0 && (far || filled == BATCH) {
                starts.push(positions.len() as u32);
                (low, high) = (number, number);
                filled = 0;
            }
            for position in self.starts[cell]..self.starts[cell + 1] {
                if filled == BATCH {
                    starts.push(positions.len() as u32);
                    (low, high) = (number, number);
                    filled = 0;
                }
                positions.push(position);
                filled += 1;
            }
        }
        if positions.len() as u32 > starts[starts.len() - 1] {
            starts.push(positions.len() as u32);
        }
        Batches { positions, starts }
    }

    /// The box around the points of some positions.
    #[inline(always)]
    pub fn bounds(&self, positions: &[u32]) -> Bounds {
        let mut bounds = Bounds::NONE;
        for &position in positions {
            bounds.add(self.point(position as usize));
        }
        bounds
    }

    /// The number along an axis of the key of the cell that a coordinate lies in, the nearest if there is none.
    #[inline(always)]
    fn number_along(&self, axis: usize, coordinate: f64) -> u64 {
        // a cast to an integer saturates
        (((coordinate - self.low[self.axes[axis]]) * self.inverse) as u64).min(self.last[axis])
    }
}

/// Points that are near each other, in batches.
pub struct Batches {
    positions: Vec<u32>,
    starts: Vec<u32>,
}

impl Batches {
    /// The positions of each batch.
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        self.starts.windows(2).map(|pair| &self.positions[pair[0] as usize..pair[1] as usize])
    }

    /// Calls `task` with every task's batches of positions, in parallel.
    pub fn for_each_task<'a>(&'a self, task: impl Fn(&mut dyn Iterator<Item = &'a [u32]>) + Sync + Send) {
        let ranges: Vec<Range<u32>> = self.starts.windows(2).map(|pair| pair[0]..pair[1]).collect();
        ranges.par_chunks(BATCHES_PER_TASK).for_each(|ranges| {
            task(&mut ranges.iter().map(|range| &self.positions[range.start as usize..range.end as usize]));
        });
    }
}

/// A row of the cells of a block.
#[derive(Clone, Copy, Default)]
struct Row {
    /// Its first cell.
    first: u32,
    /// Which cells hold points.
    occupied: u32,
}

/// A box around points.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    pub low: Point,
    pub high: Point,
}

impl Bounds {
    /// Around no points.
    pub const NONE: Self = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    /// Grows to hold a point.
    #[inline(always)]
    pub fn add(&mut self, p: Point) {
        self.merge(&Self { low: p, high: p });
    }

    /// Grows to hold another box.
    #[inline(always)]
    pub fn merge(&mut self, other: &Self) {
        for k in 0..3 {
            self.low[k] = if other.low[k] < self.low[k] { other.low[k] } else { self.low[k] };
            self.high[k] = if other.high[k] > self.high[k] { other.high[k] } else { self.high[k] };
        }
    }

    /// The length of its diagonal.
    pub fn diagonal(&self) -> f64 {
        (0..3).map(|k| (self.high[k] - self.low[k]).powi(2)).sum::<f64>().sqrt()
    }
}

/// Finds the runs of points around boxes. Boxes that are asked for one after the other should be near each other.
#[derive(Default)]
pub struct Sweep {
    /// Where the last box found each of its rows of cells.
    hints: Vec<usize>,
    /// What was found: positions of points that may be in reach.
    pub runs: Vec<Range<usize>>,
}

impl Sweep {
    /// Finds the runs of points, at least all those within `reach` of a box.
    #[inline(always)]
    pub fn find(&mut self, cells: &Cells, bounds: &Bounds, reach: f64) {
        let reach = (reach * (1.0 + 1e-12)).max(SHORTEST);
        self.runs.clear();
        let [a, b, c] = cells.axes;
        let range = |axis: usize, k: usize, reach: f64| {
            (
                cells.number_along(axis, bounds.low[k] - reach),
                cells.number_along(axis, bounds.high[k] + reach),
            )
        };
        // how far a slab of cells is from the box; a little less, for what rounding does to a cell's number
        let gap = |number: u64, k: usize| {
            let from = cells.low[k] + number as f64 * cells.size;
            (from - bounds.high[k]).max(bounds.low[k] - from - cells.size) - 1e-6 * cells.size
        };
        let squared = |x: f64| if x > 0.0 { x * x } else { 0.0 };
        let (first_a, last_a) = range(0, a, reach);
        let (first_b, last_b) = range(1, b, reach);
        let (first_c, last_c) = range(2, c, reach);
        let mut row = 0;
        for block in first_c >> BLOCK_BITS..=last_c >> BLOCK_BITS {
            // the part of its rows that is in reach
            let first_in_block = block << BLOCK_BITS;
            let inside = (first_c.saturating_sub(first_in_block), (last_c - first_in_block).min(IN_BLOCK));
            let these = ((1u64 << (inside.1 + 1)) - (1u64 << inside.0)) as u32;
            for number_a in first_a..=last_a {
                let rest = reach * reach - squared(gap(number_a, a));
                for number_b in first_b..=last_b {
                    let rest = rest - squared(gap(number_b, b));
                    row += 1;
                    if rest < 0.0 {
                        continue;
                    }
                    let found = if cells.rows.is_empty() {
                        self.seek(cells, row, block, number_a, number_b, inside)
                    } else {
                        let Row { first, occupied } = cells.rows[cells.row(block, number_a, number_b)];
                        let first = first + (occupied & ((1 << inside.0) - 1)).count_ones();
                        first as usize..(first + (occupied & these).count_ones()) as usize
                    };
                    if !found.is_empty() {
                        self.runs.push(cells.starts[found.start] as usize..cells.starts[found.end] as usize);
                    }
                }
            }
        }
    }

    /// Finds the cells of a row by their keys.
    fn seek(
        &mut self,
        cells: &Cells,
        row: usize,
        block: u64,
        a: u64,
        b: u64,
        (first, last): (u64, u64),
    ) -> Range<usize> {
        let start = (block << cells.shifts[2]) | (a << cells.shifts[0]) | (b << cells.shifts[1]);
        if self.hints.len() < row {
            self.hints.resize(row, usize::MAX);
        }
        let hint = &mut self.hints[row - 1];
        *hint = seek(&cells.keys, *hint, start | first);
        let mut end = *hint;
        while end < cells.keys.len() && cells.keys[end] <= start | last {
            end += 1;
        }
        *hint..end
    }
}

/// The first of ascending keys that is not below `key`, searched for from a hint on.
#[inline(always)]
fn seek(keys: &[u64], hint: usize, key: u64) -> usize {
    if hint >= keys.len() {
        return keys.partition_point(|&other| other < key);
    }
    let mut step = 1;
    if keys[hint] < key {
        let mut below = hint;
        while below + step < keys.len() && keys[below + step] < key {
            below += step;
            step *= 2;
        }
        let end = (below + step).min(keys.len());
        below + 1 + keys[below + 1..end].partition_point(|&other| other < key)
    } else {
        let mut end = hint;
        while end >= step && keys[end - step] >= key {
            end -= step;
            step *= 2;
        }
        let start = end.saturating_sub(step);
        start + keys[start..end].partition_point(|&other| other < key)
    }
}

/// About how far from a point its `k`-th neighbour is, the point itself the first; above zero.
///
/// From a few of the points: the distance that is nearly enough in a part of the cloud, and how many of all points lie
/// within it, a cloud taken for a surface.
pub fn reach_of(points: &[Point], k: usize) -> f64 {
    let every = |count: usize| {
        let step = points.len().div_ceil(count).max(1);
        points.iter().step_by(step).copied().collect::<Vec<Point>>()
    };
    let (seeds, part) =
        (every(REACH_SEEDS), every((points.len() / 8).clamp(REACH_POINTS[0], REACH_POINTS[1])));
    // k points of all are as many of a part
    let few = (k * part.len()).div_ceil(points.len()).clamp(2.min(part.len()), part.len());
    let mut squares: Vec<f64> = seeds
        .iter()
        .map(|&seed| {
            let mut squares: Vec<f64> = part.iter().map(|&p| squared_distance(p, seed)).collect();
            *squares.select_nth_unstable_by(few - 1, f64::total_cmp).1
        })
        .collect();
    // a ball that holds many more than k points may hold more than a piece of surface: then a smaller one
    let rounds = if part.len() < points.len() { 2 } else { 1 };
    for round in 1..=rounds {
        let counts =
            points.par_chunks(POINTS_PER_PART).map(|points| count_below(points, &seeds, &squares)).reduce(
                || vec![0; seeds.len()],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                    a
                },
            );
        let wanted = if round < rounds { 2 * k } else { k };
        for (square, count) in squares.iter_mut().zip(counts) {
            *square *= wanted as f64 / count as f64;
        }
    }
    squares.sort_unstable_by(f64::total_cmp);
    // of coincident points any distance will do
    squares[squares.len() / 2].sqrt().max(SHORTEST)
}

kernel! {
    /// How many points lie within each seed's distance, squared.
    fn count_below<S>(_, points: &[Point], seeds: &[Point], squares: &[f64]) -> Vec<u64> {
        let mut counts = vec![0; seeds.len()];
        for points in points.chunks(256) {
            let mut axes = [[f64::INFINITY; 256]; 3];
            for (i, p) in points.iter().enumerate() {
                for k in 0..3 {
                    axes[k][i] = p[k];
                }
            }
            let [x, y, z] = &axes;
            for ((count, seed), square) in counts.iter_mut().zip(seeds).zip(squares) {
                let mut sum = 0;
                for i in 0..256 {
                    let d = [x[i] - seed[0], y[i] - seed[1], z[i] - seed[2]];
                    sum += u64::from(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= *square);
                }
                *count += sum;
            }
        }
        counts
    }
}

/// The lowest three bits, with room for those of two other numbers between them.
fn spread(x: u64) -> u64 {
    (x & 1) | ((x & 2) << 2) | ((x & 4) << 4)
}

/// Values by their index.
fn fill<T: Send>(count: usize, value: impl Fn(usize) -> T + Sync) -> Vec<T> {
    (0..count).into_par_iter().with_min_len(POINTS_PER_PART).map(&value).collect()
}

/// Sorts words by `bits` bits above the `shift` lowest, equal ones in their order.
pub(super) fn sort_words(mut words: Vec<u64>, shift: u32, bits: u32) -> Vec<u64> {
    if words.len() <= 2048 {
        // the words are in order of their low bits
        words.sort_unstable();
        return words;
    }
    let passes = bits.div_ceil(DIGIT_BITS);
    let mut other = vec![0u64; words.len()];
    for pass in 0..passes {
        let (from, to) = (bits * pass / passes, bits * (pass + 1) / passes);
        let mask = (1usize << (to - from)) - 1;
        let digit = |word: u64| (word >> (shift + from)) as usize & mask;
        let mut places: Vec<Vec<u32>> = words
            .par_chunks(POINTS_PER_PART)
            .map(|words| {
                let mut counts = vec![0u32; mask + 1];
                for &word in words {
                    counts[digit(word)] += 1;
                }
                counts
            })
            .collect();
        let mut place = 0;
        for d in 0..=mask {
            for part in &mut places {
                let count = part[d];
                part[d] = place;
                place += count;
            }
        }
        let slots = Slots::new(&mut other);
        words.par_chunks(POINTS_PER_PART).zip(&mut places).for_each(|(words, places)| {
            for &word in words {
                let place = &mut places[digit(word)];
                // SAFETY: the counts give every word a place of its own
                unsafe { slots.put(*place as usize, word) };
                *place += 1;
            }
        });
        std::mem::swap(&mut words, &mut other);
    }
    words
}

/// The box around points.
pub fn bounds(points: &[Point]) -> Bounds {
    points
        .par_chunks(POINTS_PER_PART)
        .map(|points| {
            // eight points at a time
            let mut low = [f64::INFINITY; 3 * LANES];
            let mut high = [f64::NEG_INFINITY; 3 * LANES];
            let (rows, rest) = points.as_flattened().as_chunks::<{ 3 * LANES }>();
            for row in rows {
                for l in 0..3 * LANES {
                    low[l] = if row[l] < low[l] { row[l] } else { low[l] };
                    high[l] = if row[l] > high[l] { row[l] } else { high[l] };
                }
            }
            let mut bounds = Bounds::NONE;
            for p in rest.as_chunks().0 {
                bounds.add(*p);
            }
            for (low, high) in low.as_chunks().0.iter().zip(high.as_chunks().0) {
                bounds.merge(&Bounds { low: *low, high: *high });
            }
            bounds
        })
        .reduce(
            || Bounds::NONE,
            |mut a, b| {
                a.merge(&b);
                a
            },
        )
}
