//! Source points in batches, with their partners among the target points.

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::geometry::{Point, centroid, squared_distance};
use crate::icp::options::IcpOptions;
use crate::index::bounds::{Bounds, bounds};
use crate::index::cells::Cells;
use crate::index::hierarchy::Hierarchy;
use crate::index::reach::reach_of;
use crate::simd::BATCH;

const NEAR: usize = 40; // target points within a cell's width of each target point, about
pub const LISTED: usize = 6; // near target points that are kept for a source point, at most
pub const NONE: u32 = u32::MAX; // stands for no target point

/// Source points near each other.
pub struct Batch {
    pub count: usize,
    /// Source frame; lanes without a point repeat the first.
    pub points: [[f64; BATCH]; 3],
    /// The same at the last pose.
    pub moved: [[f64; BATCH]; 3],
    /// Positions of the nearest target points in the cells' order; NONE if they are out of reach.
    pub partners: [u32; BATCH],
    /// All other target points are farther than this.
    pub others: [f64; BATCH],
    /// Positions of near target points, the partner among them, padded with NONE.
    pub listed: [[u32; LISTED]; BATCH],
    /// All target points that are not listed are farther than this.
    pub beyond: [f64; BATCH],
}

/// Two clouds and their pairs.
pub struct Pairing {
    pub cells: Cells,
    /// The target in the order of the cells.
    pub sorted: Vec<Point>,
    tree: OnceLock<Hierarchy>,
    pub batches: Vec<Batch>,
    pub source_points: usize,
    pub reach: f64,
    /// The middle of the source, in its frame.
    pub center: Point,
    /// Largest rounding error of a moved point.
    pub rounding: f64,
}

impl Pairing {
    /// Sorts two clouds with points.
    pub fn new(source: &[Point], target: &[Point], options: &IcpOptions) -> Self {
        let cells = Cells::new(target, reach_of(target, NEAR));
        let sorted = cells.sorted();
        // sorted by their places at the start pose, because they will not move far
        let moved: Vec<Point> = source.par_iter().map(|&x| options.start.apply(x)).collect();
        let largest = |points: &[Point]| {
            let Bounds { low, high } = bounds(points);
            low.iter().chain(&high).fold(0.0, |most: f64, x| most.max(x.abs()))
        };
        let rounding = 16.0 * f64::EPSILON * largest(source).max(largest(target)).max(largest(&moved));
        let places = Cells::new(&moved, cells.size());
        let near_each_other: Vec<Vec<u32>> = if places.is_crowded() {
            Hierarchy::new(moved.iter().copied()).order().chunks(BATCH).map(<[u32]>::to_vec).collect()
        } else {
            let index = |&position: &u32| places.input_index(position as usize) as u32;
            places.batches().iter().map(|positions| positions.iter().map(index).collect()).collect()
        };
        let batches = near_each_other
            .into_iter()
            .map(|indices| {
                let mut points = [[0.0; BATCH]; 3];
                for l in 0..BATCH {
                    let x = source[*indices.get(l).unwrap_or(&indices[0]) as usize];
                    for k in 0..3 {
                        points[k][l] = x[k];
                    }
                }
                Batch {
                    count: indices.len(),
                    points,
                    moved: points,
                    partners: [NONE; BATCH],
                    others: [-1.0; BATCH],
                    listed: [[NONE; LISTED]; BATCH],
                    beyond: [-1.0; BATCH],
                }
            })
            .collect();
        let reach = options.max_correspondence_distance;
        let center = centroid(source);
        Self {
            cells,
            sorted,
            tree: OnceLock::new(),
            batches,
            source_points: source.len(),
            reach,
            center,
            rounding,
        }
    }

    /// Makes the nearest listed point the partner; returns whether no other point can be nearer.
    #[inline(always)]
    pub fn choose(&self, batch: &mut Batch, l: usize, moved: Point) -> bool {
        let (mut best, mut position, mut next) = (f64::INFINITY, NONE, f64::INFINITY);
        for &listed in &batch.listed[l] {
            let Some(&target) = self.sorted.get(listed as usize) else { break };
            let square = squared_distance(target, moved);
            next = next.min(best.max(square));
            let nearer = square < best || (square == best && listed < position);
            position = if nearer { listed } else { position };
            best = best.min(square);
        }
        batch.partners[l] = position;
        batch.others[l] = next.sqrt().min(batch.beyond[l]);
        let none = best > self.reach * self.reach && self.reach < batch.beyond[l];
        none || (position != NONE && is_below(best, batch.beyond[l]))
    }

    /// Finds the nearest target point by the tree; it is no farther than those at the `known` positions.
    #[cold]
    pub fn search_tree(&self, moved: Point, known: [u32; 2]) -> (u32, f64) {
        let tree = self.tree.get_or_init(|| Hierarchy::new(self.sorted.iter().copied()));
        let mut limit = self.reach * self.reach;
        for target in known.iter().filter_map(|&position| self.sorted.get(position as usize)) {
            limit = limit.min(1.001 * squared_distance(*target, moved));
        }
        let nearest = tree.nearest(moved, limit);
        // a lower bound of zero for the distance to others is always true
        (nearest.map_or(NONE, |position| position as u32), 0.0)
    }
}

/// Returns whether a squared distance is below the square of a distance; false if that is negative.
#[inline(always)]
pub fn is_below(square: f64, distance: f64) -> bool {
    let distance = distance.max(0.0);
    square < distance * distance
}
