//! Where lines cross in a plan: all places, exactly.
//!
//! Nodes are moved to a lattice, by up to 2^-31 of the plan's extent: products of differences fit in 64 bits, so every
//! comparison is exact. Where a node then lies on another segment, or segments lie on each other, each node counts as
//! moved by an amount of its own, too small to see (Edelsbrunner and Mücke 1990, "Simulation of simplicity"). So lines
//! cross as if they were in general position: one that goes through a node of another crosses it once; one that touches
//! it crosses it twice at the same place, or never.

use std::collections::TryReserveError;

use super::boxes::{Bounds, BoxTree};
use crate::parallel::go_on;

/// Steps of the lattice across the plan.
const STEPS: f64 = (1_u64 << 30) as f64;

/// Two segments that cross.
#[derive(Debug, Clone, Copy)]
pub struct Crossed {
    /// Their numbers, the less first.
    pub pair: [usize; 2],
    /// How far along each they cross, from 0 to 1.
    pub shares: [f64; 2],
    /// 1 where the second crosses the first from its right to its left, else -1.
    pub turn: i8,
}

/// All pairs of segments that cross, in order. Segments that share a node do not.
///
/// # Errors
/// If there are more than memory holds.
///
/// # Panics
/// If a segment's node is not there.
pub fn crossed(nodes: &[[f64; 2]], segments: &[[usize; 2]]) -> Result<Vec<Crossed>, TryReserveError> {
    let Some(places) = on_lattice(nodes) else { return Ok(Vec::new()) };
    // boxes of no height; whole numbers this small are exact
    let ends = |&segment: &[usize; 2]| segment.map(|k| [places[k][0] as f64, places[k][1] as f64, 0.0]);
    let tree = BoxTree::new(segments.iter().map(ends));
    let (mut found, mut short) = (Vec::new(), None);
    for (i, one) in segments.iter().enumerate() {
        if i % 256 == 0 {
            go_on();
        }
        tree.any(&Bounds::about(&ends(one)), i + 1, |j| {
            let Some((shares, turn)) = meeting(&places, *one, segments[j]) else { return false };
            short = found.try_reserve(1).err();
            if short.is_none() {
                found.push(Crossed { pair: [i, j], shares, turn });
            }
            short.is_some()
        });
        if let Some(short) = short {
            return Err(short);
        }
    }
    Ok(found)
}

/// Nodes in steps from the lowest corner; none if the plan has no extent.
fn on_lattice(nodes: &[[f64; 2]]) -> Option<Vec<[i64; 2]>> {
    let bound = |k: usize, of: fn(f64, f64) -> f64| nodes.iter().map(|p| p[k]).reduce(of);
    let low = [bound(0, f64::min)?, bound(1, f64::min)?];
    let extent = (bound(0, f64::max)? - low[0]).max(bound(1, f64::max)? - low[1]);
    let scale = STEPS / extent;
    let place = |p: &[f64; 2]| [0, 1].map(|k| ((p[k] - low[k]) * scale).round_ties_even() as i64);
    scale.is_finite().then(|| nodes.iter().map(place).collect())
}

/// How far along each of two segments they cross, and to which side the second leaves the first.
fn meeting(places: &[[i64; 2]], [a, b]: [usize; 2], [c, d]: [usize; 2]) -> Option<([f64; 2], i8)> {
    if a == c || a == d || b == c || b == d {
        return None;
    }
    let (of_a, of_b) = (side(places, [c, d, a]), side(places, [c, d, b]));
    let (of_c, of_d) = (side(places, [a, b, c]), side(places, [a, b, d]));
    (of_a.1 != of_b.1 && of_c.1 != of_d.1).then(|| ([share(of_a.0, of_b.0), share(of_c.0, of_d.0)], of_d.1))
}

/// Where a line's distance from another goes through zero; its middle, if all of it lies on that.
fn share(start: i64, stop: i64) -> f64 {
    let whole = start as f64 - stop as f64;
    if whole == 0.0 { 0.5 } else { start as f64 / whole }
}

/// Twice the area of a triangle of nodes, and on which side of the first two the third is: 1 is left.
fn side(places: &[[i64; 2]], mut nodes: [usize; 3]) -> (i64, i8) {
    let [p, q, r] = nodes.map(|k| places[k]);
    let area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    if area != 0 {
        return (area, area.signum() as i8);
    }
    let odd = (nodes[0] > nodes[1]) ^ (nodes[0] > nodes[2]) ^ (nodes[1] > nodes[2]);
    nodes.sort_unstable();
    let [p, q, r] = nodes.map(|k| places[k]);
    // the area's terms in the nodes' small moves, the largest first; one is always there, with a sign of its own
    let terms = [r[0] - q[0], q[1] - r[1], p[0] - r[0]];
    let sign = terms.into_iter().find(|&term| term != 0).map_or(1, |term| term.signum() as i8);
    (0, if odd { -sign } else { sign })
}
