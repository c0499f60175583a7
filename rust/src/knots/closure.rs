//! Closures of an open chain: both ends are led straight to a far sphere in the same direction, and joined there.
//!
//! Which knot that makes can depend on the direction, so there are many, spread evenly and always the same.
//! Nodes that a closed polyline can do without are sought once for all directions: those count whose triangles none of
//! the two straight ways passes through.

use super::boxes::Bounds;
use super::identity::{Identity, Kind, Known};
use super::projection::{NoDiagram, frame};
use super::thinning::{Thinned, thin};
use crate::Point;
use crate::geometry::{advance, dot};
use crate::parallel::go_on;

/// Directions that are tried before chains that are too tangled for an answer are given up.
const TOO_TANGLED: usize = 4;

/// Between directions that are asked one after the other; no divisor in common with the number of directions.
const STRIDE: usize = 19;

/// Directions of closures, evenly spread over the sphere: a Fibonacci lattice.
pub fn directions(count: usize) -> impl Iterator<Item = Point> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |k| {
        let z = 1.0 - (2 * k + 1) as f64 / count as f64;
        let across = (1.0 - z * z).sqrt();
        let angle = golden * k as f64;
        [across * angle.cos(), across * angle.sin(), z]
    })
}

/// An answer of closures.
#[derive(Debug)]
pub struct Answer {
    /// How many closures say so.
    pub count: usize,
    /// One that has the fewest crossings.
    pub identity: Identity,
}

/// The answers of closures in so many directions, the most frequent first.
///
/// Closures that are too tangled for a diagram count as one unknown knot.
pub fn closures(nodes: &[Point], count: usize, known: &mut Known) -> Result<Vec<Answer>, NoDiagram> {
    let thinned = thin(nodes, false, f64::INFINITY);
    let (mut answers, mut tangled) = (Vec::<Answer>::new(), 0);
    for (k, direction) in directions(count).enumerate() {
        go_on();
        let tangle = Identity::unknown();
        let found = match known.identity(&closed(&thinned, direction)) {
            Err(NoDiagram::TooManyCrossings) => &tangle,
            found => found?,
        };
        tangled += usize::from(found.kind == Kind::Unknown(None));
        match answers.iter_mut().find(|answer| answer.identity.kind == found.kind) {
            Some(answer) => {
                answer.count += 1;
                if found.code.crossings() < answer.identity.code.crossings() {
                    answer.identity = found.clone();
                }
            }
            None => answers.push(Answer { count: 1, identity: found.clone() }),
        }
        if tangled == TOO_TANGLED && k + 1 == tangled {
            break;
        }
    }
    answers.sort_by_key(|answer| std::cmp::Reverse(answer.count));
    Ok(answers)
}

/// Whether more than half of so many closures are of a kind. As soon as those that are have been, or those that are not, so
/// many more than the others, they count as most.
pub fn most_are(nodes: &[Point], count: usize, lead: usize, kind: &Kind, known: &mut Known) -> bool {
    let thinned = thin(nodes, false, f64::INFINITY);
    let all: Vec<Point> = directions(count).collect();
    let (mut are, mut others) = (0, 0);
    while 2 * are <= count && 2 * others < count && are < others + lead && others < are + lead {
        // neighbours on the sphere are asked far apart
        let direction = all[(are + others) * STRIDE % count];
        match known.identity(&closed(&thinned, direction)) {
            Ok(found) if found.kind == *kind => are += 1,
            _ => others += 1,
        }
    }
    are > others
}

/// The chain's closure in a direction, without nodes that it can do without.
fn closed(thinned: &Thinned<'_>, direction: Point) -> Vec<Point> {
    let axes = frame(direction);
    let flat: Vec<Point> = thinned.nodes.iter().map(|&p| axes.map(|axis| dot(axis, p))).collect();
    let last = flat.len() - 1;
    let is_passed = |triangle: &[u32; 3]| {
        let corners = triangle.map(|k| flat[k as usize]);
        [0, last].iter().any(|&end| !triangle.contains(&(end as u32)) && is_above(corners, flat[end]))
    };
    let passed = thinned.triangles.iter().position(is_passed).unwrap_or(thinned.triangles.len());
    let bounds = Bounds::about(&flat);
    let far = bounds.high[2] + 0.5 * bounds.extent();
    let mut polygon: Vec<Point> = thinned.after(passed).map(|k| thinned.nodes[k]).collect();
    polygon.extend([last, 0].map(|end| advance(thinned.nodes[end], far - flat[end][2], direction)));
    polygon
}

/// Whether a triangle lies above a place, or so near that rounding cannot tell.
fn is_above(corners: [Point; 3], place: Point) -> bool {
    let [a, b, c] = corners;
    if a[2].max(b[2]).max(c[2]) < place[2] {
        return false;
    }
    let turn =
        |p: Point, q: Point| (p[0] - place[0]) * (q[1] - place[1]) - (p[1] - place[1]) * (q[0] - place[0]);
    let sides = [turn(b, c), turn(c, a), turn(a, b)];
    let slack = 1e-12 * sides.iter().fold(0.0_f64, |most, side| most.max(side.abs()));
    if !(sides.iter().all(|&side| side >= -slack) || sides.iter().all(|&side| side <= slack)) {
        return false;
    }
    let whole: f64 = sides.iter().sum();
    if whole.abs() <= slack {
        return true;
    }
    (sides[0] * a[2] + sides[1] * b[2] + sides[2] * c[2]) / whole >= place[2]
}
