//! A tree of boxes of points, for clouds that do not suit a grid.
//!
//! Where each point has very many neighbours, a box that lies entirely within reach counts as a whole. Where a cloud is
//! so large that its cells are wide, the boxes are still as narrow as the points in them.
//!
//! The answers equal those of a test point by point, rounding included. Differences, squares and sums round
//! monotonically. So the nearest and the farthest place of a box bound the computed distances of its points.

use std::ops::Range;

use super::bounds::Bounds;
use crate::geometry::{Point, squared_distance};
use crate::parallel::go_on;

pub mod crowded;
pub mod remaining;
#[cfg(test)]
mod tests;

const LEAF_POINTS: usize = 8; // boxes of at most this many points are not divided
const LONG_SORT: usize = 4096; // sorts of more points than this check whether the caller has given up
const MAX_DEPTH: usize = 40; // depth of the tree at most: boxes are halved, so even 2³² points are not as deep

/// A binary tree of boxes around finite points, halved across their longest side.
pub struct Hierarchy {
    /// The first half of each box follows it.
    nodes: Vec<Node>,
    /// The points, grouped by box, and each one's index in the input.
    points: Vec<Point>,
    order: Vec<u32>,
}

struct Node {
    bounds: Bounds,
    first: u32,
    end: u32,
    /// The number of the second half; 0 if the box is not divided.
    second: u32,
}

impl Node {
    /// Positions of its points in the order of the boxes.
    #[inline(always)]
    fn positions(&self) -> Range<usize> {
        self.first as usize..self.end as usize
    }

    /// Whether all its points coincide.
    #[inline(always)]
    fn is_one_place(&self) -> bool {
        self.bounds.low == self.bounds.high
    }
}

impl Hierarchy {
    /// Sorts at most 2³² points.
    pub fn new(points: impl Iterator<Item = Point>) -> Self {
        let mut sorted: Vec<(Point, u32)> = points.zip(0..).collect();
        let mut nodes = Vec::with_capacity(sorted.len() / 2 + 1);
        if !sorted.is_empty() {
            divide(&mut sorted, 0, &mut nodes);
        }
        let (points, order) = sorted.into_iter().unzip();
        Self { nodes, points, order }
    }

    /// Visits boxes from the whole down, skipping those that are `out`. Calls `settle` with the number of each; a box
    /// is divided further until `settle` returns true.
    #[inline]
    fn divide_by(&self, out: impl Fn(&Bounds) -> bool, mut settle: impl FnMut(usize) -> bool) {
        let mut left = [0; MAX_DEPTH];
        let mut count = usize::from(!self.nodes.is_empty());
        while count > 0 {
            count -= 1;
            let mut number = left[count] as usize;
            while !out(&self.nodes[number].bounds) && !settle(number) {
                let second = self.nodes[number].second;
                if second == 0 {
                    break;
                }
                left[count] = second;
                count += 1;
                number += 1;
            }
        }
    }

    /// Renumbers the points in the order of the boxes; returns the index in the input of each.
    pub fn take_order(&mut self) -> Vec<u32> {
        let count = self.order.len() as u32;
        std::mem::replace(&mut self.order, (0..count).collect())
    }

    /// Returns runs of positions, ascending, that hold all points within a distance of a place, given its square, and
    /// few others.
    pub fn runs_near(&self, center: Point, limit: f64) -> Vec<Range<usize>> {
        let place = Bounds { low: center, high: center };
        let mut runs: Vec<Range<usize>> = Vec::new();
        self.divide_by(
            |bounds| bounds.squared_gap(&place) > limit,
            |number| {
                let node = &self.nodes[number];
                if node.second != 0 && node.bounds.squared_span(&place) > limit {
                    return false;
                }
                let positions = node.positions();
                match runs.last_mut() {
                    Some(last) if last.end == positions.start => last.end = positions.end,
                    _ => runs.push(positions),
                }
                true
            },
        );
        runs
    }

    /// Returns the index of the nearest point within a distance, given its square; the lowest index among equals.
    pub fn nearest(&self, center: Point, limit: f64) -> Option<usize> {
        self.nearest_of(center, limit, |_| true, |_| true)
    }

    /// Finds the nearest of the points that satisfy `is_one`, in boxes that satisfy `has_some`.
    #[inline]
    fn nearest_of(
        &self,
        center: Point,
        limit: f64,
        has_some: impl Fn(usize) -> bool,
        is_one: impl Fn(usize) -> bool,
    ) -> Option<usize> {
        let place = Bounds { low: center, high: center };
        let gap = |number: usize| self.nodes[number].bounds.squared_gap(&place);
        let mut best = (limit, usize::MAX);
        let mut left = [(0, 0.0); MAX_DEPTH];
        let mut count = usize::from(!self.nodes.is_empty());
        while count > 0 {
            count -= 1;
            let (mut number, mut nearest) = left[count];
            while nearest <= best.0 && has_some(number) {
                let node = &self.nodes[number];
                if node.second == 0 {
                    // points that coincide count as one, the first in the input
                    let few = if node.is_one_place() { 1 } else { LEAF_POINTS };
                    for i in node.positions().take(few) {
                        let squared = squared_distance(self.points[i], center);
                        let index = self.order[i] as usize;
                        if is_one(i) && (squared < best.0 || (squared == best.0 && index < best.1)) {
                            best = (squared, index);
                        }
                    }
                    break;
                }
                let (one, other) = (number + 1, node.second as usize);
                let (to_one, to_other) = (gap(one), gap(other));
                let (first, second) = if to_other < to_one {
                    ((other, to_other), (one, to_one))
                } else {
                    ((one, to_one), (other, to_other))
                };
                left[count] = second;
                count += 1;
                (number, nearest) = first;
            }
        }
        (best.1 != usize::MAX).then_some(best.1)
    }

    /// Divides all points into boxes of at most `most` points, or of points that coincide; returns the boxes' numbers.
    fn groups(&self, most: usize) -> Vec<usize> {
        let mut groups = Vec::new();
        self.divide_by(
            |_| false,
            |number| {
                let node = &self.nodes[number];
                let small = node.second == 0 || node.positions().len() <= most;
                if small {
                    groups.push(number);
                }
                small
            },
        );
        groups
    }
}

fn divide(points: &mut [(Point, u32)], first: u32, nodes: &mut Vec<Node>) {
    if points.len() > LONG_SORT {
        go_on();
    }
    let mut bounds = Bounds::NONE;
    for &(p, _) in points.iter() {
        bounds.add(p);
    }
    let number = nodes.len();
    nodes.push(Node { bounds, first, end: first + points.len() as u32, second: 0 });
    let Bounds { low, high } = bounds;
    if low == high {
        points.sort_unstable_by_key(|&(_, i)| i);
    }
    if points.len() <= LEAF_POINTS || low == high {
        return;
    }
    let longest = bounds.longest();
    let middle = points.len() / 2;
    // equals go by their index in the input, so that the order does not depend on the selection
    points.select_nth_unstable_by(middle, |a, b| a.0[longest].total_cmp(&b.0[longest]).then(a.1.cmp(&b.1)));
    let (one, other) = points.split_at_mut(middle);
    divide(one, first, nodes);
    nodes[number].second = nodes.len() as u32;
    divide(other, first + middle as u32, nodes);
}
