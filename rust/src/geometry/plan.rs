//! Crossings of segments in a plan, all of them, exactly.
//!
//! Nodes are moved to a lattice, by at most 2^-31 of the plan's extent. There, products of differences fit in 64 bits,
//! so every comparison is exact. A node may then lie on another segment, or two segments on one line. Each node
//! therefore counts as moved by an infinitesimal amount of its own (Edelsbrunner and Mücke 1990, "Simulation of
//! simplicity"). So segments cross as if they were in general position: a line through a node of another crosses that
//! line once. A line that touches another crosses it twice at the same place, or never.

use std::collections::TryReserveError;

use super::slabs::SlabTree;
use crate::parallel::go_on;

const STEPS: f64 = (1_u64 << 30) as f64; // steps of the lattice across the plan's extent

#[derive(Debug, Clone, Copy)]
pub struct Crossed {
    /// The numbers of the segments, the lower first.
    pub pair: [usize; 2],
    /// Where they cross along each segment, from 0 to 1.
    pub shares: [f64; 2],
    /// 1 if the second segment crosses the first from right to left, else -1.
    pub turn: i8,
}

/// Finds the pairs of segments that cross, in order, all of them or `most` of them. Segments that share a node do not
/// cross.
///
/// # Panics
/// If a segment names a node that does not exist.
pub fn find_crossings(
    nodes: &[[f64; 2]],
    segments: &[[usize; 2]],
    most: usize,
) -> Result<Vec<Crossed>, TryReserveError> {
    let Some(places) = snap_to_lattice(nodes) else { return Ok(Vec::new()) };
    // whole numbers of this size are exact in f64
    let ends = |&segment: &[usize; 2]| segment.map(|k| places[k].map(|x| x as f64));
    let tree = SlabTree::new(&segments.iter().map(ends).collect::<Vec<_>>());
    let (mut found, mut short) = (Vec::new(), None);
    for rank in 0..tree.len() {
        if rank % 256 == 0 {
            go_on();
        }
        let stops = tree.any_pair(rank, |i, j| {
            let Some((shares, turn)) = cross_segments(&places, segments[i], segments[j]) else {
                return false;
            };
            short = found.try_reserve(1).err();
            if short.is_none() && found.len() < most {
                found.push(Crossed { pair: [i, j], shares, turn });
            }
            short.is_some() || found.len() == most
        });
        if let Some(short) = short {
            return Err(short);
        }
        if stops {
            break;
        }
    }
    found.sort_unstable_by_key(|one| one.pair);
    Ok(found)
}

/// Returns the nodes in lattice steps from the lowest corner; None if the plan has no extent.
fn snap_to_lattice(nodes: &[[f64; 2]]) -> Option<Vec<[i64; 2]>> {
    let bound = |k: usize, of: fn(f64, f64) -> f64| nodes.iter().map(|p| p[k]).reduce(of);
    let low = [bound(0, f64::min)?, bound(1, f64::min)?];
    let extent = (bound(0, f64::max)? - low[0]).max(bound(1, f64::max)? - low[1]);
    let scale = STEPS / extent;
    let place = |p: &[f64; 2]| [0, 1].map(|k| ((p[k] - low[k]) * scale).round_ties_even() as i64);
    scale.is_finite().then(|| nodes.iter().map(place).collect())
}

/// Returns where two segments cross along each, and to which side the second leaves the first; None if they do not
/// cross.
fn cross_segments(places: &[[i64; 2]], [a, b]: [usize; 2], [c, d]: [usize; 2]) -> Option<([f64; 2], i8)> {
    if a == c || a == d || b == c || b == d {
        return None;
    }
    let (of_a, of_b) = (side(places, [c, d, a]), side(places, [c, d, b]));
    let (of_c, of_d) = (side(places, [a, b, c]), side(places, [a, b, d]));
    (of_a.1 != of_b.1 && of_c.1 != of_d.1).then(|| ([share(of_a.0, of_b.0), share(of_c.0, of_d.0)], of_d.1))
}

/// Returns where a segment's distance from a line passes zero, from 0 to 1; 0.5 if all of it lies on the line.
fn share(start: i64, stop: i64) -> f64 {
    let whole = start as f64 - stop as f64;
    if whole == 0.0 { 0.5 } else { start as f64 / whole }
}

/// Returns twice the area of a triangle, and the side of the third node: 1 if it is left of the line through the first
/// two.
fn side(places: &[[i64; 2]], mut nodes: [usize; 3]) -> (i64, i8) {
    let [p, q, r] = nodes.map(|k| places[k]);
    let area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    if area != 0 {
        return (area, area.signum() as i8);
    }
    let odd = (nodes[0] > nodes[1]) ^ (nodes[0] > nodes[2]) ^ (nodes[1] > nodes[2]);
    nodes.sort_unstable();
    let [p, q, r] = nodes.map(|k| places[k]);
    // the area's terms in the nodes' infinitesimal moves, the largest first; at least one is not zero
    let terms = [r[0] - q[0], q[1] - r[1], p[0] - r[0]];
    let sign = terms.into_iter().find(|&term| term != 0).map_or(1, |term| term.signum() as i8);
    (0, if odd { -sign } else { sign })
}
