//! Searches for the near target points of some lanes of a batch.

use super::choice::choose;
use super::lists::{List, NONE};
use super::near::Near;
use super::partners::{Batch, Pairing};
use crate::geometry::{Point, squared_distance};
use crate::index::around::{Around, Frame};
use crate::index::bounds::Bounds;
use crate::index::cells::Cells;
use crate::simd::{BATCH, Simd};

/// Listed points lie within this distance of a source point that lies on the target, cells.
const SPREAD: f64 = 0.35;
const MAX_REACH: f64 = 2.0; // reach of the search, cells; the tree finds farther partners
const MAX_MET: usize = 2048; // points that a search meets at most; the tree finds partners in denser places
const MAX_EXAMINED: usize = 4; // points in the cells that a search touches, at most, for each point that it may meet

/// Finds the lists and partners of some lanes of a batch.
#[inline(always)]
pub fn search<S: Simd>(
    simd: S,
    pairing: &Pairing,
    batch: &mut Batch,
    list: &mut List,
    moved: &[[f64; BATCH]; 3],
    lanes: u32,
    buffers: &mut Near,
) {
    let Pairing { cells, reach, unit, .. } = pairing;
    let place = |l: usize| -> Point { [moved[0][l], moved[1][l], moved[2][l]] };
    let spread = SPREAD * cells.size();
    let farthest = reach.hypot(spread);
    let mut left = [0; BATCH];
    let mut count = 0;
    let mut search_reach = 0.0;
    for l in 0..BATCH {
        if lanes & (1 << l) == 0 {
            continue;
        }
        left[count] = l;
        count += 1;
        // the last partner is an upper bound of the distance to the nearest
        let known = match pairing.target(batch.partners[l].to_bits()) {
            Some(partner) => 1.001 * (squared_distance(partner, place(l)) + spread * spread).sqrt(),
            None => cells.size(),
        };
        search_reach = f64::max(search_reach, known);
        for k in 0..3 {
            batch.anchors[k][l] = moved[k][l];
        }
    }
    list.clear(simd, lanes);
    search_reach = search_reach.min(farthest);
    while count > 0 {
        let mut bounds = Bounds::NONE;
        for &l in &left[..count] {
            bounds.add(place(l));
        }
        let near = search_reach.min(MAX_REACH * cells.size());
        let found = buffers.around.find_few(simd, cells, &bounds, near, MAX_EXAMINED * MAX_MET);
        // in a wide batch, single precision cannot decide which points are within reach
        let tells = |frame: &Frame| f64::from(frame.rounding) <= 0.01 * (spread * frame.unit).powi(2);
        let suits = |frame: &Frame| {
            search_reach <= MAX_REACH * cells.size() && buffers.around.count() <= MAX_MET && tells(frame)
        };
        let Some(frame) = found.filter(suits) else {
            let mut last = NONE;
            for &l in &left[..count] {
                last = pairing.search_tree(place(l), [batch.partners[l].to_bits(), last]);
                batch.partners[l] = f32::from_bits(last);
                // negative bounds tell nothing
                (batch.others[l], batch.beyond[l]) = (-1.0, -1.0);
            }
            return;
        };
        let points = frame.lanes(left[..count].iter().map(|&l| place(l)));
        let nearest = buffers.measure(simd, &points);
        let (low, _) = frame.limits(search_reach);
        let last = search_reach >= farthest;
        let spread = (spread * unit).powi(2) as f32;
        let mut limits = [-1.0; BATCH];
        for i in 0..count {
            if nearest[i] + spread <= low || last {
                limits[i] = low.min(nearest[i] + spread);
            }
        }
        let beyond = buffers.fill(simd, &points, &left, &limits, list);
        let mut listed = 0;
        let mut kept = 0;
        for i in 0..count {
            let l = left[i];
            if limits[i] < 0.0 {
                left[kept] = l;
                kept += 1;
                continue;
            }
            batch.rounding[l] = (1e-6 * frame.extent * unit) as f32;
            batch.beyond[l] = (beyond[i] - frame.rounding).max(0.0).sqrt() - batch.rounding[l];
            listed |= 1 << l;
        }
        let mut crowded = choose(simd, pairing, batch, list, moved, listed);
        while crowded != 0 {
            let l = crowded.trailing_zeros() as usize % BATCH;
            crowded &= crowded - 1;
            // too many points are as near as the nearest
            batch.partners[l] = f32::from_bits(exact(cells, &buffers.around, place(l), search_reach));
            batch.others[l] = -1.0;
        }
        count = kept;
        search_reach = (2.0 * search_reach).min(farthest);
    }
}

/// Returns the position of the nearest point around, the first in the cells' order among equals; NONE if it is out of
/// reach. It computes in double precision.
#[cold]
fn exact(cells: &Cells, around: &Around, moved: Point, reach: f64) -> u32 {
    let (mut best, mut nearest) = (reach * reach, NONE);
    for i in around.positions() {
        let square = squared_distance(cells.point(i), moved);
        if square < best || (square == best && (i as u32) < nearest) {
            (best, nearest) = (square, i as u32);
        }
    }
    nearest
}
