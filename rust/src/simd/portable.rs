//! Portable code: loops that the compiler may vectorize itself.

use std::ops::{Add, Div, Mul, Sub};

use super::eight::Eight;
use super::lanes::{BATCH, Doubles, LANES, Lanes, Singles, Whole};
use super::set::Simd;

/// A token that anyone may make.
#[derive(Clone, Copy)]
pub struct Portable;

impl Simd for Portable {
    type Eight = Lanes;
    type F = Singles;
    type D = Doubles;
    type I = Whole;
    type M = [bool; BATCH];
    type H = [bool; LANES];

    const MANY_REGISTERS: bool = false;

    #[inline(always)]
    fn load8(self, x: &Lanes) -> Lanes {
        *x
    }
    #[inline(always)]
    fn splat8(self, x: f32) -> Lanes {
        Lanes::all(x)
    }
    #[inline(always)]
    fn transpose8(self, rows: [Lanes; LANES]) -> [Lanes; LANES] {
        let mut columns = rows;
        for i in 0..LANES {
            for l in 0..LANES {
                columns[l].0[i] = rows[i].0[l];
            }
        }
        columns
    }
    #[inline(always)]
    fn load(self, x: &Singles) -> Singles {
        *x
    }
    #[inline(always)]
    fn store(self, x: Singles) -> Singles {
        x
    }
    #[inline(always)]
    fn splat(self, x: f32) -> Singles {
        [x; BATCH]
    }
    #[inline(always)]
    fn add(self, a: Singles, b: Singles) -> Singles {
        std::array::from_fn(|l| a[l] + b[l])
    }
    #[inline(always)]
    fn sub(self, a: Singles, b: Singles) -> Singles {
        std::array::from_fn(|l| a[l] - b[l])
    }
    #[inline(always)]
    fn mul(self, a: Singles, b: Singles) -> Singles {
        std::array::from_fn(|l| a[l] * b[l])
    }
    #[inline(always)]
    fn div(self, a: Singles, b: Singles) -> Singles {
        std::array::from_fn(|l| a[l] / b[l])
    }
    #[inline(always)]
    fn min(self, a: Singles, b: Singles) -> Singles {
        std::array::from_fn(|l| if a[l] < b[l] { a[l] } else { b[l] })
    }
    #[inline(always)]
    fn max(self, a: Singles, b: Singles) -> Singles {
        std::array::from_fn(|l| if a[l] > b[l] { a[l] } else { b[l] })
    }
    #[inline(always)]
    fn sqrt(self, x: Singles) -> Singles {
        x.map(f32::sqrt)
    }
    #[inline(always)]
    fn le(self, a: Singles, b: Singles) -> [bool; BATCH] {
        std::array::from_fn(|l| a[l] <= b[l])
    }
    #[inline(always)]
    fn select(self, mask: [bool; BATCH], a: Singles, b: Singles) -> Singles {
        std::array::from_fn(|l| if mask[l] { a[l] } else { b[l] })
    }
    #[inline(always)]
    fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> Singles {
        x.map(|x| ((x - origin) * unit) as f32)
    }
    #[inline(always)]
    fn narrow_each(self, x: &[f64; BATCH], origins: &[f64; BATCH], unit: f64) -> Singles {
        std::array::from_fn(|l| ((x[l] - origins[l]) * unit) as f32)
    }
    #[inline(always)]
    fn compress(self, bits: u32, x: Singles, to: &mut [f32]) {
        compress(bits, &x, to);
    }
    #[inline(always)]
    fn mask(self, bits: u32) -> [bool; BATCH] {
        std::array::from_fn(|l| bits & (1 << l) != 0)
    }
    #[inline(always)]
    fn bits(self, mask: [bool; BATCH]) -> u32 {
        (0..BATCH).map(|l| u32::from(mask[l]) << l).sum()
    }
    #[inline(always)]
    fn or(self, a: [bool; BATCH], b: [bool; BATCH]) -> [bool; BATCH] {
        std::array::from_fn(|l| a[l] | b[l])
    }
    #[inline(always)]
    fn xor(self, a: [bool; BATCH], b: [bool; BATCH]) -> [bool; BATCH] {
        std::array::from_fn(|l| a[l] ^ b[l])
    }
    #[inline(always)]
    fn half<const SECOND: bool>(self, mask: [bool; BATCH]) -> [bool; LANES] {
        std::array::from_fn(|l| mask[if SECOND { LANES + l } else { l }])
    }
    #[inline(always)]
    fn splat_whole(self, x: i32) -> Whole {
        [x; BATCH]
    }
    #[inline(always)]
    fn store_whole(self, x: Whole) -> Whole {
        x
    }
    #[inline(always)]
    fn add_whole_if(self, mask: [bool; BATCH], a: Whole, x: Whole) -> Whole {
        std::array::from_fn(|l| if mask[l] { a[l].wrapping_add(x[l]) } else { a[l] })
    }
    #[inline(always)]
    fn load_half(self, x: &Doubles) -> Doubles {
        *x
    }
    #[inline(always)]
    fn store_half(self, x: Doubles) -> Doubles {
        x
    }
    #[inline(always)]
    fn splat_half(self, x: f64) -> Doubles {
        [x; LANES]
    }
    #[inline(always)]
    fn add_half(self, a: Doubles, b: Doubles) -> Doubles {
        std::array::from_fn(|l| a[l] + b[l])
    }
    #[inline(always)]
    fn sub_half(self, a: Doubles, b: Doubles) -> Doubles {
        std::array::from_fn(|l| a[l] - b[l])
    }
    #[inline(always)]
    fn mul_half(self, a: Doubles, b: Doubles) -> Doubles {
        std::array::from_fn(|l| a[l] * b[l])
    }
    #[inline(always)]
    fn choose_half(self, a: Doubles, b: Doubles, yes: Doubles, no: Doubles) -> Doubles {
        std::array::from_fn(|l| if a[l] < b[l] { yes[l] } else { no[l] })
    }
    #[inline(always)]
    fn narrow_half(self, x: Doubles) -> Lanes {
        Lanes(x.map(|x| x as f32))
    }
    #[inline(always)]
    fn lt_half(self, a: Doubles, b: Doubles) -> u32 {
        let mut bits = 0;
        for l in 0..LANES {
            bits |= u32::from(a[l] < b[l]) << l;
        }
        bits
    }
    #[inline(always)]
    fn add_half_if(self, mask: [bool; LANES], a: Doubles, x: Doubles) -> Doubles {
        std::array::from_fn(|l| if mask[l] { a[l] + x[l] } else { a[l] })
    }
}

/// Packs the lanes of some bits.
#[inline(always)]
pub fn compress(mut bits: u32, x: &Singles, to: &mut [f32]) {
    for slot in to {
        if bits == 0 {
            break;
        }
        *slot = x[bits.trailing_zeros() as usize % BATCH];
        bits &= bits - 1;
    }
}

/// Applies a formula to each lane.
macro_rules! each {
    ($l:ident => $formula:expr) => {{
        let mut result = Lanes([0.0; LANES]);
        let mut $l = 0;
        while $l < LANES {
            result.0[$l] = $formula;
            $l += 1;
        }
        result
    }};
}

macro_rules! operators {
    ($($trait:ident, $method:ident, $operator:tt;)*) => {
        $(impl $trait for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                each!(l => self.0[l] $operator other.0[l])
            }
        })*
    };
}
operators! { Add, add, +; Sub, sub, -; Mul, mul, *; Div, div, /; }

impl Eight for Lanes {
    #[inline(always)]
    fn store(self) -> Lanes {
        self
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        each!(l => self.0[l].sqrt())
    }
    #[inline(always)]
    fn floor(self) -> Self {
        each!(l => self.0[l].floor())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        each!(l => self.0[l].abs())
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        each!(l => if self.0[l] > other.0[l] { self.0[l] } else { other.0[l] })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        each!(l => if self.0[l] < other.0[l] { self.0[l] } else { other.0[l] })
    }
    #[inline(always)]
    fn below(self, other: Self) -> Self {
        each!(l => if self.0[l] < other.0[l] { 1.0 } else { 0.0 })
    }
    #[inline(always)]
    fn not_above(self, other: Self) -> Self {
        each!(l => if self.0[l] <= other.0[l] { 1.0 } else { 0.0 })
    }
    #[inline(always)]
    fn choose(self, yes: Self, no: Self) -> Self {
        each!(l => if self.0[l] != 0.0 { yes.0[l] } else { no.0[l] })
    }
}
