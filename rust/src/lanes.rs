//! Numbers that are worked on eight at once.
//!
//! Work is written once, for any kind of eight numbers, and compiled twice: for plain arrays, and for the registers of
//! AVX, which are used where the processor has AVX2. Both round alike, so results are the same bits. Such work must be
//! inlined as a whole: what it is made of says so, and has no closures.

use std::ops::{Add, Div, Mul, Sub};

/// How many numbers.
pub const LANES: usize = 8;

/// Eight numbers in single precision, as they lie in memory.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub struct Lanes(pub [f32; LANES]);

impl Lanes {
    /// The same number in all lanes.
    pub const fn all(value: f32) -> Self {
        Self([value; LANES])
    }
}

/// Eight numbers to work with.
pub trait Eight:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The same number in all lanes.
    fn all(value: f32) -> Self;
    /// Takes numbers from memory.
    fn load(numbers: &Lanes) -> Self;
    /// Puts the numbers into memory.
    fn store(self) -> Lanes;
    /// Square roots.
    fn sqrt(self) -> Self;
    /// The greatest whole numbers that are not greater.
    fn floor(self) -> Self;
    /// Absolute values.
    fn abs(self) -> Self;
    /// The larger of each two; the other one if this is not a number.
    fn max(self, other: Self) -> Self;
    /// The smaller of each two; the other one if this is not a number.
    fn min(self, other: Self) -> Self;
    /// Where this is less than the other: 1, elsewhere 0.
    fn below(self, other: Self) -> Self;
    /// Where this is not above the other: 1, elsewhere 0.
    fn not_above(self, other: Self) -> Self;
    /// The first number where this is not 0, elsewhere the second.
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

macro_rules! operators {
    ($type:ident, $(($trait:ident, $method:ident, $a:ident, $b:ident, $formula:expr)),*) => {
        $(impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let ($a, $b) = (self, other);
                $formula
            }
        })*
    };
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

operators!(
    Lanes,
    (Add, add, a, b, each!(l => a.0[l] + b.0[l])),
    (Sub, sub, a, b, each!(l => a.0[l] - b.0[l])),
    (Mul, mul, a, b, each!(l => a.0[l] * b.0[l])),
    (Div, div, a, b, each!(l => a.0[l] / b.0[l]))
);

impl Eight for Lanes {
    #[inline(always)]
    fn all(value: f32) -> Self {
        Self([value; LANES])
    }
    #[inline(always)]
    fn load(numbers: &Lanes) -> Self {
        *numbers
    }
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

/// Eight numbers in a register of AVX. Work with them may only be called where the processor has AVX2, see [`wide`].
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub struct Avx(std::arch::x86_64::__m256);

#[cfg(target_arch = "x86_64")]
mod avx {
    use std::arch::x86_64::*;
    use std::ops::{Add, Div, Mul, Sub};

    use super::{Avx, Eight, Lanes};

    // SAFETY: of all that follow: only called where the processor has AVX2
    operators!(
        Avx,
        (Add, add, a, b, Avx(unsafe { _mm256_add_ps(a.0, b.0) })),
        (Sub, sub, a, b, Avx(unsafe { _mm256_sub_ps(a.0, b.0) })),
        (Mul, mul, a, b, Avx(unsafe { _mm256_mul_ps(a.0, b.0) })),
        (Div, div, a, b, Avx(unsafe { _mm256_div_ps(a.0, b.0) }))
    );

    impl Eight for Avx {
        #[inline(always)]
        fn all(value: f32) -> Self {
            Self(unsafe { _mm256_set1_ps(value) })
        }
        #[inline(always)]
        fn load(numbers: &Lanes) -> Self {
            Self(unsafe { _mm256_load_ps(numbers.0.as_ptr()) })
        }
        #[inline(always)]
        fn store(self) -> Lanes {
            let mut numbers = Lanes([0.0; super::LANES]);
            unsafe { _mm256_store_ps(numbers.0.as_mut_ptr(), self.0) };
            numbers
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn floor(self) -> Self {
            Self(unsafe { _mm256_floor_ps(self.0) })
        }
        #[inline(always)]
        fn abs(self) -> Self {
            Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            Self(unsafe { _mm256_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            Self(unsafe { _mm256_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn below(self, other: Self) -> Self {
            Self(unsafe { _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0), _mm256_set1_ps(1.0)) })
        }
        #[inline(always)]
        fn not_above(self, other: Self) -> Self {
            Self(unsafe { _mm256_and_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0), _mm256_set1_ps(1.0)) })
        }
        #[inline(always)]
        fn choose(self, yes: Self, no: Self) -> Self {
            Self(unsafe {
                let mask = _mm256_cmp_ps::<_CMP_NEQ_UQ>(self.0, _mm256_setzero_ps());
                _mm256_blendv_ps(no.0, yes.0, mask)
            })
        }
    }
}

/// Defines a function of a kind of eight numbers `V` that chooses the kind by what the processor has.
macro_rules! wide {
    ($(#[$meta:meta])* $vis:vis fn $name:ident<$kind:ident>($($argument:ident: $type:ty),* $(,)?) $(-> $result:ty)? $body:block) => {
        $(#[$meta])*
        $vis fn $name($($argument: $type),*) $(-> $result)? {
            #[inline(always)]
            fn work<$kind: $crate::lanes::Eight>($($argument: $type),*) $(-> $result)? $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            fn wider($($argument: $type),*) $(-> $result)? {
                work::<$crate::lanes::Avx>($($argument),*)
            }

            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has AVX2
                return unsafe { wider($($argument),*) };
            }
            work::<$crate::lanes::Lanes>($($argument),*)
        }
    };
}
pub(crate) use wide;

/// Eight vectors, coordinate by coordinate.
#[derive(Clone, Copy)]
pub struct Three<V>(pub [V; 3]);

impl<V: Eight> Three<V> {
    /// The same vector in all lanes.
    #[inline(always)]
    pub fn all(vector: [f32; 3]) -> Self {
        Self([V::all(vector[0]), V::all(vector[1]), V::all(vector[2])])
    }

    /// Takes vectors from memory.
    #[inline(always)]
    pub fn load(vectors: &[Lanes; 3]) -> Self {
        Self([V::load(&vectors[0]), V::load(&vectors[1]), V::load(&vectors[2])])
    }

    /// Inner products.
    #[inline(always)]
    pub fn dot(self, other: Self) -> V {
        self.0[0] * other.0[0] + self.0[1] * other.0[1] + self.0[2] * other.0[2]
    }

    /// Vector products.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
    }

    /// Unit vectors; 0 for those without length.
    #[inline(always)]
    pub fn unit(self) -> Self {
        self * (V::all(1.0) / self.dot(self).sqrt().max(V::all(f32::MIN_POSITIVE)))
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

#[cfg(test)]
mod tests {
    use super::*;

    /// All operations on some numbers.
    fn results<V: Eight>(a: &Lanes, b: &Lanes) -> Vec<Lanes> {
        let (a, b) = (V::load(a), V::load(b));
        let (x, y) = (Three([a, b, a]), Three([b, a, V::all(2.0)]));
        let three = (x.cross(y) + x - y).unit().0;
        [
            a + b,
            a - b,
            a * b,
            a / b,
            a.abs().sqrt(),
            a.floor(),
            a.max(b),
            a.min(b),
            a.below(b),
            a.not_above(b),
            a.below(b).choose(a, b),
            x.dot(y),
            three[0],
            three[2],
            V::all(a.sum() as f32),
        ]
        .map(V::store)
        .to_vec()
    }

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn registers_and_arrays_round_alike() {
        #[target_feature(enable = "avx2")]
        fn in_registers(a: &Lanes, b: &Lanes) -> Vec<Lanes> {
            results::<Avx>(a, b)
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            let a = Lanes([0.1, -2.7, 3e8, -0.0, 5.5, 1e-20, 7.7, 8.0]);
            let b = Lanes([0.3, 2.7, -3e8, 1.0, 5.5, 1e-10, -7.1, 0.9]);
            // SAFETY: the processor has AVX2
            assert_eq!(unsafe { in_registers(&a, &b) }, results::<Lanes>(&a, &b));
        }
    }
}
