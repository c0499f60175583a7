//! The exact Jones polynomial of a diagram, by Kauffman's bracket.
//!
//! Crossings are added one by one, next to those already there. The partial result is a sum over the ways in which its
//! open edges can be joined without crossings. Equal ways are merged, so time grows with their number, not with 2 to
//! the number of crossings. (L. H. Kauffman: State models and the Jones polynomial, Topology 26, 1987.)

use rustc_hash::FxHashMap;

use super::code::GaussCode;
use crate::parallel::go_on;

/// Crossings of a diagram at most. Coefficients are at most 2 to the number of crossings, so intermediate sums may wrap
/// at 2^64.
pub const MAX_CROSSINGS: usize = 40;
const MAX_OPEN: usize = 16; // open edges at most; there are 1430 ways to join them

/// A Laurent polynomial: the exponent of the first coefficient, and the coefficients from there up.
pub type Laurent = (i64, Vec<i64>);

/// For each slot of an open edge, the slot that it is joined with.
type Joined = [u8; MAX_OPEN];

/// Returns V(t), with V = t + t^3 − t^4 for the trefoil of three positive crossings; None if the diagram is too large.
pub fn compute_jones(code: &GaussCode) -> Option<Laurent> {
    if code.crossings() > MAX_CROSSINGS {
        return None;
    }
    if code.crossings() == 0 {
        return Some((0, vec![1]));
    }
    let bracket = compute_bracket(&code.planar_diagram())?;
    // V(t) = (-A^3)^-w <D>, t = A^-4
    let writhe = code.writhe();
    let sign = if writhe % 2 == 0 { 1 } else { -1 };
    let mut terms: Vec<(i64, i64)> = (bracket.1.iter().enumerate())
        .filter(|&(_, &x)| x != 0)
        .map(|(k, &x)| (-(bracket.0 + k as i64 - 3 * writhe) / 4, sign * x))
        .collect();
    terms.sort_unstable();
    let (first, last) = (terms.first()?.0, terms.last()?.0);
    let mut coefficients = vec![0; (last - first) as usize + 1];
    for (power, x) in terms {
        coefficients[(power - first) as usize] = x;
    }
    Some((first, coefficients))
}

/// Returns the bracket in powers of A, 1 for a circle; None if too many edges are open at once.
fn compute_bracket(diagram: &[[u32; 4]]) -> Option<Laurent> {
    let mut left: Vec<[u32; 4]> = diagram.to_vec();
    // the open edges, by slot
    let mut open: Vec<u32> = Vec::new();
    let mut ways = FxHashMap::<Joined, Laurent>::default();
    ways.insert([0; MAX_OPEN], (0, vec![1]));
    while !left.is_empty() {
        go_on();
        let edges = |crossing: &[u32; 4]| crossing.iter().filter(|edge| open.contains(edge)).count();
        let best = (0..left.len()).max_by_key(|&k| (edges(&left[k]), left.len() - k))?;
        let crossing = left.remove(best);
        let mut then: Vec<u32> = open.clone();
        for (k, edge) in crossing.into_iter().enumerate() {
            // an edge from the crossing to itself is closed at once
            let again = crossing.iter().enumerate().any(|(other, &same)| other != k && same == edge);
            match then.iter().position(|&at| at == edge) {
                Some(slot) => {
                    then.remove(slot);
                }
                None if !again => then.push(edge),
                None => {}
            }
        }
        if then.len() > MAX_OPEN {
            return None;
        }
        let [a, b, c, d] = crossing;
        let mut added = FxHashMap::<Joined, Laurent>::default();
        for (joined, polynomial) in &ways {
            for (pairs, power) in [([(a, b), (c, d)], 1), ([(a, d), (b, c)], -1)] {
                let (next, circles) = smooth(&open, joined, pairs, &then);
                let mut part = (polynomial.0 + power, polynomial.1.clone());
                // the bracket is normalized by the last circle, which counts 1
                let counted = circles - usize::from(then.is_empty() && left.is_empty());
                for _ in 0..counted {
                    part = multiply_by_circle(&part);
                }
                added.entry(next).and_modify(|all| add(all, &part)).or_insert(part);
            }
        }
        (open, ways) = (then, added);
    }
    ways.into_values().next()
}

/// Joins two pairs of a crossing's edges to the open edges; also returns the number of circles that this closes.
fn smooth(open: &[u32], joined: &Joined, pairs: [(u32, u32); 2], then: &[u32]) -> (Joined, usize) {
    // paths by their ends: the existing ones, and two more
    let mut paths: [(u32, u32); MAX_OPEN] = [(0, 0); MAX_OPEN];
    let mut count = 0;
    for (slot, &edge) in open.iter().enumerate() {
        let other = usize::from(joined[slot]);
        if slot < other {
            paths[count] = (edge, open[other]);
            count += 1;
        }
    }
    let mut circles = 0;
    for (p, q) in pairs {
        if p == q {
            circles += 1;
            continue;
        }
        let mut ends = [p, q];
        for which in 0..2 {
            let end = ends[which];
            let Some(k) = (0..count).find(|&k| paths[k].0 == end || paths[k].1 == end) else { continue };
            ends[which] = if paths[k].0 == end { paths[k].1 } else { paths[k].0 };
            count -= 1;
            paths[k] = paths[count];
            if ends[0] == ends[1] {
                break;
            }
        }
        if ends[0] == ends[1] {
            circles += 1;
        } else {
            paths[count] = (ends[0], ends[1]);
            count += 1;
        }
    }
    let mut next = [0; MAX_OPEN];
    let slot = |edge: u32| then.iter().position(|&at| at == edge);
    for &(p, q) in &paths[..count] {
        if let (Some(p), Some(q)) = (slot(p), slot(q)) {
            next[p] = q as u8;
            next[q] = p as u8;
        }
    }
    (next, circles)
}

/// Multiplies by −A^2 − A^−2.
fn multiply_by_circle((low, coefficients): &Laurent) -> Laurent {
    let mut wider = vec![0_i64; coefficients.len() + 4];
    for (k, &x) in coefficients.iter().enumerate() {
        wider[k] = wider[k].wrapping_sub(x);
        wider[k + 4] = wider[k + 4].wrapping_sub(x);
    }
    (low - 2, wider)
}

fn add(all: &mut Laurent, part: &Laurent) {
    let low = all.0.min(part.0);
    let high = (all.0 + all.1.len() as i64).max(part.0 + part.1.len() as i64);
    if low < all.0 {
        all.1.splice(0..0, std::iter::repeat_n(0, (all.0 - low) as usize));
        all.0 = low;
    }
    all.1.resize((high - low) as usize, 0);
    for (k, &x) in part.1.iter().enumerate() {
        let at = &mut all.1[(part.0 - low) as usize + k];
        *at = at.wrapping_add(x);
    }
}
