//! How likely it is that a knot stays what it is when crossings may have been read the wrong way round.

use rustc_hash::FxHashMap;

use super::code::GaussCode;
use super::identity::{Identity, Kind};
use super::reidemeister::{reduced, twists};
use crate::parallel::go_on;

/// Of the crossings that may be wrong so many, the least sure, are tried both ways; the others count as right.
const TRIED: usize = 10;
/// Combinations less likely than this count as other knots.
const LEAST: f64 = 1e-8;

/// The probability that the diagram's knot is the one that it shows, given each crossing's probability to be right.
///
/// Crossings are independent. Those that only twist a strand do not matter; the others that are not tried must all be right:
/// the answer is then a lower bound.
pub fn order_probability(code: &GaussCode, right: &[f64]) -> f64 {
    let twists = twists(code);
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

/// Kinds of reduced diagrams, each worked out once.
#[derive(Default)]
struct Kinds(FxHashMap<GaussCode, Kind>);

impl Kinds {
    fn of(&mut self, code: &GaussCode) -> Kind {
        let found = self.0.entry(reduced(code)).or_insert_with_key(|code| Identity::of(code.clone()).kind);
        found.clone()
    }

    /// How likely the diagram, which is so likely itself, is a knot of a kind, with doubtful crossings either way.
    fn share(&mut self, code: &GaussCode, doubtful: &[(usize, f64)], chance: f64, kind: &Kind) -> f64 {
        go_on();
        if chance < LEAST {
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
