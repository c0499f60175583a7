//! Diagrams of closed polylines: the signed crossings seen from far away.

use super::code::{GaussCode, Visit};
use crate::geometry::boxes::{Bounds, BoxTree};
use crate::geometry::{Point, cross, dot, normalized};
use crate::parallel::go_on;

pub const MAX_CROSSINGS: usize = 20_000; // crossings of a diagram at most
const MAX_PAIRS: usize = 200_000_000; // pairs of segments that are examined at most
/// A crossing nearer to a node than this may be on either side of it, lengths of the segment.
const NEAR_NODE: f64 = 1e-9;
const NEAR_STRAND: f64 = 1e-12; // strands whose heights differ less than this meet, extents

/// Why there is no diagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoDiagram {
    /// A strand lies over a node from this direction; any other will do.
    Unlucky,
    /// The polyline meets itself.
    Meets,
    TooManyCrossings,
}

/// A diagram, and the places of its visits.
#[derive(Debug)]
pub struct Diagram {
    pub code: GaussCode,
    /// For each visit, the number of the segment and the share of it before the crossing.
    pub at: Vec<(usize, f64)>,
}

/// The closing curve from the last node to the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lid {
    /// A segment like the others.
    Segment,
    /// An arc above everything: both ends are led to the viewer.
    Above,
}

/// A view of an open polyline, with its own crossings.
#[derive(Debug)]
pub struct Look {
    flat: Vec<Point>,
    found: Vec<Crossing>,
}

impl Look {
    /// Views nodes from the unit vector `towards`.
    pub fn new(nodes: &[Point], towards: Point) -> Result<Self, NoDiagram> {
        let flat = seen(nodes, towards);
        let found = crossings(&flat, None)?;
        Ok(Self { flat, found })
    }

    /// Returns the diagram of the stretch between two nodes, closed by an arc above it; None if the arc lies over a
    /// node.
    pub fn stretch(&self, from: usize, to: usize) -> Option<GaussCode> {
        let within = |crossing: &&Crossing| crossing.segments.iter().all(|k| (from..to).contains(k));
        let mut found: Vec<Crossing> = self.found.iter().filter(within).copied().collect();
        let lid = [self.flat[to], self.flat[from]];
        for k in from + 1..to.saturating_sub(1) {
            match meet([self.flat[k], self.flat[k + 1]], lid) {
                Meeting::None => {}
                Meeting::Unclear => return None,
                Meeting::At { parts, turn, .. } => {
                    found.push(Crossing { segments: [k, to], parts, first_over: false, turn });
                }
            }
        }
        Some(encode(&found).code)
    }
}

/// Returns unit vectors to the right, up and to the viewer.
pub fn make_frame(towards: Point) -> [Point; 3] {
    let least = (0..3).min_by(|&a, &b| towards[a].abs().total_cmp(&towards[b].abs())).unwrap_or(0);
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let right = normalized(cross(axis, towards));
    [right, cross(towards, right), towards]
}

/// Returns the diagram of nodes closed by a lid, seen from the unit vector `towards`.
pub fn draw_diagram(nodes: &[Point], lid: Lid, towards: Point) -> Result<Diagram, NoDiagram> {
    Ok(encode(&crossings(&seen(nodes, towards), Some(lid))?))
}

/// Returns coordinates to the right, up and to the viewer.
fn seen(nodes: &[Point], towards: Point) -> Vec<Point> {
    let axes = make_frame(towards);
    nodes.iter().map(|&p| axes.map(|axis| dot(axis, p))).collect()
}

/// Finds the crossings of viewed nodes, closed by a lid or open.
fn crossings(flat: &[Point], lid: Option<Lid>) -> Result<Vec<Crossing>, NoDiagram> {
    let count = flat.len();
    let scale = Bounds::about(flat).extent();
    let segment = |k: usize| [flat[k], flat[if k + 1 == count { 0 } else { k + 1 }]];
    // boxes of no height: two that lie over each other meet
    let on_ground = |k: usize| segment(k).map(|[x, y, _]| [x, y, 0.0]);
    let segments = if lid.is_none() { count - 1 } else { count };
    let tree = BoxTree::new((0..segments).map(on_ground));
    let (mut found, mut failure, mut pairs) = (Vec::new(), None, 0);
    for k in 0..segments {
        if k % 256 == 0 {
            go_on();
        }
        let first = segment(k);
        let stopped = tree.any(&Bounds::about(&on_ground(k)), k + 1, |other| {
            pairs += 1;
            if pairs > MAX_PAIRS {
                failure = Some(NoDiagram::TooManyCrossings);
                return true;
            }
            if other == k + 1 || (k == 0 && other + 1 == count) {
                return false;
            }
            let covered = lid == Some(Lid::Above) && other + 1 == count;
            match meet(first, segment(other)) {
                Meeting::None => return false,
                Meeting::Unclear => failure = Some(NoDiagram::Unlucky),
                Meeting::At { drop, .. } if !covered && drop.abs() <= NEAR_STRAND * scale => {
                    failure = Some(NoDiagram::Meets);
                }
                Meeting::At { .. } if found.len() >= MAX_CROSSINGS => {
                    failure = Some(NoDiagram::TooManyCrossings);
                }
                Meeting::At { parts, drop, turn } => {
                    found.push(Crossing {
                        segments: [k, other],
                        parts,
                        first_over: !covered && drop > 0.0,
                        turn,
                    });
                }
            }
            failure.is_some()
        });
        if stopped {
            break;
        }
    }
    match failure {
        Some(failure) => Err(failure),
        None => Ok(found),
    }
}

#[derive(Debug, Clone, Copy)]
struct Crossing {
    segments: [usize; 2],
    parts: [f64; 2],
    first_over: bool,
    /// Whether the second segment crosses the first from right to left.
    turn: bool,
}

enum Meeting {
    None,
    /// Too near to a node to decide.
    Unclear,
    At {
        parts: [f64; 2],
        /// Height of the first segment above the second.
        drop: f64,
        turn: bool,
    },
}

/// Returns how two segments meet in the plane.
fn meet([a, b]: [Point; 2], [c, d]: [Point; 2]) -> Meeting {
    let flat_cross = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let (along, across) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]]);
    let apart = [c[0] - a[0], c[1] - a[1]];
    let size = flat_cross(along, across);
    let squared = |p: [f64; 2]| p[0] * p[0] + p[1] * p[1];
    if size * size <= 1e-24 * squared(along) * squared(across) {
        // parallel segments lie beside each other or on one line, where their boxes show whether they overlap
        let longer = if squared(along) >= squared(across) { along } else { across };
        let beside = flat_cross(longer, apart).abs() > NEAR_NODE * squared(longer);
        return if beside { Meeting::None } else { Meeting::Unclear };
    }
    let parts = [flat_cross(apart, across) / size, flat_cross(apart, along) / size];
    let is_within = |part: f64, margin: f64| part > -margin && part < 1.0 + margin;
    if !parts.iter().all(|&part| is_within(part, NEAR_NODE)) {
        return Meeting::None;
    }
    if !parts.iter().all(|&part| is_within(part, -NEAR_NODE)) {
        return Meeting::Unclear;
    }
    let drop = a[2] + parts[0] * (b[2] - a[2]) - c[2] - parts[1] * (d[2] - c[2]);
    Meeting::At { parts, drop, turn: size > 0.0 }
}

/// Sorts the visits in the order of the polyline.
fn encode(found: &[Crossing]) -> Diagram {
    let mut visits: Vec<(usize, f64, Visit)> = (found.iter().enumerate())
        .flat_map(|(k, crossing)| {
            [0, 1].map(|which| {
                let over = crossing.first_over == (which == 0);
                (crossing.segments[which], crossing.parts[which], Visit { crossing: k as u32, over })
            })
        })
        .collect();
    visits.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let signs =
        found.iter().map(|crossing| if crossing.first_over == crossing.turn { 1 } else { -1 }).collect();
    Diagram {
        at: visits.iter().map(|&(segment, part, _)| (segment, part)).collect(),
        code: GaussCode { visits: visits.into_iter().map(|(_, _, visit)| visit).collect(), signs },
    }
}
