//! Source points in batches, with their partners among the target points.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::lists::{LISTED, List, NONE};
use super::near::Near;
use super::sums::TERMS;
use crate::geometry::{Point, RigidMotion, centroid, squared_distance};
use crate::icp::options::IcpOptions;
use crate::index::cells::Cells;
use crate::index::halves::halve;
use crate::index::hierarchy::Hierarchy;
use crate::index::reach::reach_of;
use crate::simd::{BATCH, Singles, prefetch};

const NEAR: usize = 40; // target points within a cell's width of each target point, about

/// Batches that one task works on; fixed, so that sums do not depend on the number of threads.
pub const BATCHES_PER_TASK: usize = 8;
const CACHED: usize = 8192; // source points whose lists stay in the cache of a core
const MAX_BUFFERS: usize = 64; // buffers at most: more would not stay in the cache

/// Batches that a thread pairs in turn.
pub struct Task {
    pub batches: Vec<Batch>,
    /// The list of each batch.
    pub lists: Vec<List>,
    /// Sums over the pairs at the last pose.
    pub sums: [f64; TERMS],
}

/// Source points near each other; registers of numbers begin with lines of the cache.
#[repr(align(64))]
pub struct Batch {
    pub count: usize,
    /// Source frame; lanes without a point repeat the first.
    pub points: [[f64; BATCH]; 3],
    /// Nearest target points, far from everything if they are out of reach.
    pub targets: [[f64; BATCH]; 3],
    /// Their positions in the cells' order as the bits of floats; NONE if they are out of reach.
    pub partners: Singles,
    /// Places of the last search, in the target's frame.
    pub anchors: [[f64; BATCH]; 3],
    /// Places where the partner was chosen.
    pub last: [Singles; 3],
    /// All other target points are farther from there than this.
    pub others: Singles,
    /// All target points that are not listed are farther from the anchor than this.
    pub beyond: Singles,
    /// Largest rounding error of a distance.
    pub rounding: Singles,
}

impl Batch {
    /// Returns the points, moved by a pose.
    #[inline(always)]
    pub fn moved_to(&self, pose: &RigidMotion) -> [[f64; BATCH]; 3] {
        // one axis after the other: a loop over the axes would be compiled to scattered stores
        [self.moved_along(0, pose), self.moved_along(1, pose), self.moved_along(2, pose)]
    }

    #[inline(always)]
    fn moved_along(&self, axis: usize, pose: &RigidMotion) -> [f64; BATCH] {
        let (r, t) = (&pose.rotation, pose.translation[axis]);
        let (r0, r1, r2) = (r[(axis, 0)], r[(axis, 1)], r[(axis, 2)]);
        let [x, y, z] = &self.points;
        let mut values = [0.0; BATCH];
        for l in 0..BATCH {
            values[l] = r0 * x[l] + r1 * y[l] + r2 * z[l] + t;
        }
        values
    }

    /// Returns bits of the lanes with a point of their own.
    #[inline(always)]
    pub fn lanes(&self) -> u32 {
        (1u32 << self.count) - 1
    }

    /// Returns the place of the last search of a lane.
    #[inline(always)]
    pub fn anchor(&self, l: usize) -> Point {
        [self.anchors[0][l], self.anchors[1][l], self.anchors[2][l]]
    }
}

/// Two clouds and their pairs.
pub struct Pairing {
    pub cells: Cells,
    /// The target in the order of the cells.
    pub sorted: Vec<Point>,
    tree: OnceLock<Hierarchy>,
    pub tasks: Vec<Task>,
    /// Buffers of stretches of tasks, kept from pose to pose.
    pub buffers: Vec<Near>,
    pub source_points: usize,
    /// Whether lists and targets leave the cache between poses.
    pub is_large: bool,
    /// The middle of the source, in its frame.
    pub center: Point,
    /// The pose before the last.
    pub before: RigidMotion,
    /// The last pose.
    pub pose: RigidMotion,
    pub reach: f64,
    /// Cells' widths in a metre.
    pub unit: f64,
    /// A little more than the reach, in single precision and cells.
    pub within: f32,
}

impl Pairing {
    /// Sorts two clouds with points.
    pub fn new(source: &[Point], target: &[Point], options: &IcpOptions) -> Self {
        let (cells, near_each_other) =
            rayon::join(|| Cells::new(target, reach_of(target, NEAR)), || halve(source));
        let sorted = cells.sorted();
        let batch = |indices: &[u32]| {
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
                targets: [[f64::INFINITY; BATCH]; 3],
                partners: [f32::from_bits(NONE); BATCH],
                anchors: points,
                last: [[0.0; BATCH]; 3],
                others: [-1.0; BATCH],
                beyond: [-1.0; BATCH],
                rounding: [0.0; BATCH],
            }
        };
        let tasks: Vec<Task> = near_each_other
            .par_chunks(BATCHES_PER_TASK * BATCH)
            .map(|some| Task {
                batches: some.chunks(BATCH).map(batch).collect(),
                lists: vec![List::EMPTY; some.len().div_ceil(BATCH)],
                sums: [0.0; TERMS],
            })
            .collect();
        let reach = options.max_correspondence_distance;
        let unit = 1.0 / cells.size();
        Self {
            cells,
            sorted,
            tree: OnceLock::new(),
            buffers: (0..tasks.len().min(MAX_BUFFERS)).map(|_| Near::default()).collect(),
            tasks,
            source_points: source.len(),
            is_large: source.len() > CACHED,
            center: centroid(source),
            before: options.start,
            pose: options.start,
            reach,
            unit,
            within: (reach * unit * (1.0 + 1e-6)) as f32,
        }
    }

    /// Returns the position of the nearest of some target points, the first in the cells' order among equals; NONE if
    /// there is none.
    #[cold]
    pub fn nearest_of(&self, positions: [u32; LISTED], moved: Point) -> u32 {
        let (mut best, mut nearest) = (f64::INFINITY, NONE);
        for position in positions {
            let Some(&target) = self.sorted.get(position as usize) else { continue };
            let square = squared_distance(target, moved);
            if square < best || (square == best && position < nearest) {
                (best, nearest) = (square, position);
            }
        }
        nearest
    }

    /// Asks for the places of the partners of some lanes.
    #[inline(always)]
    pub fn prefetch_targets(&self, batch: &Batch, mut lanes: u32) {
        while lanes != 0 {
            let l = lanes.trailing_zeros() as usize % BATCH;
            lanes &= lanes - 1;
            if let Some(target) = self.sorted.get(batch.partners[l].to_bits() as usize) {
                prefetch(target);
            }
        }
    }

    /// Notes the places of the partners of some lanes.
    #[inline(always)]
    pub fn take_targets(&self, batch: &mut Batch, mut lanes: u32) {
        while lanes != 0 {
            let l = lanes.trailing_zeros() as usize % BATCH;
            lanes &= lanes - 1;
            let target = self.target(batch.partners[l].to_bits()).unwrap_or([f64::INFINITY; 3]);
            for k in 0..3 {
                batch.targets[k][l] = target[k];
            }
        }
    }

    /// Returns the target point at a position, None for no point.
    #[inline(always)]
    pub fn target(&self, position: u32) -> Option<Point> {
        self.sorted.get(position as usize).copied()
    }

    /// Finds the nearest target point by the tree; it is no farther than those at the `known` positions.
    #[cold]
    pub fn search_tree(&self, moved: Point, known: [u32; 2]) -> u32 {
        let tree = self.tree.get_or_init(|| Hierarchy::new(self.sorted.iter().copied()));
        let mut limit = self.reach * self.reach;
        for target in known.iter().filter_map(|&position| self.target(position)) {
            limit = limit.min(1.001 * squared_distance(target, moved));
        }
        tree.nearest(moved, limit).map_or(NONE, |position| position as u32)
    }
}
