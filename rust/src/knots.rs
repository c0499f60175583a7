//! Knots: which knot a chain is tied in, where, and how certain that is.
//!
//! - `projection` makes a diagram of a polyline, and `code` its Gauss, planar and Dowker–Thistlethwaite codes.
//! - `thinning` removes nodes and `reidemeister` removes crossings that the knot does not need.
//! - `alexander` and `jones` are the polynomials by which `table` names the knot.
//! - `closure` closes an open chain in many directions.
//! - `knotted_core` finds where the knot lies, from the diagrams of `stretches`.

mod alexander;
mod closure;
mod code;
mod identity;
mod jones;
mod knotted_core;
mod linking;
mod order;
mod projection;
mod reidemeister;
mod stretches;
mod table;
#[cfg(test)]
mod tests;
mod thinning;

use crate::checks::{check_finite, check_unit};
use crate::error::{Error, Result};
use crate::geometry::boxes::Bounds;
use crate::geometry::polyline::arc_length;
use crate::geometry::{Point, normalized, sub};
use closure::{Answer, find_closures};
pub(crate) use code::{GaussCode, Visit};
use identity::{Identity, Kind, Known};
pub(crate) use jones::Laurent;
use knotted_core::find_knotted_core;
use projection::{Diagram, Lid, NoDiagram};
pub(crate) use table::Chirality;
use table::TABLE;

const CLOSURES: usize = 50; // directions in which an open chain is closed
const MAX_PAIRS: usize = 100_000_000; // pairs of segments of a linking integral at most
/// First turn of a direction of view in which a strand lies over a node, radians; each further turn is four times
/// larger.
const TURN: f64 = 1e-9;
const TURNS: i32 = 10; // number of these turns; the last is about 0.2 mrad
const NEAR_ENDS: f64 = 1e-12; // ends nearer than this count as one place, extents of the chain

/// A knot by name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Named {
    /// None if the table does not have it.
    pub name: Option<&'static str>,
    pub chirality: Chirality,
    /// The share of closures that give this knot.
    pub share: f64,
}

/// The knot of a chain.
#[derive(Debug)]
pub(crate) struct Knot {
    /// The knots that the closures give, the most frequent first; never empty.
    pub answers: Vec<Named>,
    /// The first and last node of the shortest stretch that still has this knot.
    pub core: Option<[usize; 2]>,
    /// A knot that has the same polynomials as the first answer.
    pub twin: Option<&'static str>,
    /// Coefficients of the Alexander polynomial, a palindrome with the sum 1; None if the diagram has too many
    /// crossings.
    pub alexander: Option<Vec<i64>>,
    pub jones: Option<Laurent>,
    /// The diagram with the fewest crossings found for the first answer.
    pub code: GaussCode,
}

/// Identifies the knot of a chain of ordered nodes.
pub(crate) fn identify(points: &[Point], closed: bool) -> Result<Knot> {
    let nodes = check_nodes("points", points, closed)?;
    let mut known = Known::default();
    if closed || is_joined(&nodes) {
        let ring = if closed { &nodes[..] } else { &nodes[..nodes.len() - 1] };
        let identity = match known.identity(ring) {
            Err(NoDiagram::Meets) => return Err(meets_itself()),
            Err(_) => Identity::unknown(),
            Ok(found) => found.clone(),
        };
        return Ok(make_knot(vec![Answer { count: 1, identity }], None));
    }
    let answers = find_closures(&nodes, CLOSURES, &mut known).map_err(|_| meets_itself())?;
    let core = match answers[0].identity.kind {
        Kind::Known(1.., _) if 2 * answers[0].count > CLOSURES => {
            Some(find_knotted_core(&nodes, &answers[0].identity.code, CLOSURES))
        }
        _ => None,
    };
    Ok(make_knot(answers, core))
}

/// Returns the diagram of a chain seen from the unit vector `direction`. An arc above an open chain closes it.
pub(crate) fn draw(points: &[Point], closed: bool, direction: Point) -> Result<GaussCode> {
    Ok(diagram_from(points, closed, direction)?.0.code)
}

/// Returns the probability that the knot is right although some crossings, seen from the unit vector `direction`, may
/// have the wrong order.
///
/// Each row holds the arc lengths of two strands that cross, metres, and the probability that the nodes give their
/// order right. Without `strict`, rows beyond the visible crossings must all be right, and so must all rows if there is
/// no diagram.
pub(crate) fn find_order_probability(
    points: &[Point],
    closed: bool,
    direction: Point,
    crossings: &[Point],
    strict: bool,
) -> Result<f64> {
    let (diagram, arc) = match diagram_from(points, closed, direction) {
        Err(_) if !strict => return Ok(crossings.iter().map(|row| row[2]).product()),
        found => found?,
    };
    let count = diagram.code.crossings();
    let length = arc[arc.len() - 1];
    if let Some(row) = crossings.iter().find(|row| {
        let along = |s: f64| (-1e-9 * length..=length * (1.0 + 1e-9)).contains(&s);
        !(along(row[0]) && along(row[1]) && (0.0..=1.0).contains(&row[2]))
    }) {
        let wanted = format!("expected two arc lengths from 0 to {length} and a probability, got {row:?}");
        return Err(Error::invalid("crossings", wanted));
    }
    let place = |visit: usize| {
        let (segment, part) = diagram.at[visit];
        // the lid has no length
        arc.get(segment + 1).map(|stop| arc[segment] + part * (stop - arc[segment]))
    };
    let seen: Vec<[f64; 2]> = (diagram.code.places().iter())
        .map(|&[over, under]| [over, under].map(|visit| place(visit).unwrap_or(f64::INFINITY)))
        .collect();
    let own = seen.iter().filter(|places| places.iter().all(|s| s.is_finite())).count();
    if strict && crossings.len() > own {
        let found = format!("expected at most the {own} crossings seen from there, got {}", crossings.len());
        return Err(Error::invalid("crossings", found));
    }
    let (mut right, mut rest) = (vec![1.0; count], 1.0);
    let mut taken: Vec<bool> = seen.iter().map(|places| places.iter().any(|s| s.is_infinite())).collect();
    for &[s, t, probability] in crossings {
        let apart = |k: usize| {
            let [a, b] = seen[k];
            f64::min((a - s).abs() + (b - t).abs(), (a - t).abs() + (b - s).abs())
        };
        let nearest = (0..count).filter(|&k| !taken[k]).min_by(|&a, &b| apart(a).total_cmp(&apart(b)));
        match nearest {
            Some(k) => {
                taken[k] = true;
                right[k] = probability;
            }
            None => rest *= probability,
        }
    }
    Ok(order::find_order_probability(&diagram.code, &right) * rest)
}

/// Returns how often two chains wind around each other: a whole number if both are closed.
pub(crate) fn find_linking_number(a: &[Point], b: &[Point], closed: [bool; 2]) -> Result<f64> {
    check_nodes("a", a, closed[0])?;
    check_nodes("b", b, closed[1])?;
    if a.len().saturating_mul(b.len()) > MAX_PAIRS {
        let got = format!("expected at most {MAX_PAIRS} pairs of nodes, got {} times {}", a.len(), b.len());
        return Err(Error::invalid("b", got));
    }
    let all: Vec<Point> = a.iter().chain(b).copied().collect();
    let all = scaled(&all);
    let (a, b) = all.split_at(a.len());
    let integral =
        linking::compute_linking_integral(&list_segments(a, closed[0]), &list_segments(b, closed[1]));
    Ok(if closed == [true; 2] { integral.round() } else { integral })
}

/// Returns the diagram of a chain and the arc lengths of its nodes, metres; for a closed chain also the total length.
fn diagram_from(points: &[Point], closed: bool, direction: Point) -> Result<(Diagram, Vec<f64>)> {
    check_unit("direction", direction)?;
    let nodes = check_nodes("points", points, closed)?;
    let mut path = points.to_vec();
    if closed {
        path.push(points[0]);
    }
    let lid = if closed || is_joined(&nodes) { Lid::Segment } else { Lid::Above };
    let ring = if !closed && lid == Lid::Segment { &nodes[..nodes.len() - 1] } else { &nodes[..] };
    let mut towards = direction;
    for attempt in 0..TURNS {
        match projection::draw_diagram(ring, lid, normalized(towards)) {
            Ok(diagram) => return Ok((diagram, arc_length(&path))),
            Err(NoDiagram::Meets) => {
                return Err(meets_itself());
            }
            Err(NoDiagram::TooManyCrossings) => {
                let most = projection::MAX_CROSSINGS;
                return Err(Error::invalid("points", format!("expected at most {most} crossings")));
            }
            Err(NoDiagram::Unlucky) => {
                let turn = TURN * f64::powi(4.0, attempt);
                towards =
                    [direction[0] + 0.83 * turn, direction[1] - 0.47 * turn, direction[2] + 0.29 * turn];
            }
        }
    }
    Err(Error::invalid("direction", "expected one from which strands do not lie along each other"))
}

fn meets_itself() -> Error {
    Error::not_enough("points", "the curve meets itself, and neither strand is on top there")
}

/// Checks that nodes form a polyline; returns them around the origin in a box of about unit size.
fn check_nodes(name: &'static str, points: &[Point], closed: bool) -> Result<Vec<Point>> {
    check_finite(name, points)?;
    let (least, wanted) = if closed { (3, "three nodes of a closed chain") } else { (2, "two nodes") };
    if points.len() < least {
        return Err(Error::invalid(name, format!("expected at least {wanted}, got {}", points.len())));
    }
    if let Some(row) = points.windows(2).position(|pair| pair[0] == pair[1]) {
        let rows = format!("expected no two equal nodes in a row, but rows {row} and {} are", row + 1);
        return Err(Error::invalid(name, rows));
    }
    if closed && points[0] == points[points.len() - 1] {
        let reason = "expected a closed chain without its first node again at the end";
        return Err(Error::invalid(name, reason));
    }
    Ok(scaled(points))
}

/// Moves points to the origin, and scales them by a power of two to a size near 1.
fn scaled(points: &[Point]) -> Vec<Point> {
    let moved: Vec<Point> = points.iter().map(|&p| sub(p, points[0])).collect();
    let factor = f64::powi(2.0, -(Bounds::about(&moved).extent().log2().floor() as i32));
    moved.into_iter().map(|p| p.map(|x| x * factor)).collect()
}

/// Returns whether an open chain ends where it begins.
fn is_joined(nodes: &[Point]) -> bool {
    let apart = sub(nodes[nodes.len() - 1], nodes[0]);
    nodes.len() > 3 && apart.iter().all(|x| x.abs() <= NEAR_ENDS)
}

fn list_segments(nodes: &[Point], closed: bool) -> Vec<[Point; 2]> {
    let last = closed.then(|| [nodes[nodes.len() - 1], nodes[0]]);
    nodes.windows(2).map(|pair| [pair[0], pair[1]]).chain(last).collect()
}

fn make_knot(answers: Vec<Answer>, core: Option<[usize; 2]>) -> Knot {
    let total: usize = answers.iter().map(|answer| answer.count).sum();
    let named = |answer: &Answer| {
        let (name, chirality) = match answer.identity.kind {
            Kind::Known(k, chirality) => (Some(TABLE[k].name), chirality),
            Kind::Unknown(_) => (None, Chirality::None),
        };
        Named { name, chirality, share: answer.count as f64 / total as f64 }
    };
    let Identity { kind, code, alexander, jones } = &answers[0].identity;
    let twin = match kind {
        Kind::Known(k, _) => TABLE[*k].twin.as_ref(),
        Kind::Unknown(_) => None,
    };
    Knot {
        core,
        twin: twin.filter(|twin| code.crossings() >= twin.crossings).map(|twin| twin.name),
        alexander: alexander.clone(),
        jones: jones.clone().or_else(|| alexander.as_ref().and_then(|_| jones::compute_jones(code))),
        code: code.clone(),
        answers: answers.iter().map(named).collect(),
    }
}
