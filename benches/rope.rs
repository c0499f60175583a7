//! A depth camera's cloud of a rope, for benchmarks.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use strand::Point;

pub const RADIUS: f64 = 0.0042; // radius of the rope, metres
const PATCH: f64 = 0.0004 * 0.0004; // area of the surface for each point, square metres
const COIL: (f64, f64) = (0.1, 0.03); // radius of the coil, and its rise for each turn, metres

/// A depth camera's cloud of a rope, and the axis point of each point.
pub struct Rope {
    pub points: Vec<Point>,
    pub normals: Vec<Point>,
    pub axis: Vec<Point>,
}

impl Rope {
    /// Makes points anywhere on the surface, in random order, with 0.1 mm of noise along the normal.
    pub fn new(count: usize, mut random: impl FnMut() -> f64) -> Self {
        let length = count as f64 * PATCH / (TAU * RADIUS);
        let (radius, rise) = (COIL.0, COIL.1 / TAU);
        let per_radian = radius.hypot(rise);
        let mut rope = Self { points: Vec::with_capacity(count), normals: Vec::new(), axis: Vec::new() };
        for _ in 0..count {
            let turn = random() * length / per_radian;
            let (sine, cosine) = turn.sin_cos();
            let axis = Vector3::new(radius * cosine, radius * sine, rise * turn);
            let outward = Vector3::new(cosine, sine, 0.0);
            let along = Vector3::new(-radius * sine, radius * cosine, rise) / per_radian;
            let around = TAU * random();
            let normal = outward * around.cos() + along.cross(&outward) * around.sin();
            let noise = normal * (1e-4 * (random() + random() - 1.0));
            rope.points.push((axis + normal * RADIUS + noise).into());
            rope.normals.push(normal.into());
            rope.axis.push((axis + noise).into());
        }
        rope
    }
}
