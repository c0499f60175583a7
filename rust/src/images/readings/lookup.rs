//! Look-up of places in the image by their position.

use std::ops::Range;

use super::planar::Place;
use crate::geometry::cut_off;
use crate::simd::{LANES, kernel};

const MAX_CELLS: f64 = 4096.0; // cells along a side at most; matters for ropes much thinner than a pixel
const NOWHERE: u64 = u64::MAX; // the nearest node of a place without one

/// Places sorted into square cells.
pub struct Lookup {
    low: Place,
    /// Cells for each pixel.
    inverse: f64,
    width: usize,
    height: usize,
    starts: Vec<u32>,
    /// Numbers of the places, cell by cell.
    numbers: Vec<u32>,
    /// Their columns and their rows, then `LANES` places at infinity.
    places: [Vec<f64>; 2],
}

impl Lookup {
    /// Sorts places into cells of this size or larger.
    pub fn new(nodes: &[Place], cell: f64) -> Self {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for x in nodes {
            for c in 0..2 {
                low[c] = low[c].min(x[c]);
                high[c] = high[c].max(x[c]);
            }
        }
        let inverse = 1.0 / cell.max((high[0] - low[0]).max(high[1] - low[1]) / MAX_CELLS);
        // without places nothing is found
        let width = ((high[0] - low[0]).max(0.0) * inverse) as usize + 1;
        let height = ((high[1] - low[1]).max(0.0) * inverse) as usize + 1;
        let cell_of = |x: &Place| {
            let [column, row] = [0, 1].map(|c| cut_off((x[c] - low[c]) * inverse) as usize);
            row * width + column
        };
        let mut starts = vec![0u32; width * height + 1];
        for x in nodes {
            starts[cell_of(x) + 1] += 1;
        }
        for k in 0..width * height {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        let mut numbers = vec![0; nodes.len()];
        let mut places = [0, 1].map(|_| vec![f64::INFINITY; nodes.len() + LANES]);
        for (i, x) in nodes.iter().enumerate() {
            let k = cell_of(x);
            let to = next[k] as usize;
            numbers[to] = i as u32;
            for c in 0..2 {
                places[c][to] = x[c];
            }
            next[k] += 1;
        }
        Self { low, inverse, width, height, starts, numbers, places }
    }

    /// Returns the columns of cells (`c` 0) or the rows (`c` 1) within reach of a coordinate.
    #[inline(always)]
    fn range(&self, c: usize, at: f64, reach: f64) -> Range<usize> {
        let first = cut_off((at - reach - self.low[c]) * self.inverse) as usize;
        let last = (at + reach - self.low[c]) * self.inverse;
        first..if last < 0.0 { 0 } else { (cut_off(last) as usize + 1).min([self.width, self.height][c]) }
    }

    /// Returns the sorted places in the cells within reach of a place, row by row.
    #[inline(always)]
    fn runs(&self, at: Place, reach: f64) -> impl Iterator<Item = Range<usize>> {
        let columns = self.range(0, at[0], reach);
        let rows = if columns.is_empty() { 0..0 } else { self.range(1, at[1], reach) };
        rows.map(move |y| {
            let row = y * self.width;
            self.starts[row + columns.start] as usize..self.starts[row + columns.end] as usize
        })
    }

    /// Calls with the number and the place of each place in the cells within reach of a place.
    #[inline]
    pub fn visit(&self, at: Place, reach: f64, mut call: impl FnMut(usize, Place)) {
        for run in self.runs(at, reach) {
            for i in run {
                call(self.numbers[i] as usize, [self.places[0][i], self.places[1][i]]);
            }
        }
    }

    /// Returns the numbers of the places nearer to some nodes than a distance, ascending, each with its nearest node.
    pub fn near(&self, nodes: &[Place], within: f64) -> Vec<(usize, usize)> {
        // all of them lie in these rows of cells
        let (mut top, mut bottom) = (usize::MAX, 0);
        for node in nodes {
            let rows = self.range(1, node[1], within);
            (top, bottom) = (top.min(rows.start), bottom.max(rows.end));
        }
        if top >= bottom {
            return Vec::new();
        }
        let [first, last] = [top, bottom].map(|row| self.starts[row * self.width] as usize);
        let mut squares = vec![within * within; last - first + LANES];
        let mut nearest = vec![NOWHERE; last - first + LANES];
        find_nearest_nodes(self, nodes, within, first, &mut squares, &mut nearest);
        let found = (first..last).zip(nearest).filter(|&(_, node)| node != NOWHERE);
        let mut found: Vec<(usize, usize)> =
            found.map(|(i, node)| (self.numbers[i] as usize, node as usize)).collect();
        found.sort_unstable();
        found
    }
}

kernel! {
    /// Lowers the squared distances of sorted places, from the `first` on, to those from nodes; sets the nearest nodes.
    fn find_nearest_nodes<S>(
        _,
        lookup: &Lookup,
        nodes: &[Place],
        within: f64,
        first: usize,
        squares: &mut [f64],
        nearest: &mut [u64]
    ) {
        for (number, node) in nodes.iter().enumerate() {
            for run in lookup.runs(*node, within) {
                // places after the run are too far to matter
                for start in run.step_by(LANES) {
                    let [x, y] = [0, 1].map(|c| &lookup.places[c][start..start + LANES]);
                    let squares = &mut squares[start - first..][..LANES];
                    let nearest = &mut nearest[start - first..][..LANES];
                    for l in 0..LANES {
                        let square = (x[l] - node[0]).powi(2) + (y[l] - node[1]).powi(2);
                        let nearer = square < squares[l];
                        squares[l] = if nearer { square } else { squares[l] };
                        nearest[l] = if nearer { number as u64 } else { nearest[l] };
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_places_are_those_of_a_full_search() {
        let place = |i: usize| [(i * i % 97) as f64 * 0.9, (i * 31 % 83) as f64 * 0.7];
        let places: Vec<Place> = (0..400).map(place).collect();
        let nodes: Vec<Place> =
            (0..30).map(|i| [f64::from(i) * 3.1 - 4.0, 20.0 + f64::from(i * i % 11)]).collect();
        for (cell, within) in [(3.0, 9.0), (5.0, 2.0), (200.0, 9.0)] {
            let found = Lookup::new(&places, cell).near(&nodes, within);
            let square = |p: Place, q: Place| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2);
            let expected: Vec<(usize, usize)> = (0..places.len())
                .filter_map(|i| {
                    let each = nodes.iter().map(|&node| square(places[i], node)).enumerate();
                    let (node, least) = each.min_by(|a, b| a.1.total_cmp(&b.1))?;
                    (least < within * within).then_some((i, node))
                })
                .collect();
            assert!(!expected.is_empty() && expected.len() < places.len());
            assert_eq!(found, expected);
        }
        assert!(Lookup::new(&places, 3.0).near(&[[0.0, 500.0]], 9.0).is_empty());
        assert!(Lookup::new(&[], 3.0).near(&nodes, 9.0).is_empty());
    }
}
