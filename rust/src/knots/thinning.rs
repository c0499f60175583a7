//! Fewer nodes for the same knot: the reduction of a polyline by Koniaris, Muthukumar and Taylor.
//!
//! A node can go if nothing passes through the triangle that it forms with its neighbours: the polyline can then be
//! drawn across the triangle. A strand within rounding of the triangle counts as passing through.
//!
//! K. Koniaris, M. Muthukumar: Knottedness in ring polymers, Phys. Rev. Lett. 66 (1991);
//! W. R. Taylor: A deeply knotted protein structure and how it might fold, Nature 406 (2000).

use crate::geometry::boxes::{Bounds, BoxTree};
use crate::geometry::{Point, cross, dot, squared_distance, sub};
use crate::parallel::go_on;

/// Pairs of a triangle and a segment that are examined at most; beyond that, superfluous nodes stay.
const MAX_PAIRS: usize = 50_000_000;
const MIN_YIELD: usize = 10; // a pass that removes less than one node in this many is the last
const ROUNDING: f64 = 1e-14; // rounding of coordinates, extents

/// A polyline and its superfluous nodes, in the order of their removal.
pub struct Thinned<'a> {
    pub nodes: &'a [Point],
    /// The triangles across which the polyline is drawn, one by one; each removes its middle node.
    pub triangles: Vec<[u32; 3]>,
    /// For each node, the number of the triangle that removes it; `u32::MAX` if it stays.
    ends: Vec<u32>,
}

impl Thinned<'_> {
    /// Returns the nodes that remain after some triangles.
    pub fn after(&self, triangles: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.nodes.len()).filter(move |&k| self.ends[k] as usize >= triangles)
    }

    /// Returns the nodes that stay.
    pub fn left(&self) -> Vec<Point> {
        self.after(self.triangles.len()).map(|k| self.nodes[k]).collect()
    }
}

/// Removes nodes as long as any can go whose neighbours are at most `reach` apart. Both ends of an open polyline stay.
pub fn thin(nodes: &[Point], closed: bool, reach: f64) -> Thinned<'_> {
    let count = nodes.len();
    let mut work = Work {
        thinned: Thinned { nodes, triangles: Vec::new(), ends: vec![u32::MAX; count] },
        next: (1..=count as u32).map(|k| if k as usize == count { 0 } else { k }).collect(),
        obstacles: vec![[0; 4]; count],
        closed,
        scale: Bounds::about(nodes).extent(),
        reach,
        pairs: 0,
    };
    let mut kept: Vec<u32> = (0..count as u32).collect();
    loop {
        let before = kept.len();
        if before <= work.least() || work.pairs > MAX_PAIRS {
            return work.thinned;
        }
        work.pass(&kept);
        kept.retain(|&k| work.thinned.ends[k as usize] == u32::MAX);
        if kept.len() * MIN_YIELD > before * (MIN_YIELD - 1) {
            return work.thinned;
        }
    }
}

struct Work<'a> {
    thinned: Thinned<'a>,
    /// For each node, the end of the segment from there.
    next: Vec<u32>,
    /// For each node, the triangle's other corners when it was last tried, and the segment that passed through.
    obstacles: Vec<[u32; 4]>,
    closed: bool,
    scale: f64,
    reach: f64,
    pairs: usize,
}

impl Work<'_> {
    /// The fewest nodes of a polyline.
    fn least(&self) -> usize {
        if self.closed { 3 } else { 2 }
    }

    /// Tries all nodes except those after a removed one, so that all triangles grow evenly.
    fn pass(&mut self, kept: &[u32]) {
        let (count, nodes) = (kept.len(), self.thinned.nodes);
        let node = |k: u32| nodes[k as usize];
        let tried = if self.closed { count } else { count - 1 };
        let mut tree = BoxTree::new(kept[..tried].iter().map(|&k| [node(k), node(self.next[k as usize])]));
        let (mut left, mut before, mut rank) = (count, 0, 1);
        while rank < tried && left > self.least() && self.pairs <= MAX_PAIRS {
            if rank % 256 == 0 {
                go_on();
            }
            let after = if rank + 1 == count { 0 } else { rank + 1 };
            let ranks = [before, rank, after];
            if !self.is_free(ranks.map(|rank| kept[rank]), kept, &tree) {
                before = rank;
                rank += 1;
                continue;
            }
            let corners = ranks.map(|rank| kept[rank]);
            self.thinned.ends[corners[1] as usize] = self.thinned.triangles.len() as u32;
            self.thinned.triangles.push(corners);
            self.next[corners[0] as usize] = corners[2];
            tree.stretch(before, node(corners[2]));
            left -= 1;
            before = after;
            rank += 2;
        }
    }

    /// Returns whether nothing passes through a node's triangle. The tree holds the segments from kept nodes.
    fn is_free(&mut self, corners: [u32; 3], kept: &[u32], tree: &BoxTree) -> bool {
        let nodes = self.thinned.nodes;
        let node = |k: u32| nodes[k as usize];
        let [a, b, c] = corners;
        if squared_distance(node(a), node(c)) > self.reach * self.reach {
            return false;
        }
        let [left, right, start, stop] = self.obstacles[b as usize];
        if start != stop && [left, right] == [a, c] && self.is_there(start, stop) {
            return false;
        }
        let triangle = Triangle::new(corners.map(node), self.scale);
        let mut obstacle = None;
        let mut pairs = self.pairs;
        let is_hit = |rank: usize| {
            pairs += 1;
            let start = kept[rank];
            let stop = self.next[start as usize];
            if start == a || start == b || !self.is_there(start, stop) {
                return false;
            }
            let is_hit = triangle.is_pierced(node(start), node(stop), [stop == a, start == c]);
            if is_hit {
                obstacle = Some([a, c, start, stop]);
            }
            is_hit
        };
        let is_free = !tree.any(&Bounds::about(&triangle.corners), 0, is_hit);
        self.pairs = pairs;
        self.obstacles[b as usize] = obstacle.unwrap_or_default();
        is_free
    }

    fn is_there(&self, start: u32, stop: u32) -> bool {
        self.thinned.ends[start as usize] == u32::MAX && self.next[start as usize] == stop
    }
}

struct Triangle {
    corners: [Point; 3],
    normal: Point,
    /// At least the longest edge.
    size: f64,
    /// Rounding of products of a coordinate and an edge.
    rounding: f64,
    /// Whether rounding cannot distinguish it from a straight stretch.
    is_flat: bool,
}

impl Triangle {
    fn new(corners: [Point; 3], scale: f64) -> Self {
        let [a, b, c] = corners;
        let size = norm(sub(b, a)) + norm(sub(c, a));
        let normal = cross(sub(b, a), sub(c, a));
        let rounding = ROUNDING * scale * size;
        Self { corners, normal, size, rounding, is_flat: norm(normal) <= rounding }
    }

    /// Returns whether a segment passes through, or so near that rounding cannot decide. `shared` holds whether it ends
    /// at the first corner, and whether it begins at the last.
    fn is_pierced(&self, p: Point, q: Point, shared: [bool; 2]) -> bool {
        let [a, b, c] = self.corners;
        if self.is_flat {
            // nothing fits into a straight stretch
            return false;
        }
        let height = |x: Point| {
            let from = sub(x, a);
            let height = dot(self.normal, from);
            if height.abs() <= self.rounding * (self.size + norm(from)) { 0.0 } else { height }
        };
        let turn = |from: Point, x: Point, y: Point| dot(self.normal, cross(sub(x, from), sub(y, from)));
        let inside = |from: Point, right: Point, left: Point, x: Point| {
            height(x) == 0.0 && turn(from, right, x) >= 0.0 && turn(from, x, left) >= 0.0
        };
        if shared[0] && shared[1] {
            return height(p) == 0.0 && height(q) == 0.0;
        }
        if shared[0] {
            return inside(a, b, c, p);
        }
        if shared[1] {
            return inside(c, a, b, q);
        }
        let (above, below) = (height(p), height(q));
        if above * below > 0.0 {
            return false;
        }
        let along = sub(q, p);
        if above == 0.0 && below == 0.0 {
            return ![(a, b), (b, c), (c, a)]
                .iter()
                .any(|&(x, y)| turn(x, y, p) < 0.0 && turn(x, y, q) < 0.0);
        }
        let slack = self.rounding * norm(along);
        let sides = [(a, b), (b, c), (c, a)].map(|(x, y)| dot(along, cross(sub(x, p), sub(y, p))));
        sides.iter().all(|&side| side >= -slack) || sides.iter().all(|&side| side <= slack)
    }
}

/// Returns the sum of the absolute coordinates, which is at least the length.
fn norm(p: Point) -> f64 {
    p[0].abs() + p[1].abs() + p[2].abs()
}
