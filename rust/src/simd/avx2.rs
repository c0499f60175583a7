//! AVX2: a batch is two registers.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

use super::eight::Eight;
use super::lanes::{BATCH, Doubles, LANES, Lanes, Singles, Whole};
use super::portable;
use super::proven::proven;
use super::set::Simd;

/// Proof that the processor has AVX2 and the bit instructions that came with it.
#[derive(Clone, Copy)]
pub struct Avx2(());

impl Avx2 {
    /// Returns whether the processor has all features that `kernel!` compiles for.
    pub fn is_there() -> bool {
        is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt")
    }

    /// Makes the token.
    ///
    /// # Safety
    /// [`Avx2::is_there`] must hold.
    #[inline(always)]
    pub const unsafe fn assume() -> Self {
        Self(())
    }
}

impl Simd for Avx2 {
    type Eight = InRegister;
    type F = [__m256; 2];
    type D = [__m256d; 2];
    type I = [__m256i; 2];
    type M = [__m256; 2];
    type H = __m256;

    const MANY_REGISTERS: bool = false;

    #[inline(always)]
    fn half<const SECOND: bool>(self, mask: [__m256; 2]) -> __m256 {
        mask[usize::from(SECOND)]
    }
    #[inline(always)]
    fn compress(self, bits: u32, x: [__m256; 2], to: &mut [f32]) {
        portable::compress(bits, &self.store(x), to);
    }
    proven! { "avx2";
        fn load8(self, x: &Lanes) -> InRegister {
            // SAFETY: eight numbers, aligned
            InRegister(unsafe { _mm256_load_ps(x.0.as_ptr()) })
        }
        fn splat8(self, x: f32) -> InRegister {
            InRegister(_mm256_set1_ps(x))
        }
        fn transpose8(self, rows: [InRegister; LANES]) -> [Lanes; LANES] {
            let [InRegister(a), InRegister(b), InRegister(c), InRegister(d), late @ ..] = rows;
            let [InRegister(e), InRegister(f), InRegister(g), InRegister(h)] = late;
            let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
            let (ef, gh) = (_mm256_unpacklo_ps(e, f), _mm256_unpacklo_ps(g, h));
            let (ab_late, cd_late) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
            let (ef_late, gh_late) = (_mm256_unpackhi_ps(e, f), _mm256_unpackhi_ps(g, h));
            // the first and the second four rows of columns 0 and 4, 1 and 5, 2 and 6, 3 and 7
            let halves = [
                [_mm256_shuffle_ps::<0x44>(ab, cd), _mm256_shuffle_ps::<0x44>(ef, gh)],
                [_mm256_shuffle_ps::<0xee>(ab, cd), _mm256_shuffle_ps::<0xee>(ef, gh)],
                [_mm256_shuffle_ps::<0x44>(ab_late, cd_late), _mm256_shuffle_ps::<0x44>(ef_late, gh_late)],
                [_mm256_shuffle_ps::<0xee>(ab_late, cd_late), _mm256_shuffle_ps::<0xee>(ef_late, gh_late)],
            ];
            let mut columns = [Lanes::all(0.0); LANES];
            for i in 0..4 {
                let [first, second] = halves[i];
                // SAFETY: there is room for eight numbers, aligned
                unsafe {
                    let (low, high) = (columns[i].0.as_mut_ptr(), columns[i + 4].0.as_mut_ptr());
                    _mm256_store_ps(low, _mm256_permute2f128_ps::<0x20>(first, second));
                    _mm256_store_ps(high, _mm256_permute2f128_ps::<0x31>(first, second));
                }
            }
            columns
        }
        fn load(self, x: &Singles) -> [__m256; 2] {
            // SAFETY: sixteen numbers
            unsafe { [_mm256_loadu_ps(x.as_ptr()), _mm256_loadu_ps(x[LANES..].as_ptr())] }
        }
        fn store(self, x: [__m256; 2]) -> Singles {
            // SAFETY: both are sixteen numbers
            unsafe { std::mem::transmute::<[__m256; 2], Singles>(x) }
        }
        fn splat(self, x: f32) -> [__m256; 2] {
            [_mm256_set1_ps(x); 2]
        }
        fn add(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_add_ps(a[0], b[0]), _mm256_add_ps(a[1], b[1])]
        }
        fn sub(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_sub_ps(a[0], b[0]), _mm256_sub_ps(a[1], b[1])]
        }
        fn mul(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])]
        }
        fn div(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_div_ps(a[0], b[0]), _mm256_div_ps(a[1], b[1])]
        }
        fn min(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_min_ps(a[0], b[0]), _mm256_min_ps(a[1], b[1])]
        }
        fn sqrt(self, x: [__m256; 2]) -> [__m256; 2] {
            [_mm256_sqrt_ps(x[0]), _mm256_sqrt_ps(x[1])]
        }
        fn max(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_max_ps(a[0], b[0]), _mm256_max_ps(a[1], b[1])]
        }
        fn le(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_cmp_ps::<_CMP_LE_OQ>(a[0], b[0]), _mm256_cmp_ps::<_CMP_LE_OQ>(a[1], b[1])]
        }
        fn select(self, mask: [__m256; 2], a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_blendv_ps(b[0], a[0], mask[0]), _mm256_blendv_ps(b[1], a[1], mask[1])]
        }
        fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> [__m256; 2] {
            let (origin, unit) = (_mm256_set1_pd(origin), _mm256_set1_pd(unit));
            let mut quarters = [_mm_setzero_ps(); 4];
            for i in 0..4 {
                // SAFETY: four numbers remain from there on
                let x = unsafe { _mm256_loadu_pd(x[4 * i..].as_ptr()) };
                quarters[i] = _mm256_cvtpd_ps(_mm256_mul_pd(_mm256_sub_pd(x, origin), unit));
            }
            [_mm256_set_m128(quarters[1], quarters[0]), _mm256_set_m128(quarters[3], quarters[2])]
        }
        fn narrow_each(self, x: &[f64; BATCH], origins: &[f64; BATCH], unit: f64) -> [__m256; 2] {
            let unit = _mm256_set1_pd(unit);
            let mut quarters = [_mm_setzero_ps(); 4];
            for i in 0..4 {
                // SAFETY: four numbers remain from there on
                let (x, origin) =
                    unsafe { (_mm256_loadu_pd(x[4 * i..].as_ptr()), _mm256_loadu_pd(origins[4 * i..].as_ptr())) };
                quarters[i] = _mm256_cvtpd_ps(_mm256_mul_pd(_mm256_sub_pd(x, origin), unit));
            }
            [_mm256_set_m128(quarters[1], quarters[0]), _mm256_set_m128(quarters[3], quarters[2])]
        }
        fn mask(self, bits: u32) -> [__m256; 2] {
            let lanes = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let low = _mm256_and_si256(_mm256_set1_epi32(bits as i32), lanes);
            let high = _mm256_and_si256(_mm256_set1_epi32((bits >> LANES) as i32), lanes);
            [
                _mm256_castsi256_ps(_mm256_cmpeq_epi32(low, lanes)),
                _mm256_castsi256_ps(_mm256_cmpeq_epi32(high, lanes)),
            ]
        }
        fn bits(self, mask: [__m256; 2]) -> u32 {
            (_mm256_movemask_ps(mask[0]) | (_mm256_movemask_ps(mask[1]) << LANES)) as u32
        }
        fn or(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_or_ps(a[0], b[0]), _mm256_or_ps(a[1], b[1])]
        }
        fn xor(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            [_mm256_xor_ps(a[0], b[0]), _mm256_xor_ps(a[1], b[1])]
        }
        fn splat_whole(self, x: i32) -> [__m256i; 2] {
            [_mm256_set1_epi32(x); 2]
        }
        fn store_whole(self, x: [__m256i; 2]) -> Whole {
            // SAFETY: both are sixteen numbers
            unsafe { std::mem::transmute::<[__m256i; 2], Whole>(x) }
        }
        fn add_whole_if(self, mask: [__m256; 2], a: [__m256i; 2], x: [__m256i; 2]) -> [__m256i; 2] {
            let x = [
                _mm256_and_si256(_mm256_castps_si256(mask[0]), x[0]),
                _mm256_and_si256(_mm256_castps_si256(mask[1]), x[1]),
            ];
            [_mm256_add_epi32(a[0], x[0]), _mm256_add_epi32(a[1], x[1])]
        }
        fn load_half(self, x: &Doubles) -> [__m256d; 2] {
            // SAFETY: eight numbers
            unsafe { [_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x[LANES / 2..].as_ptr())] }
        }
        fn store_half(self, x: [__m256d; 2]) -> Doubles {
            // SAFETY: both are eight numbers
            unsafe { std::mem::transmute::<[__m256d; 2], Doubles>(x) }
        }
        fn splat_half(self, x: f64) -> [__m256d; 2] {
            [_mm256_set1_pd(x); 2]
        }
        fn add_half(self, a: [__m256d; 2], b: [__m256d; 2]) -> [__m256d; 2] {
            [_mm256_add_pd(a[0], b[0]), _mm256_add_pd(a[1], b[1])]
        }
        fn sub_half(self, a: [__m256d; 2], b: [__m256d; 2]) -> [__m256d; 2] {
            [_mm256_sub_pd(a[0], b[0]), _mm256_sub_pd(a[1], b[1])]
        }
        fn mul_half(self, a: [__m256d; 2], b: [__m256d; 2]) -> [__m256d; 2] {
            [_mm256_mul_pd(a[0], b[0]), _mm256_mul_pd(a[1], b[1])]
        }
        fn choose_half(
            self,
            a: [__m256d; 2],
            b: [__m256d; 2],
            yes: [__m256d; 2],
            no: [__m256d; 2]
        ) -> [__m256d; 2] {
            [
                _mm256_blendv_pd(no[0], yes[0], _mm256_cmp_pd::<_CMP_LT_OQ>(a[0], b[0])),
                _mm256_blendv_pd(no[1], yes[1], _mm256_cmp_pd::<_CMP_LT_OQ>(a[1], b[1])),
            ]
        }
        fn narrow_half(self, x: [__m256d; 2]) -> InRegister {
            InRegister(_mm256_set_m128(_mm256_cvtpd_ps(x[1]), _mm256_cvtpd_ps(x[0])))
        }
        fn lt_half(self, a: [__m256d; 2], b: [__m256d; 2]) -> u32 {
            let low = _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a[0], b[0]));
            let high = _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a[1], b[1]));
            (low | (high << (LANES / 2))) as u32
        }
        fn add_half_if(self, mask: __m256, a: [__m256d; 2], x: [__m256d; 2]) -> [__m256d; 2] {
            let mask = _mm256_castps_si256(mask);
            let low = _mm256_cvtepi32_epi64(_mm256_castsi256_si128(mask));
            let high = _mm256_cvtepi32_epi64(_mm256_extracti128_si256::<1>(mask));
            [
                _mm256_blendv_pd(a[0], _mm256_add_pd(a[0], x[0]), _mm256_castsi256_pd(low)),
                _mm256_blendv_pd(a[1], _mm256_add_pd(a[1], x[1]), _mm256_castsi256_pd(high)),
            ]
        }
    }
}

/// Eight numbers in a register. Its existence proves AVX2, as a token does: only tokens make it.
#[derive(Clone, Copy)]
pub struct InRegister(pub(super) __m256);

macro_rules! operators {
    ($($trait:ident, $method:ident, $intrinsic:ident;)*) => {
        $(impl $trait for InRegister {
            type Output = Self;
            proven! { "avx2";
                fn $method(a: InRegister, b: InRegister) -> InRegister {
                    InRegister($intrinsic(a.0, b.0))
                }
            }
        })*
    };
}
operators! {
    Add, add, _mm256_add_ps;
    Sub, sub, _mm256_sub_ps;
    Mul, mul, _mm256_mul_ps;
    Div, div, _mm256_div_ps;
}

impl Eight for InRegister {
    proven! { "avx2";
        fn store(x: InRegister) -> Lanes {
            let mut numbers = Lanes::all(0.0);
            // SAFETY: there is room for eight numbers, aligned
            unsafe { _mm256_store_ps(numbers.0.as_mut_ptr(), x.0) };
            numbers
        }
        fn sqrt(x: InRegister) -> InRegister {
            InRegister(_mm256_sqrt_ps(x.0))
        }
        fn floor(x: InRegister) -> InRegister {
            InRegister(_mm256_floor_ps(x.0))
        }
        fn abs(x: InRegister) -> InRegister {
            InRegister(_mm256_andnot_ps(_mm256_set1_ps(-0.0), x.0))
        }
        fn max(a: InRegister, b: InRegister) -> InRegister {
            InRegister(_mm256_max_ps(a.0, b.0))
        }
        fn min(a: InRegister, b: InRegister) -> InRegister {
            InRegister(_mm256_min_ps(a.0, b.0))
        }
        fn below(a: InRegister, b: InRegister) -> InRegister {
            InRegister(_mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a.0, b.0), _mm256_set1_ps(1.0)))
        }
        fn not_above(a: InRegister, b: InRegister) -> InRegister {
            InRegister(_mm256_and_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a.0, b.0), _mm256_set1_ps(1.0)))
        }
        fn choose(x: InRegister, yes: InRegister, no: InRegister) -> InRegister {
            let mask = _mm256_cmp_ps::<_CMP_NEQ_UQ>(x.0, _mm256_setzero_ps());
            InRegister(_mm256_blendv_ps(no.0, yes.0, mask))
        }
    }
}
