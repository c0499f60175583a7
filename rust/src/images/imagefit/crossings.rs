//! Crossings of strands in an image, and which strand is on top.

use super::places::{APART, HIDES, OnChain, Place2, STEP, TOUCHING};
use super::smoothing::{Gap, Profile};

const TOGETHER: usize = 5; // pairs nearer than this in both places along the rope belong to one crossing, samples
/// Crossings nearer than this along either strand are one, samples: what separates them is jitter.
const WINDING: usize = 4;
const STRETCH: usize = 8; // length of the pieces in which a long overlap is kept apart, samples
const MAX_DOUBLE: usize = 24; // pairs of neighbouring crossings at most whose orders are flipped together
/// Work on the orders of all crossings together at most: samples times crossings of each solution.
const MAX_WORK: usize = 100_000_000;
const CLEAR: f64 = 20.0; // a crossing is not tried again if its two orders alone differ by more than this, cost

/// A crossing of two strands in an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Crossing {
    /// Places where the strands lie over each other: first the strand that comes earlier, then the other.
    pub pairs: Vec<[OnChain; 2]>,
    /// Whether the first strand is nearer to the camera.
    pub first_on_top: bool,
    /// The extra cost of the opposite order.
    pub margin: f64,
}

impl Crossing {
    /// Returns the pairs with the upper strand first.
    pub fn ordered(&self) -> impl Iterator<Item = [OnChain; 2]> + '_ {
        self.pairs.iter().map(|&[a, b]| if self.first_on_top { [a, b] } else { [b, a] })
    }
}

/// Samples of two strands that hide each other.
#[derive(Debug, Clone)]
pub struct Overlap {
    /// Samples of the earlier strand, and of the other.
    pub sides: [Vec<usize>; 2],
    /// Pairs of them where the axes nearly cross, with their distance in the image, image radii.
    pub pairs: Vec<([usize; 2], f64)>,
}

/// Groups pairs of samples i < j, sorted and with their distance in the image, into overlaps.
///
/// Where strands wind around each other, each crossing is an overlap of its own.
pub fn find_overlaps(pairs: &[([usize; 2], f64)], places: &[Place2], chains: &[u32]) -> Vec<Overlap> {
    let mut group: Vec<usize> = (0..pairs.len()).collect();
    let root = |group: &mut Vec<usize>, mut i: usize| {
        while group[i] != i {
            group[i] = group[group[i]];
            i = group[i];
        }
        i
    };
    for a in 0..pairs.len() {
        let [i, j] = pairs[a].0;
        for b in a + 1..pairs.len() {
            let [k, l] = pairs[b].0;
            if k > i + TOGETHER {
                break;
            }
            if l.abs_diff(j) <= TOGETHER {
                let (x, y) = (root(&mut group, a), root(&mut group, b));
                group[x.max(y)] = x.min(y);
            }
        }
    }
    let roots: Vec<usize> = (0..pairs.len()).map(|a| root(&mut group, a)).collect();
    let mut firsts: Vec<usize> = roots.clone();
    firsts.sort_unstable();
    firsts.dedup();
    let mut found = Vec::new();
    for first in firsts {
        let members: Vec<([usize; 2], f64)> =
            pairs.iter().zip(&roots).filter(|&(_, &r)| r == first).map(|(p, _)| *p).collect();
        let mut centers: Vec<[usize; 2]> = Vec::new();
        for &(pair, _) in &members {
            if cross(pair, places, chains) && centers.iter().all(|&c| measure_between(c, pair) > WINDING) {
                centers.push(pair);
            }
        }
        if centers.len() < 2 {
            found.push(Overlap::of(members));
            continue;
        }
        let nearest = |pair| (0..centers.len()).min_by_key(|&c| measure_between(centers[c], pair));
        for c in 0..centers.len() {
            found.push(Overlap::of(members.iter().filter(|p| nearest(p.0) == Some(c)).copied().collect()));
        }
    }
    found
}

/// Returns the distance of pairs of samples along the rope, samples.
fn measure_between(a: [usize; 2], b: [usize; 2]) -> usize {
    a[0].abs_diff(b[0]).max(a[1].abs_diff(b[1]))
}

/// Returns whether the pieces of the two strands that begin at a pair of samples cross.
fn cross(pair: [usize; 2], places: &[Place2], chains: &[u32]) -> bool {
    if pair.iter().any(|&i| i + 1 >= places.len() || chains[i] != chains[i + 1]) {
        return false;
    }
    let [a, b] = pair.map(|i| [places[i], places[i + 1]]);
    let side = |s: [Place2; 2], p: Place2| {
        (s[1][0] - s[0][0]) * (p[1] - s[0][1]) - (s[1][1] - s[0][1]) * (p[0] - s[0][0])
    };
    side(a, b[0]) * side(a, b[1]) <= 0.0 && side(b, a[0]) * side(b, a[1]) < 0.0
}

impl Overlap {
    /// Makes an overlap of pairs of samples.
    fn of(members: Vec<([usize; 2], f64)>) -> Self {
        let side = |k: usize| {
            let mut side: Vec<usize> = members.iter().map(|p| p.0[k]).collect();
            side.sort_unstable();
            side.dedup();
            side
        };
        let least = members.iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
        let near = (least + 0.3).max(0.9);
        Self { sides: [side(0), side(1)], pairs: members.iter().filter(|p| p.1 < near).copied().collect() }
    }

    /// Adds the gaps that an order requires.
    fn gaps(&self, first_on_top: bool, into: &mut Vec<Gap>) {
        let start = into.len();
        let mut at = 0;
        while at < self.pairs.len() {
            let from = self.pairs[at].0[0];
            let end = at + self.pairs[at..].iter().take_while(|p| p.0[0] < from + STRETCH).count();
            let stretch = &self.pairs[at..end];
            let needs = stretch.iter().map(|p| (TOUCHING * TOUCHING - p.1 * p.1).max(0.0).sqrt());
            into.push(Gap {
                pairs: stretch.iter().map(|p| if first_on_top { p.0 } else { [p.0[1], p.0[0]] }).collect(),
                need: needs.sum::<f64>() / stretch.len() as f64,
                share: 1.0,
            });
            at = end;
        }
        let share = 1.0 / (into.len() - start) as f64;
        for gap in &mut into[start..] {
            gap.share = share;
        }
    }
}

/// Evidence about the samples' depths, before any order is known.
pub struct Evidence<'a> {
    pub profile: &'a Profile,
    /// Weights of the depths, 0 where strands hide each other.
    pub clear: &'a [f64],
    /// Weights where it is known which strand a depth belongs to.
    pub owned: &'a [f64],
    pub sigma: f64,
    /// Depths without any order, with which the search begins.
    pub start: &'a [f64],
}

impl Evidence<'_> {
    /// Returns depths and cost for an order of the overlaps; an overlap without an order has neither depth nor gap.
    pub fn solve(&self, overlaps: &[Overlap], order: &[Option<bool>], rounds: usize) -> (Vec<f64>, f64) {
        let mut weights = self.clear.to_vec();
        let mut gaps = Vec::new();
        let decided = || overlaps.iter().zip(order).filter_map(|(o, &first)| Some((o, first?)));
        for (overlap, first) in decided() {
            for &i in &overlap.sides[usize::from(!first)] {
                weights[i] = self.owned[i];
            }
            overlap.gaps(first, &mut gaps);
        }
        for (overlap, first) in decided() {
            for &i in &overlap.sides[usize::from(first)] {
                weights[i] = 0.0;
            }
        }
        self.profile.solve(&weights, self.sigma, &gaps, self.start, rounds)
    }

    /// Decides which strand is on top at each overlap, and by what margin. All are decided together, because a strand's
    /// depth at one crossing bounds its depth at the next.
    pub fn decide(&self, overlaps: &[Overlap]) -> Vec<(bool, f64)> {
        let cost = |order: &[Option<bool>], rounds| self.solve(overlaps, order, rounds).1;
        let mut alone = vec![0.0; overlaps.len()];
        let mut order: Vec<Option<bool>> = vec![None; overlaps.len()];
        let mut start = order.clone();
        for k in 0..overlaps.len() {
            let costs = [true, false].map(|first| {
                order[k] = Some(first);
                cost(&order, 2)
            });
            order[k] = None;
            start[k] = Some(costs[0] <= costs[1]);
            alone[k] = (costs[0] - costs[1]).abs();
        }
        if overlaps.len() < 2 {
            return start.iter().zip(alone).map(|(first, margin)| (first == &Some(true), margin)).collect();
        }
        let mut order = start;
        let mut best = cost(&order, 3);
        let mut margins = alone.clone();
        let each = self.start.len() * overlaps.len();
        let mut work = 0;
        for _ in 0..2 * overlaps.len() {
            if work > MAX_WORK {
                break;
            }
            let singles = (0..overlaps.len()).filter(|&k| alone[k] < CLEAR).map(|k| vec![k]);
            let doubles = find_neighbors(overlaps).into_iter().take(MAX_DOUBLE);
            let doubles = doubles.filter(|p| p.iter().all(|&k| alone[k] < CLEAR)).map(|p| p.to_vec());
            let mut gain: Option<(f64, Vec<usize>)> = None;
            for flips in singles.chain(doubles) {
                let mut other = order.clone();
                for &k in &flips {
                    other[k] = other[k].map(|first| !first);
                }
                let more = cost(&other, 3) - best;
                work += each;
                if let [k] = flips[..] {
                    margins[k] = more;
                }
                if more < gain.as_ref().map_or(-1e-9, |g| g.0) {
                    gain = Some((more, flips));
                }
            }
            let Some((more, flips)) = gain else { break };
            for k in flips {
                order[k] = order[k].map(|first| !first);
            }
            best += more;
        }
        order.iter().zip(margins).map(|(first, margin)| (first == &Some(true), margin.max(0.0))).collect()
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

/// Returns whether two samples are different places of the ropes.
#[inline]
pub fn apart(chain: [u32; 2], index: [usize; 2]) -> bool {
    chain[0] != chain[1] || index[0].abs_diff(index[1]) as f64 * STEP > APART
}

/// Returns pairs of samples that hide each other in an image, sorted, with their distance, image radii.
pub fn find_hiding(
    places: &[Place2],
    chains: &[u32],
    grid: &super::grid::Grid,
    radius_px: f64,
) -> Vec<([usize; 2], f64)> {
    let mut found = Vec::new();
    grid.pairs(places, HIDES * radius_px, |i, j, d| {
        if apart([chains[i], chains[j]], [i, j]) {
            found.push(([i, j], d.sqrt() / radius_px));
        }
    });
    found.sort_unstable_by_key(|pair| pair.0);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_of_one_crossing_are_together() {
        let pair = |i: usize, j: usize| ([i, j], 0.5);
        let pairs = [pair(10, 50), pair(11, 51), pair(14, 53), pair(30, 80), pair(31, 79)];
        let places: Vec<Place2> = (0..100).map(|i| [i as f64, 0.0]).collect();
        let found = find_overlaps(&pairs, &places, &[0; 100]);
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].sides, [vec![10, 11, 14], vec![50, 51, 53]]);
        assert_eq!(find_neighbors(&found), [[0, 1]]);
    }
}
