//! The operations of an instruction set.

use super::eight::Eight;
use super::lanes::{BATCH, Doubles, LANES, Lanes, Singles, Whole};

/// A token for an instruction set, and its operations. No number may be NaN, except in an [`Eight`] and a half
/// batch.
pub trait Simd: Copy {
    /// Eight single-precision numbers with operators.
    type Eight: Eight;
    /// A batch in single precision.
    type F: Copy;
    /// A half batch in double precision.
    type D: Copy;
    /// A batch of integers.
    type I: Copy;
    /// Masks of a batch and of a half batch.
    type M: Copy;
    type H: Copy;

    /// Whether there are enough registers to sum many terms over a whole batch.
    const MANY_REGISTERS: bool;

    /// Loads eight numbers from memory.
    fn load8(self, x: &Lanes) -> Self::Eight;
    /// Puts one number into eight lanes.
    fn splat8(self, x: f32) -> Self::Eight;
    /// Stores eight rows of eight numbers column by column.
    fn transpose8(self, rows: [Self::Eight; LANES]) -> [Lanes; LANES];

    fn load(self, x: &Singles) -> Self::F;
    fn store(self, x: Self::F) -> Singles;
    fn splat(self, x: f32) -> Self::F;
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// The smaller of two numbers, lane by lane.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The larger of two numbers, lane by lane.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// Square roots.
    fn sqrt(self, x: Self::F) -> Self::F;
    /// A mask of the lanes where a ≤ b.
    fn le(self, a: Self::F, b: Self::F) -> Self::M;
    /// Takes a in the lanes of the mask, b in the others.
    fn select(self, mask: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// Converts coordinates to single precision, relative to an origin and in units.
    fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> Self::F;
    /// As [`Simd::narrow`], each coordinate relative to an origin of its own.
    fn narrow_each(self, x: &[f64; BATCH], origins: &[f64; BATCH], unit: f64) -> Self::F;
    /// Packs the lanes of some bits at the start of `to`, which has room for a batch.
    fn compress(self, bits: u32, x: Self::F, to: &mut [f32]);

    /// Makes a mask of bits, the lowest for the first lane.
    fn mask(self, bits: u32) -> Self::M;
    /// Returns the bits of a mask.
    fn bits(self, mask: Self::M) -> u32;
    /// The lanes of either mask.
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    /// The lanes of exactly one of two masks.
    fn xor(self, a: Self::M, b: Self::M) -> Self::M;
    /// The first or the second half of a mask.
    fn half<const SECOND: bool>(self, mask: Self::M) -> Self::H;

    fn splat_whole(self, x: i32) -> Self::I;
    fn store_whole(self, x: Self::I) -> Whole;
    /// Adds x in the lanes of the mask.
    fn add_whole_if(self, mask: Self::M, a: Self::I, x: Self::I) -> Self::I;

    fn load_half(self, x: &Doubles) -> Self::D;
    fn store_half(self, x: Self::D) -> Doubles;
    fn splat_half(self, x: f64) -> Self::D;
    fn add_half(self, a: Self::D, b: Self::D) -> Self::D;
    fn sub_half(self, a: Self::D, b: Self::D) -> Self::D;
    fn mul_half(self, a: Self::D, b: Self::D) -> Self::D;
    /// Takes `yes` where a < b, else `no`.
    fn choose_half(self, a: Self::D, b: Self::D, yes: Self::D, no: Self::D) -> Self::D;
    /// Converts to single precision.
    fn narrow_half(self, x: Self::D) -> Self::Eight;
    /// The bits of the lanes where a < b, the lowest for the first lane; not where one is NaN.
    fn lt_half(self, a: Self::D, b: Self::D) -> u32;
    /// Adds x in the lanes of the mask.
    fn add_half_if(self, mask: Self::H, a: Self::D, x: Self::D) -> Self::D;
}
