//! Axis points from surface points and normals (section IV-D, eq. 16–18).

use std::borrow::Cow;

use crate::error::{Result, check_finite, check_normals, check_positive, check_same_length};
use crate::geometry::{advance, squared_distance, sub};
use crate::index::around::{Around, squared_distances};
use crate::index::cells::Cells;
use crate::parallel::Slots;
use crate::wide::{self, BATCH, LANES, Simd, Wide};
use crate::{Point, parallel};

/// Cells to the reach of the average.
const CELLS: f64 = 2.0;

/// Points of the string's axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Centerline {
    /// c̄, the averaged axis points, metres.
    pub points: Vec<Point>,
    /// Which input point each of them was computed at.
    pub indices: Vec<usize>,
}

/// Moves every surface point inwards by the string's radius, c_i = p_i − r n_i (eq. 16), and averages: where at
/// least `min_neighbors` points p_j lie within 2r of p_i (p_i itself is one), c̄_i is the mean of their c_j
/// (eq. 17–18).
///
/// Points whose normal is the zero vector take no part.
///
/// # Errors
/// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite, a normal is neither of
/// unit length nor zero, the lengths of the arrays differ, or `radius` is not positive.
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
    let indices: Vec<usize> = (0..points.len()).filter(|&i| normals[i] != [0.0; 3]).collect();
    let surface = match indices.len() == points.len() {
        true => Cow::Borrowed(points),
        false => Cow::Owned(indices.iter().map(|&i| points[i]).collect()),
    };
    let mut means = vec![None; surface.len()];
    let slots = Slots::new(&mut means);
    parallel::run(|| {
        let cells = Cells::new(&surface, 2.0 * radius / CELLS);
        let axis = cells.gather(|i| advance(surface[i], -radius, normals[indices[i]]));
        cells.batches().for_each_task(|batches| {
            let (mut around, mut near) = (Around::default(), Vec::new());
            for batch in batches {
                let (near, around) = (&mut near, &mut around);
                let averages =
                    Averages { cells: &cells, axis: &axis, reach: 2.0 * radius, batch, around, near };
                let (counts, means) = wide::run(averages);
                for (l, &position) in batch.iter().enumerate() {
                    let position = position as usize;
                    let mean = (counts[l] >= min_neighbors).then_some(means[l]);
                    // SAFETY: every point is in one batch
                    unsafe { slots.put(cells.input_index(position), mean) };
                }
            }
        });
    });
    let count = means.iter().flatten().count();
    let mut found = Centerline { points: Vec::with_capacity(count), indices: Vec::with_capacity(count) };
    for (mean, i) in means.into_iter().zip(indices) {
        if let Some(mean) = mean {
            found.points.push(mean);
            found.indices.push(i);
        }
    }
    Ok(found)
}

/// Numbers of the points within a reach of each point of a batch, and the means of their axis points.
struct Averages<'a> {
    cells: &'a Cells,
    /// The axis point c of each point, in the cells' order.
    axis: &'a [Point],
    reach: f64,
    batch: &'a [u32],
    around: &'a mut Around,
    /// Axis points relative to the batch.
    near: &'a mut Vec<Point>,
}

impl Wide for Averages<'_> {
    type Output = ([usize; BATCH], [Point; BATCH]);

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> ([usize; BATCH], [Point; BATCH]) {
        let Self { cells, axis, reach, batch, around, near } = self;
        let frame = around.find_apart::<S, true>(simd, cells, &cells.bounds(batch), reach);
        let origin = frame.origin;
        near.clear();
        near.extend(around.positions().map(|i| sub(axis[i], origin)));
        // what is in reach of all points of the batch, in several sums, so that one need not wait for the other
        let mut parts = [[0.0; 3]; 4];
        let (fours, rest) = around.inside().as_chunks::<4>();
        for four in fours {
            for (part, number) in parts.iter_mut().zip(four) {
                let c = axis[number.to_bits() as usize];
                for k in 0..3 {
                    part[k] += c[k] - origin[k];
                }
            }
        }
        for number in rest {
            let c = axis[number.to_bits() as usize];
            for k in 0..3 {
                parts[0][k] += c[k] - origin[k];
            }
        }
        let inside = around.inside().len();
        let mut inside_sum = [0.0; 3];
        for k in 0..3 {
            inside_sum[k] = (parts[0][k] + parts[1][k]) + (parts[2][k] + parts[3][k]);
        }
        let lanes = frame.lanes(batch.iter().map(|&position| cells.point(position as usize)));
        let lanes = [simd.load(&lanes[0]), simd.load(&lanes[1]), simd.load(&lanes[2])];
        let (low, high) = frame.limits(reach);
        let (low, high, one) = (simd.splat(low), simd.splat(high), simd.splat(1.0));
        let (mut surely, mut maybe) = (simd.splat(0.0), simd.splat(0.0));
        let (mut first, mut second) = ([simd.zero(); 3], [simd.zero(); 3]);
        let [x, y, z] = around.axes();
        for (((&x, &y), &z), c) in x.iter().zip(y).zip(z).zip(&*near) {
            let squares = squared_distances(simd, x, y, z, lanes);
            let within = simd.le(squares, low);
            surely = simd.select(within, simd.add(surely, one), surely);
            maybe = simd.select(simd.le(squares, high), simd.add(maybe, one), maybe);
            for k in 0..3 {
                first[k] = simd.add_if(simd.half::<false>(within), first[k], c[k]);
                second[k] = simd.add_if(simd.half::<true>(within), second[k], c[k]);
            }
        }
        let (surely, maybe) = (simd.store(surely), simd.store(maybe));
        let mut sums = [[0.0; 3]; BATCH];
        for k in 0..3 {
            let halves = [simd.store_half(first[k]), simd.store_half(second[k])];
            for l in 0..BATCH {
                sums[l][k] = halves[l / LANES][l % LANES];
            }
        }
        let mut counts = surely.map(|count| count as usize);
        for (l, &position) in batch.iter().enumerate() {
            if surely[l] != maybe[l] {
                (counts[l], sums[l]) = exactly(cells, position as usize, reach, around, near);
            }
            counts[l] += inside;
            for k in 0..3 {
                sums[l][k] += inside_sum[k];
            }
        }
        // the sums are relative to the batch
        let means =
            std::array::from_fn(|l| std::array::from_fn(|k| origin[k] + sums[l][k] / counts[l] as f64));
        (counts, means)
    }
}

/// The number of points within a reach, of those that may be beyond, and the sum of their axis points, in double
/// precision.
#[cold]
fn exactly(cells: &Cells, position: usize, reach: f64, around: &Around, near: &[Point]) -> (usize, Point) {
    let center = cells.point(position);
    let (mut count, mut sum) = (0, [0.0; 3]);
    for (i, c) in around.positions().zip(near) {
        if squared_distance(cells.point(i), center) <= reach * reach {
            count += 1;
            for k in 0..3 {
                sum[k] += c[k];
            }
        }
    }
    (count, sum)
}
