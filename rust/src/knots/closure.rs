//! Closures of an open chain: both ends are led straight to a far sphere in the same direction, and joined there.
//!
//! Which knot that makes can depend on the direction, so there are many, spread evenly and always the same.
//! Nodes that a closed polyline can do without are sought once for all directions: those count whose triangles none of
//! the two straight ways passes through.

use super::identity::{Identity, Kind, Known};
use super::projection::{NoDiagram, frame};
use super::thinning::{Thinned, thin};
use crate::geometry::boxes::Bounds;
use crate::geometry::{Point, advance, dot, squared_distance, sub};
use crate::parallel::go_on;

/// Directions that are tried before chains that are too tangled for an answer are given up.
const TOO_TANGLED: usize = 4;

/// How much larger than they are triangles count where it is only asked which may be met.
const ROUNDING: f64 = 1e-9;

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
    let open = Open::new(nodes);
    let (mut answers, mut tangled) = (Vec::<Answer>::new(), 0);
    for (k, direction) in directions(count).enumerate() {
        go_on();
        let tangle = Identity::unknown();
        let found = match known.identity(&open.closed(direction)) {
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

/// An open chain, to be closed without nodes that it can do without.
struct Open<'a> {
    thinned: Thinned<'a>,
    /// A ball that holds all nodes.
    middle: Point,
    reach: f64,
    /// By triangle, for the first and the last node: the way to its middle, and the least square of how far that goes
    /// along a direction in which the triangle may be met.
    ways: Vec<[(Point, f64); 2]>,
}

impl<'a> Open<'a> {
    fn new(nodes: &'a [Point]) -> Self {
        let thinned = thin(nodes, false, f64::INFINITY);
        let Bounds { low, high } = Bounds::about(nodes);
        let middle = advance(low, 0.5, sub(high, low));
        let ends = [0, nodes.len() - 1];
        let ways = (thinned.triangles.iter())
            .map(|triangle| {
                let corners = triangle.map(|k| nodes[k as usize]);
                let centre = std::array::from_fn(|k| corners.iter().map(|p| p[k]).sum::<f64>() / 3.0);
                let wide = corners.iter().map(|&p| squared_distance(p, centre)).fold(0.0, f64::max);
                ends.map(|end| {
                    let way = sub(centre, nodes[end]);
                    let least = (1.0 - ROUNDING) * dot(way, way) - (1.0 + ROUNDING) * wide;
                    (way, if triangle.contains(&(end as u32)) { f64::INFINITY } else { least })
                })
            })
            .collect();
        Self { thinned, middle, reach: squared_distance(high, low).sqrt(), ways }
    }

    /// The closure in a direction.
    fn closed(&self, direction: Point) -> Vec<Point> {
        let (nodes, axes) = (self.thinned.nodes, frame(direction));
        let ends = [0, nodes.len() - 1];
        let seen = |k: usize| axes.map(|axis| dot(axis, nodes[k]));
        let is_passed = |&k: &usize| {
            (self.ways[k].iter().zip(ends)).any(|(&(way, least), end)| {
                let along = dot(way, direction);
                let corners = || self.thinned.triangles[k].map(|corner| seen(corner as usize));
                along * along >= least && is_above(corners(), seen(end))
            })
        };
        let all = self.ways.len();
        let passed = (0..all).find(is_passed).unwrap_or(all);
        let far = dot(self.middle, direction) + self.reach;
        let mut polygon: Vec<Point> = self.thinned.after(passed).map(|k| nodes[k]).collect();
        polygon.extend(
            [ends[1], ends[0]].map(|end| advance(nodes[end], far - dot(nodes[end], direction), direction)),
        );
        polygon
    }
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
