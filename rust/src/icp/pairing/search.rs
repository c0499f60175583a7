//! Searches for the near target points of a batch.

use super::choice::choose;
use super::lists::{List, NONE};
use super::near::Near;
use super::partners::{Batch, Pairing};
use crate::geometry::{Point, dot, squared_distance};
use crate::index::around::{Around, Frame};
use crate::index::bounds::Bounds;
use crate::index::cells::Cells;
use crate::simd::{BATCH, Simd};

/// Listed points lie within this distance of an anchor that lies on the target, cells.
const SPREAD: f64 = 0.35;
const LEAD: f64 = 3.0; // steps, as the last one, by which lists are made ahead, at most
const MAX_REACH: f64 = 2.0; // reach of the search, cells; the tree finds farther partners
const MAX_MET: usize = 2048; // points that a search meets at most; the tree finds partners in denser places
const MAX_EXAMINED: usize = 4; // points in the cells that a search touches, at most, for each point that it may meet

/// Finds the lists and partners of a batch.
#[inline(always)]
pub fn search<S: Simd>(
    simd: S,
    pairing: &Pairing,
    batch: &mut Batch,
    list: &mut List,
    moved: &[[f64; BATCH]; 3],
    buffers: &mut Near,
) {
    let Pairing { cells, reach, unit, .. } = pairing;
    let place = |l: usize| -> Point { [moved[0][l], moved[1][l], moved[2][l]] };
    let spread = SPREAD * cells.size();
    let farthest = reach.hypot(spread);
    batch.anchors = lead(pairing, batch, moved, spread);
    // the last partner is an upper bound of the distance to the nearest
    let mut known: [f64; BATCH] = std::array::from_fn(|l| {
        let apart = [0, 1, 2].map(|k| batch.targets[k][l] - batch.anchors[k][l]);
        (dot(apart, apart) + spread * spread).sqrt()
    });
    let mut search_reach = 0.0;
    for known in &known[..batch.count] {
        search_reach = f64::max(search_reach, if known.is_finite() { 1.001 * known } else { cells.size() });
    }
    search_reach = search_reach.min(farthest);
    let mut left = batch.lanes();
    list.clear(simd, left);
    while left != 0 {
        let places = take_left(&batch.anchors, left);
        let near = search_reach.min(MAX_REACH * cells.size());
        let found = buffers.around.find_few(simd, cells, &Bounds::of(&places), near, MAX_EXAMINED * MAX_MET);
        // in a wide batch, single precision cannot decide which points are within reach
        let tells = |frame: &Frame| f64::from(frame.rounding) <= 0.01 * (spread * frame.unit).powi(2);
        let suits = |frame: &Frame| {
            search_reach <= MAX_REACH * cells.size() && buffers.around.count() <= MAX_MET && tells(frame)
        };
        let Some(frame) = found.filter(suits) else {
            let mut last = NONE;
            for l in (0..BATCH).filter(|l| left & (1 << l) != 0) {
                last = pairing.search_tree(place(l), [batch.partners[l].to_bits(), last]);
                batch.partners[l] = f32::from_bits(last);
                // negative bounds tell nothing
                (batch.others[l], batch.beyond[l]) = (-1.0, -1.0);
            }
            return;
        };
        let points = frame.narrow(simd, &places);
        let (low, _) = frame.limits(search_reach);
        let mut limits = known.map(|known| low.min((known * unit).powi(2) as f32));
        let mut listed = left;
        if (0..BATCH).any(|l| left & (1 << l) != 0 && known[l] >= search_reach) {
            let nearest = buffers.find_nearest(simd, &points);
            let spread = (spread * unit).powi(2) as f32;
            for l in 0..BATCH {
                limits[l] = low.min(nearest[l] + spread);
                if nearest[l] + spread > low && search_reach < farthest {
                    listed &= !(1 << l);
                }
            }
        }
        for l in 0..BATCH {
            limits[l] = if listed & (1 << l) != 0 { limits[l] } else { -1.0 };
        }
        let beyond = buffers.fill(simd, &points, &limits, list);
        let rounding = (1e-6 * frame.extent * unit) as f32;
        for l in 0..BATCH {
            if listed & (1 << l) != 0 {
                batch.rounding[l] = rounding;
                batch.beyond[l] = (beyond[l] - frame.rounding).max(0.0).sqrt() - rounding;
            }
        }
        left &= !listed;
        let mut put_back = false;
        let mut open = choose(simd, pairing, batch, list, moved, listed);
        while open != 0 {
            let l = open.trailing_zeros() as usize % BATCH;
            open &= open - 1;
            if batch.anchor(l) != place(l) {
                // the list of the place ahead does not reach back
                for k in 0..3 {
                    batch.anchors[k][l] = moved[k][l];
                }
                known[l] = f64::INFINITY;
                list.clear(simd, 1 << l);
                left |= 1 << l;
                put_back = true;
                continue;
            }
            // too many points are as near as the nearest
            batch.partners[l] = f32::from_bits(exact(cells, &buffers.around, place(l), search_reach));
            batch.others[l] = -1.0;
        }
        // a lane that was put back has its nearest point within this reach; it is put back once
        if !put_back {
            search_reach = (2.0 * search_reach).min(farthest);
        }
    }
}

/// Returns places, with those of lanes that are not left replaced by one that is.
#[inline(always)]
fn take_left(places: &[[f64; BATCH]; 3], left: u32) -> [[f64; BATCH]; 3] {
    let mut kept = *places;
    for l in 0..BATCH {
        if left & (1 << l) == 0 {
            for k in 0..3 {
                kept[k][l] = places[k][left.trailing_zeros() as usize % BATCH];
            }
        }
    }
    kept
}

/// Returns places ahead of the points. Lists made there last longer: points mostly move on in the direction of their
/// last step.
///
/// A list must serve the present place too, so no point is led farther than half of what its list allows.
#[inline(always)]
fn lead(pairing: &Pairing, batch: &Batch, moved: &[[f64; BATCH]; 3], spread: f64) -> [[f64; BATCH]; 3] {
    let before = batch.moved_to(&pairing.before);
    let mut ahead = *moved;
    for l in 0..BATCH {
        let length = |x: Point| dot(x, x).sqrt();
        let [x, y, z] = [0, 1, 2].map(|k| batch.targets[k][l] - moved[k][l]);
        let step = [0, 1, 2].map(|k| moved[k][l] - before[k][l]);
        let apart = length([x, y, z]).min(pairing.reach);
        let most = 0.5 * ((apart * apart + spread * spread).sqrt() - apart);
        let steps = (most / length(step)).min(LEAD);
        for k in 0..3 {
            ahead[k][l] += steps * step[k];
        }
    }
    ahead
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
