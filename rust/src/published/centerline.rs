//! Axis points from surface points and normals (section IV-D, eq. 16–18).
//!
//! Sections and equations are those of *Shape Modeling of A String And Recognition Using Distance Sensor*.

use std::borrow::Cow;

use crate::checks::{check_finite, check_normals, check_positive, check_same_length};
use crate::error::Result;
use crate::geometry::{Point, advance, squared_distance, sub};
use crate::index::around::{Around, Carried, squared_distances};
use crate::index::bounds::Bounds;
use crate::index::cells::Cells;
use crate::index::hierarchy::crowded::{Crowded, Sum};
use crate::parallel;
use crate::parallel::Slots;
use crate::simd::{BATCH, Doubles, LANES, kernel};

const CELLS: f64 = 2.0; // cells within the reach of the average

/// Points on the rope's axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Centerline {
    /// c̄, the averaged axis points, metres.
    pub points: Vec<Point>,
    /// The index of the input point that each was computed at.
    pub indices: Vec<usize>,
}

/// Moves surface points inwards by the rope's radius and averages them: c_i = p_i − r n_i (eq. 16).
///
/// Where at least `min_neighbors` points p_j, p_i included, lie within 2r of p_i, the axis point c̄_i is the mean of
/// their c_j (eq. 17–18). Points with a zero normal take no part.
///
/// # Errors
/// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite, a normal is neither of unit length
/// nor zero, the lengths of the arrays differ, or `radius` is not positive.
pub fn centerline(
    points: &[Point],
    normals: &[Point],
    radius: f64,
    min_neighbors: usize,
) -> Result<Centerline> {
    check_finite("points", points)?;
    check_same_length("normals", normals.len(), "points", points.len())?;
    check_normals("normals", normals)?;
    check_positive("radius", radius)?;
    let partial = normals.contains(&[0.0; 3]);
    // the indices of the points that take part, if not all do
    let taking: Vec<u32> = match partial {
        true => (0..points.len()).filter(|&i| normals[i] != [0.0; 3]).map(|i| i as u32).collect(),
        false => Vec::new(),
    };
    let index = |i: usize| if partial { taking[i] as usize } else { i };
    let surface = match partial {
        true => Cow::Owned(taking.iter().map(|&i| points[i as usize]).collect()),
        false => Cow::Borrowed(points),
    };
    // NaN where there is no mean
    let mut means = vec![[0.0; 3]; surface.len()];
    let (slots, crowded) = (Slots::new(&mut means), Crowded::default());
    let reach = 2.0 * radius;
    let enough = |count: usize, mean: Point| if count >= min_neighbors { mean } else { [f64::NAN; 3] };
    parallel::run(|| {
        let cells = Cells::new_in_parts(&surface, reach / CELLS);
        let inward = |i: usize| {
            let i = index(i);
            advance(points[i], -radius, normals[i])
        };
        let axis = cells.gather_axes(inward);
        cells.batches().for_each_task(|around: &mut Around, batches| {
            for batch in batches {
                let Some((counts, means)) = average(&cells, &axis, reach, batch, around) else {
                    crowded.add(batch.iter().map(|&position| cells.input_index(position as usize)));
                    continue;
                };
                for (l, &position) in batch.iter().enumerate() {
                    let position = position as usize;
                    let mean = enough(counts[l], means[l]);
                    // SAFETY: every point is in one batch
                    unsafe { slots.put(cells.input_index(position), mean) };
                }
            }
        });
        drop((cells, axis));
        let carried = |i: usize| {
            let i = index(i);
            Mean { count: 1, base: points[i], mean: normals[i].map(|n| -radius * n) }
        };
        let mean = |found: Mean| enough(found.count, advance(found.base, 1.0, found.mean));
        // SAFETY: every point has one answer
        let put = |i: usize, &mean: &Point| unsafe { slots.put(i, mean) };
        crowded.answer(&surface, reach, carried, mean, put);
    });
    let found = |i: &usize| !means[*i][0].is_nan();
    let indices = (0..means.len()).filter(found).map(index).collect();
    means.retain(|mean| !mean[0].is_nan());
    Ok(Centerline { points: means, indices })
}

kernel! {
    /// For each point of a batch, counts the points within reach and averages their axis points; None where cells are
    /// crowded.
    fn average<S>(
        simd,
        cells: &Cells,
        axis: &Carried,
        reach: f64,
        batch: &[u32],
        around: &mut Around,
    ) -> Option<([usize; BATCH], [Point; BATCH])> {
        let places = cells.batch(batch);
        let frame = around.find_carried(simd, cells, &Bounds::of(&places), reach, axis)?;
        let lanes = frame.narrow(simd, &places);
        let lanes = [simd.load(&lanes[0]), simd.load(&lanes[1]), simd.load(&lanes[2])];
        let (low, high) = frame.limits(reach);
        let (low, high, one) = (simd.splat(low), simd.splat(high), simd.splat_whole(1));
        let (mut counts, mut unsure) = (simd.splat_whole(0), simd.mask(0));
        let (mut first, mut second) = ([simd.splat_half(0.0); 3], [simd.splat_half(0.0); 3]);
        let [x, y, z] = around.axes();
        for (((&x, &y), &z), c) in x.iter().zip(y).zip(z).zip(around.values()) {
            let squares = squared_distances(simd, x, y, z, lanes);
            let (within, maybe) = (simd.le(squares, low), simd.le(squares, high));
            unsure = simd.or(unsure, simd.xor(within, maybe));
            counts = simd.add_whole_if(within, counts, one);
            for (k, &c) in c.iter().enumerate() {
                let c = simd.splat_half(c);
                first[k] = simd.add_half_if(simd.half::<false>(within), first[k], c);
                second[k] = simd.add_half_if(simd.half::<true>(within), second[k], c);
            }
        }
        let (counts, unsure) = (simd.store_whole(counts), simd.bits(unsure));
        let sums: [[Doubles; 2]; 3] =
            std::array::from_fn(|k| [simd.store_half(first[k]), simd.store_half(second[k])]);
        let inside = around.inside();
        let mut result = ([0; BATCH], [[0.0; 3]; BATCH]);
        for (l, &position) in batch.iter().enumerate() {
            let (mut count, mut sum) = (counts[l] as usize, sums.map(|halves| halves[l / LANES][l % LANES]));
            if unsure & (1 << l) != 0 {
                (count, sum) = exactly(cells, position as usize, reach, around);
            }
            count += inside.count;
            result.0[l] = count;
            for k in 0..3 {
                result.1[l][k] = frame.origin[k] + (sum[k] + inside.sums[k]) / count as f64;
            }
        }
        Some(result)
    }
}

/// A mean of axis points, relative to one of the surface points: coordinates far from the origin would be too coarse.
#[derive(Clone, Copy)]
struct Mean {
    count: usize,
    base: Point,
    mean: Point,
}

impl Sum for Mean {
    fn and(self, other: Self) -> Self {
        let count = self.count + other.count;
        let share = other.count as f64 / count as f64;
        let apart = advance(sub(other.base, self.base), 1.0, sub(other.mean, self.mean));
        Self { count, base: self.base, mean: advance(self.mean, share, apart) }
    }
}

/// Counts the points within reach, of those that may be beyond it, and sums their axis points, with distances in double
/// precision.
#[cold]
fn exactly(cells: &Cells, position: usize, reach: f64, around: &Around) -> (usize, Point) {
    let center = cells.point(position);
    let (mut count, mut sum) = (0, [0.0; 3]);
    for (i, c) in around.positions().zip(around.values()) {
        if squared_distance(cells.point(i), center) <= reach * reach {
            count += 1;
            for k in 0..3 {
                sum[k] += c[k];
            }
        }
    }
    (count, sum)
}
