//! Source points and their nearest target points, kept from pose to pose.
//!
//! A search also tells how near any other target point is at least. While the source point has moved by less than
//! what that leaves, its partner stays the nearest. After that one of the few that were near may have become the
//! nearest, and only where it has moved by more than what all others leave is searched again.

mod search;
mod sums;

use std::sync::OnceLock;

use nalgebra::SMatrix;
use rayon::prelude::*;

use crate::parallel::go_on;

use super::IcpOptions;
use crate::geometry::{Point, RigidMotion, centroid, squared_distance};
use crate::index::around::Around;
use crate::index::bounds::{Bounds, bounds};
use crate::index::cells::Cells;
use crate::index::hierarchy::Hierarchy;
use crate::index::reach::reach_of;
use crate::simd::{BATCH, LANES, kernel};
use search::search;
pub use sums::Pairs;
use sums::{TERMS, add_pairs};

/// A cell is so wide that about this many target points are within its width of each.
const NEAR: usize = 40;
/// Most target points that are kept of a source point's surroundings.
const LISTED: usize = 6;
/// Batches that a task works through; fixed, so that sums do not depend on the number of threads.
const BATCHES_PER_TASK: usize = 16;
/// Up to this many lanes of a batch are searched for alone; if there are more, all are.
const FEW: usize = 1;
/// All lanes.
const ALL: [usize; BATCH] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
/// No target point.
const NONE: u32 = u32::MAX;

/// Source points that are near each other.
struct Batch {
    count: usize,
    /// In the source's frame; lanes without a point repeat the first.
    points: [[f64; BATCH]; 3],
    /// Positions of the nearest target points in the order of the cells; none where they are out of reach.
    partners: [u32; BATCH],
    /// All other target points are farther than this.
    others: [f64; BATCH],
    /// Positions of target points that were near, the partner among them, and none behind the last.
    listed: [[u32; LISTED]; BATCH],
    /// All target points that are not listed are farther than this.
    beyond: [f64; BATCH],
}

/// Both clouds and the pairs.
pub struct Pairing {
    cells: Cells,
    /// The target in the order of the cells.
    sorted: Vec<Point>,
    tree: OnceLock<Hierarchy>,
    batches: Vec<Batch>,
    source_points: usize,
    reach: f64,
    /// Where the pairs were found.
    pose: RigidMotion,
    /// The source's middle, in its frame.
    center: Point,
    /// What rounding may move a point by.
    rounding: f64,
}

impl Pairing {
    /// Sorts both clouds, which are not empty.
    pub fn new(source: &[Point], target: &[Point], options: &IcpOptions) -> Self {
        let cells = Cells::new(target, reach_of(target, NEAR));
        let sorted = cells.sorted();
        // by where they are at first, because they will not go far
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
            pose: options.start,
            center,
            rounding,
        }
    }

    /// Finds the pairs at a pose.
    pub fn pair(&mut self, pose: &RigidMotion) -> Pairs {
        let origin = pose.apply(self.center);
        let mut batches = std::mem::take(&mut self.batches);
        let parts: Vec<[f64; TERMS]> = batches
            .par_chunks_mut(BATCHES_PER_TASK)
            .map_init(Around::default, |around, batches| {
                go_on();
                pair(self, batches, pose, origin, around)
            })
            .collect();
        self.batches = batches;
        self.pose = *pose;
        let mut sums = [0.0; TERMS];
        for part in parts {
            for (sum, part) in sums.iter_mut().zip(part) {
                *sum += part;
            }
        }
        Pairs::new(sums, origin, self.source_points)
    }

    /// Sums a matrix of the moved source point, the target point and its index over all pairs.
    pub fn sum<const R: usize, const C: usize>(
        &self,
        term: impl Fn(Point, Point, usize) -> SMatrix<f64, R, C> + Sync,
    ) -> SMatrix<f64, R, C> {
        let parts: Vec<SMatrix<f64, R, C>> = self
            .batches
            .par_chunks(BATCHES_PER_TASK)
            .map(|batches| {
                let mut sum = SMatrix::zeros();
                for batch in batches {
                    let moved = moved_to(&batch.points, &self.pose);
                    for l in 0..batch.count {
                        let moved = moved.map(|values| values[l]);
                        if let Some(&target) = self.sorted.get(batch.partners[l] as usize)
                            && squared_distance(target, moved) <= self.reach * self.reach
                        {
                            sum += term(moved, target, self.cells.input_index(batch.partners[l] as usize));
                        }
                    }
                }
                sum
            })
            .collect();
        parts.iter().sum()
    }

    /// Makes the nearest of the listed points the partner; tells whether none of the others may be one instead.
    #[inline(always)]
    fn choose(&self, batch: &mut Batch, l: usize, moved: Point) -> bool {
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

    /// The nearest target point by the tree, which is no farther than those in `known` positions.
    #[cold]
    fn search_tree(&self, moved: Point, known: [u32; 2]) -> (u32, f64) {
        let tree = self.tree.get_or_init(|| Hierarchy::new(self.sorted.iter().copied()));
        let mut limit = self.reach * self.reach;
        for target in known.iter().filter_map(|&position| self.sorted.get(position as usize)) {
            limit = limit.min(1.001 * squared_distance(*target, moved));
        }
        let nearest = tree.nearest(moved, limit);
        // that others are farther than nothing is always true
        (nearest.map_or(NONE, |position| position as u32), 0.0)
    }
}

kernel! {
    /// Moves the points of some batches, finds their partners and sums over the pairs.
    fn pair<S>(
        simd,
        pairing: &Pairing,
        batches: &mut [Batch],
        pose: &RigidMotion,
        origin: Point,
        around: &mut Around,
    ) -> [f64; TERMS] {
        let limit = pairing.reach * pairing.reach;
        let mut sums = [[0.0; LANES]; TERMS];
        for batch in batches {
            let moved = moved_to(&batch.points, pose);
            let steps = squares(&moved, &moved_to(&batch.points, &pairing.pose)).map(f64::sqrt);
            let mut targets = [[0.0; BATCH]; 3];
            for l in 0..BATCH {
                let partner = pairing.sorted.get(batch.partners[l] as usize).unwrap_or(&origin);
                for k in 0..3 {
                    targets[k][l] = partner[k];
                }
            }
            let apart = squares(&moved, &targets);
            let mut same = [true; BATCH];
            for l in 0..BATCH {
                batch.others[l] -= steps[l] + pairing.rounding;
                batch.beyond[l] -= steps[l] + pairing.rounding;
                let nearest = is_below(apart[l], batch.others[l]);
                // then it does not matter which is the nearest
                let none =
                    ((apart[l] > limit) | (batch.partners[l] == NONE)) & (pairing.reach < batch.others[l]);
                same[l] = (nearest & (batch.partners[l] != NONE)) | none;
            }
            let mut left = [0; BATCH];
            let mut count = 0;
            for l in 0..batch.count {
                left[count] = l;
                count += usize::from(!same[l]);
            }
            let mut open = [0; BATCH];
            let mut open_count = 0;
            for &l in &left[..count] {
                open[open_count] = l;
                let sure = pairing.choose(batch, l, [moved[0][l], moved[1][l], moved[2][l]]);
                open_count += usize::from(!sure);
            }
            if open_count > FEW {
                // then all of them: others would follow soon, and cost little more now
                (left, count) = (ALL, batch.count);
                (open, open_count) = (left, count);
            }
            if open_count > 0 {
                search(simd, pairing, batch, &moved, &open[..open_count], around);
            }
            for &l in &left[..count] {
                if let Some(&partner) = pairing.sorted.get(batch.partners[l] as usize) {
                    for k in 0..3 {
                        targets[k][l] = partner[k];
                    }
                }
            }
            let paired: [bool; BATCH] = std::array::from_fn(|l| batch.partners[l] != NONE && l < batch.count);
            for half in 0..BATCH / LANES {
                add_pairs(&mut sums, half, &moved, &targets, &paired, origin, limit);
            }
        }
        sums.map(|sum| sum.iter().sum())
    }
}

/// Where a pose puts the points of a batch.
#[inline(always)]
fn moved_to(points: &[[f64; BATCH]; 3], pose: &RigidMotion) -> [[f64; BATCH]; 3] {
    let (r, t) = (&pose.rotation, &pose.translation);
    let mut moved = [[0.0; BATCH]; 3];
    for k in 0..3 {
        let (r0, r1, r2, t) = (r[(k, 0)], r[(k, 1)], r[(k, 2)], t[k]);
        let [x, y, z] = points;
        let mut values = [0.0; BATCH];
        for l in 0..BATCH {
            values[l] = r0 * x[l] + r1 * y[l] + r2 * z[l] + t;
        }
        moved[k] = values;
    }
    moved
}

/// Squared distances between the points of the lanes.
#[inline(always)]
fn squares(a: &[[f64; BATCH]; 3], b: &[[f64; BATCH]; 3]) -> [f64; BATCH] {
    let mut squares = [0.0; BATCH];
    for l in 0..BATCH {
        let d = [a[0][l] - b[0][l], a[1][l] - b[1][l], a[2][l] - b[2][l]];
        squares[l] = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    }
    squares
}

/// Whether a squared distance is below a distance, which may be negative.
#[inline(always)]
fn is_below(square: f64, distance: f64) -> bool {
    let distance = distance.max(0.0);
    square < distance * distance
}
