//! Clouds and rigid motions that several tests of the kernels use.
#![allow(dead_code)] // every test binary uses a part of them

use std::f64::consts::TAU;

use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use strand::{Point, RigidMotion};

/// A place far from the origin, metres; nearby multiples of 1/8 are exact in binary.
pub const FAR_AWAY: Point = [1e5, -2e5, 3e5];

/// Configures proptest with the same `cases` in every run.
pub fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(20_240_607),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// Makes points as depth cameras and careless callers do: on a lattice (with duplicates, and distances that equal a
/// radius), on a plane, on a line, anywhere, and far out. Some clouds are far from the origin.
pub fn any_cloud(most: usize) -> impl Strategy<Value = Vec<Point>> {
    let lattice = prop::array::uniform3(-4i32..4).prop_map(|p| p.map(|x| f64::from(x) * 0.5));
    let plane = (-16i32..16, -16i32..16).prop_map(|(x, y)| [f64::from(x) * 0.125, f64::from(y) * 0.125, 0.5]);
    let line = (-16i32..16).prop_map(|x| [f64::from(x) * 0.125, 1.0, -1.0]);
    let free = prop::array::uniform3(-2.0f64..2.0);
    let far_out = prop::array::uniform3(-2.0f64..2.0).prop_map(|[x, y, z]| [x * 1e7, y, z]);
    let point = prop_oneof![6 => lattice, 4 => plane, 2 => line, 6 => free, 1 => far_out];
    let origin = prop_oneof![3 => Just([0.0; 3]), 1 => Just(FAR_AWAY)];
    (prop::collection::vec(point, 0..most), origin).prop_map(|(points, origin)| shifted(&points, origin))
}

/// Makes points in general position: no two distances are equal.
pub fn free_cloud(least: usize, most: usize) -> impl Strategy<Value = Vec<Point>> {
    prop::collection::vec(prop::array::uniform3(-1.0f64..1.0), least..most)
}

/// Returns a random order of `count` indices.
pub fn order(seed: u64, count: usize) -> Vec<usize> {
    let mut random = Random(seed);
    let mut order: Vec<usize> = (0..count).collect();
    for i in (1..count).rev() {
        order.swap(i, (random.uniform() * (i + 1) as f64) as usize);
    }
    order
}

/// Makes any rotation and a shift of some metres.
pub fn any_motion() -> impl Strategy<Value = RigidMotion> {
    (prop::array::uniform3(-2.0f64..2.0), prop::array::uniform3(-5.0f64..5.0)).prop_map(|(w, t)| motion(w, t))
}

/// Makes the motion that rotates by a rotation vector and then shifts.
pub fn motion(rotation: Point, translation: Point) -> RigidMotion {
    RigidMotion {
        rotation: Rotation3::new(Vector3::from(rotation)).into_inner(),
        translation: Vector3::from(translation),
    }
}

pub fn inverse(motion: &RigidMotion) -> RigidMotion {
    let rotation = motion.rotation.transpose();
    RigidMotion { rotation, translation: -(rotation * motion.translation) }
}

pub fn moved(points: &[Point], motion: &RigidMotion) -> Vec<Point> {
    points.iter().map(|&p| motion.apply(p)).collect()
}

pub fn shifted(points: &[Point], by: Point) -> Vec<Point> {
    points.iter().map(|p| [p[0] + by[0], p[1] + by[1], p[2] + by[2]]).collect()
}

pub fn scaled(points: &[Point], by: f64) -> Vec<Point> {
    points.iter().map(|p| p.map(|x| x * by)).collect()
}

pub fn reordered<T: Copy>(values: &[T], order: &[usize]) -> Vec<T> {
    order.iter().map(|&i| values[i]).collect()
}

pub fn distance(a: Point, b: Point) -> f64 {
    (Vector3::from(a) - Vector3::from(b)).norm()
}

/// Returns the sine of the angle between two unit vectors, regardless of their signs.
pub fn sine_between(a: Point, b: Point) -> f64 {
    Vector3::from(a).cross(&Vector3::from(b)).norm()
}

/// Pseudo-random numbers, the same in every run (splitmix64, Steele et al. 2014).
pub struct Random(pub u64);

impl Random {
    /// Returns a number in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a point in a cube of side 2 around the origin.
    pub fn point(&mut self) -> Point {
        std::array::from_fn(|_| 2.0 * self.uniform() - 1.0)
    }
}

/// Makes points and outward normals of a tube of radius 1 about the x axis, `length` long.
pub fn tube(count: usize, length: f64, seed: u64) -> (Vec<Point>, Vec<Point>) {
    let mut random = Random(seed);
    (0..count)
        .map(|_| {
            let (x, angle) = (length * random.uniform(), TAU * random.uniform());
            ([x, angle.cos(), angle.sin()], [0.0, angle.cos(), angle.sin()])
        })
        .unzip()
}

/// Makes points and unit normals of a smooth surface without symmetry, about 2 x 2.
pub fn hills(count: usize, seed: u64) -> (Vec<Point>, Vec<Point>) {
    let mut random = Random(seed);
    (0..count)
        .map(|_| {
            let [x, y, _] = random.point();
            let z = 0.3 * (2.0 * x + 0.5).sin() + 0.2 * (3.0 * y).cos() + 0.15 * (x - 2.0 * y).sin();
            let slope_x = 0.6 * (2.0 * x + 0.5).cos() + 0.15 * (x - 2.0 * y).cos();
            let slope_y = -0.6 * (3.0 * y).sin() - 0.3 * (x - 2.0 * y).cos();
            let normal: Point = Vector3::new(-slope_x, -slope_y, 1.0).normalize().into();
            ([x, y, z], normal)
        })
        .unzip()
}
