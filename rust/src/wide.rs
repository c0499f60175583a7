//! The widest instructions that the processor has, chosen when the program runs.
//!
//! Kernels are written once, generic in [`Simd`], and compiled for each set of instructions. Lanes are as many for
//! every width, what is summed is summed in the same order, and products and sums are never fused: the answers are the
//! same bits on every processor.

/// Double precision numbers of half the lanes, in loops that the compiler itself turns into wide instructions.
pub const LANES: usize = 8;
/// Numbers that are worked on at a time: a register of AVX-512 in single precision.
pub const BATCH: usize = 2 * LANES;

/// Double precision numbers of half the lanes.
pub type Lanes = [f64; LANES];
/// Single precision numbers of all lanes.
pub type Singles = [f32; BATCH];
/// Whole numbers of all lanes.
pub type Whole = [i32; BATCH];

/// Operations on all lanes at once; no NaN among them.
pub trait Simd: Copy {
    /// Single precision numbers of all lanes.
    type F: Copy;
    /// Double precision numbers of half the lanes.
    type D: Copy;
    /// Whole numbers of all lanes.
    type I: Copy;
    /// Which lanes, and which of half of them.
    type M: Copy;
    type H: Copy;

    /// Whether sums over all lanes of many terms have registers enough.
    const MANY_REGISTERS: bool;

    fn load(self, x: &Singles) -> Self::F;
    fn store(self, x: Self::F) -> Singles;
    fn splat(self, x: f32) -> Self::F;
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// Where a ≤ b.
    fn le(self, a: Self::F, b: Self::F) -> Self::M;
    /// a in the lanes of the mask, b in the others.
    fn select(self, mask: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// The lanes of a mask as bits.
    fn bits(self, mask: Self::M) -> u32;
    /// Coordinates relative to an origin, in units.
    fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> Self::F;
    /// Puts the lanes of some bits one behind the other at the start of `to`, which has room for all lanes.
    fn compress(self, bits: u32, x: Self::F, to: &mut [f32]);
    /// The smaller of each two.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The larger of each two.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// The first or the second half.
    fn half<const SECOND: bool>(self, mask: Self::M) -> Self::H;
    fn zero(self) -> Self::D;
    /// Lanes of either mask, and of only one of them.
    fn or(self, a: Self::M, b: Self::M) -> Self::M;
    fn xor(self, a: Self::M, b: Self::M) -> Self::M;
    /// The mask of some bits.
    fn mask(self, bits: u32) -> Self::M;
    fn store_whole(self, x: Self::I) -> Whole;
    fn splat_whole(self, x: i32) -> Self::I;
    /// a + x in the lanes of the mask, a in the others.
    fn add_whole_if(self, mask: Self::M, a: Self::I, x: Self::I) -> Self::I;
    fn load_half(self, x: &Lanes) -> Self::D;
    fn splat_half(self, x: f64) -> Self::D;
    fn sub_half(self, a: Self::D, b: Self::D) -> Self::D;
    /// a + x in the lanes of the mask, a in the others.
    fn add_half_if(self, mask: Self::H, a: Self::D, x: Self::D) -> Self::D;
    /// The same with a number.
    #[inline(always)]
    fn add_if(self, mask: Self::H, a: Self::D, x: f64) -> Self::D {
        self.add_half_if(mask, a, self.splat_half(x))
    }
    fn store_half(self, x: Self::D) -> Lanes;
}

/// Work that is worth wide instructions.
///
/// `run` and all that it calls in its inner loops must be `#[inline(always)]`: only code that is inlined into the
/// functions below is compiled for their instructions.
pub trait Wide {
    /// What the work gives.
    type Output;
    /// Does it.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Does work with the widest instructions that there are.
#[inline]
pub fn run<W: Wide>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        let bits = is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt");
        let width = if bits { x86::allowed_width() } else { 0 };
        if width >= 512
            && is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw")
        {
            // SAFETY: the processor has the features
            return unsafe { x86::with_avx512(work) };
        }
        if width >= 256 && is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has the features
            return unsafe { x86::with_avx2(work) };
        }
    }
    work.run(Portable)
}

/// What every processor can do.
#[derive(Clone, Copy)]
struct Portable;

impl Simd for Portable {
    type F = Singles;
    type D = Lanes;
    type I = Whole;
    type M = [bool; BATCH];
    type H = [bool; LANES];

    const MANY_REGISTERS: bool = false;

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
    fn le(self, a: Singles, b: Singles) -> [bool; BATCH] {
        std::array::from_fn(|l| a[l] <= b[l])
    }
    #[inline(always)]
    fn select(self, mask: [bool; BATCH], a: Singles, b: Singles) -> Singles {
        std::array::from_fn(|l| if mask[l] { a[l] } else { b[l] })
    }
    #[inline(always)]
    fn bits(self, mask: [bool; BATCH]) -> u32 {
        (0..BATCH).map(|l| u32::from(mask[l]) << l).sum()
    }
    #[inline(always)]
    fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> Singles {
        x.map(|x| ((x - origin) * unit) as f32)
    }
    #[inline(always)]
    fn compress(self, bits: u32, x: Singles, to: &mut [f32]) {
        compress(bits, &x, to);
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
    fn half<const SECOND: bool>(self, mask: [bool; BATCH]) -> [bool; LANES] {
        std::array::from_fn(|l| mask[if SECOND { LANES + l } else { l }])
    }
    #[inline(always)]
    fn zero(self) -> Lanes {
        [0.0; LANES]
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
    fn mask(self, bits: u32) -> [bool; BATCH] {
        std::array::from_fn(|l| bits & (1 << l) != 0)
    }
    #[inline(always)]
    fn store_whole(self, x: Whole) -> Whole {
        x
    }
    #[inline(always)]
    fn splat_whole(self, x: i32) -> Whole {
        [x; BATCH]
    }
    #[inline(always)]
    fn add_whole_if(self, mask: [bool; BATCH], a: Whole, x: Whole) -> Whole {
        std::array::from_fn(|l| if mask[l] { a[l].wrapping_add(x[l]) } else { a[l] })
    }
    #[inline(always)]
    fn load_half(self, x: &Lanes) -> Lanes {
        *x
    }
    #[inline(always)]
    fn splat_half(self, x: f64) -> Lanes {
        [x; LANES]
    }
    #[inline(always)]
    fn sub_half(self, a: Lanes, b: Lanes) -> Lanes {
        std::array::from_fn(|l| a[l] - b[l])
    }
    #[inline(always)]
    fn add_half_if(self, mask: [bool; LANES], a: Lanes, x: Lanes) -> Lanes {
        std::array::from_fn(|l| if mask[l] { a[l] + x[l] } else { a[l] })
    }
    #[inline(always)]
    fn store_half(self, x: Lanes) -> Lanes {
        x
    }
}

#[inline(always)]
fn compress(mut bits: u32, x: &Singles, to: &mut [f32]) {
    for slot in to {
        if bits == 0 {
            break;
        }
        *slot = x[bits.trailing_zeros() as usize % BATCH];
        bits &= bits - 1;
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::{BATCH, LANES, Lanes, Simd, Singles, Whole, Wide};

    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,bmi1,bmi2,lzcnt,popcnt")]
    pub fn with_avx512<W: Wide>(work: W) -> W::Output {
        work.run(Avx512)
    }

    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
    pub fn with_avx2<W: Wide>(work: W) -> W::Output {
        work.run(Avx2)
    }

    #[derive(Clone, Copy)]
    pub struct Avx512;

    // SAFETY, for all of it: only `with_avx512` has an `Avx512`, and loads and stores are of whole arrays
    impl Simd for Avx512 {
        type F = __m512;
        type D = __m512d;
        type I = __m512i;
        type M = __mmask16;
        type H = __mmask8;

        const MANY_REGISTERS: bool = true;

        #[inline(always)]
        fn load(self, x: &Singles) -> __m512 {
            unsafe { _mm512_loadu_ps(x.as_ptr()) }
        }
        #[inline(always)]
        fn store(self, x: __m512) -> Singles {
            unsafe { std::mem::transmute::<__m512, Singles>(x) }
        }
        #[inline(always)]
        fn splat(self, x: f32) -> __m512 {
            unsafe { _mm512_set1_ps(x) }
        }
        #[inline(always)]
        fn add(self, a: __m512, b: __m512) -> __m512 {
            unsafe { _mm512_add_ps(a, b) }
        }
        #[inline(always)]
        fn sub(self, a: __m512, b: __m512) -> __m512 {
            unsafe { _mm512_sub_ps(a, b) }
        }
        #[inline(always)]
        fn mul(self, a: __m512, b: __m512) -> __m512 {
            unsafe { _mm512_mul_ps(a, b) }
        }
        #[inline(always)]
        fn le(self, a: __m512, b: __m512) -> __mmask16 {
            unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b) }
        }
        #[inline(always)]
        fn select(self, mask: __mmask16, a: __m512, b: __m512) -> __m512 {
            unsafe { _mm512_mask_blend_ps(mask, b, a) }
        }
        #[inline(always)]
        fn bits(self, mask: __mmask16) -> u32 {
            u32::from(mask)
        }
        #[inline(always)]
        fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> __m512 {
            unsafe {
                let (origin, unit) = (_mm512_set1_pd(origin), _mm512_set1_pd(unit));
                let low = _mm512_mul_pd(_mm512_sub_pd(_mm512_loadu_pd(x.as_ptr()), origin), unit);
                let high = _mm512_mul_pd(_mm512_sub_pd(_mm512_loadu_pd(x[LANES..].as_ptr()), origin), unit);
                let low = _mm512_castps256_ps512(_mm512_cvtpd_ps(low));
                _mm512_insertf32x8::<1>(low, _mm512_cvtpd_ps(high))
            }
        }
        #[inline(always)]
        fn compress(self, bits: u32, x: __m512, to: &mut [f32]) {
            assert!(to.len() >= BATCH);
            unsafe { _mm512_storeu_ps(to.as_mut_ptr(), _mm512_maskz_compress_ps(bits as __mmask16, x)) }
        }
        #[inline(always)]
        fn min(self, a: __m512, b: __m512) -> __m512 {
            unsafe { _mm512_min_ps(a, b) }
        }
        #[inline(always)]
        fn max(self, a: __m512, b: __m512) -> __m512 {
            unsafe { _mm512_max_ps(a, b) }
        }
        #[inline(always)]
        fn half<const SECOND: bool>(self, mask: __mmask16) -> __mmask8 {
            if SECOND { (mask >> LANES) as __mmask8 } else { mask as __mmask8 }
        }
        #[inline(always)]
        fn zero(self) -> __m512d {
            unsafe { _mm512_setzero_pd() }
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
        fn mask(self, bits: u32) -> __mmask16 {
            bits as __mmask16
        }
        #[inline(always)]
        fn store_whole(self, x: __m512i) -> Whole {
            unsafe { std::mem::transmute::<__m512i, Whole>(x) }
        }
        #[inline(always)]
        fn splat_whole(self, x: i32) -> __m512i {
            unsafe { _mm512_set1_epi32(x) }
        }
        #[inline(always)]
        fn add_whole_if(self, mask: __mmask16, a: __m512i, x: __m512i) -> __m512i {
            unsafe { _mm512_mask_add_epi32(a, mask, a, x) }
        }
        #[inline(always)]
        fn load_half(self, x: &Lanes) -> __m512d {
            unsafe { _mm512_loadu_pd(x.as_ptr()) }
        }
        #[inline(always)]
        fn splat_half(self, x: f64) -> __m512d {
            unsafe { _mm512_set1_pd(x) }
        }
        #[inline(always)]
        fn sub_half(self, a: __m512d, b: __m512d) -> __m512d {
            unsafe { _mm512_sub_pd(a, b) }
        }
        #[inline(always)]
        fn add_half_if(self, mask: __mmask8, a: __m512d, x: __m512d) -> __m512d {
            unsafe { _mm512_mask_add_pd(a, mask, a, x) }
        }
        #[inline(always)]
        fn store_half(self, x: __m512d) -> Lanes {
            unsafe { std::mem::transmute::<__m512d, Lanes>(x) }
        }
    }

    #[derive(Clone, Copy)]
    pub struct Avx2;

    // SAFETY, for all of it: only `with_avx2` has an `Avx2`, and loads and stores are of whole arrays
    impl Simd for Avx2 {
        type F = [__m256; 2];
        type D = [__m256d; 2];
        type I = [__m256i; 2];
        type M = [__m256; 2];
        type H = __m256;

        const MANY_REGISTERS: bool = false;

        #[inline(always)]
        fn load(self, x: &Singles) -> [__m256; 2] {
            unsafe { [_mm256_loadu_ps(x.as_ptr()), _mm256_loadu_ps(x[LANES..].as_ptr())] }
        }
        #[inline(always)]
        fn store(self, x: [__m256; 2]) -> Singles {
            unsafe { std::mem::transmute::<[__m256; 2], Singles>(x) }
        }
        #[inline(always)]
        fn splat(self, x: f32) -> [__m256; 2] {
            unsafe { [_mm256_set1_ps(x); 2] }
        }
        #[inline(always)]
        fn add(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            unsafe { [_mm256_add_ps(a[0], b[0]), _mm256_add_ps(a[1], b[1])] }
        }
        #[inline(always)]
        fn sub(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            unsafe { [_mm256_sub_ps(a[0], b[0]), _mm256_sub_ps(a[1], b[1])] }
        }
        #[inline(always)]
        fn mul(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            unsafe { [_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])] }
        }
        #[inline(always)]
        fn le(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            unsafe { [_mm256_cmp_ps::<_CMP_LE_OQ>(a[0], b[0]), _mm256_cmp_ps::<_CMP_LE_OQ>(a[1], b[1])] }
        }
        #[inline(always)]
        fn select(self, mask: [__m256; 2], a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            unsafe { [_mm256_blendv_ps(b[0], a[0], mask[0]), _mm256_blendv_ps(b[1], a[1], mask[1])] }
        }
        #[inline(always)]
        fn bits(self, mask: [__m256; 2]) -> u32 {
            unsafe { (_mm256_movemask_ps(mask[0]) | (_mm256_movemask_ps(mask[1]) << LANES)) as u32 }
        }
        #[inline(always)]
        fn narrow(self, x: &[f64; BATCH], origin: f64, unit: f64) -> [__m256; 2] {
            unsafe {
                let (origin, unit) = (_mm256_set1_pd(origin), _mm256_set1_pd(unit));
                let mut quarters = [_mm_setzero_ps(); 4];
                for i in 0..4 {
                    let x = _mm256_sub_pd(_mm256_loadu_pd(x[4 * i..].as_ptr()), origin);
                    quarters[i] = _mm256_cvtpd_ps(_mm256_mul_pd(x, unit));
                }
                [_mm256_set_m128(quarters[1], quarters[0]), _mm256_set_m128(quarters[3], quarters[2])]
            }
        }
        #[inline(always)]
        fn compress(self, bits: u32, x: [__m256; 2], to: &mut [f32]) {
            super::compress(bits, &self.store(x), to);
        }
        #[inline(always)]
        fn min(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            unsafe { [_mm256_min_ps(a[0], b[0]), _mm256_min_ps(a[1], b[1])] }
        }
        #[inline(always)]
        fn max(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            unsafe { [_mm256_max_ps(a[0], b[0]), _mm256_max_ps(a[1], b[1])] }
        }
        #[inline(always)]
        fn half<const SECOND: bool>(self, mask: [__m256; 2]) -> __m256 {
            mask[usize::from(SECOND)]
        }
        #[inline(always)]
        fn zero(self) -> [__m256d; 2] {
            unsafe { [_mm256_setzero_pd(); 2] }
        }
        #[inline(always)]
        fn or(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            unsafe { [_mm256_or_ps(a[0], b[0]), _mm256_or_ps(a[1], b[1])] }
        }
        #[inline(always)]
        fn xor(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            unsafe { [_mm256_xor_ps(a[0], b[0]), _mm256_xor_ps(a[1], b[1])] }
        }
        #[inline(always)]
        fn mask(self, bits: u32) -> [__m256; 2] {
            unsafe {
                let lanes = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let low = _mm256_and_si256(_mm256_set1_epi32(bits as i32), lanes);
                let high = _mm256_and_si256(_mm256_set1_epi32((bits >> LANES) as i32), lanes);
                [
                    _mm256_castsi256_ps(_mm256_cmpeq_epi32(low, lanes)),
                    _mm256_castsi256_ps(_mm256_cmpeq_epi32(high, lanes)),
                ]
            }
        }
        #[inline(always)]
        fn store_whole(self, x: [__m256i; 2]) -> Whole {
            unsafe { std::mem::transmute::<[__m256i; 2], Whole>(x) }
        }
        #[inline(always)]
        fn splat_whole(self, x: i32) -> [__m256i; 2] {
            unsafe { [_mm256_set1_epi32(x); 2] }
        }
        #[inline(always)]
        fn add_whole_if(self, mask: [__m256; 2], a: [__m256i; 2], x: [__m256i; 2]) -> [__m256i; 2] {
            unsafe {
                let x = [
                    _mm256_and_si256(_mm256_castps_si256(mask[0]), x[0]),
                    _mm256_and_si256(_mm256_castps_si256(mask[1]), x[1]),
                ];
                [_mm256_add_epi32(a[0], x[0]), _mm256_add_epi32(a[1], x[1])]
            }
        }
        #[inline(always)]
        fn load_half(self, x: &Lanes) -> [__m256d; 2] {
            unsafe { [_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x[LANES / 2..].as_ptr())] }
        }
        #[inline(always)]
        fn splat_half(self, x: f64) -> [__m256d; 2] {
            unsafe { [_mm256_set1_pd(x); 2] }
        }
        #[inline(always)]
        fn sub_half(self, a: [__m256d; 2], b: [__m256d; 2]) -> [__m256d; 2] {
            unsafe { [_mm256_sub_pd(a[0], b[0]), _mm256_sub_pd(a[1], b[1])] }
        }
        #[inline(always)]
        fn add_half_if(self, mask: __m256, a: [__m256d; 2], x: [__m256d; 2]) -> [__m256d; 2] {
            unsafe {
                let mask = _mm256_castps_si256(mask);
                let low = _mm256_cvtepi32_epi64(_mm256_castsi256_si128(mask));
                let high = _mm256_cvtepi32_epi64(_mm256_extracti128_si256::<1>(mask));
                [
                    _mm256_blendv_pd(a[0], _mm256_add_pd(a[0], x[0]), _mm256_castsi256_pd(low)),
                    _mm256_blendv_pd(a[1], _mm256_add_pd(a[1], x[1]), _mm256_castsi256_pd(high)),
                ]
            }
        }
        #[inline(always)]
        fn store_half(self, x: [__m256d; 2]) -> Lanes {
            unsafe { std::mem::transmute::<[__m256d; 2], Lanes>(x) }
        }
    }

    #[cfg(not(test))]
    pub const fn allowed_width() -> u32 {
        u32::MAX
    }

    #[cfg(test)]
    pub fn allowed_width() -> u32 {
        super::tests::WIDTH.load(std::sync::atomic::Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use crate::{
        IcpOptions, Neighbors, Objective, Point, RigidMotion, Viewpoints, centerline, count_neighbors,
        estimate_normals, icp,
    };

    /// Registers that are wider than this many bits are not used.
    pub static WIDTH: AtomicU32 = AtomicU32::new(u32::MAX);

    /// All numbers that the kernels give for one cloud, as bits.
    fn answers(points: &[Point]) -> Vec<u64> {
        let mut bits = Vec::new();
        let mut numbers = |values: &[f64]| bits.extend(values.iter().map(|x| x.to_bits()));
        let counts = count_neighbors(points, 0.2).unwrap();
        numbers(&counts.iter().map(|&count| count as f64).collect::<Vec<_>>());
        let above = Viewpoints::One([0.0, 0.0, 9.0]);
        for neighbors in [Neighbors::Nearest(12), Neighbors::Within(0.2)] {
            let found = estimate_normals(points, neighbors, above).unwrap();
            numbers(found.normals.as_flattened());
            numbers(&found.variation);
            numbers(centerline(points, &found.normals, 0.2, 5).unwrap().points.as_flattened());
        }
        let source: Vec<Point> = points.iter().map(|p| [p[0] + 0.02, p[1] - 0.01, p[2] + 0.03]).collect();
        let options = IcpOptions {
            start: RigidMotion::identity(),
            max_correspondence_distance: 0.1,
            max_iterations: 5,
            tolerance: 0.0,
        };
        let found = icp(&source, points, Objective::PointToPoint, &options).unwrap();
        numbers(found.transformation.to_rows().as_flattened());
        numbers(&[found.fitness, found.inlier_rmse]);
        bits
    }

    #[test]
    fn answers_are_the_same_bits_for_any_width() {
        // low-discrepancy points on a wavy sheet, and some of them twice
        let points: Vec<Point> = (0..4000)
            .map(|i| {
                let at = |step: f64| (f64::from(i % 3700) * step).fract();
                let (x, y) = (4.0 * at(0.754_877_666), 4.0 * at(0.569_840_291));
                [x, y, 0.3 * (2.0 * x).sin() * y.cos()]
            })
            .collect();
        let expected = answers(&points);
        for width in [256, 128] {
            WIDTH.store(width, Ordering::Relaxed);
            assert!(answers(&points) == expected, "{width} bits");
        }
        WIDTH.store(u32::MAX, Ordering::Relaxed);
    }
}
