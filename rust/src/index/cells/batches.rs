//! The points of cells in batches of near points.

use std::ops::Range;

use rayon::prelude::*;

use crate::parallel::go_on;

use super::{Cells, fill, spread};
use crate::index::sort::sort_words;
use crate::simd::BATCH;

/// Batches that one task works on; fixed, so that results do not depend on the number of threads.
const BATCHES_PER_TASK: usize = 32;

impl Cells {
    /// Divides all points into batches of at most [`BATCH`] near points.
    pub fn batches(&self) -> Batches {
        // cells in order of cubes of eight along each axis, and inside a cube by their interleaved bits
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
            let far = (0..3).any(|k| high[k] - low[k] >= self.batch_cells);
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
}

/// Batches of near points.
pub struct Batches {
    positions: Vec<u32>,
    starts: Vec<u32>,
}

impl Batches {
    /// Calls `task` with the batches of each task, in parallel. Tasks reuse the buffers of others.
    pub fn for_each_task<'a, B: Default>(
        &'a self,
        task: impl Fn(&mut B, &mut dyn Iterator<Item = &'a [u32]>) + Sync + Send,
    ) {
        let ranges: Vec<Range<u32>> = self.starts.windows(2).map(|pair| pair[0]..pair[1]).collect();
        ranges.par_chunks(BATCHES_PER_TASK).for_each_init(B::default, |buffers, ranges| {
            let mut batches = ranges.iter().map(|range| {
                go_on();
                &self.positions[range.start as usize..range.end as usize]
            });
            task(buffers, &mut batches);
        });
    }
}
