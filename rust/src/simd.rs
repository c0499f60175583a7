//! Wide instructions: the only room that knows which ones the processor has.
//!
//! A kernel is written once with [`kernel!`], generic in [`Simd`]. It is compiled for each instruction set: AVX-512,
//! AVX2 and portable code. When the program runs, it chooses the widest set that the processor has. Answers are equal
//! bit for bit on every processor. The number of lanes is the same for every width, sums have one order, and products
//! and sums are never fused.
//!
//! Each set has a token that implements [`Simd`]. Only a token, or numbers that a token made, give access to wide
//! instructions. Tokens of optional sets are made only after the processor was asked.

mod eight;
mod portable;
#[cfg(target_arch = "x86_64")]
mod proven;

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(test)]
mod tests;

use std::sync::atomic::{AtomicU8, Ordering};

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub use avx512::Avx512;
pub use eight::{Eight, Lanes, Three};
use portable::Portable;

/// Numbers of a half batch: a single-precision register of AVX2, a double-precision register of AVX-512.
pub const LANES: usize = 8;
/// Numbers of a batch, which are processed together: a single-precision register of AVX-512.
pub const BATCH: usize = 2 * LANES;

/// A half batch in double precision.
pub type Doubles = [f64; LANES];
/// A batch in single precision.
pub type Singles = [f32; BATCH];
/// A batch of integers.
pub type Whole = [i32; BATCH];

/// A token for an instruction set, and its operations. No number may be NaN, except in an [`Eight`].
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

    fn load(self, x: &Singles) -> Self::F;
    fn store(self, x: Self::F) -> Singles;
    fn splat(self, x: f32) -> Self::F;
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// The smaller of two numbers, lane by lane.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The larger of two numbers, lane by lane.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// A mask of the lanes where a ≤ b.
    fn le(self, a: Self::F, b: Self::F) -> Self::M;
    /// Takes a in the lanes of the mask, b in the others.
    fn select(self, mask: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// Converts coordinates to single precision, relative to an origin and in units.
    fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> Self::F;
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
    fn sub_half(self, a: Self::D, b: Self::D) -> Self::D;
    /// Adds x in the lanes of the mask.
    fn add_half_if(self, mask: Self::H, a: Self::D, x: Self::D) -> Self::D;
}

/// Defines a function that is compiled for each instruction set. Its first argument is the token of the set that runs;
/// callers omit it.
///
/// Functions that it calls in its inner loops must be `#[inline(always)]` and have no closures that are not: only what
/// is inlined is compiled for the set.
macro_rules! kernel {
    (
        $(#[$meta:meta])*
        $visibility:vis fn $name:ident<$kind:ident>($token:pat, $($argument:ident: $type:ty),* $(,)?)
        $(-> $result:ty)? $body:block
    ) => {
        $(#[$meta])*
        $visibility fn $name($($argument: $type),*) $(-> $result)? {
            #[inline(always)]
            fn work<$kind: $crate::simd::Simd>($token: $kind, $($argument: $type),*) $(-> $result)? $body

            match $crate::simd::widest() {
                #[cfg(target_arch = "x86_64")]
                $crate::simd::Widest::Avx512(token) => {
                    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,bmi1,bmi2,lzcnt,popcnt")]
                    fn compiled(token: $crate::simd::Avx512, $($argument: $type),*) $(-> $result)? {
                        work(token, $($argument),*)
                    }
                    // SAFETY: the token proves that the processor has these features, see `Avx512`
                    unsafe { compiled(token, $($argument),*) }
                }
                #[cfg(target_arch = "x86_64")]
                $crate::simd::Widest::Avx2(token) => {
                    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
                    fn compiled(token: $crate::simd::Avx2, $($argument: $type),*) $(-> $result)? {
                        work(token, $($argument),*)
                    }
                    // SAFETY: the token proves that the processor has these features, see `Avx2`
                    unsafe { compiled(token, $($argument),*) }
                }
                $crate::simd::Widest::Portable(token) => work(token, $($argument),*),
            }
        }
    };
}
pub(crate) use kernel;

/// The token of the widest instructions that the processor has.
#[derive(Clone, Copy)]
pub enum Widest {
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    Portable(Portable),
}

/// The widest set, as one of the numbers below. Numbers of sets that the processor lacks never appear.
static WIDEST: AtomicU8 = AtomicU8::new(NOT_ASKED);
const NOT_ASKED: u8 = 0;
const PORTABLE: u8 = 1;
#[cfg(target_arch = "x86_64")]
const AVX2: u8 = 2;
#[cfg(target_arch = "x86_64")]
const AVX512: u8 = 3;

/// Returns the token of the widest instructions that the processor has.
#[inline(always)]
pub fn widest() -> Widest {
    let mut number = WIDEST.load(Ordering::Relaxed);
    if number == NOT_ASKED {
        number = ask();
    }
    match number {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: this number appears only if the processor has these instructions
        AVX512 => Widest::Avx512(unsafe { Avx512::assume() }),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: this number appears only if the processor has these instructions
        AVX2 => Widest::Avx2(unsafe { Avx2::assume() }),
        _ => Widest::Portable(Portable),
    }
}

/// Asks the processor; the answer is the same every time.
#[cold]
fn ask() -> u8 {
    let number = detected();
    WIDEST.store(number, Ordering::Relaxed);
    number
}

fn detected() -> u8 {
    #[cfg(target_arch = "x86_64")]
    {
        if Avx512::is_there() {
            return AVX512;
        }
        if Avx2::is_there() {
            return AVX2;
        }
    }
    PORTABLE
}
