//! The rays of a view that end in directions which callers ask about, and a grid of these directions.

use rayon::prelude::*;

use crate::clouds::depth::{Pinhole, has_return};
use crate::geometry::Point;
use crate::simd::{BATCH, kernel};

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
#[derive(Default)]
pub(super) struct Rays {
    flat: [Vec<f32>; 2],
    squared: Vec<f32>,
    count: usize,
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
        Self { flat: [room(), room()], squared: room(), count: 0 }
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
        let count = self.count;
        let room = count..count + BATCH;
        let [first, second] = &mut self.flat;
        let (first, second) = (&mut first[room.clone()], &mut second[room.clone()]);
        let third = &mut self.squared[room];
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
            values.truncate(self.count);
        }
        self
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Returns the corners of the box around the directions, if there are any.
    pub(super) fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let most = |values: &[f32], of: fn(f32, f32) -> f32| values.iter().copied().reduce(of);
        let corner = |of| {
            let [first, second] = &self.flat;
            Some([f64::from(most(first, of)?), f64::from(most(second, of)?)])
        };
        Some([corner(f32::min)?, corner(f32::max)?])
    }

    /// Calls `visit` with the cell of each ray, its row and column, and its squared distance.
    #[inline]
    pub(super) fn visit(&self, cells: Cells, mut visit: impl FnMut([usize; 2], f32)) {
        let [first, second] = &self.flat;
        for ((&x, &y), &squared) in first.iter().zip(second).zip(&self.squared) {
            visit(cells.of([x, y]), squared);
        }
    }
}

impl Cells {
    pub(super) fn new(low: [f64; 2], cell: f64) -> Self {
        Self { low: low.map(|x| x as f32), inverse: (1.0 / cell) as f32 }
    }

    #[inline]
    pub(super) fn of(&self, flat: [f32; 2]) -> [usize; 2] {
        [0, 1].map(|k| ((flat[k] - self.low[k]) * self.inverse) as usize)
    }
}
