//! Arguments of kernels, made of bytes.

use nalgebra::{Rotation3, Vector3};

use crate::geometry::{Point, RigidMotion, advance, dot, normalized};

/// Numbers at which arithmetic changes.
const ODD: [f64; 16] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    5e-324,
    -1e-310,
    f64::MIN_POSITIVE,
    1e-160,
    1e-20,
    -0.0,
    1.0 + f64::EPSILON,
    4_503_599_627_370_497.0,
    1e15,
    9.9e99,
    1e100,
    -1e154,
    f64::MAX,
];

/// Bytes that are used up from the front; zeros follow the last one.
pub struct Bytes<'a>(pub &'a [u8]);

impl Bytes<'_> {
    pub fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// Returns a number below `count`, at most 256.
    pub fn below(&mut self, count: usize) -> usize {
        usize::from(self.byte()) % count
    }

    pub fn flag(&mut self) -> bool {
        self.byte() & 1 == 1
    }

    fn steps(&mut self) -> f64 {
        f64::from(i16::from_le_bytes([self.byte(), self.byte()]))
    }

    /// Returns a power of two, over all of double precision.
    fn power(&mut self) -> f64 {
        2f64.powi(8 * i32::from(self.byte() as i8))
    }

    /// Returns a number from −8 to 8, or one that is odd or of any size.
    pub fn number(&mut self) -> f64 {
        match self.byte() {
            0..=219 => self.steps() / 4096.0,
            220..=239 => self.steps() * self.power(),
            odd => ODD[usize::from(odd & 15)],
        }
    }

    /// Returns a number from −8 to 8.
    pub fn ordinary(&mut self) -> f64 {
        self.steps() / 4096.0
    }

    /// Returns a number from 0 to 8, or one that is odd.
    pub fn length(&mut self) -> f64 {
        self.number().abs()
    }

    pub fn point(&mut self) -> Point {
        [self.number(), self.number(), self.number()]
    }

    pub fn ordinary_point(&mut self) -> Point {
        [self.ordinary(), self.ordinary(), self.ordinary()]
    }

    pub fn unit(&mut self) -> Point {
        let d = self.ordinary_point();
        if dot(d, d) > 0.0 { normalized(d) } else { [0.0, 0.0, 1.0] }
    }

    /// Returns a rigid motion; every second one turns nothing.
    pub fn motion(&mut self) -> RigidMotion {
        let turned = self.flag();
        let turn = if turned { self.ordinary_point() } else { [0.0; 3] };
        RigidMotion { rotation: Rotation3::new(turn.into()).into_inner(), translation: self.point().into() }
    }

    /// Returns a rigid motion by at most 14 m.
    pub fn ordinary_motion(&mut self) -> RigidMotion {
        let translation = Vector3::from(self.ordinary_point());
        RigidMotion { translation, ..self.motion() }
    }

    /// Returns up to `most` points: a lattice, a path, points that repeat, of any size, anywhere, or odd.
    pub fn points(&mut self, most: usize) -> Vec<Point> {
        let (kind, count) = (self.byte(), self.below(most + 1));
        let scale = if kind & 2 > 0 { self.power() } else { 1.0 };
        let offset = if kind & 4 > 0 { self.point() } else { [0.0; 3] };
        let mut points: Vec<Point> = Vec::with_capacity(count);
        for _ in 0..count {
            let own = match kind & 1 {
                0 => std::array::from_fn(|_| f64::from(self.byte() as i8) / 16.0),
                _ if kind & 64 > 0 => self.point(),
                _ => self.ordinary_point(),
            };
            let mut place = advance(offset, scale, own);
            if let (true, Some(&before)) = (kind & 16 > 0, points.last()) {
                place = advance(before, 0.25 * scale, own);
            }
            if kind & 8 > 0 && !points.is_empty() && self.flag() {
                place = points[self.below(256) % points.len()];
            }
            points.push(place);
        }
        points
    }
}

/// Panics unless all coordinates are finite.
pub fn require_finite<const N: usize>(points: &[[f64; N]]) {
    assert!(points.as_flattened().iter().all(|x| x.is_finite()), "not finite: {points:?}");
}

/// Returns the largest coordinate; infinity if one is NaN.
pub fn largest(points: &[Point]) -> f64 {
    points
        .as_flattened()
        .iter()
        .fold(0.0, |most, x| if x.abs() <= most { most } else { x.abs().min(f64::INFINITY) })
}
