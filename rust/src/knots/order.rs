//! How likely it is that a knot stays what it is when crossings may have been read the wrong way round.

use super::code::GaussCode;
use super::identity::{Identity, Kind};
use super::reidemeister::reduced;
use crate::parallel::go_on;

/// Of the crossings that may be wrong so many, the least sure, are tried both ways; the others count as right.
const TRIED: usize = 10;

/// The probability that the diagram's knot is the one that it shows, given each crossing's probability to be right.
///
/// Crossings are independent. Those that are not tried must all be right: the answer is then a lower bound.
pub fn order_probability(code: &GaussCode, right: &[f64]) -> f64 {
    let mut doubtful: Vec<usize> = (0..right.len()).filter(|&k| right[k] < 1.0).collect();
    doubtful.sort_by(|&a, &b| right[a].total_cmp(&right[b]));
    let rest: f64 = doubtful.iter().skip(TRIED).map(|&k| right[k]).product();
    doubtful.truncate(TRIED);
    let shown = kind(code);
    let all: f64 = (0..1_usize << doubtful.len())
        .map(|wrong| {
            go_on();
            let is_wrong = |place: usize| wrong >> place & 1 == 1;
            let chance =
                |(place, &k): (usize, &usize)| if is_wrong(place) { 1.0 - right[k] } else { right[k] };
            let probability: f64 = doubtful.iter().enumerate().map(chance).product();
            let mut other = code.clone();
            for (_, &k) in doubtful.iter().enumerate().filter(|&(place, _)| is_wrong(place)) {
                other.switch(k);
            }
            if probability > 0.0 && kind(&other) == shown { probability } else { 0.0 }
        })
        .sum();
    all * rest
}

fn kind(code: &GaussCode) -> Kind {
    Identity::of(reduced(code)).kind
}
