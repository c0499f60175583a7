//! Look-up of places in the image by their position.

use std::ops::Range;

use super::planar::Place;
use crate::geometry::cut_off;
use crate::simd::{Doubles, LANES, kernel};

const MAX_CELLS: f64 = 4096.0; // cells along a side at most; matters for ropes much thinner than a pixel
const NOWHERE: f64 = -1.0; // the nearest node of a place without one

/// Columns and rows of `LANES` sorted places or directions.
pub type Block = [Doubles; 2];

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
    /// Their columns and their rows; places at infinity fill the last block.
    blocks: Vec<Block>,
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
        let mut blocks = vec![[[f64::INFINITY; LANES]; 2]; nodes.len().div_ceil(LANES)];
        for (i, x) in nodes.iter().enumerate() {
            let k = cell_of(x);
            let to = next[k] as usize;
            numbers[to] = i as u32;
            for c in 0..2 {
                blocks[to / LANES][c][to % LANES] = x[c];
            }
            next[k] += 1;
        }
        Self { low, inverse, width, height, starts, numbers, blocks }
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

    /// Calls with the number of each place in the cells within reach of a place.
    #[inline]
    pub fn visit(&self, at: Place, reach: f64, mut call: impl FnMut(usize)) {
        for run in self.runs(at, reach) {
            for &i in &self.numbers[run] {
                call(i as usize);
            }
        }
    }

    /// Returns the numbers of the places nearer to some nodes than a distance, ascending, each with its nearest node.
    pub fn near(&self, nodes: &[Place], within: f64) -> Vec<(usize, usize)> {
        let (numbers, nearest) = self.search(nodes, within, None);
        let Some(&first) = numbers.iter().min() else { return Vec::new() };
        let last = numbers.iter().max().unwrap_or(&first);
        // places near each other have near numbers: a list of all between them takes less time than sorting
        let mut found = vec![None; (last - first) as usize + 1];
        for (i, node) in list_found(numbers, &nearest) {
            found[(i - first) as usize] = Some(node);
        }
        (first..).zip(found).filter_map(|(i, node)| Some((i as usize, node?))).collect()
    }

    /// Returns the nearest node of each place that is nearer than a distance; only of those that run across the place's
    /// direction.
    pub fn find_across(&self, nodes: &[Place], within: f64, across: &Across) -> Vec<Option<usize>> {
        let mut found = vec![None; self.numbers.len()];
        let (numbers, nearest) = self.search(nodes, within, Some(across));
        for (i, node) in list_found(numbers, &nearest) {
            found[i as usize] = Some(node);
        }
        found
    }

    /// Returns the numbers of all places that may be nearer to some nodes than a distance, block by block, and the
    /// blocks' nearest nodes.
    fn search(&self, nodes: &[Place], within: f64, across: Option<&Across>) -> (&[u32], Vec<Nearest>) {
        // all of them lie in these rows of cells
        let (mut top, mut bottom) = (usize::MAX, 0);
        for node in nodes {
            let rows = self.range(1, node[1], within);
            (top, bottom) = (top.min(rows.start), bottom.max(rows.end));
        }
        if top >= bottom {
            return (&[], Vec::new());
        }
        let [first, last] = [top, bottom].map(|row| self.starts[row * self.width] as usize);
        let blocks = first / LANES..last.div_ceil(LANES);
        let mut nearest =
            vec![Nearest { squares: [within * within; LANES], numbers: [NOWHERE; LANES] }; blocks.len()];
        lower_squares(self, nodes, within, across, blocks.start, &mut nearest);
        let end = self.numbers.len().min(blocks.end * LANES);
        (&self.numbers[blocks.start * LANES..end], nearest)
    }

    /// Sorts directions as the places are.
    pub fn sort(&self, direction: impl Fn(usize) -> Place) -> Vec<Block> {
        let mut blocks = vec![[[0.0; LANES]; 2]; self.blocks.len()];
        for (at, &i) in self.numbers.iter().enumerate() {
            for (row, x) in blocks[at / LANES].iter_mut().zip(direction(i as usize)) {
                row[at % LANES] = x;
            }
        }
        blocks
    }
}

/// The directions of nodes and of places, which run across each other.
pub struct Across<'a> {
    /// Unit directions of the nodes.
    pub nodes: &'a [Place],
    /// Unit directions of the places, sorted as these are.
    pub places: &'a [Block],
    /// The cosine of the angle between both is smaller.
    pub below: f64,
}

/// The nearest nodes of a block's places.
#[derive(Clone)]
struct Nearest {
    /// Squared distances from them.
    squares: Doubles,
    /// Their numbers, `NOWHERE` for none.
    numbers: Doubles,
}

/// Lists the places of blocks that have a nearest node, and these nodes.
fn list_found(numbers: &[u32], nearest: &[Nearest]) -> impl Iterator<Item = (u32, usize)> {
    let nodes = nearest.iter().flat_map(|block| block.numbers);
    numbers.iter().zip(nodes).filter_map(|(&i, node)| (node != NOWHERE).then_some((i, node as usize)))
}

kernel! {
    /// Lowers squared distances of sorted places, from block `first` on, to those from nodes; sets their nearest nodes.
    fn lower_squares<S>(
        simd,
        lookup: &Lookup,
        nodes: &[Place],
        within: f64,
        across: Option<&Across>,
        first: usize,
        nearest: &mut [Nearest],
    ) {
        let far = simd.splat_half(f64::INFINITY);
        for (number, node) in nodes.iter().enumerate() {
            let at = node.map(|x| simd.splat_half(x));
            let own = simd.splat_half(number as f64);
            for run in lookup.runs(*node, within).filter(|run| !run.is_empty()) {
                // other places of the blocks are too far to matter
                for b in run.start / LANES..run.end.div_ceil(LANES) {
                    let away = [0, 1].map(|c| simd.sub_half(simd.load_half(&lookup.blocks[b][c]), at[c]));
                    let [x, y] = away.map(|x| simd.mul_half(x, x));
                    let mut square = simd.add_half(x, y);
                    if let Some(across) = across {
                        let along = [0, 1].map(|c| {
                            let (own, place) = (across.nodes[number][c], &across.places[b][c]);
                            simd.mul_half(simd.splat_half(own), simd.load_half(place))
                        });
                        let along = simd.add_half(along[0], along[1]);
                        square = simd.choose_half(along, simd.splat_half(across.below), square, far);
                        square = simd.choose_half(simd.splat_half(-across.below), along, square, far);
                    }
                    let Nearest { squares, numbers } = &mut nearest[b - first];
                    let before = simd.load_half(squares);
                    *squares = simd.store_half(simd.choose_half(square, before, square, before));
                    *numbers = simd.store_half(simd.choose_half(square, before, own, simd.load_half(numbers)));
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
        let places: Vec<Place> = (0..397).map(place).collect();
        let nodes: Vec<Place> =
            (0..30).map(|i| [f64::from(i) * 3.1 - 4.0, 20.0 + f64::from(i * i % 11)]).collect();
        // of nodes at one place, the first one counts
        let nodes = [&nodes[..], &nodes[7..9]].concat();
        let turn = |i: usize, by: f64| [(i as f64 * by).sin(), (i as f64 * by).cos()];
        let directions: Vec<Place> = (0..nodes.len()).map(|i| turn(i, 0.7)).collect();
        for (cell, within) in [(3.0, 9.0), (5.0, 2.0), (200.0, 9.0)] {
            let lookup = Lookup::new(&places, cell);
            let across = Across { nodes: &directions, places: &lookup.sort(|i| turn(i, 0.3)), below: 0.45 };
            let found = lookup.near(&nodes, within);
            let square = |p: Place, q: Place| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2);
            let search_all = |may: &dyn Fn(usize, usize) -> bool| -> Vec<(usize, usize)> {
                let nearest = |i: usize| {
                    let each = nodes.iter().map(|&node| square(places[i], node)).enumerate();
                    let own = each.filter(|&(node, least)| least < within * within && may(i, node));
                    own.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(node, _)| (i, node))
                };
                (0..places.len()).filter_map(nearest).collect()
            };
            let expected = search_all(&|_, _| true);
            assert!(!expected.is_empty() && expected.len() < places.len());
            assert_eq!(found, expected);
            let found = lookup.find_across(&nodes, within, &across);
            let found: Vec<(usize, usize)> = (0..places.len()).filter_map(|i| Some((i, found[i]?))).collect();
            let along = |a: Place, b: Place| (a[0] * b[0] + a[1] * b[1]).abs();
            let fewer = search_all(&|i, node| along(turn(i, 0.3), directions[node]) < 0.45);
            assert!(!fewer.is_empty() && fewer.len() < expected.len());
            assert_eq!(found, fewer);
        }
        assert!(Lookup::new(&places, 3.0).near(&[[0.0, 500.0]], 9.0).is_empty());
        assert!(Lookup::new(&[], 3.0).near(&nodes, 9.0).is_empty());
    }
}
