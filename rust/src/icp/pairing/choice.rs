//! Choices that the lists and bounds of a batch allow at a pose.
//!
//! Distances are in cells' widths. Places are relative to the anchor of each lane.

use super::lists::{List, NONE};
use super::partners::{Batch, Pairing};
use crate::simd::{BATCH, Simd, Singles};

/// Returns bits of the lanes whose partner is the same as before, or that still have no target point in reach.
#[inline(always)]
pub fn is_same<S: Simd>(simd: S, pairing: &Pairing, batch: &Batch, moved: &[[f64; BATCH]; 3]) -> u32 {
    let unit = pairing.unit;
    let apart = from_each(simd, &batch.targets, moved, unit);
    let steps = apart_from(simd, &batch.last, from_each(simd, moved, &batch.anchors, unit));
    let nearest = simd.min(length(simd, apart), simd.splat(pairing.within));
    let farthest = simd.add(simd.add(nearest, length(simd, steps)), simd.load(&batch.rounding));
    simd.bits(simd.le(farthest, simd.load(&batch.others)))
}

/// Makes the nearest listed points the partners of some lanes; returns bits of those that need a search.
#[inline(always)]
pub fn choose<S: Simd>(
    simd: S,
    pairing: &Pairing,
    batch: &mut Batch,
    list: &List,
    moved: &[[f64; BATCH]; 3],
    lanes: u32,
) -> u32 {
    let places = from_each(simd, moved, &batch.anchors, pairing.unit);
    let mut first = simd.splat(f32::MAX);
    let mut second = simd.splat(f32::MAX);
    let mut numbers = simd.splat(f32::from_bits(NONE));
    for row in &list.rows {
        let square = squared_length(simd, apart_from(simd, &row.places, places));
        let nearer = simd.le(square, first);
        second = simd.min(second, simd.max(first, square));
        first = simd.min(first, square);
        numbers = simd.select(nearer, simd.load(&row.numbers), numbers);
    }
    let (first, second) = (simd.sqrt(first), simd.sqrt(second));
    let rounding = simd.load(&batch.rounding);
    let rest = simd.sub(simd.load(&batch.beyond), length(simd, places));
    let nearest = simd.add(simd.min(first, simd.splat(pairing.within)), rounding);
    let covered = simd.bits(simd.le(nearest, rest)) & lanes;
    let clear = simd.le(simd.add(nearest, rounding), second);
    let others = simd.min(simd.sub(simd.select(clear, second, first), rounding), rest);
    let chosen = simd.mask(covered);
    batch.others = simd.store(simd.select(chosen, others, simd.load(&batch.others)));
    for k in 0..3 {
        batch.last[k] = simd.store(simd.select(chosen, places[k], simd.load(&batch.last[k])));
    }
    let before = simd.load(&batch.partners);
    batch.partners = simd.store(simd.select(chosen, numbers, before));
    let mut tied = covered & !simd.bits(clear);
    while tied != 0 {
        let l = tied.trailing_zeros() as usize % BATCH;
        tied &= tied - 1;
        batch.partners[l] =
            f32::from_bits(pairing.nearest_of(list.numbers(l), moved.map(|values| values[l])));
    }
    lanes & !covered
}

/// Returns places relative to others in single precision and in cells.
#[inline(always)]
fn from_each<S: Simd>(
    simd: S,
    places: &[[f64; BATCH]; 3],
    others: &[[f64; BATCH]; 3],
    unit: f64,
) -> [S::F; 3] {
    [
        simd.narrow_each(&places[0], &others[0], unit),
        simd.narrow_each(&places[1], &others[1], unit),
        simd.narrow_each(&places[2], &others[2], unit),
    ]
}

/// Returns vectors between places.
#[inline(always)]
fn apart_from<S: Simd>(simd: S, [x, y, z]: &[Singles; 3], places: [S::F; 3]) -> [S::F; 3] {
    [simd.sub(simd.load(x), places[0]), simd.sub(simd.load(y), places[1]), simd.sub(simd.load(z), places[2])]
}

#[inline(always)]
fn squared_length<S: Simd>(simd: S, [x, y, z]: [S::F; 3]) -> S::F {
    simd.add(simd.add(simd.mul(x, x), simd.mul(y, y)), simd.mul(z, z))
}

#[inline(always)]
fn length<S: Simd>(simd: S, vector: [S::F; 3]) -> S::F {
    simd.sqrt(squared_length(simd, vector))
}
