//! Stretches of chains around crossings: where there are many crossings, each is decided by the depths near it.

use std::ops::Range;

use super::crossings::{Evidence, Overlap};
use super::smoothing::Profile;

/// Samples before and after a crossing whose depths bear on it, at most.
const MAX_REACH: usize = 60;
/// Samples times crossings: with fewer, each is decided by all depths.
const MAX_WHOLE: usize = 4_000;

/// The evidence near some overlaps.
pub struct Stretch {
    ranges: Vec<Range<usize>>,
    profile: Profile,
    clear: Vec<f64>,
    owned: Vec<f64>,
    start: Vec<f64>,
    sigma: f64,
    /// The overlaps that lie inside, and their numbers among all.
    overlaps: Vec<Overlap>,
    numbers: Vec<usize>,
}

/// Returns whether overlaps are so many that each is decided by the depths near it.
pub fn are_many(evidence: &Evidence, overlaps: &[Overlap]) -> bool {
    evidence.start.len() * overlaps.len() > MAX_WHOLE
}

impl Stretch {
    /// Cuts the evidence near some of the overlaps.
    pub fn new(evidence: &Evidence, overlaps: &[Overlap], chosen: &[usize]) -> Self {
        let reach = evidence.profile.measure_reach(evidence.sigma).min(MAX_REACH);
        let mut ranges: Vec<Range<usize>> = Vec::new();
        for side in chosen.iter().flat_map(|&k| &overlaps[k].sides) {
            let (first, last) = (side[0], side[side.len() - 1]);
            for chain in evidence.profile.chains.iter().filter(|c| c.start <= last && c.end > first) {
                let begin = first.saturating_sub(reach).max(chain.start);
                ranges.push(begin..(last + reach + 1).min(chain.end));
            }
        }
        ranges.sort_unstable_by_key(|range| range.start);
        let chain_of = |i: usize| evidence.profile.chains.partition_point(|chain| chain.end <= i);
        ranges.dedup_by(|next, before| {
            let touches = next.start <= before.end && chain_of(next.start) == chain_of(before.start);
            before.end = if touches { before.end.max(next.end) } else { before.end };
            touches
        });
        let cut = |values: &[f64]| ranges.iter().flat_map(|r| &values[r.clone()]).copied().collect();
        let mut made = Self {
            profile: evidence.profile.cut(&ranges),
            clear: cut(evidence.clear),
            owned: cut(evidence.owned),
            start: cut(evidence.start),
            sigma: evidence.sigma,
            overlaps: Vec::new(),
            numbers: Vec::new(),
            ranges,
        };
        let inside = (0..overlaps.len()).filter_map(|k| Some((k, made.move_in(&overlaps[k])?)));
        (made.numbers, made.overlaps) = inside.unzip();
        made
    }

    /// Returns an overlap with the samples' numbers in the stretch; None if it does not lie inside.
    fn move_in(&self, overlap: &Overlap) -> Option<Overlap> {
        let place = |i: usize| {
            let number = self.ranges.partition_point(|range| range.end <= i);
            let range = self.ranges.get(number).filter(|range| range.start <= i)?;
            let before: usize = self.ranges[..number].iter().map(Range::len).sum();
            Some(before + i - range.start)
        };
        let side = |k: usize| overlap.sides[k].iter().map(|&i| place(i)).collect::<Option<Vec<_>>>();
        let pairs = overlap.pairs.iter().map(|&([i, j], away)| Some(([place(i)?, place(j)?], away)));
        Some(Overlap { sides: [side(0)?, side(1)?], pairs: pairs.collect::<Option<Vec<_>>>()? })
    }

    /// Returns how much work its cost is: its samples times its overlaps.
    pub fn work(&self) -> usize {
        self.start.len() * self.overlaps.len()
    }

    /// Returns whether an overlap lies inside.
    pub fn holds(&self, overlap: usize) -> bool {
        self.numbers.contains(&overlap)
    }

    /// Returns the cost of an order of all overlaps, by the depths inside.
    pub fn cost(&self, order: &[Option<bool>], rounds: usize) -> f64 {
        let order: Vec<Option<bool>> = self.numbers.iter().map(|&k| order[k]).collect();
        let evidence = Evidence {
            profile: &self.profile,
            clear: &self.clear,
            owned: &self.owned,
            sigma: self.sigma,
            start: &self.start,
        };
        evidence.solve(&self.overlaps, &order, rounds).1
    }
}
