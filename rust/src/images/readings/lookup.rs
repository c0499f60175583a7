//! Look-up of places in the image by their position.

use super::planar::Place;

const MAX_CELLS: f64 = 4096.0; // cells along a side at most; matters for ropes much thinner than a pixel

/// Places sorted into square cells.
pub struct Lookup {
    low: Place,
    cell: f64,
    width: usize,
    height: usize,
    starts: Vec<u32>,
    /// Numbers and places, cell by cell.
    nodes: Vec<(u32, Place)>,
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
        let cell = cell.max((high[0] - low[0]).max(high[1] - low[1]) / MAX_CELLS);
        // without places nothing is found
        let width = ((high[0] - low[0]).max(0.0) / cell) as usize + 1;
        let height = ((high[1] - low[1]).max(0.0) / cell) as usize + 1;
        let cell_of =
            |x: &Place| ((x[1] - low[1]) / cell) as usize * width + ((x[0] - low[0]) / cell) as usize;
        let mut starts = vec![0u32; width * height + 1];
        for x in nodes {
            starts[cell_of(x) + 1] += 1;
        }
        for k in 0..width * height {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        let mut sorted = vec![(0, [0.0; 2]); nodes.len()];
        for (i, x) in nodes.iter().enumerate() {
            let k = cell_of(x);
            sorted[next[k] as usize] = (i as u32, *x);
            next[k] += 1;
        }
        Self { low, cell, width, height, starts, nodes: sorted }
    }

    /// Calls with the number and the place of each place in the cells within reach of a place.
    #[inline]
    pub fn visit(&self, at: Place, reach: f64, mut call: impl FnMut(usize, Place)) {
        let range = |c: usize, count: usize| {
            // a cast to an integer cuts off, and saturates
            let first = ((at[c] - reach - self.low[c]) / self.cell) as usize;
            let last = (at[c] + reach - self.low[c]) / self.cell;
            (first, if last < 0.0 { 0 } else { (last as usize + 1).min(count) })
        };
        let ((left, right), (top, bottom)) = (range(0, self.width), range(1, self.height));
        for y in top..bottom {
            if left >= right {
                break;
            }
            let (from, to) = (self.starts[y * self.width + left], self.starts[y * self.width + right]);
            for &(i, place) in &self.nodes[from as usize..to as usize] {
                call(i as usize, place);
            }
        }
    }
}
