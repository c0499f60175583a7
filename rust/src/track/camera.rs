//! What one camera shows at one time: its pixels of ropes, and what stands before a place.

use nalgebra::Vector3;

use crate::clouds::depth::Pinhole;
use crate::geometry::{Point, RigidMotion};

/// Pixels of ropes that are used at most; more than these are thinned evenly.
const MAX_PIXELS: usize = 6000;

/// One image with its camera. `depth` is in metres, 0 without return; images are row by row.
pub struct Camera<'a> {
    pub depth: &'a [f64],
    /// Whether a pixel shows a rope.
    pub mask: &'a [bool],
    /// Whether a pixel shows the robot or a hand.
    pub occluders: Option<&'a [bool]>,
    pub width: usize,
    pub pinhole: Pinhole,
    /// Camera to world.
    pub pose: RigidMotion,
    /// Time of the image after that of the answer, s.
    pub delay: f64,
    /// Depth that the camera adds to every surface, metres.
    pub bias: f64,
}

/// A pixel of a rope.
#[derive(Clone, Copy)]
pub struct Pixel {
    pub u: f64,
    pub v: f64,
    /// Depth, metres.
    pub z: f64,
}

/// What a pixel shows.
#[derive(Clone, Copy, PartialEq)]
pub enum Shown {
    /// Nothing: outside the image, or without depth.
    Unknown,
    /// The robot or a hand, at an unknown depth.
    Occluder,
    /// A rope at a depth, metres; 0 without return.
    Rope(f64),
    /// Something else at a depth, metres.
    Other(f64),
}

impl Camera<'_> {
    pub fn height(&self) -> usize {
        self.depth.len() / self.width.max(1)
    }

    /// Turns a place of the world into the camera's frame.
    pub fn see(&self, p: Point) -> Point {
        (self.pose.rotation.transpose() * (Vector3::from(p) - self.pose.translation)).into()
    }

    /// Turns a direction of the camera's frame into the world.
    pub fn turn(&self, d: Point) -> Point {
        (self.pose.rotation * Vector3::from(d)).into()
    }

    /// Turns a direction of the world into the camera's frame.
    pub fn turn_back(&self, d: Point) -> Point {
        (self.pose.rotation.transpose() * Vector3::from(d)).into()
    }

    /// Returns column and row of a place of the camera's frame, pixels.
    pub fn project(&self, p: Point) -> [f64; 2] {
        let ([fx, fy], [cx, cy]) = (self.pinhole.focal, self.pinhole.center);
        [p[0] / p[2] * fx + cx, p[1] / p[2] * fy + cy]
    }

    /// Returns the place of the camera's frame that a pixel shows at a depth.
    pub fn lift(&self, u: f64, v: f64, z: f64) -> Point {
        self.pinhole.point(u, v, z)
    }

    /// Returns the index of the pixel at a column and a row.
    pub fn index(&self, u: f64, v: f64) -> Option<usize> {
        let (u, v) = (u.round(), v.round());
        let inside = u >= 0.0 && v >= 0.0 && u < self.width as f64 && v < self.height() as f64;
        inside.then(|| v as usize * self.width + u as usize)
    }

    /// Returns what a pixel shows.
    pub fn shown(&self, index: Option<usize>) -> Shown {
        let Some(i) = index else { return Shown::Unknown };
        if self.occluders.is_some_and(|occluders| occluders[i]) {
            return Shown::Occluder;
        }
        match (self.mask[i], self.depth[i]) {
            (true, z) => Shown::Rope(z),
            (false, z) if z > 0.0 => Shown::Other(z),
            _ => Shown::Unknown,
        }
    }

    /// Tells whether a pixel shows something nearer than a depth, metres.
    pub fn is_before(&self, index: Option<usize>, z: f64) -> bool {
        match self.shown(index) {
            Shown::Occluder => true,
            Shown::Rope(seen) | Shown::Other(seen) => seen > 0.0 && seen < z,
            Shown::Unknown => false,
        }
    }

    /// Counts the pixels within `reach` pixels of a place, on every other row and column, that show something nearer than a
    /// depth, metres: anything below `far`, or what is no rope below `near`.
    pub fn count_before(&self, [u, v]: [f64; 2], reach: f64, far: f64, near: f64) -> [usize; 2] {
        let steps = reach.ceil() as i64;
        let mut counts = [0; 2];
        for down in (-steps..=steps).step_by(2) {
            for right in (-steps..=steps).step_by(2) {
                match self.shown(self.index(u + right as f64, v + down as f64)) {
                    Shown::Occluder => counts = counts.map(|count| count + 1),
                    Shown::Rope(z) if z > 0.0 && z < far => counts[0] += 1,
                    Shown::Other(z) => {
                        counts[0] += usize::from(z < far);
                        counts[1] += usize::from(z < near);
                    }
                    _ => {}
                }
            }
        }
        counts
    }

    /// Lists the ropes' pixels with depth, and how many each stands for.
    pub fn read(&self) -> (Vec<Pixel>, f64) {
        let mut found = Vec::new();
        for (v, row) in self.mask.chunks_exact(self.width.max(1)).enumerate() {
            for (u, _) in row.iter().enumerate().filter(|(_, is_rope)| **is_rope) {
                let i = v * self.width + u;
                let free = self.occluders.is_none_or(|occluders| !occluders[i]);
                if self.depth[i] > 0.0 && free {
                    found.push(Pixel { u: u as f64, v: v as f64, z: self.depth[i] });
                }
            }
        }
        let count = found.len();
        if count > MAX_PIXELS {
            let share = MAX_PIXELS as f64 / count as f64;
            found.retain(|pixel| scramble(pixel.u as u64, pixel.v as u64) < share);
        }
        let each = count as f64 / found.len().max(1) as f64;
        (found, each)
    }
}

/// Returns a number from 0 to 1 that belongs to a pixel, so that thinning has no pattern.
fn scramble(u: u64, v: u64) -> f64 {
    let mut x = (u << 32 | v).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x ^= x >> 32;
    x = x.wrapping_mul(0xd6e8_feb8_6659_fd93);
    (x >> 11) as f64 / (1u64 << 53) as f64
}
