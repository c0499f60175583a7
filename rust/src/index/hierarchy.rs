//! Boxes of points within boxes, for what a grid does not suit: where very many points are in reach of each, all of a
//! box that is in reach counts at once; and where a cloud reaches so far that its cells are wide, boxes are as narrow
//! as what they hold.
//!
//! What lies within a distance is decided as point by point, rounding included: differences, squares and sums round
//! monotonically, so the nearest and the farthest place of a box bound what is worked out for its points.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::bounds::Bounds;
use crate::geometry::{Point, squared_distance};
use crate::parallel::go_on;

/// Boxes of so few points, or of points in one place, are not divided.
const FEW: usize = 8;
/// Most points that are answered for together, and how many such groups a task works through.
const GROUP: usize = 32;
const GROUPS_PER_TASK: usize = 16;
/// While so many points are sorted someone may no longer wait for them.
const MANY: usize = 4096;
/// Boxes are halved, so 2³² points are not as deep.
const DEEPEST: usize = 40;

/// A binary tree of boxes around finite points, halved across their longest side.
pub struct Hierarchy {
    /// Each box's first half follows it.
    nodes: Vec<Node>,
    /// The points, those of a box one behind the other, and each one's index in the input.
    points: Vec<Point>,
    order: Vec<u32>,
}

struct Node {
    bounds: Bounds,
    first: u32,
    end: u32,
    /// The second half; 0 where the box is not divided.
    second: u32,
}

impl Node {
    /// Positions of its points.
    #[inline(always)]
    fn positions(&self) -> Range<usize> {
        self.first as usize..self.end as usize
    }

    /// Whether all of its points are in one place.
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

    /// Indices of the points in the order of the boxes: what is near in space is mostly near in it.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Calls `settle` with the numbers of boxes that are not `out`, from the whole down, until it tells that no more need
    /// be known of a box.
    #[inline]
    fn divide_by(&self, out: impl Fn(&Bounds) -> bool, mut settle: impl FnMut(usize) -> bool) {
        let mut left = [0; DEEPEST];
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

    /// Runs of positions in the order of the boxes that hold all points within a distance, given its square, of a place,
    /// ascending, and few others.
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

    /// The nearest point within a distance, given its square, of a place: its index, of equals the least.
    pub fn nearest(&self, center: Point, limit: f64) -> Option<usize> {
        self.nearest_of(center, limit, |_| true, |_| true)
    }

    /// The nearest of the points at some positions, in some boxes.
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
        let mut left = [(0, 0.0); DEEPEST];
        let mut count = usize::from(!self.nodes.is_empty());
        while count > 0 {
            count -= 1;
            let (mut number, mut nearest) = left[count];
            while nearest <= best.0 && has_some(number) {
                let node = &self.nodes[number];
                if node.second == 0 {
                    // points in one place are taken together, and the first in the input comes first
                    let few = if node.is_one_place() { 1 } else { FEW };
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

    /// Boxes of at most so many points, or of points in one place, that hold all.
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

/// Puts points in order of their boxes.
fn divide(points: &mut [(Point, u32)], first: u32, nodes: &mut Vec<Node>) {
    if points.len() > MANY {
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
    if points.len() <= FEW || low == high {
        return;
    }
    let side = |k: usize| high[k] - low[k];
    let longest = (1..3).fold(0, |longest, k| if side(k) > side(longest) { k } else { longest });
    let middle = points.len() / 2;
    // of equals the first in the input, so that the order is the same whatever the selection did
    points.select_nth_unstable_by(middle, |a, b| a.0[longest].total_cmp(&b.0[longest]).then(a.1.cmp(&b.1)));
    let (one, other) = points.split_at_mut(middle);
    divide(one, first, nodes);
    nodes[number].second = nodes.len() as u32;
    divide(other, first + middle as u32, nodes);
}

/// Sums over boxes and points that make one sum.
pub trait Sum: Copy {
    /// Two sums in one.
    fn and(self, other: Self) -> Self;
}

/// A number of points.
impl Sum for usize {
    fn and(self, other: Self) -> Self {
        self + other
    }
}

/// A hierarchy whose points carry something that can be summed.
pub struct Summed<S> {
    hierarchy: Hierarchy,
    /// Of each point, in the order of the boxes, and of each box.
    points: Vec<S>,
    nodes: Vec<S>,
}

impl<S: Sum> Summed<S> {
    /// Sums what points carry, given by their indices in the input.
    pub fn new(points: impl Iterator<Item = Point>, carried: impl Fn(usize) -> S) -> Self {
        let hierarchy = Hierarchy::new(points);
        let points: Vec<S> = hierarchy.order.iter().map(|&i| carried(i as usize)).collect();
        // halves come behind what they are halves of
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

    /// Answers for points that are near each other: `answer` makes something of the sum over what lies within a distance,
    /// given its square, of a point, and `put` gets it with the point's index.
    ///
    /// What is decided for all points of a group at once is summed once.
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

/// Points of a cloud that are left open because the cells around them are crowded.
#[derive(Default)]
pub struct Crowded(Mutex<Vec<u32>>);

impl Crowded {
    /// Leaves points open, given by their indices.
    #[cold]
    pub fn add(&self, indices: impl Iterator<Item = usize>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(indices.map(|i| i as u32));
    }

    /// Makes an answer for each from the sum over what lies within a radius of it, in parallel; `put` gets it with the
    /// point's index, once.
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

/// Points of a hierarchy that are left, from which some are taken.
pub struct Remaining<'a> {
    hierarchy: &'a Hierarchy,
    /// How many of each box's points are left; not kept true inside of boxes of which none is.
    nodes: Vec<u32>,
    /// Whether points are left, in the order of the boxes.
    points: Vec<bool>,
}

impl<'a> Remaining<'a> {
    /// All points.
    pub fn new(hierarchy: &'a Hierarchy) -> Self {
        Self {
            hierarchy,
            nodes: hierarchy.nodes.iter().map(|node| node.end - node.first).collect(),
            points: vec![true; hierarchy.points.len()],
        }
    }

    /// Takes all points within a distance, given its square, of a place; calls `taken` with the index of each.
    pub fn take(&mut self, center: Point, limit: f64, mut taken: impl FnMut(usize)) {
        if !self.nodes.is_empty() {
            self.take_of(0, center, limit, &mut taken);
        }
    }

    fn take_of(&mut self, number: usize, center: Point, limit: f64, taken: &mut impl FnMut(usize)) {
        let hierarchy = self.hierarchy;
        let (node, place) = (&hierarchy.nodes[number], Bounds { low: center, high: center });
        if self.nodes[number] == 0 || node.bounds.squared_gap(&place) > limit {
            return;
        }
        let whole = node.bounds.squared_span(&place) <= limit;
        if !whole && node.second != 0 {
            let second = node.second as usize;
            self.take_of(number + 1, center, limit, taken);
            self.take_of(second, center, limit, taken);
            self.nodes[number] = self.nodes[number + 1] + self.nodes[second];
            return;
        }
        for i in node.positions() {
            if self.points[i] && (whole || squared_distance(hierarchy.points[i], center) <= limit) {
                self.points[i] = false;
                self.nodes[number] -= 1;
                taken(hierarchy.order[i] as usize);
            }
        }
    }

    /// The nearest of the points that are left within a distance, given its square, of a place: its index, of equals the
    /// least.
    pub fn nearest(&self, center: Point, limit: f64) -> Option<usize> {
        self.hierarchy.nearest_of(center, limit, |number| self.nodes[number] > 0, |i| self.points[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Many points in few places, on a lattice, in a dense spot, anywhere and far out.
    fn cloud() -> impl Strategy<Value = Vec<Point>> {
        let lattice = prop::array::uniform3(-2i32..2).prop_map(|p| p.map(|x| f64::from(x) * 0.5));
        let spot = prop::array::uniform3(-2.0f64..2.0).prop_map(|p| p.map(|x| 0.25 + 1e-9 * x));
        let free = prop::array::uniform3(-2.0f64..2.0);
        let far = prop::array::uniform3(-2.0f64..2.0).prop_map(|p| [p[0] * 1e12, p[1], p[2]]);
        let point = prop_oneof![8 => lattice, 4 => Just([0.25; 3]), 4 => spot, 4 => free, 1 => far];
        prop::collection::vec(point, 0..200)
    }

    fn any_limit() -> impl Strategy<Value = f64> {
        prop_oneof![Just(0.0), Just(0.25), Just(1.0), Just(1e-18), 0.01f64..9.0, Just(1e30)]
    }

    impl Sum for (usize, u64) {
        fn and(self, other: Self) -> Self {
            (self.0 + other.0, self.1 + other.1)
        }
    }

    proptest! {
        #[test]
        fn a_hierarchy_finds_what_brute_force_finds(points in cloud(), limit in any_limit()) {
            let hierarchy = Hierarchy::new(points.iter().copied());
            for &center in points.iter().chain(&[[0.3, 0.1, -0.2]]) {
                let expected: Vec<usize> =
                    (0..points.len()).filter(|&j| squared_distance(points[j], center) <= limit).collect();
                let runs = hierarchy.runs_near(center, limit);
                prop_assert!(runs.windows(2).all(|pair| pair[0].end < pair[1].start));
                let mut found: Vec<usize> = runs.into_iter().flatten().map(|i| hierarchy.order()[i] as usize).collect();
                found.retain(|&j| squared_distance(points[j], center) <= limit);
                found.sort_unstable();
                prop_assert_eq!(&found, &expected);
            }
        }

        #[test]
        fn sums_are_those_of_brute_force(points in cloud(), limit in any_limit(), open: u64) {
            let crowded = Crowded::default();
            let is_open = |i: usize| open & (1 << (i % 64)) != 0;
            crowded.add((0..points.len()).filter(|&i| is_open(i)));
            let found = Mutex::new(vec![None; points.len()]);
            crowded.answer(
                &points,
                limit.sqrt(),
                |i| (1, i as u64),
                |sum| sum,
                |i, &sum| assert!(found.lock().unwrap()[i].replace(sum).is_none()),
            );
            let limit = limit.sqrt() * limit.sqrt();
            for (i, found) in found.into_inner().unwrap().into_iter().enumerate() {
                let near = |&j: &usize| squared_distance(points[j], points[i]) <= limit;
                let near: Vec<u64> = (0..points.len()).filter(near).map(|j| j as u64).collect();
                prop_assert_eq!(found, is_open(i).then_some((near.len(), near.iter().sum())));
            }
        }

        #[test]
        fn what_remains_is_what_was_not_taken(points in cloud(), limits in prop::collection::vec(any_limit(), 1..6)) {
            let hierarchy = Hierarchy::new(points.iter().copied());
            let mut remaining = Remaining::new(&hierarchy);
            let mut left: Vec<usize> = (0..points.len()).collect();
            for (n, limit) in limits.into_iter().enumerate() {
                let center = points.get(7 * n).copied().unwrap_or([0.1, 0.0, 0.0]);
                let squared = |i: usize| squared_distance(points[i], center);
                let nearer = |&a: &usize, &b: &usize| squared(a).total_cmp(&squared(b)).then(a.cmp(&b));
                let of_all = (0..points.len()).filter(|&i| squared(i) <= 4.0 * limit).min_by(nearer);
                prop_assert_eq!(hierarchy.nearest(center, 4.0 * limit), of_all);
                let mut taken = Vec::new();
                remaining.take(center, limit, |i| taken.push(i));
                taken.sort_unstable();
                let expected: Vec<usize> = left.iter().copied().filter(|&i| squared(i) <= limit).collect();
                prop_assert_eq!(taken, expected);
                left.retain(|&i| squared(i) > limit);
                let within = left.iter().copied().filter(|&i| squared(i) <= 4.0 * limit);
                prop_assert_eq!(remaining.nearest(center, 4.0 * limit), within.min_by(nearer));
            }
        }
    }
}
