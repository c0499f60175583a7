//! Crossings of strands in an image, and which strand is on top.

use super::places::{APART, HIDES, OnChain, Place2, STEP, TOUCHING};
use super::smoothing::{Gap, Profile};

const TOGETHER: usize = 5; // pairs nearer than this in both places along the rope belong to one crossing, samples
/// Crossings nearer than this along either strand are one, samples: what separates them is jitter.
const WINDING: usize = 4;
const STRETCH: usize = 8; // length of the pieces in which a long overlap is kept apart, samples

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
}

/// Returns whether two samples are different places of the ropes.
#[inline]
pub fn apart(chain: [u32; 2], index: [usize; 2]) -> bool {
    chain[0] != chain[1] || index[0].abs_diff(index[1]) as f64 * STEP > APART
}

/// Returns pairs of samples that hide each other in an image, sorted, with their distance, image radii.
pub fn find_hiding(chains: &[u32], grid: &super::grid::Grid, radius_px: f64) -> Vec<([usize; 2], f64)> {
    let mut found = Vec::new();
    grid.pairs(HIDES * radius_px, |i, j, d| {
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
    }
}
