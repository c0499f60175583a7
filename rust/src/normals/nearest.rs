//! Planes fitted to the k nearest points.

use std::num::NonZeroUsize;
use std::sync::OnceLock;

use super::planes::{Answers, Covariances, covariance};
use super::sums::Sums;
use crate::error::{Error, Result};
use crate::geometry::{Moments, Point, Symmetric3, squared_distance, sub};
use crate::index::Tree;
use crate::index::around::Around;
use crate::index::bounds::Bounds;
use crate::index::cells::Cells;
use crate::index::reach::reach_of;
use crate::parallel;
use crate::simd::{BATCH, Simd, Singles, kernel};

const WIDTH: f64 = 2.0; // width of a cell, distances of the k-th neighbour
const FIRST_REACH: f64 = 1.4; // reach of the first search, distances of the k-th neighbour
const MAX_REACH: f64 = 5.0; // reach of the last search, cells; the tree finds the neighbours of much sparser points
/// Points that a search meets at most, for each neighbour; the tree finds the neighbours of much denser points.
const MAX_MET: usize = 64;
const ALL: u32 = (1 << BATCH) - 1; // a bit for each lane
const MAX_ROUNDS: usize = 24; // rounds of the search for the k-th distance at most

/// Fits a plane to the `k` nearest points of each point.
pub(super) fn fit(points: &[Point], k: usize, answers: &Answers) -> Result<()> {
    let count = NonZeroUsize::new(k)
        .filter(|k| k.get() >= 3)
        .ok_or_else(|| Error::invalid("k", format!("expected at least 3 neighbours, got {k}")))?;
    if points.is_empty() {
        return Ok(());
    }
    if points.len() < k {
        return Err(Error::not_enough(
            "points",
            format!("{} points, fewer than the k = {k} neighbours asked for", points.len()),
        ));
    }
    parallel::run(|| {
        let cells = Cells::new_in_parts(points, WIDTH * reach_of(points, k));
        let tree = OnceLock::new();
        cells.batches().for_each_task(|(search, covariances): &mut (Search, Covariances), batches| {
            for batch in batches {
                search.left.clear();
                search.left.extend(batch);
                let mut reach = FIRST_REACH / WIDTH * cells.size();
                while !search.left.is_empty()
                    && reach <= MAX_REACH * cells.size()
                    && search.widen(&cells, k, reach, covariances)
                {
                    reach *= 1.5;
                }
                // the last point's neighbours are also near the next point, though farther away
                let mut known: Option<(Point, f64)> = None;
                for &position in &search.left {
                    let tree: &Tree = tree.get_or_init(|| Tree::new(points));
                    let center = cells.point(position as usize);
                    let limit = known.map_or(f64::INFINITY, |(before, farthest)| {
                        1.001 * (farthest + squared_distance(center, before).sqrt()).powi(2)
                            + f64::MIN_POSITIVE
                    });
                    let mut moments = Moments::default();
                    let mut farthest = 0.0f64;
                    for i in tree.nearest(center, count, limit) {
                        moments.add(sub(points[i], center));
                        farthest = farthest.max(squared_distance(points[i], center));
                    }
                    known = Some((center, farthest.sqrt()));
                    covariances.add(position as usize, covariance(&moments));
                }
            }
            covariances.fit(&cells, answers);
        });
    });
    Ok(())
}

/// Buffers that a task reuses from batch to batch.
#[derive(Default)]
struct Search {
    /// Positions of points whose neighbours are not found yet.
    left: Vec<u32>,
    around: Around,
    sums: Sums,
}

/// Whether the k nearest points of a point are known.
#[derive(Clone, Copy, PartialEq)]
enum Cut {
    /// They are the points within the lane's limit.
    Clear,
    /// Single precision does not decide which they are.
    Close,
    /// There may be nearer points beyond the reach.
    Beyond,
}

impl Search {
    /// Searches for the neighbours of the remaining points up to a reach; returns false if there are too many points.
    fn widen(&mut self, cells: &Cells, k: usize, reach: f64, covariances: &mut Covariances) -> bool {
        let Some(cuts) = sum_nearest(self, cells, k, reach) else { return false };
        let Self { left, around, sums } = self;
        let mut kept = 0;
        for l in 0..left.len() {
            let position = left[l] as usize;
            let found = match cuts[l] {
                Cut::Clear => sums.covariance(l).or_else(|| exactly(cells, position, k, reach, around)),
                Cut::Close => exactly(cells, position, k, reach, around),
                Cut::Beyond => None,
            };
            match found {
                Some(covariance) => covariances.add(position, covariance),
                None => {
                    left[kept] = left[l];
                    kept += 1;
                }
            }
        }
        left.truncate(kept);
        true
    }
}

kernel! {
    /// Sums over the nearest points of each remaining point, up to a reach; None if there are too many points.
    fn sum_nearest<S>(
        simd,
        search: &mut Search,
        cells: &Cells,
        k: usize,
        reach: f64,
    ) -> Option<[Cut; BATCH]> {
        let Search { left, around, sums } = search;
        let places = cells.batch(left);
        let frame = around.find(simd, cells, &Bounds::of(&places), reach)?;
        if around.count() > MAX_MET * k {
            return None;
        }
        if around.count() < k {
            return Some([Cut::Beyond; BATCH]);
        }
        // points beyond the reach are certainly farther than this
        let (farthest, _) = frame.limits(reach);
        let within = sums.measure(simd, around, &frame.narrow(simd, &places), farthest);
        // a gap of twice the rounding error decides
        let margin = 2.0 * frame.rounding;
        let k = k as f32;
        let at = cut(simd, sums, k, farthest, &within, margin);
        let count = sums.add(simd, cells, &frame, &places, &at);
        Some(std::array::from_fn(|l| {
            if within[l] < k {
                Cut::Beyond
            } else if count[l] == k && at[l] <= farthest {
                Cut::Clear
            } else {
                Cut::Close
            }
        }))
    }
}

/// Finds in each lane a number between the k-th and the next squared distance, a margin from one of them.
///
/// Counts the distances below some number, which gives the answer if they are `k`, one more or one fewer. Otherwise
/// uses false position, with halving where that is slow. Starts with the `farthest` and the counts `within` it. Where
/// several points are as far as the k-th, it returns their distance; where it finds no number, a negative one.
#[inline(always)]
fn cut<S: Simd>(simd: S, sums: &Sums, k: f32, farthest: f32, within: &Singles, margin: f32) -> Singles {
    let [one_fewer, one_more, middle] = [k - 1.0, k + 1.0, k + 0.5].map(|count| simd.splat(count));
    let (half, one, margin) = (simd.splat(0.5), simd.splat(1.0), simd.splat(margin));
    let within = simd.load(within);
    let (mut low, mut low_count) = (simd.splat(0.0), simd.splat(0.0));
    let (mut high, mut high_count) = (simd.splat(farthest), within);
    let mut at = simd.mul(high, simd.min(simd.div(simd.splat(k), within), one));
    let mut found = simd.bits(simd.le(within, one_fewer));
    for round in 1..=MAX_ROUNDS {
        let [count, largest, least] = sums.count_below(simd, at);
        let (fewer, more) = (simd.le(count, one_fewer), simd.le(one_more, count));
        (low, low_count) =
            (simd.select(fewer, least, low), simd.select(fewer, simd.add(count, one), low_count));
        (high, high_count) = (simd.select(more, largest, high), simd.select(more, count, high_count));
        let kth = simd.select(fewer, least, largest);
        let beside = simd.select(more, simd.sub(largest, margin), simd.add(kth, margin));
        let share = simd.div(simd.sub(middle, low_count), simd.sub(high_count, low_count));
        let share = if round % 3 == 0 { half } else { share };
        let next = simd.add(low, simd.mul(simd.sub(high, low), share));
        let hit = simd.bits(simd.le(one_fewer, count)) & simd.bits(simd.le(count, one_more));
        at = simd.select(simd.mask(found), at, simd.select(simd.mask(hit), beside, next));
        // the k-th distance is one of several equal ones
        let equal = simd.bits(simd.le(high, low));
        found |= hit | equal;
        if found == ALL {
            break;
        }
    }
    // nothing is below this
    simd.store(simd.select(simd.mask(found), at, simd.splat(-1.0)))
}

/// Returns the covariance of the k nearest points in double precision, the first in the cells' order among equals; None
/// if points beyond the reach may be nearer.
#[cold]
fn exactly(cells: &Cells, position: usize, k: usize, reach: f64, around: &Around) -> Option<Symmetric3> {
    let center = cells.point(position);
    let mut near: Vec<(f64, usize)> =
        around.positions().map(|i| (squared_distance(cells.point(i), center), i)).collect();
    let (_, last, _) = near.select_nth_unstable_by(k - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    if last.0 > reach * reach {
        return None;
    }
    // in order, so that the sums do not depend on the selection
    near[..k].sort_unstable_by_key(|&(_, i)| i);
    let mut moments = Moments::default();
    for &(_, i) in &near[..k] {
        moments.add(sub(cells.point(i), center));
    }
    Some(covariance(&moments))
}
