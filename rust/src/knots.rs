//! Knots: what is tied in a chain, where, and how sure that is.
//!
//! `projection` makes a diagram of a polyline, `code` its Gauss, planar and Dowker-Thistlethwaite codes. `thinning` takes nodes and
//! `reidemeister` crossings away that no knot needs. `alexander` and `jones` are polynomials of what is left, by which `table`
//! names it. An open chain is closed in many directions by `closure`; `knotted_core` is where its knot lies, sought by the
//! diagrams of `stretches`.

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
use closure::{Answer, closures};
pub(crate) use code::{GaussCode, Visit};
use identity::{Identity, Kind, Known};
pub(crate) use jones::Laurent;
use knotted_core::knotted_core;
use projection::{Diagram, Lid, NoDiagram};
pub(crate) use table::Chirality;
use table::TABLE;

/// Directions in which an open chain is closed.
const CLOSURES: usize = 50;
/// Most pairs of segments of a linking integral.
const MOST_PAIRS: usize = 100_000_000;
/// A direction of view is turned by so much where a strand lies over a node, radians, and then by four times more each time.
const TURN: f64 = 1e-9;
/// The last of these turns is by about 0.2 mrad.
const TURNS: i32 = 10;
/// Ends nearer than this, of the extent, are one place.
const NEAR_ENDS: f64 = 1e-12;

/// A knot by name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Named {
    /// None outside of the table.
    pub name: Option<&'static str>,
    pub chirality: Chirality,
    /// The share of closures that say so.
    pub share: f64,
}

/// What is tied in a chain.
#[derive(Debug)]
pub(crate) struct Knot {
    /// What closures say, the most frequent first; never empty.
    pub answers: Vec<Named>,
    /// The first and last node of the shortest stretch that still is this knot.
    pub core: Option<[usize; 2]>,
    /// A knot that the polynomials cannot tell from the first answer.
    pub twin: Option<&'static str>,
    /// Coefficients, a palindrome with the sum 1; none for a diagram with too many crossings.
    pub alexander: Option<Vec<i64>>,
    pub jones: Option<Laurent>,
    /// The diagram with the fewest crossings that was found of the first answer.
    pub code: GaussCode,
}

/// What is tied in a chain of ordered nodes.
///
/// # Errors
/// `InvalidArgument` for nodes that are no polyline, or one that meets itself.
pub(crate) fn knot(points: &[Point], closed: bool) -> Result<Knot> {
    let nodes = checked("points", points, closed)?;
    let mut known = Known::default();
    if closed || is_joined(&nodes) {
        let ring = if closed { &nodes[..] } else { &nodes[..nodes.len() - 1] };
        let identity = match known.identity(ring) {
            Err(NoDiagram::Meets) => return Err(meets_itself()),
            Err(_) => Identity::unknown(),
            Ok(found) => found.clone(),
        };
        return Ok(told(vec![Answer { count: 1, identity }], None));
    }
    let answers = closures(&nodes, CLOSURES, &mut known).map_err(|_| meets_itself())?;
    let core = match answers[0].identity.kind {
        Kind::Known(1.., _) if 2 * answers[0].count > CLOSURES => {
            Some(knotted_core(&nodes, &answers[0].identity.code, CLOSURES))
        }
        _ => None,
    };
    Ok(told(answers, core))
}

/// The diagram of a chain seen from the unit vector `direction`, as it is. An open chain is closed by an arc above it.
///
/// # Errors
/// `InvalidArgument` as of [`knot`], for a direction of another length, or for too many crossings.
pub(crate) fn seen(points: &[Point], closed: bool, direction: Point) -> Result<GaussCode> {
    Ok(diagram_from(points, closed, direction)?.0.code)
}

/// The probability that errors in the order of crossings, as seen from the unit vector `direction`, leave the knot what it is.
///
/// Each row has the arc lengths of two strands that cross, metres, and the probability that the nodes have their order right.
/// If not `strict`, rows beyond the crossings that are seen must be right, and all if there is no diagram from there.
///
/// # Errors
/// `InvalidArgument` for rows that are not arc lengths and a probability; if `strict`, as of [`seen`] and for more rows than
/// crossings.
pub(crate) fn order_probability(
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
    Ok(order::order_probability(&diagram.code, &right) * rest)
}

/// How often two chains wind round each other: a whole number if both are closed.
///
/// # Errors
/// `InvalidArgument` for nodes that are no polyline, or more than 1e8 pairs of segments.
pub(crate) fn linking_number(a: &[Point], b: &[Point], closed: [bool; 2]) -> Result<f64> {
    checked("a", a, closed[0])?;
    checked("b", b, closed[1])?;
    if a.len().saturating_mul(b.len()) > MOST_PAIRS {
        let got = format!("expected at most {MOST_PAIRS} pairs of nodes, got {} times {}", a.len(), b.len());
        return Err(Error::invalid("b", got));
    }
    let all: Vec<Point> = a.iter().chain(b).copied().collect();
    let all = scaled(&all);
    let (a, b) = all.split_at(a.len());
    let integral = linking::linking_integral(&segments(a, closed[0]), &segments(b, closed[1]));
    Ok(if closed == [true; 2] { integral.round() } else { integral })
}

/// A diagram of a chain, and arc lengths at its nodes, metres; of a closed one also once around.
fn diagram_from(points: &[Point], closed: bool, direction: Point) -> Result<(Diagram, Vec<f64>)> {
    check_unit("direction", direction)?;
    let nodes = checked("points", points, closed)?;
    let mut path = points.to_vec();
    if closed {
        path.push(points[0]);
    }
    let lid = if closed || is_joined(&nodes) { Lid::Segment } else { Lid::Above };
    let ring = if !closed && lid == Lid::Segment { &nodes[..nodes.len() - 1] } else { &nodes[..] };
    let mut towards = direction;
    for attempt in 0..TURNS {
        match projection::diagram(ring, lid, normalized(towards)) {
            Ok(diagram) => return Ok((diagram, arc_length(&path))),
            Err(NoDiagram::Meets) => {
                return Err(meets_itself());
            }
            Err(NoDiagram::TooManyCrossings) => {
                let most = projection::MOST_CROSSINGS;
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
    Error::invalid("points", "expected a curve that does not meet itself")
}

/// The nodes about the origin in a box of about unit size, if they are a polyline.
fn checked(name: &'static str, points: &[Point], closed: bool) -> Result<Vec<Point>> {
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

/// Moved to the origin, and to a size near 1 by a power of two.
fn scaled(points: &[Point]) -> Vec<Point> {
    let moved: Vec<Point> = points.iter().map(|&p| sub(p, points[0])).collect();
    let factor = f64::powi(2.0, -(Bounds::about(&moved).extent().log2().floor() as i32));
    moved.into_iter().map(|p| p.map(|x| x * factor)).collect()
}

/// Whether an open chain ends where it begins.
fn is_joined(nodes: &[Point]) -> bool {
    let apart = sub(nodes[nodes.len() - 1], nodes[0]);
    nodes.len() > 3 && apart.iter().all(|x| x.abs() <= NEAR_ENDS)
}

fn segments(nodes: &[Point], closed: bool) -> Vec<[Point; 2]> {
    let last = closed.then(|| [nodes[nodes.len() - 1], nodes[0]]);
    nodes.windows(2).map(|pair| [pair[0], pair[1]]).chain(last).collect()
}

fn told(answers: Vec<Answer>, core: Option<[usize; 2]>) -> Knot {
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
        jones: jones.clone().or_else(|| alexander.as_ref().and_then(|_| jones::jones(code))),
        code: code.clone(),
        answers: answers.iter().map(named).collect(),
    }
}
