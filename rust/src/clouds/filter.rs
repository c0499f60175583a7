//! The outlier filter: drops points with too few neighbours within a searching radius (section IV-A).
//!
//! Sections and equations are those of *Shape Modeling of A String And Recognition Using Distance Sensor*.

use crate::checks::{check_finite, check_positive};
use crate::error::Result;
use crate::geometry::{Point, squared_distance};
use crate::index::around::{Around, squared_distances};
use crate::index::bounds::Bounds;
use crate::index::cells::Cells;
use crate::index::hierarchy::crowded::Crowded;
use crate::parallel;
use crate::parallel::Slots;
use crate::simd::{Singles, kernel};

/// Returns which points have at least `min_neighbors` other points within `radius`, metres.
///
/// Points on the boundary count, and coincident points count each other. An empty cloud gives an empty mask.
///
/// # Errors
/// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite or `radius` is not positive.
///
/// ```
/// let points = [[0.0; 3], [0.01, 0.0, 0.0], [1.0, 0.0, 0.0]];
/// assert_eq!(strand::radius_outlier_mask(&points, 0.02, 1)?, [true, true, false]);
/// # Ok::<(), strand::Error>(())
/// ```
pub fn radius_outlier_mask(points: &[Point], radius: f64, min_neighbors: usize) -> Result<Vec<bool>> {
    check(points, radius)?;
    // the point itself is found as well
    let wanted = min_neighbors.saturating_add(1);
    let known = |surely, maybe| ((surely >= wanted) == (maybe >= wanted)).then_some(surely >= wanted);
    Ok(map(points, radius, known, |count| count >= wanted))
}

/// Counts the other points within `radius` of each point.
///
/// # Errors
/// As [`radius_outlier_mask`].
pub fn count_neighbors(points: &[Point], radius: f64) -> Result<Vec<usize>> {
    check(points, radius)?;
    let known = |surely, maybe| (surely == maybe).then(|| surely - 1);
    Ok(map(points, radius, known, |count| count - 1))
}

fn check(points: &[Point], radius: f64) -> Result<()> {
    check_finite("points", points)?;
    check_positive("radius", radius)
}

const CELLS: f64 = 1.0; // width of a cell, radii

/// Answers for each point from the number of points within the radius, the point itself included.
///
/// `known` may answer early from lower and upper limits of that number.
fn map<T: Send + Copy + Default>(
    points: &[Point],
    radius: f64,
    known: impl Fn(usize, usize) -> Option<T> + Sync + Send,
    answer: impl Fn(usize) -> T + Sync + Send,
) -> Vec<T> {
    let mut answers = vec![T::default(); points.len()];
    let (slots, crowded) = (Slots::new(&mut answers), Crowded::default());
    parallel::run(|| {
        let cells = Cells::new(points, radius / CELLS);
        cells.batches().for_each_task(|around: &mut Around, batches| {
            for batch in batches {
                let Some(counts) = count_around(&cells, radius, batch, around) else {
                    crowded.add(batch.iter().map(|&position| cells.input_index(position as usize)));
                    continue;
                };
                for (l, &position) in batch.iter().enumerate() {
                    let position = position as usize;
                    let value = known(counts[0][l] as usize, counts[1][l] as usize)
                        .unwrap_or_else(|| answer(exactly(&cells, position, radius, around)));
                    // SAFETY: every point is in one batch
                    unsafe { slots.put(cells.input_index(position), value) };
                }
            }
        });
        drop(cells);
        // SAFETY: every point has one answer
        let put = |i: usize, &value: &T| unsafe { slots.put(i, value) };
        crowded.answer(points, radius, |_| 1, &answer, put);
    });
    answers
}

kernel! {
    /// For each point of a batch, counts the points that are certainly within a radius, and those that may be; None
    /// where cells are crowded.
    fn count_around<S>(
        simd,
        cells: &Cells,
        radius: f64,
        batch: &[u32],
        around: &mut Around,
    ) -> Option<[Singles; 2]> {
        let places = cells.batch(batch);
        let frame = around.find(simd, cells, &Bounds::of(&places), radius)?;
        let lanes = frame.narrow(simd, &places);
        let lanes = [simd.load(&lanes[0]), simd.load(&lanes[1]), simd.load(&lanes[2])];
        let (low, high) = frame.limits(radius);
        let (low, high) = (simd.splat(low), simd.splat(high));
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        let (mut surely, mut maybe) = (zero, zero);
        let [x, y, z] = around.axes();
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            let squares = squared_distances(simd, x, y, z, lanes);
            surely = simd.select(simd.le(squares, low), simd.add(surely, one), surely);
            maybe = simd.select(simd.le(squares, high), simd.add(maybe, one), maybe);
        }
        Some([simd.store(surely), simd.store(maybe)])
    }
}

/// Counts the points within a radius in double precision.
#[cold]
fn exactly(cells: &Cells, position: usize, radius: f64, around: &Around) -> usize {
    let center = cells.point(position);
    around.positions().filter(|&i| squared_distance(cells.point(i), center) <= radius * radius).count()
}
