//! Closures of an open chain: both ends are extended straight in one direction to a far sphere, and joined there.
//!
//! The knot of a closure can depend on the direction, so many directions are tried, evenly spread and always the same.
//! The chain's superfluous nodes are sought once for all directions. For each direction, those nodes stay whose
//! triangles are pierced by one of the two straight extensions.

use super::identity::{Identity, Kind, Known};
use super::projection::{NoDiagram, make_frame};
use super::thinning::{Thinned, thin};
use crate::geometry::boxes::Bounds;
use crate::geometry::{Point, advance, dot, squared_distance, sub};
use crate::parallel::go_on;

const TOO_TANGLED: usize = 4; // directions that are tried before a chain counts as too tangled

const ROUNDING: f64 = 1e-9; // relative margin of triangles when the search excludes those that cannot be met

/// Returns directions spread evenly over the sphere: a Fibonacci lattice.
pub fn spread_directions(count: usize) -> impl Iterator<Item = Point> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |k| {
        let z = 1.0 - (2 * k + 1) as f64 / count as f64;
        let across = (1.0 - z * z).sqrt();
        let angle = golden * k as f64;
        [across * angle.cos(), across * angle.sin(), z]
    })
}

/// A knot that some closures give.
#[derive(Debug)]
pub struct Answer {
    /// The number of those closures.
    pub count: usize,
    /// The one with the fewest crossings.
    pub identity: Identity,
}

/// Returns the knots of `count` closures, the most frequent first.
///
/// Closures that are too tangled for a diagram count as one unknown knot.
pub fn find_closures(nodes: &[Point], count: usize, known: &mut Known) -> Result<Vec<Answer>, NoDiagram> {
    let open = Open::new(nodes);
    let (mut answers, mut tangled) = (Vec::<Answer>::new(), 0);
    for (k, direction) in spread_directions(count).enumerate() {
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

/// An open chain and its superfluous nodes, ready to be closed in any direction.
struct Open<'a> {
    thinned: Thinned<'a>,
    /// A ball around all nodes.
    middle: Point,
    reach: f64,
    /// For each triangle, from the first and from the last node: the vector to its middle, and the least squared
    /// component along a direction in which the triangle may be met.
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
                let center = std::array::from_fn(|k| corners.iter().map(|p| p[k]).sum::<f64>() / 3.0);
                let wide = corners.iter().map(|&p| squared_distance(p, center)).fold(0.0, f64::max);
                ends.map(|end| {
                    let way = sub(center, nodes[end]);
                    let least = (1.0 - ROUNDING) * dot(way, way) - (1.0 + ROUNDING) * wide;
                    (way, if triangle.contains(&(end as u32)) { f64::INFINITY } else { least })
                })
            })
            .collect();
        Self { thinned, middle, reach: squared_distance(high, low).sqrt(), ways }
    }

    /// Returns the closure in a direction.
    fn closed(&self, direction: Point) -> Vec<Point> {
        let (nodes, axes) = (self.thinned.nodes, make_frame(direction));
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

/// Returns whether a triangle lies above a place, or so near that rounding cannot decide.
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
