//! Eight numbers with operators.

use std::ops::{Add, Div, Mul, Sub};

use super::lanes::Lanes;

/// Eight numbers to compute with; a [`Simd`](super::Simd) token makes them.
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
