//! The probability that a knot is right although some crossings may be.

use rustc_hash::FxHashMap;

use super::code::GaussCode;
use super::identity::{Identity, Kind};
use super::reidemeister::{find_twists, reduced};
use crate::parallel::go_on;

/// Uncertain crossings that are tried both ways, the least certain first; the others must be right.
const TRIED: usize = 10;
const MIN_CHANCE: f64 = 1e-8; // combinations less likely than this count as other knots, probability

/// Returns the probability that a diagram shows the right knot, given each crossing's probability to be right.
///
/// Crossings are independent. Crossings that only twist a strand do not matter. Other crossings that are not tried must
/// all be right, which makes the answer a lower bound.
pub fn find_order_probability(code: &GaussCode, right: &[f64]) -> f64 {
    let twists = find_twists(code);
    let mut doubtful: Vec<(usize, f64)> = (right.iter().copied().enumerate())
        .filter(|&(crossing, right)| right < 1.0 && !twists[crossing])
        .collect();
    doubtful.sort_by(|a, b| a.1.total_cmp(&b.1));
    let rest: f64 = doubtful.iter().skip(TRIED).map(|&(_, right)| right).product();
    doubtful.truncate(TRIED);
    let mut kinds = Kinds::default();
    let shown = kinds.of(code);
    kinds.share(code, &doubtful, 1.0, &shown) * rest
}

/// Kinds of reduced diagrams, each found once.
#[derive(Default)]
struct Kinds(FxHashMap<GaussCode, Kind>);

impl Kinds {
    fn of(&mut self, code: &GaussCode) -> Kind {
        let found = self.0.entry(reduced(code)).or_insert_with_key(|code| Identity::of(code.clone()).kind);
        found.clone()
    }

    /// Returns the probability of a knot's kind, with doubtful crossings either way; `chance` is that of the diagram
    /// itself.
    fn share(&mut self, code: &GaussCode, doubtful: &[(usize, f64)], chance: f64, kind: &Kind) -> f64 {
        go_on();
        if chance < MIN_CHANCE {
            return 0.0;
        }
        let Some((&(crossing, right), others)) = doubtful.split_first() else {
            return if self.of(code) == *kind { chance } else { 0.0 };
        };
        let mut switched = code.clone();
        switched.switch(crossing);
        self.share(code, others, chance * right, kind)
            + self.share(&switched, others, chance * (1.0 - right), kind)
    }
}
