//! The points around a box, as runs of the cells' points.

use std::ops::Range;

use super::{BLOCK_BITS, Cells, IN_BLOCK, Row};
use crate::geometry::Point;
use crate::index::bounds::Bounds;
use crate::index::limits::SHORTEST;

const MAX_ROWS: u64 = 1 << 12; // rows of cells that are examined around a box, at most

/// Finds the runs of points around boxes. Consecutive boxes should be near each other.
#[derive(Default)]
pub struct Sweep {
    /// Where the search for the last box found each of its rows of cells.
    hints: Vec<usize>,
    /// The result: runs of positions of points that may be within reach.
    pub runs: Vec<Range<usize>>,
}

impl Sweep {
    /// Finds runs that hold all points within `reach` of a box. Returns false, and finds nothing, if the cells are too
    /// wide or hold more than `most` points.
    #[inline(always)]
    pub fn find(&mut self, cells: &Cells, bounds: &Bounds, reach: f64, most: usize) -> bool {
        let reach = (reach * (1.0 + 1e-12)).max(SHORTEST);
        self.runs.clear();
        let [a, b, c] = cells.axes;
        // relative to the cells: small differences would be lost in coordinates far from the origin
        let low: Point = std::array::from_fn(|k| bounds.low[k] - cells.low[k]);
        let high: Point = std::array::from_fn(|k| bounds.high[k] - cells.low[k]);
        let wider = reach + 1e-9 * cells.size;
        let range = |axis: usize, k: usize| {
            (cells.number_along(axis, low[k] - wider), cells.number_along(axis, high[k] + wider))
        };
        // the distance of a slab of cells from the box, less a little for the rounding of cells' numbers
        let gap = |number: u64, k: usize| {
            let from = number as f64 * cells.size;
            (from - high[k]).max(low[k] - from - cells.size) - 1e-6 * cells.size
        };
        let squared = |x: f64| if x > 0.0 { x * x } else { 0.0 };
        let (first_a, last_a) = range(0, a);
        let (first_b, last_b) = range(1, b);
        let (first_c, last_c) = range(2, c);
        let blocks = (last_c >> BLOCK_BITS) - (first_c >> BLOCK_BITS) + 1;
        // each is below 2²⁰
        if cells.wide || (last_a - first_a + 1) * (last_b - first_b + 1) * blocks > MAX_ROWS {
            return false;
        }
        let mut row = 0;
        let mut points = 0;
        for block in first_c >> BLOCK_BITS..=last_c >> BLOCK_BITS {
            // the cells of its rows that are within reach
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
                        let run = cells.starts[found.start] as usize..cells.starts[found.end] as usize;
                        points += run.len();
                        self.runs.push(run);
                    }
                }
            }
        }
        points <= most
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

/// Returns the position of the first of ascending keys that is not below `key`, searching from a hint on.
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
