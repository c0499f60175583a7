//! Which strand is on top at each crossing of an image.

use super::crossings::{Evidence, Overlap};
use super::stretches::{Stretch, are_many};
use crate::parallel;

const MAX_DOUBLE: usize = 24; // pairs of neighbouring crossings at most whose orders are flipped together
/// Work on the orders of all crossings together at most: samples times crossings of each solution.
const MAX_WORK: usize = 30_000_000;
const CLEAR: f64 = 20.0; // a crossing is not tried again if its two orders alone differ by more than this, cost

/// Decides which strand is on top at each overlap, and by what margin. All are decided together, because a strand's
/// depth at one crossing bounds its depth at the next.
pub fn decide_order(evidence: &Evidence, overlaps: &[Overlap]) -> Vec<(bool, f64)> {
    let many = are_many(evidence, overlaps);
    let cut =
        |of: Vec<usize>| Flip { near: many.then(|| Stretch::new(evidence, overlaps, &of)), of, more: None };
    let cost = |near: &Option<Stretch>, order: &[Option<bool>], rounds| match near {
        Some(near) => near.cost(order, rounds),
        None => evidence.solve(overlaps, order, rounds).1,
    };
    let mut singles: Vec<Flip> = (0..overlaps.len()).map(|k| cut(vec![k])).collect();
    let mut alone = vec![0.0; overlaps.len()];
    let mut order: Vec<Option<bool>> = vec![None; overlaps.len()];
    let mut start = order.clone();
    for k in 0..overlaps.len() {
        parallel::go_on();
        let costs = [true, false].map(|first| {
            order[k] = Some(first);
            cost(&singles[k].near, &order, 2)
        });
        order[k] = None;
        start[k] = Some(costs[0] <= costs[1]);
        alone[k] = (costs[0] - costs[1]).abs();
    }
    if overlaps.len() < 2 {
        return start.iter().zip(alone).map(|(first, margin)| (first == &Some(true), margin)).collect();
    }
    let mut order = start;
    let mut best = cost(&None, &order, 3);
    singles.retain(|flip| alone[flip.of[0]] < CLEAR);
    let doubles = find_neighbors(overlaps).into_iter().take(MAX_DOUBLE);
    let doubles = doubles.filter(|p| p.iter().all(|&k| alone[k] < CLEAR)).map(|p| p.to_vec());
    let mut flips: Vec<Flip> = singles.into_iter().chain(doubles.map(cut)).collect();
    let mut margins = alone;
    let mut work = 0;
    for _ in 0..2 * overlaps.len() {
        for flip in flips.iter_mut().filter(|flip| flip.more.is_none()) {
            parallel::go_on();
            let before = if many { cost(&flip.near, &order, 3) } else { best };
            let other = flip.turn(&order);
            let more = cost(&flip.near, &other, 3) - before;
            work += flip.near.as_ref().map_or(evidence.start.len() * overlaps.len(), Stretch::work);
            if let [k] = flip.of[..] {
                margins[k] = more;
            }
            flip.more = Some(more);
        }
        let mut gain: Option<(f64, usize)> = None;
        for (number, flip) in flips.iter().enumerate() {
            let more = flip.more.unwrap_or(0.0);
            if more < gain.map_or(-1e-9, |g| g.0) {
                gain = Some((more, number));
            }
        }
        let Some((more, number)) = gain else { break };
        order = flips[number].turn(&order);
        best += more;
        if work > MAX_WORK {
            break;
        }
        let turned = flips[number].of.clone();
        for flip in &mut flips {
            // far from what was turned, nothing changed
            if flip.near.as_ref().is_none_or(|near| turned.iter().any(|&k| near.holds(k))) {
                flip.more = None;
            }
        }
    }
    order.iter().zip(margins).map(|(first, margin)| (first == &Some(true), margin.max(0.0))).collect()
}

/// Overlaps whose orders are turned together.
struct Flip {
    of: Vec<usize>,
    /// The evidence near them, if not all is asked.
    near: Option<Stretch>,
    /// The extra cost, if it is known.
    more: Option<f64>,
}

impl Flip {
    fn turn(&self, order: &[Option<bool>]) -> Vec<Option<bool>> {
        let mut other = order.to_vec();
        for &k in &self.of {
            other[k] = other[k].map(|first| !first);
        }
        other
    }
}

/// Returns pairs of overlaps that follow each other along a rope.
fn find_neighbors(overlaps: &[Overlap]) -> Vec<[usize; 2]> {
    let mut visits: Vec<(usize, usize)> = Vec::new();
    for (k, overlap) in overlaps.iter().enumerate() {
        visits.extend(overlap.sides.iter().map(|side| (side[side.len() / 2], k)));
    }
    visits.sort_unstable();
    let mut pairs: Vec<[usize; 2]> = visits
        .windows(2)
        .filter(|w| w[0].1 != w[1].1)
        .map(|w| [w[0].1.min(w[1].1), w[0].1.max(w[1].1)])
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
