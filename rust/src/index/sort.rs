//! Parallel sorting by some bits of a word.

use rayon::prelude::*;

use super::limits::POINTS_PER_PART;
use crate::parallel::Slots;

const MAX_DIGIT_BITS: u32 = 12; // bits of a digit of the sort at most
const MAX_PARTS: usize = 64; // parts of the words at most: each has a counter for every value of a digit
const MIN_RADIX_WORDS: usize = 2048; // fewer words are sorted in one go

/// Sorts words by `bits` bits above the `shift` lowest; equal ones keep their order.
pub fn sort_words(mut words: Vec<u64>, shift: u32, bits: u32) -> Vec<u64> {
    if words.len() <= MIN_RADIX_WORDS {
        // the words are already in order of their lower bits
        words.sort_unstable();
        return words;
    }
    let passes = bits.div_ceil(MAX_DIGIT_BITS);
    let part = words.len().div_ceil(MAX_PARTS).max(POINTS_PER_PART);
    let mut other = vec![0u64; words.len()];
    for pass in 0..passes {
        let (from, to) = (bits * pass / passes, bits * (pass + 1) / passes);
        let mask = (1usize << (to - from)) - 1;
        let digit = |word: u64| (word >> (shift + from)) as usize & mask;
        let mut places: Vec<Vec<u32>> = words
            .par_chunks(part)
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
        words.par_chunks(part).zip(&mut places).for_each(|(words, places)| {
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
