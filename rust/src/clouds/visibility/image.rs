//! What a depth image shows of directions: its own pixels are looked up.

use std::ops::{Deref, Range};
use std::sync::Arc;

use crate::clouds::depth::{Pinhole, has_return};
use crate::geometry::{Point, dot};

pub(super) const MIN_POINTS: usize = 16; // points of a view at least; a view with fewer knows nothing
const REACH: f64 = 0.7; // distance from a direction at which pixels count, pixels between neighboring returns
const BLOCK: usize = 3; // side of the blocks in which returns are counted, pixels
const EVERY: usize = 4; // of so many rows of blocks one is counted

/// Depths row by row, metres.
pub(crate) type Depths = Arc<dyn Deref<Target = [f64]> + Send + Sync>;

/// A depth image.
#[derive(Clone)]
pub(crate) struct ImageView {
    pub depth: Depths,
    /// Pixels in a row.
    pub width: usize,
    pub camera: Pinhole,
}

/// A depth image that knows how far its returns are apart.
pub(super) struct ImageSight {
    view: ImageView,
    /// How far from a direction pixels count, pixels.
    reach: f64,
}

impl ImageView {
    fn height(&self) -> usize {
        self.depth.len() / self.width.max(1)
    }

    /// Returns the pixels around points that are in front of the camera; None if the image shows none of them.
    fn pixels_around(&self, points: &[Point]) -> Option<[Range<usize>; 2]> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &p in points.iter().filter(|p| p[2] > 0.0) {
            let pixel = self.camera.pixel(p);
            for k in 0..2 {
                (low[k], high[k]) = (low[k].min(pixel[k]), high[k].max(pixel[k]));
            }
        }
        let size = [self.width, self.height()];
        let ranges =
            [0, 1].map(|k| (low[k].max(0.0) as usize)..((high[k] + 1.0).max(0.0) as usize).min(size[k]));
        ranges.iter().all(|range| range.start < range.end).then_some(ranges)
    }
}

impl ImageSight {
    /// Takes a view; None if it has hardly any returns around the points that callers ask about.
    pub(super) fn new(view: &ImageView, about: &[Point]) -> Option<Self> {
        let [columns, rows] = view.pixels_around(about)?;
        let (mut returns, mut blocks) = (0, 0);
        for top in rows.clone().step_by(BLOCK * EVERY) {
            let bottom = (top + BLOCK).min(rows.end);
            for left in columns.clone().step_by(BLOCK) {
                let right = (left + BLOCK).min(columns.end);
                let of_row = |v: usize| view.depth[v * view.width + left..v * view.width + right].iter();
                let count = (top..bottom).flat_map(of_row).filter(|&&z| has_return(z)).count();
                returns += count;
                blocks += usize::from(count > 0) * (bottom - top) * (right - left);
            }
        }
        if returns == 0 || about.len() < MIN_POINTS {
            return None;
        }
        // where pixels without return are scattered among others, those farther away count too
        let spacing = (blocks as f64 / returns as f64).sqrt();
        Some(Self { view: view.clone(), reach: REACH * spacing })
    }

    /// Returns the least distance from the camera in the direction of a point of its frame, infinite without returns;
    /// None outside the image.
    pub(super) fn nearest(&self, towards: Point) -> Option<f64> {
        let ImageView { depth, width, camera } = &self.view;
        if towards[2] <= 0.0 {
            return None;
        }
        let pixel = camera.pixel(towards);
        let size = [*width, self.view.height()];
        if !(0..2).all(|k| pixel[k] >= -0.5 && pixel[k] < size[k] as f64 - 0.5) {
            return None;
        }
        let [columns, rows] = [0, 1].map(|k| {
            let first = (pixel[k] - self.reach).ceil().max(0.0) as usize;
            first..((pixel[k] + self.reach).floor() as usize + 1).min(size[k])
        });
        let mut nearest = f64::INFINITY;
        for v in rows {
            for u in columns.clone() {
                let z = depth[v * width + u];
                if has_return(z) {
                    let seen = camera.point(u as f64, v as f64, z);
                    nearest = nearest.min(dot(seen, seen));
                }
            }
        }
        Some(nearest.sqrt())
    }
}
