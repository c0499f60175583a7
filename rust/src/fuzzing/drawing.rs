//! Depth images and masks of ropes, made of bytes.

use super::bytes::Bytes;
use crate::clouds::depth::Pinhole;
use crate::geometry::Point;

/// Ropes on a table that faces the camera.
pub struct Scene {
    pub size: [usize; 2],
    pub depth: Vec<f64>,
    pub mask: Vec<bool>,
    /// Columns and rows of each rope's nodes.
    pub strokes: Vec<Vec<[f64; 2]>>,
    /// Radius of the ropes, pixels.
    pub radius_px: f64,
    pub camera: Pinhole,
    /// Depth of the ropes' axes, metres.
    pub axis: f64,
}

impl Scene {
    /// Draws up to three ropes; some pixels are changed.
    pub fn new(bytes: &mut Bytes<'_>) -> Self {
        let size = [16 + bytes.below(40), 12 + bytes.below(30)];
        let radius_px = 0.25 + bytes.below(24) as f64 / 6.0;
        let camera =
            Pinhole { focal: [30.0 + bytes.below(64) as f64; 2], center: [0.5 * size[0] as f64, 8.0] };
        let axis = 0.2 + bytes.below(128) as f64 / 100.0;
        let strokes: Vec<Vec<[f64; 2]>> = (0..1 + bytes.below(3))
            .map(|_| {
                let mut at = [0, 1].map(|k| bytes.below(size[k]) as f64);
                let mut stroke = vec![at];
                for _ in 0..1 + bytes.below(8) {
                    at = at.map(|x| x + f64::from(bytes.byte() as i8) / 8.0);
                    stroke.push(at);
                }
                stroke
            })
            .collect();
        let radius = radius_px * axis / camera.focal[0];
        let pixels = size[0] * size[1];
        let (mut depth, mut mask) = (vec![axis + radius; pixels], vec![false; pixels]);
        for k in 0..pixels {
            let place = [(k % size[0]) as f64, (k / size[0]) as f64];
            let off =
                strokes.iter().map(|stroke| measure_distance(place, stroke)).fold(f64::INFINITY, f64::min);
            if off <= radius_px {
                mask[k] = true;
                depth[k] = axis - radius * (1.0 - (off / radius_px).powi(2)).sqrt();
            }
        }
        for _ in 0..bytes.below(32) {
            let (k, many) = (bytes.below(256) * 256 + bytes.below(256), 1 + bytes.below(40));
            let (value, own) = (bytes.number(), bytes.below(4));
            for k in (0..many).map(|more| (k + more) % pixels) {
                match own {
                    0 => mask[k] = !mask[k],
                    1 => depth[k] = 0.0,
                    2 => depth[k] = value,
                    _ => depth[k] += 0.01 * value,
                }
            }
        }
        Self { size, depth, mask, strokes, radius_px, camera, axis }
    }

    /// The ropes' radius, metres.
    pub fn radius(&self) -> f64 {
        self.radius_px * self.axis / self.camera.focal[0]
    }

    /// Returns `count` places along a rope's axis, camera frame, metres.
    pub fn nodes(&self, rope: usize, count: usize) -> Vec<Point> {
        let stroke = &self.strokes[rope];
        let place = |i: usize| {
            let at = i as f64 / (count - 1) as f64 * (stroke.len() - 1) as f64;
            let k = (at as usize).min(stroke.len() - 2);
            let [u, v] = [0, 1].map(|c| stroke[k][c] + (at - k as f64) * (stroke[k + 1][c] - stroke[k][c]));
            self.camera.point(u, v, self.axis)
        };
        (0..count).map(place).collect()
    }
}

/// Returns the distance of a place from a polyline.
fn measure_distance(place: [f64; 2], stroke: &[[f64; 2]]) -> f64 {
    let from = |pair: &[[f64; 2]]| {
        let step = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
        let off = [place[0] - pair[0][0], place[1] - pair[0][1]];
        let square = step[0] * step[0] + step[1] * step[1];
        let along = if square > 0.0 { (off[0] * step[0] + off[1] * step[1]) / square } else { 0.0 };
        let along = along.clamp(0.0, 1.0);
        (off[0] - along * step[0]).hypot(off[1] - along * step[1])
    };
    stroke.windows(2).map(from).fold(f64::INFINITY, f64::min)
}
