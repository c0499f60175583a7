//! Wide instructions: the only place that knows which ones the processor has.
//!
//! A kernel is written once with [`kernel!`], generic in [`Simd`], and compiled for each set of instructions: AVX-512,
//! AVX2, and what every processor has. The widest that the processor has is chosen when the program runs. There are as
//! many lanes for every width, what is summed is summed in the same order, and products and sums are never fused: the
//! answers are the same bits on every processor.
//!
//! Each set has a token that implements [`Simd`]. Wide instructions are reached only through a token, or through numbers
//! that a token made, and tokens of sets that a processor may lack are only made after asking it.

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

/// Numbers of a half batch: a register of AVX2 in single precision, one of AVX-512 in double precision.
pub const LANES: usize = 8;
/// Numbers that are worked on at a time: a register of AVX-512 in single precision.
pub const BATCH: usize = 2 * LANES;

/// Double precision numbers of a half batch.
pub type Doubles = [f64; LANES];
/// Single precision numbers of a batch.
pub type Singles = [f32; BATCH];
/// Whole numbers of a batch.
pub type Whole = [i32; BATCH];

/// A token for a set of instructions, and what can be done with them. No number may be NaN, except in an [`Eight`].
pub trait Simd: Copy {
    /// Eight single precision numbers that calculate by operators.
    type Eight: Eight;
    /// Single precision numbers of a batch.
    type F: Copy;
    /// Double precision numbers of a half batch.
    type D: Copy;
    /// Whole numbers of a batch.
    type I: Copy;
    /// Which lanes of a batch, and which of a half batch.
    type M: Copy;
    type H: Copy;

    /// Whether sums over a whole batch of many terms have registers enough.
    const MANY_REGISTERS: bool;

    /// Takes eight numbers from memory.
    fn load8(self, x: &Lanes) -> Self::Eight;
    /// The same number in eight lanes.
    fn splat8(self, x: f32) -> Self::Eight;

    fn load(self, x: &Singles) -> Self::F;
    fn store(self, x: Self::F) -> Singles;
    fn splat(self, x: f32) -> Self::F;
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// The smaller of each two.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The larger of each two.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// Where a ≤ b.
    fn le(self, a: Self::F, b: Self::F) -> Self::M;
    /// a in the lanes of the mask, b in the others.
    fn select(self, mask: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// Coordinates relative to an origin, in units.
    fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> Self::F;
    /// Puts the lanes of some bits one behind the other at the start of `to`, which has room for a batch.
    fn compress(self, bits: u32, x: Self::F, to: &mut [f32]);

    /// The mask of some bits, the lowest for the first lane.
    fn mask(self, bits: u32) -> Self::M;
    /// The bits of a mask.
    fn bits(self, mask: Self::M) -> u32;
    /// Lanes of either mask.
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    /// Lanes of only one of two masks.
    fn xor(self, a: Self::M, b: Self::M) -> Self::M;
    /// The first or the second half.
    fn half<const SECOND: bool>(self, mask: Self::M) -> Self::H;

    fn splat_whole(self, x: i32) -> Self::I;
    fn store_whole(self, x: Self::I) -> Whole;
    /// a + x in the lanes of the mask, a in the others.
    fn add_whole_if(self, mask: Self::M, a: Self::I, x: Self::I) -> Self::I;

    fn load_half(self, x: &Doubles) -> Self::D;
    fn store_half(self, x: Self::D) -> Doubles;
    fn splat_half(self, x: f64) -> Self::D;
    fn sub_half(self, a: Self::D, b: Self::D) -> Self::D;
    /// a + x in the lanes of the mask, a in the others.
    fn add_half_if(self, mask: Self::H, a: Self::D, x: Self::D) -> Self::D;
}

/// Defines a function that is compiled for each set of instructions. Its first argument is the token of the one that
/// runs; callers leave it out.
///
/// Functions that it calls in its inner loops must be `#[inline(always)]` and have no closures that are not: only what is
/// inlined is compiled for the set.
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

/// What [`widest`] gives: one of the numbers below. Those of sets that the processor lacks are never there.
static WIDEST: AtomicU8 = AtomicU8::new(NOT_ASKED);
const NOT_ASKED: u8 = 0;
const PORTABLE: u8 = 1;
#[cfg(target_arch = "x86_64")]
const AVX2: u8 = 2;
#[cfg(target_arch = "x86_64")]
const AVX512: u8 = 3;

/// The widest instructions that there are.
#[inline(always)]
pub fn widest() -> Widest {
    let mut number = WIDEST.load(Ordering::Relaxed);
    if number == NOT_ASKED {
        number = ask();
    }
    match number {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: this number is only there where the processor has these instructions
        AVX512 => Widest::Avx512(unsafe { Avx512::assume() }),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: this number is only there where the processor has these instructions
        AVX2 => Widest::Avx2(unsafe { Avx2::assume() }),
        _ => Widest::Portable(Portable),
    }
}

/// Asks the processor, which gives the same answer every time.
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
