//! Sums over all points within reach of each point, for crowded places.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::Hierarchy;
use crate::geometry::{Point, squared_distance};
use crate::parallel::go_on;

const GROUP: usize = 32; // points that are answered together at most
const GROUPS_PER_TASK: usize = 16; // groups that one task works on

/// A sum that can be combined with another.
pub trait Sum: Copy {
    /// Combines two sums.
    fn and(self, other: Self) -> Self;
}

/// A count of points.
impl Sum for usize {
    fn and(self, other: Self) -> Self {
        self + other
    }
}

/// A hierarchy whose points carry values that can be summed.
pub struct Summed<S> {
    hierarchy: Hierarchy,
    /// The value of each point, in the order of the boxes, and the sum of each box.
    points: Vec<S>,
    nodes: Vec<S>,
}

impl<S: Sum> Summed<S> {
    /// Sums the values that `carried` gives for each index of the input.
    pub fn new(points: impl Iterator<Item = Point>, carried: impl Fn(usize) -> S) -> Self {
        let hierarchy = Hierarchy::new(points);
        let points: Vec<S> = hierarchy.order.iter().map(|&i| carried(i as usize)).collect();
        // in reverse, so that both halves of a box come before it
        let mut nodes: Vec<S> = Vec::new();
        let count = hierarchy.nodes.len();
        for (number, node) in hierarchy.nodes.iter().enumerate().rev() {
            let sum = match node.second as usize {
                0 => points[node.positions()].iter().copied().reduce(S::and),
                second => Some(nodes[count - 2 - number].and(nodes[count - 1 - second])),
            };
            nodes.extend(sum);
        }
        nodes.reverse();
        Self { hierarchy, points, nodes }
    }

    /// Answers for the points of one group.
    ///
    /// `answer` turns the sum over all points within a distance of a point into an answer. `limit` is the square of
    /// that distance. `put` gets the point's index and the answer. Boxes that lie within reach of the whole group are
    /// summed once.
    fn answer<A>(
        &self,
        group: usize,
        limit: f64,
        answer: impl Fn(S) -> A,
        put: impl Fn(usize, &A),
        undecided: &mut Vec<u32>,
    ) {
        let Hierarchy { nodes, points, order } = &self.hierarchy;
        let around = &nodes[group].bounds;
        let mut all: Option<S> = None;
        undecided.clear();
        self.hierarchy.divide_by(
            |bounds| bounds.squared_gap(around) > limit,
            |number| {
                let node = &nodes[number];
                if node.bounds.squared_span(around) <= limit {
                    let sum = self.nodes[number];
                    all = Some(all.map_or(sum, |all| all.and(sum)));
                    return true;
                }
                if node.second == 0 {
                    undecided.extend(node.first..node.end);
                }
                false
            },
        );
        let sum_at = |center: Point| {
            let mut sum = all;
            for &i in undecided.iter() {
                let i = i as usize;
                if squared_distance(points[i], center) <= limit {
                    sum = Some(sum.map_or(self.points[i], |sum| sum.and(self.points[i])));
                }
            }
            sum
        };
        let one_place = nodes[group].is_one_place();
        let mut last = None;
        for i in nodes[group].positions() {
            if last.is_none() || !one_place {
                // a point is within any distance of itself
                last = sum_at(points[i]).map(&answer);
            }
            if let Some(answer) = &last {
                put(order[i] as usize, answer);
            }
        }
    }
}

/// Points of a cloud that still need an answer, because the cells around them are crowded.
#[derive(Default)]
pub struct Crowded(Mutex<Vec<u32>>);

impl Crowded {
    /// Adds points, given by their indices.
    #[cold]
    pub fn add(&self, indices: impl Iterator<Item = usize>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(indices.map(|i| i as u32));
    }

    /// Answers for each point from the sum over all points within `radius` of it, in parallel.
    ///
    /// `put` gets each point's index and answer once.
    pub fn answer<S: Sum + Send + Sync, A>(
        self,
        points: &[Point],
        radius: f64,
        carried: impl Fn(usize) -> S,
        answer: impl Fn(S) -> A + Sync,
        put: impl Fn(usize, &A) + Sync,
    ) {
        let indices = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        if indices.is_empty() {
            return;
        }
        let mut open = vec![false; points.len()];
        for i in indices {
            open[i as usize] = true;
        }
        let summed = Summed::new(points.iter().copied(), carried);
        let put_open = |i: usize, answer: &A| {
            if open[i] {
                put(i, answer);
            }
        };
        summed.hierarchy.groups(GROUP).par_chunks(GROUPS_PER_TASK).for_each(|groups| {
            go_on();
            let mut undecided = Vec::new();
            for &group in groups {
                let members = &summed.hierarchy.order[summed.hierarchy.nodes[group].positions()];
                if members.iter().any(|&i| open[i as usize]) {
                    summed.answer(group, radius * radius, &answer, put_open, &mut undecided);
                }
            }
        });
    }
}
