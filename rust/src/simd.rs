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
mod lanes;
mod portable;
#[cfg(target_arch = "x86_64")]
mod proven;
mod set;
mod three;

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
pub use eight::Eight;
pub use lanes::{BATCH, Doubles, LANES, Lanes, Singles, find_least};
use portable::Portable;
pub use set::Simd;
pub use three::Three;

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

#[cfg(target_arch = "x86_64")]
const CACHE_LINE: usize = 64; // bytes

/// Asks the processor to fetch a value into its cache, line by line from its start, for use after other work. Nothing
/// waits for the value, and it does not change.
#[inline(always)]
pub fn prefetch<T>(value: &T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let start: *const i8 = std::ptr::from_ref(value).cast();
        for offset in (0..size_of::<T>()).step_by(CACHE_LINE) {
            // SAFETY: every processor of this kind has the instruction, and it may ask for any place
            unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(offset)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}

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
const NOT_ASKED: u8 = 0; // the processor was not asked yet
const PORTABLE: u8 = 1; // what every processor has
#[cfg(target_arch = "x86_64")]
const AVX2: u8 = 2; // eight lanes of 32 bits
#[cfg(target_arch = "x86_64")]
const AVX512: u8 = 3; // sixteen lanes of 32 bits

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
