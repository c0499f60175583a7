//! Eight numbers, and eight vectors, with operators.

use std::ops::{Add, Div, Mul, Sub};

use super::{LANES, Simd};

/// Eight single-precision numbers in memory.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub struct Lanes(pub [f32; LANES]);

impl Lanes {
    /// Puts one number into all lanes.
    pub const fn all(value: f32) -> Self {
        Self([value; LANES])
    }
}

/// Eight numbers to compute with; a [`Simd`] token makes them.
pub trait Eight:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Stores the numbers in memory.
    fn store(self) -> Lanes;
    /// Square roots.
    fn sqrt(self) -> Self;
    /// The greatest integers that are not greater.
    fn floor(self) -> Self;
    /// Absolute values.
    fn abs(self) -> Self;
    /// The larger of two numbers; `other` if this is NaN.
    fn max(self, other: Self) -> Self;
    /// The smaller of two numbers; `other` if this is NaN.
    fn min(self, other: Self) -> Self;
    /// 1 where this is less than the other number, else 0.
    fn below(self, other: Self) -> Self;
    /// 1 where this is not above the other number, else 0.
    fn not_above(self, other: Self) -> Self;
    /// The first number where this is not 0, else the second.
    fn choose(self, yes: Self, no: Self) -> Self;

    /// The sum of all lanes.
    #[inline(always)]
    fn sum(self) -> f64 {
        let mut sum = 0.0;
        for number in self.store().0 {
            sum += f64::from(number);
        }
        sum
    }
}

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
