//! The rays of a view that end in directions which callers ask about, and a grid of these directions.

use rayon::prelude::*;

use crate::clouds::depth::{Pinhole, has_return};
use crate::geometry::Point;
use crate::simd::{BATCH, Singles, kernel};

/// Directions farther than this from a view's middle are not gridded, tangents.
pub(super) const MAX_TANGENT: f64 = 3.0;
/// Points that one task projects.
const POINTS_PER_TASK: usize = 16384;
const PIXELS_AROUND: f64 = 2.0; // margin for rounding around the pixels that may see the asked directions

/// One camera's data.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Observed<'a> {
    /// Points in the camera frame, metres.
    Points(&'a [Point]),
    /// A depth image: depths row by row, metres; pixels in a row; the camera.
    Image(&'a [f64], usize, Pinhole),
}

/// Directions on the plane at distance 1 in front of a camera, perpendicular to the third axis.
pub(super) struct Window {
    pub(super) axes: [Point; 3],
    /// Corners of the box outside of which rays are dropped.
    pub(super) low: [f32; 2],
    pub(super) high: [f32; 2],
}

/// Directions in a window and squared distances from the camera; single precision is finer than any pixel.
pub(super) struct Rays {
    flat: [Vec<f32>; 2],
    squared: Vec<f32>,
    count: usize,
    /// Lanes of the corners of the box around the directions.
    low: [Singles; 2],
    high: [Singles; 2],
}

/// A square grid of directions.
#[derive(Clone, Copy)]
pub(super) struct Cells {
    low: [f32; 2],
    inverse: f32,
}

impl Observed<'_> {
    /// Returns the rays in a window, task by task.
    pub(super) fn rays(&self, window: &Window) -> Vec<Rays> {
        match *self {
            Self::Points(points) => {
                points.par_chunks(POINTS_PER_TASK).map(|points| project_points(window, points)).collect()
            }
            Self::Image(depth, width, camera) => {
                let width = width.max(1);
                let [columns, rows] = window.pixels(camera, [width, depth.len() / width]);
                let depth = &depth[rows.start * width..rows.end * width];
                let per_task = POINTS_PER_TASK.div_ceil(width);
                let project = |(task, depth): (usize, &[f64])| {
                    project_rows(window, depth, width, columns.clone(), rows.start + task * per_task, camera)
                };
                depth.par_chunks(per_task * width).enumerate().map(project).collect()
            }
        }
    }
}

impl Window {
    /// Returns the columns and rows of an image in which all pixels lie that see directions in the window.
    fn pixels(&self, camera: Pinhole, size: [usize; 2]) -> [std::ops::Range<usize>; 2] {
        let whole = size.map(|count| 0..count);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in 0..4 {
            let [a, b] = [0, 1].map(|k| f64::from([self.low, self.high][corner >> k & 1][k]));
            let towards: Point =
                std::array::from_fn(|k| a * self.axes[0][k] + b * self.axes[1][k] + self.axes[2][k]);
            let pixel = camera.pixel(towards);
            // the window reaches behind the image plane
            if towards[2] < 1e-6 || !pixel.iter().all(|x| x.is_finite()) {
                return whole;
            }
            for k in 0..2 {
                (low[k], high[k]) = (low[k].min(pixel[k]), high[k].max(pixel[k]));
            }
        }
        std::array::from_fn(|k| {
            let end = ((high[k] + PIXELS_AROUND).ceil().max(0.0) as usize).min(size[k]);
            ((low[k] - PIXELS_AROUND).floor().max(0.0) as usize).min(end)..end
        })
    }
}

kernel! {
    /// Makes the rays to points of the camera frame.
    fn project_points<S>(_, window: &Window, points: &[Point]) -> Rays {
        let mut rays = Rays::with_room(points.len());
        for points in points.chunks(BATCH) {
            let mut batch = [[0.0; BATCH]; 3];
            let mut there = [false; BATCH];
            for (l, p) in points.iter().enumerate() {
                for k in 0..3 {
                    batch[k][l] = p[k];
                }
                there[l] = true;
            }
            rays.add(window, &batch, &there);
        }
        rays.trimmed()
    }
}

kernel! {
    /// Makes the rays to what some columns of an image see, from row `first` on.
    fn project_rows<S>(
        _,
        window: &Window,
        depth: &[f64],
        width: usize,
        columns: std::ops::Range<usize>,
        first: usize,
        camera: Pinhole,
    ) -> Rays {
        let mut rays = Rays::with_room(depth.len() / width * columns.len());
        for (row, v) in depth.chunks_exact(width).zip(first..) {
            for (part, depth) in row[columns.clone()].chunks(BATCH).enumerate() {
                let u = columns.start + part * BATCH;
                let mut z = [0.0; BATCH];
                z[..depth.len()].copy_from_slice(depth);
                let mut batch = [[0.0; BATCH]; 3];
                let mut there = [false; BATCH];
                for l in 0..BATCH {
                    let point = camera.point((u + l) as f64, v as f64, z[l]);
                    for k in 0..3 {
                        batch[k][l] = point[k];
                    }
                    there[l] = has_return(z[l]);
                }
                rays.add(window, &batch, &there);
            }
        }
        rays.trimmed()
    }
}

impl Rays {
    fn with_room(count: usize) -> Self {
        let room = || vec![0.0; count + BATCH];
        let (low, high) = ([[f32::INFINITY; BATCH]; 2], [[f32::NEG_INFINITY; BATCH]; 2]);
        Self { flat: [room(), room()], squared: room(), count: 0, low, high }
    }

    /// Adds the rays to those of a batch of points that are there and in a window.
    #[inline(always)]
    fn add(&mut self, window: &Window, batch: &[[f64; BATCH]; 3], there: &[bool; BATCH]) {
        let Window { axes, low, high } = window;
        let mut flat = [[0.0; BATCH]; 2];
        let mut squared = [0.0; BATCH];
        let mut kept = [false; BATCH];
        for l in 0..BATCH {
            let [x, y, z] = [batch[0][l], batch[1][l], batch[2][l]];
            let depth = x * axes[2][0] + y * axes[2][1] + z * axes[2][2];
            let mut near = there[l] & (depth > 0.0);
            for k in 0..2 {
                let tangent = (x * axes[k][0] + y * axes[k][1] + z * axes[k][2]) / depth;
                flat[k][l] = tangent as f32;
                near &= (tangent.abs() < MAX_TANGENT) & (flat[k][l] > low[k]) & (flat[k][l] < high[k]);
            }
            squared[l] = (x * x + y * y + z * z) as f32;
            kept[l] = near;
        }
        if kept == [false; BATCH] {
            return;
        }
        for k in 0..2 {
            for l in 0..BATCH {
                let (low, high) = (&mut self.low[k][l], &mut self.high[k][l]);
                *low = if kept[l] & (flat[k][l] < *low) { flat[k][l] } else { *low };
                *high = if kept[l] & (flat[k][l] > *high) { flat[k][l] } else { *high };
            }
        }
        let count = self.count;
        let room = count..count + BATCH;
        let [first, second] = &mut self.flat;
        let (first, second) = (&mut first[room.clone()], &mut second[room.clone()]);
        let third = &mut self.squared[room];
        if kept == [true; BATCH] {
            first.copy_from_slice(&flat[0]);
            second.copy_from_slice(&flat[1]);
            third.copy_from_slice(&squared);
            self.count += BATCH;
            return;
        }
        let mut n = 0;
        for l in 0..BATCH {
            (first[n], second[n], third[n]) = (flat[0][l], flat[1][l], squared[l]);
            n += usize::from(kept[l]);
        }
        self.count += n;
    }

    fn trimmed(mut self) -> Self {
        let [first, second] = &mut self.flat;
        for values in [first, second, &mut self.squared] {
            values.truncate(self.count.next_multiple_of(BATCH));
        }
        self
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Returns the corners of the box around the directions, if there are any.
    pub(super) fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let corner = |lanes: &[Singles; 2], of: fn(f32, f32) -> f32| {
            [0, 1].map(|k| f64::from(lanes[k].iter().copied().fold(lanes[k][0], of)))
        };
        (self.count > 0).then(|| [corner(&self.low, f32::min), corner(&self.high, f32::max)])
    }

    /// Iterates over directions.
    pub(super) fn directions(&self) -> impl Iterator<Item = [f32; 2]> {
        let [first, second] = &self.flat;
        first.iter().zip(second).map(|(&x, &y)| [x, y]).take(self.count)
    }
}

kernel! {
    /// Marks the cells with rays; `width` cells make a row.
    pub(super) fn mark_taken<S>(_, rays: &Rays, cells: Cells, width: usize, taken: &mut [bool]) {
        let [x, y] = &rays.flat;
        for (i, (x, y)) in x.as_chunks().0.iter().zip(y.as_chunks().0).enumerate() {
            let numbers = cells.number_batch(x, y, width);
            for l in 0..BATCH.min(rays.count - i * BATCH) {
                taken[numbers[l] as usize] = true;
            }
        }
    }
}

kernel! {
    /// Lowers the squared distances of cells to those of their rays; `width` cells make a row.
    pub(super) fn lower_to_rays<S>(_, rays: &Rays, cells: Cells, width: usize, nearest: &mut [f32]) {
        let [x, y] = &rays.flat;
        let batches = x.as_chunks().0.iter().zip(y.as_chunks().0).zip(rays.squared.as_chunks::<BATCH>().0);
        for (i, ((x, y), squared)) in batches.enumerate() {
            let numbers = cells.number_batch(x, y, width);
            for l in 0..BATCH.min(rays.count - i * BATCH) {
                let least = &mut nearest[numbers[l] as usize];
                *least = if squared[l] < *least { squared[l] } else { *least };
            }
        }
    }
}

impl Cells {
    pub(super) fn new(low: [f64; 2], cell: f64) -> Self {
        Self { low: low.map(|x| x as f32), inverse: (1.0 / cell) as f32 }
    }

    /// Returns the row and column of a direction.
    #[inline]
    pub(super) fn of(&self, flat: [f32; 2]) -> [usize; 2] {
        [0, 1].map(|k| ((flat[k] - self.low[k]) * self.inverse) as usize)
    }

    /// Returns the numbers of directions' cells, counted row by row.
    #[inline(always)]
    fn number_batch(&self, x: &Singles, y: &Singles, width: usize) -> [u32; BATCH] {
        let mut numbers = [0u32; BATCH];
        for l in 0..BATCH {
            let row = ((x[l] - self.low[0]) * self.inverse) as u32;
            let column = ((y[l] - self.low[1]) * self.inverse) as u32;
            // what fills up a batch may lie anywhere
            numbers[l] = row.wrapping_mul(width as u32).wrapping_add(column);
        }
        numbers
    }
}
