//! Bindings of knots: names, diagrams, linking numbers.

use pyo3::prelude::*;

use super::arguments::{Points, point};
use super::released::released;
use crate::knots::{self, Chirality, GaussCode, Laurent};

/// The codes of a diagram: signed Gauss, signs of the crossings, planar diagram, Dowker-Thistlethwaite.
type Codes = (Vec<i64>, Vec<i8>, Vec<[u32; 4]>, Vec<i64>);
/// A knot that closures give: name, chirality, share of closures.
type Answer = (Option<&'static str>, Option<&'static str>, f64);
type Knot = (Vec<Answer>, Option<[usize; 2]>, Option<&'static str>, Option<Vec<i64>>, Option<Laurent>, Codes);

/// Identify the knot of ordered nodes; see `strand.knot`.
#[pyfunction]
pub(super) fn identify_knot(py: Python<'_>, points: &Bound<'_, PyAny>, closed: bool) -> PyResult<Knot> {
    let points = Points::new("points", points, "(N, 3)")?;
    let found = released(py, move || knots::identify(&points, closed))??;
    let answers = found.answers.iter().map(|answer| (answer.name, chirality(answer.chirality), answer.share));
    Ok((answers.collect(), found.core, found.twin, found.alexander, found.jones, codes(&found.code)))
}

/// Return the codes of the diagram of ordered nodes seen from a unit vector; see `strand.knot_diagram`.
#[pyfunction]
pub(super) fn draw_knot(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    closed: bool,
    direction: &Bound<'_, PyAny>,
) -> PyResult<Codes> {
    let points = Points::new("points", points, "(N, 3)")?;
    let direction = point("direction", direction)?;
    Ok(codes(&released(py, move || knots::draw(&points, closed, direction))??))
}

/// Return the probability that a knot is right although crossings may have the wrong order; see `strand.knot`.
///
/// Each of `crossings` holds two arc lengths, metres, and a probability; with `strict`, there may be at most as many as
/// visible crossings.
#[pyfunction]
pub(super) fn find_order_probability(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    closed: bool,
    direction: &Bound<'_, PyAny>,
    crossings: &Bound<'_, PyAny>,
    strict: bool,
) -> PyResult<f64> {
    let points = Points::new("points", points, "(N, 3)")?;
    let crossings = Points::new("crossings", crossings, "(K, 3)")?;
    let direction = point("direction", direction)?;
    Ok(released(py, move || knots::find_order_probability(&points, closed, direction, &crossings, strict))??)
}

/// Return how often two chains wind around each other; see `strand.linking_number`.
#[pyfunction]
pub(super) fn find_linking_number(
    py: Python<'_>,
    a: &Bound<'_, PyAny>,
    b: &Bound<'_, PyAny>,
    closed: [bool; 2],
) -> PyResult<f64> {
    let (a, b) = (Points::new("a", a, "(N, 3)")?, Points::new("b", b, "(M, 3)")?);
    Ok(released(py, move || knots::find_linking_number(&a, &b, closed))??)
}

fn chirality(chirality: Chirality) -> Option<&'static str> {
    match chirality {
        Chirality::Right => Some("right"),
        Chirality::Left => Some("left"),
        Chirality::None => None,
    }
}

/// Returns the codes of a diagram, with crossings and edges counted from 1.
fn codes(code: &GaussCode) -> Codes {
    let signed = |visit: &knots::Visit| {
        let number = i64::from(visit.crossing) + 1;
        if visit.over { number } else { -number }
    };
    let planar = code.planar_diagram().into_iter().map(|edges| edges.map(|edge| edge + 1)).collect();
    (code.visits.iter().map(signed).collect(), code.signs.clone(), planar, code.dowker_thistlethwaite())
}
