//! AVX-512: a batch is one register.

use std::arch::x86_64::*;

use super::avx2::{Avx2, InRegister};
use super::lanes::{BATCH, Doubles, LANES, Lanes, Singles, Whole};
use super::proven::proven;
use super::set::Simd;

/// Proof that the processor has AVX-512 with its usual extensions, and all of [`Avx2`].
#[derive(Clone, Copy)]
pub struct Avx512(Avx2);

impl Avx512 {
    /// Returns whether the processor has all features that `kernel!` compiles for.
    pub fn is_there() -> bool {
        Avx2::is_there()
            && is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw")
    }

    /// Makes the token.
    ///
    /// # Safety
    /// [`Avx512::is_there`] must hold.
    #[inline(always)]
    pub const unsafe fn assume() -> Self {
        // SAFETY: `Avx2::is_there` then holds as well
        Self(unsafe { Avx2::assume() })
    }
}

impl Simd for Avx512 {
    type Eight = InRegister;
    type F = __m512;
    type D = __m512d;
    type I = __m512i;
    type M = __mmask16;
    type H = __mmask8;

    const MANY_REGISTERS: bool = true;

    #[inline(always)]
    fn load8(self, x: &Lanes) -> InRegister {
        self.0.load8(x)
    }
    #[inline(always)]
    fn splat8(self, x: f32) -> InRegister {
        self.0.splat8(x)
    }
    #[inline(always)]
    fn transpose8(self, rows: [InRegister; LANES]) -> [Lanes; LANES] {
        self.0.transpose8(rows)
    }
    #[inline(always)]
    fn mask(self, bits: u32) -> __mmask16 {
        bits as __mmask16
    }
    #[inline(always)]
    fn bits(self, mask: __mmask16) -> u32 {
        u32::from(mask)
    }
    #[inline(always)]
    fn or(self, a: __mmask16, b: __mmask16) -> __mmask16 {
        a | b
    }
    #[inline(always)]
    fn xor(self, a: __mmask16, b: __mmask16) -> __mmask16 {
        a ^ b
    }
    #[inline(always)]
    fn half<const SECOND: bool>(self, mask: __mmask16) -> __mmask8 {
        if SECOND { (mask >> LANES) as __mmask8 } else { mask as __mmask8 }
    }
    proven! { "avx512f,avx512vl,avx512dq,avx512bw";
        fn load(self, x: &Singles) -> __m512 {
            // SAFETY: sixteen numbers
            unsafe { _mm512_loadu_ps(x.as_ptr()) }
        }
        fn store(self, x: __m512) -> Singles {
            // SAFETY: both are sixteen numbers
            unsafe { std::mem::transmute::<__m512, Singles>(x) }
        }
        fn splat(self, x: f32) -> __m512 {
            _mm512_set1_ps(x)
        }
        fn add(self, a: __m512, b: __m512) -> __m512 {
            _mm512_add_ps(a, b)
        }
        fn sub(self, a: __m512, b: __m512) -> __m512 {
            _mm512_sub_ps(a, b)
        }
        fn mul(self, a: __m512, b: __m512) -> __m512 {
            _mm512_mul_ps(a, b)
        }
        fn div(self, a: __m512, b: __m512) -> __m512 {
            _mm512_div_ps(a, b)
        }
        fn min(self, a: __m512, b: __m512) -> __m512 {
            _mm512_min_ps(a, b)
        }
        fn max(self, a: __m512, b: __m512) -> __m512 {
            _mm512_max_ps(a, b)
        }
        fn sqrt(self, x: __m512) -> __m512 {
            _mm512_sqrt_ps(x)
        }
        fn le(self, a: __m512, b: __m512) -> __mmask16 {
            _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b)
        }
        fn select(self, mask: __mmask16, a: __m512, b: __m512) -> __m512 {
            _mm512_mask_blend_ps(mask, b, a)
        }
        fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> __m512 {
            let (origin, unit) = (_mm512_set1_pd(origin), _mm512_set1_pd(unit));
            // SAFETY: two times eight numbers
            let (low, high) = unsafe { (_mm512_loadu_pd(x.as_ptr()), _mm512_loadu_pd(x[LANES..].as_ptr())) };
            let low = _mm512_cvtpd_ps(_mm512_mul_pd(_mm512_sub_pd(low, origin), unit));
            let high = _mm512_cvtpd_ps(_mm512_mul_pd(_mm512_sub_pd(high, origin), unit));
            _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
        }
        fn narrow_each(self, x: &[f64; BATCH], origins: &[f64; BATCH], unit: f64) -> __m512 {
            let unit = _mm512_set1_pd(unit);
            // SAFETY: two times eight numbers
            let (low, high) = unsafe { (_mm512_loadu_pd(x.as_ptr()), _mm512_loadu_pd(x[LANES..].as_ptr())) };
            // SAFETY: two times eight numbers
            let (from_low, from_high) =
                unsafe { (_mm512_loadu_pd(origins.as_ptr()), _mm512_loadu_pd(origins[LANES..].as_ptr())) };
            let low = _mm512_cvtpd_ps(_mm512_mul_pd(_mm512_sub_pd(low, from_low), unit));
            let high = _mm512_cvtpd_ps(_mm512_mul_pd(_mm512_sub_pd(high, from_high), unit));
            _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
        }
        fn compress(self, bits: u32, x: __m512, to: &mut [f32]) {
            assert!(to.len() >= BATCH);
            // SAFETY: there is room for sixteen numbers
            unsafe { _mm512_storeu_ps(to.as_mut_ptr(), _mm512_maskz_compress_ps(bits as __mmask16, x)) }
        }
        fn splat_whole(self, x: i32) -> __m512i {
            _mm512_set1_epi32(x)
        }
        fn store_whole(self, x: __m512i) -> Whole {
            // SAFETY: both are sixteen numbers
            unsafe { std::mem::transmute::<__m512i, Whole>(x) }
        }
        fn add_whole_if(self, mask: __mmask16, a: __m512i, x: __m512i) -> __m512i {
            _mm512_mask_add_epi32(a, mask, a, x)
        }
        fn load_half(self, x: &Doubles) -> __m512d {
            // SAFETY: eight numbers
            unsafe { _mm512_loadu_pd(x.as_ptr()) }
        }
        fn store_half(self, x: __m512d) -> Doubles {
            // SAFETY: both are eight numbers
            unsafe { std::mem::transmute::<__m512d, Doubles>(x) }
        }
        fn splat_half(self, x: f64) -> __m512d {
            _mm512_set1_pd(x)
        }
        fn add_half(self, a: __m512d, b: __m512d) -> __m512d {
            _mm512_add_pd(a, b)
        }
        fn sub_half(self, a: __m512d, b: __m512d) -> __m512d {
            _mm512_sub_pd(a, b)
        }
        fn mul_half(self, a: __m512d, b: __m512d) -> __m512d {
            _mm512_mul_pd(a, b)
        }
        fn choose_half(self, a: __m512d, b: __m512d, yes: __m512d, no: __m512d) -> __m512d {
            _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b), no, yes)
        }
        fn narrow_half(self, x: __m512d) -> InRegister {
            InRegister(_mm512_cvtpd_ps(x))
        }
        fn lt_half(self, a: __m512d, b: __m512d) -> u32 {
            u32::from(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b))
        }
        fn add_half_if(self, mask: __mmask8, a: __m512d, x: __m512d) -> __m512d {
            _mm512_mask_add_pd(a, mask, a, x)
        }
    }
}
