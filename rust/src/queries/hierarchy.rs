//! A tree of boxes of capsules, and the searches through it.

use super::boxes::{BoxMotion, segment_to_box};
use super::capsule::{Approach, Capsule};
use super::rays::Line;
use crate::geometry::{Point, advance, dot, squared_distance, sub};
use crate::index::bounds::Bounds;

const LEAF_CAPSULES: usize = 4; // boxes of at most this many capsules are not divided
const MAX_DEPTH: usize = 40; // depth of the tree at most: boxes are halved, so even 2³² capsules are not as deep

/// A binary tree of boxes around the axes of capsules, halved across their longest side.
pub struct Hierarchy {
    /// The first half of each box follows it.
    nodes: Vec<Node>,
    /// The capsules, grouped by box.
    capsules: Vec<Capsule>,
}

struct Node {
    /// The box around the axes.
    bounds: Bounds,
    /// The largest radius.
    radius: f64,
    first: u32,
    end: u32,
    /// The number of the second half; 0 if the box is not divided.
    second: u32,
}

/// Returns whether the distance from a surface exceeds `best`, given the squared distance from its axis and its radius.
#[inline(always)]
fn is_beyond(squared: f64, radius: f64, best: f64) -> bool {
    let reach = best + radius;
    reach < 0.0 || squared > reach * reach
}

impl Hierarchy {
    /// Sorts at most 2³² capsules, and numbers them in the given order.
    pub fn new(mut capsules: Vec<Capsule>) -> Self {
        for (number, capsule) in capsules.iter_mut().enumerate() {
            capsule.number = number as u32;
        }
        let mut nodes = Vec::with_capacity(capsules.len());
        if !capsules.is_empty() {
            divide(&mut capsules, 0, &mut nodes);
        }
        Self { nodes, capsules }
    }

    /// Finds the capsule with the least distance from a point to its surface; returns that distance and the capsule.
    pub fn nearest(&self, point: Point) -> Option<(f64, &Capsule)> {
        let place = Bounds { low: point, high: point };
        let found = self.search(
            None,
            |node| node.bounds.squared_gap(&place),
            |squared, node, best| is_beyond(squared, node.radius, best),
            |capsule, best| {
                let squared = capsule.squared_distance(point);
                (!is_beyond(squared, capsule.radius, best)).then(|| (squared.sqrt() - capsule.radius, ()))
            },
        );
        found.map(|(least, (), capsule)| (least, capsule))
    }

    /// As [`Hierarchy::nearest`], for a point that moves straight and evenly.
    pub fn closest(&self, start: Point, step: Point) -> Option<(f64, Approach, &Capsule)> {
        let square = dot(step, step);
        let inverse = if square > 0.0 { 1.0 / square } else { 0.0 };
        // balls around boxes take a tenth of the time of boxes, and fit small boxes well
        let gap = |node: &Node| {
            let time = (dot(sub(node.bounds.middle(), start), step) * inverse).clamp(0.0, 1.0);
            let distance = squared_distance(node.bounds.middle(), advance(start, time, step)).sqrt();
            (distance - 0.5 * node.bounds.diagonal()).max(0.0).powi(2)
        };
        self.search(
            None,
            gap,
            |squared, node, best| is_beyond(squared, node.radius, best),
            |capsule, best| {
                let found = capsule.approach(start, step);
                (!is_beyond(found.squared, capsule.radius, best))
                    .then(|| (found.squared.sqrt() - capsule.radius, found))
            },
        )
    }

    /// Finds the capsule, widened by some length, that a line enters first; returns the distance along the line.
    pub fn first(&self, line: &Line, wider: f64) -> Option<(f64, &Capsule)> {
        let found = self.search(
            None,
            |node| line.enters_box(&node.bounds, [node.radius + wider; 3]),
            |enters, _, best| enters > best || enters.is_infinite(),
            |capsule, _| line.enters(capsule, wider).map(|distance| (distance, ())),
        );
        found.map(|(distance, (), capsule)| (distance, capsule))
    }

    /// Finds the clearance of a moving box, its time, and the capsule.
    pub fn clearance_of_box(&self, motion: &BoxMotion) -> Option<(f64, f64, &Capsule)> {
        let (start, step) = motion.way();
        // few capsules come as near as the nearest to its centre
        let (_, _, near) = self.closest(start, step)?;
        let (clearance, time) = motion.clearance(near, f64::INFINITY);
        self.search(
            Some((clearance, time, near)),
            |node| squared_distance_to_box(start, step, &node.bounds, motion.reach),
            |squared, node, best| is_beyond(squared, node.radius, best),
            |capsule, best| Some(motion.clearance(capsule, best)),
        )
    }

    /// Finds the first contact of a moving box: its time and the capsule. `near` is a capsule that it comes near to.
    pub fn first_of_box<'a>(&'a self, motion: &BoxMotion, near: &'a Capsule) -> Option<(f64, &'a Capsule)> {
        let found = self.search(
            motion.first_contact(near, 1.0).map(|time| (time, (), near)),
            |node| motion.line.enters_box(&node.bounds, motion.reach.map(|x| x + node.radius)),
            |enters, _, best| enters.is_infinite() || motion.line.share(enters) > best,
            |capsule, best| motion.first_contact(capsule, best.min(1.0)).map(|time| (time, ())),
        );
        found.map(|(time, (), capsule)| (time, capsule))
    }

    /// Finds the capsule with the least value of `ask`, the lowest number among equals; returns `held` if none is less.
    ///
    /// `ask` gets the least value so far and may return None for larger ones. The `key` of a box is computed once.
    /// Boxes with smaller keys come first. Boxes that are `out`, given the least value, are skipped.
    #[inline]
    fn search<'a, T>(
        &'a self,
        held: Option<(f64, T, &'a Capsule)>,
        key: impl Fn(&Node) -> f64,
        out: impl Fn(f64, &Node, f64) -> bool,
        mut ask: impl FnMut(&Capsule, f64) -> Option<(f64, T)>,
    ) -> Option<(f64, T, &'a Capsule)> {
        let mut found = held;
        let mut best = found.as_ref().map_or(f64::INFINITY, |held| held.0);
        let mut left = [(0, 0.0); MAX_DEPTH];
        let mut count = 0;
        if let Some(root) = self.nodes.first() {
            left[0] = (0, key(root));
            count = 1;
        }
        while count > 0 {
            count -= 1;
            let (mut number, mut mine) = left[count];
            while !out(mine, &self.nodes[number], best) {
                let node = &self.nodes[number];
                if node.second == 0 {
                    for capsule in &self.capsules[node.first as usize..node.end as usize] {
                        let Some((value, more)) = ask(capsule, best) else { continue };
                        let first = |found: &(f64, T, &Capsule)| capsule.number < found.2.number;
                        if value < best || (value == best && found.as_ref().is_some_and(first)) {
                            best = value;
                            found = Some((value, more, capsule));
                        }
                    }
                    break;
                }
                let (one, other) = (number + 1, node.second as usize);
                let (to_one, to_other) = (key(&self.nodes[one]), key(&self.nodes[other]));
                let (near, far) = if to_other < to_one {
                    ((other, to_other), (one, to_one))
                } else {
                    ((one, to_one), (other, to_other))
                };
                left[count] = far;
                count += 1;
                (number, mine) = near;
            }
        }
        found
    }
}

/// Returns the squared distance of a segment from a box that is wider by some lengths on each side.
#[inline]
fn squared_distance_to_box(start: Point, step: Point, bounds: &Bounds, wider: Point) -> f64 {
    let from_middle = std::array::from_fn(|k| start[k] - 0.5 * (bounds.low[k] + bounds.high[k]));
    let half = std::array::from_fn(|k| 0.5 * (bounds.high[k] - bounds.low[k]) + wider[k]);
    let (_, off) = segment_to_box(from_middle, step, half);
    dot(off, off)
}

/// Sorts capsules into boxes, recursively.
fn divide(capsules: &mut [Capsule], first: u32, nodes: &mut Vec<Node>) {
    let (mut bounds, mut middles, mut radius) = (Bounds::NONE, Bounds::NONE, 0.0_f64);
    for capsule in capsules.iter() {
        bounds.add(capsule.at(0.0));
        bounds.add(capsule.at(capsule.length));
        middles.add(capsule.at(0.5 * capsule.length));
        radius = radius.max(capsule.radius);
    }
    let number = nodes.len();
    nodes.push(Node { bounds, radius, first, end: first + capsules.len() as u32, second: 0 });
    if capsules.len() <= LEAF_CAPSULES {
        return;
    }
    let side = |k: usize| middles.high[k] - middles.low[k];
    let longest = (1..3).fold(0, |longest, k| if side(k) > side(longest) { k } else { longest });
    let place = |capsule: &Capsule| capsule.at(0.5 * capsule.length)[longest];
    let half = capsules.len() / 2;
    // equals go by their number, so that the order does not depend on the selection
    capsules.select_nth_unstable_by(half, |a, b| place(a).total_cmp(&place(b)).then(a.number.cmp(&b.number)));
    let (one, other) = capsules.split_at_mut(half);
    divide(one, first, nodes);
    nodes[number].second = nodes.len() as u32;
    divide(other, first + half as u32, nodes);
}
