//! Eight vectors, with operators.

use std::ops::{Add, Mul, Sub};

use super::eight::Eight;
use super::lanes::Lanes;
use super::set::Simd;

/// Eight vectors, coordinate by coordinate.
#[derive(Clone, Copy)]
pub struct Three<V>(pub [V; 3]);

impl<V: Eight> Three<V> {
    /// Puts one vector into all lanes.
    #[inline(always)]
    pub fn all(simd: impl Simd<Eight = V>, vector: [f32; 3]) -> Self {
        Self([simd.splat8(vector[0]), simd.splat8(vector[1]), simd.splat8(vector[2])])
    }

    /// Loads vectors from memory.
    #[inline(always)]
    pub fn load(simd: impl Simd<Eight = V>, vectors: &[Lanes; 3]) -> Self {
        Self([simd.load8(&vectors[0]), simd.load8(&vectors[1]), simd.load8(&vectors[2])])
    }

    /// Dot products.
    #[inline(always)]
    pub fn dot(self, other: Self) -> V {
        self.0[0] * other.0[0] + self.0[1] * other.0[1] + self.0[2] * other.0[2]
    }

    /// Cross products.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
    }

    /// Unit vectors; 0 for vectors without length.
    #[inline(always)]
    pub fn unit(self, simd: impl Simd<Eight = V>) -> Self {
        self * (simd.splat8(1.0) / self.dot(self).sqrt().max(simd.splat8(f32::MIN_POSITIVE)))
    }
}

impl<V: Eight> Add for Three<V> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1], self.0[2] + other.0[2]])
    }
}

impl<V: Eight> Sub for Three<V> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self([self.0[0] - other.0[0], self.0[1] - other.0[1], self.0[2] - other.0[2]])
    }
}

impl<V: Eight> Mul<V> for Three<V> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, scale: V) -> Self {
        Self([self.0[0] * scale, self.0[1] * scale, self.0[2] * scale])
    }
}
