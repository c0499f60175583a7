//! A hierarchy from which points are taken.

use super::super::bounds::Bounds;
use super::Hierarchy;
use crate::geometry::{Point, squared_distance};

/// The points of a hierarchy that have not been taken.
pub struct Remaining<'a> {
    hierarchy: &'a Hierarchy,
    /// The number of points left in each box; not kept up to date inside empty boxes.
    nodes: Vec<u32>,
    /// Whether each point is left, in the order of the boxes.
    points: Vec<bool>,
}

impl<'a> Remaining<'a> {
    /// Starts with all points.
    pub fn new(hierarchy: &'a Hierarchy) -> Self {
        Self {
            hierarchy,
            nodes: hierarchy.nodes.iter().map(|node| node.end - node.first).collect(),
            points: vec![true; hierarchy.points.len()],
        }
    }

    /// Takes all points within a distance of a place, given its square; calls `taken` with the index of each.
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

    /// Returns the index of the nearest point that is left within a distance, given its square; the lowest index among
    /// equals.
    pub fn nearest(&self, center: Point, limit: f64) -> Option<usize> {
        self.hierarchy.nearest_of(center, limit, |number| self.nodes[number] > 0, |i| self.points[i])
    }
}
