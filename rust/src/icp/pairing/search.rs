//! The nearest target points of some lanes of a batch.

use super::partners::{Batch, LISTED, NONE, Pairing};
use crate::geometry::{Point, squared_distance};
use crate::index::around::{Around, Frame, squared_distances};
use crate::index::bounds::Bounds;
use crate::index::cells::Cells;
use crate::simd::{BATCH, Simd, Singles};

const SPREAD: f64 = 0.35; // listed points lie within this distance of the nearest, cells
const MAX_REACH: f64 = 2.0; // reach of the search, cells; the tree finds farther partners
const MAX_MET: usize = 2048; // points that a search meets at most; the tree finds partners in denser places
const MAX_EXAMINED: usize = 4; // points in the cells that a search touches, at most, for each point that it may meet

/// Finds the partners of some lanes of a batch.
#[inline(always)]
pub(super) fn search<S: Simd>(
    simd: S,
    pairing: &Pairing,
    batch: &mut Batch,
    moved: &[[f64; BATCH]; 3],
    lanes: &[usize],
    around: &mut Around,
) {
    let Pairing { cells, sorted, reach, .. } = pairing;
    let moved = |l: usize| -> Point { [moved[0][l], moved[1][l], moved[2][l]] };
    // all points up to there are listed
    let spread = SPREAD * cells.size();
    let farthest = reach.hypot(spread);
    let mut left = [0; BATCH];
    left[..lanes.len()].copy_from_slice(lanes);
    let mut count = lanes.len();
    let mut search_reach = 0.0;
    for &l in lanes {
        // the last partner is an upper bound of the distance to the nearest
        let known = match sorted.get(batch.partners[l] as usize) {
            Some(&partner) => 1.001 * (squared_distance(partner, moved(l)) + spread * spread).sqrt(),
            None => cells.size(),
        };
        search_reach = f64::max(search_reach, known);
    }
    search_reach = search_reach.min(farthest);
    while count > 0 {
        let mut bounds = Bounds::NONE;
        for &l in &left[..count] {
            bounds.add(moved(l));
        }
        let near = search_reach.min(MAX_REACH * cells.size());
        let found = around.find_few(simd, cells, &bounds, near, MAX_EXAMINED * MAX_MET);
        // in a wide batch, single precision cannot decide which points are within reach
        let tells = |frame: &Frame| f64::from(frame.rounding) <= 0.01 * (spread * frame.unit).powi(2);
        let suits = |frame: &Frame| {
            search_reach <= MAX_REACH * cells.size() && around.count() <= MAX_MET && tells(frame)
        };
        let Some(frame) = found.filter(suits) else {
            let mut last = NONE;
            for &l in &left[..count] {
                let known = [batch.partners[l], last];
                (batch.partners[l], batch.others[l]) = pairing.search_tree(moved(l), known);
                last = batch.partners[l];
                (batch.listed[l], batch.beyond[l]) = ([NONE; LISTED], batch.others[l]);
            }
            return;
        };
        let points = frame.lanes(left[..count].iter().map(|&l| moved(l)));
        let Nearest { numbers, first, second, next } = nearest(simd, around, &points);
        let (low, _) = frame.limits(search_reach);
        let last = search_reach >= farthest;
        let spread = (spread * frame.unit).powi(2) as f32;
        let surely = |square: f32| {
            (f64::from(square.min(low)) - f64::from(frame.rounding)).max(0.0).sqrt() / frame.unit
        };
        let mut kept = 0;
        for i in 0..count {
            let l = left[i];
            if first[i] + spread > low && !last {
                left[kept] = l;
                kept += 1;
                continue;
            }
            for n in 0..LISTED {
                batch.listed[l][n] = numbers[n][i].to_bits();
            }
            batch.beyond[l] = surely(next[i]);
            if first[i] > low {
                (batch.partners[l], batch.others[l]) = (NONE, surely(low));
            } else if second[i] - first[i] > 2.0 * frame.rounding {
                (batch.partners[l], batch.others[l]) = (batch.listed[l][0], surely(second[i]));
            } else if !pairing.choose(batch, l, moved(l)) {
                // too many points are as near as the nearest
                let (square, position, apart) = exact_two(cells, around, moved(l));
                let found = square <= search_reach * search_reach;
                batch.partners[l] = if found { position } else { NONE };
                batch.others[l] = if found { apart.sqrt().min(search_reach) } else { search_reach };
                (batch.listed[l], batch.beyond[l]) = ([NONE; LISTED], 0.0);
            }
        }
        count = kept;
        search_reach = (2.0 * search_reach).min(farthest);
    }
}

/// The nearest points around, for each lane.
struct Nearest {
    /// Their numbers, the nearest first.
    numbers: [Singles; LISTED],
    /// Squared distances of the first, of the second, and of the one after the last listed.
    first: Singles,
    second: Singles,
    next: Singles,
}

/// Finds the nearest points around, for each lane.
#[inline(always)]
fn nearest<S: Simd>(simd: S, around: &Around, points: &[Singles; 3]) -> Nearest {
    let lanes = [simd.load(&points[0]), simd.load(&points[1]), simd.load(&points[2])];
    let mut squares = [simd.splat(f32::MAX); LISTED + 1];
    let mut numbers = [simd.splat(f32::from_bits(NONE)); LISTED];
    let [x, y, z] = around.axes();
    for (((&x, &y), &z), &this) in x.iter().zip(y).zip(z).zip(around.numbers()) {
        let mut square = squared_distances(simd, x, y, z, lanes);
        if simd.bits(simd.le(square, squares[LISTED])) == 0 {
            continue;
        }
        let mut number = simd.splat(this);
        for n in 0..LISTED {
            let nearer = simd.le(square, squares[n]);
            let farther = simd.max(square, squares[n]);
            squares[n] = simd.min(square, squares[n]);
            square = farther;
            let after = simd.select(nearer, numbers[n], number);
            numbers[n] = simd.select(nearer, number, numbers[n]);
            number = after;
        }
        squares[LISTED] = simd.min(square, squares[LISTED]);
    }
    Nearest {
        numbers: numbers.map(|number| simd.store(number)),
        first: simd.store(squares[0]),
        second: simd.store(squares[1]),
        next: simd.store(squares[LISTED]),
    }
}

/// Returns the squared distance and position of the nearest point around, the first in the cells' order among equals,
/// and the squared distance of the next, in double precision.
#[cold]
fn exact_two(cells: &Cells, around: &Around, moved: Point) -> (f64, u32, f64) {
    let (mut best, mut position, mut second) = (f64::INFINITY, NONE, f64::INFINITY);
    for i in around.positions() {
        let square = squared_distance(cells.point(i), moved);
        if square < best || (square == best && (i as u32) < position) {
            (best, position, second) = (square, i as u32, best);
        } else if square < second {
            second = square;
        }
    }
    (best, position, second)
}
