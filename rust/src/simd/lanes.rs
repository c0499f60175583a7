//! Numbers in memory, as many as are processed together.

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

/// Eight single-precision numbers in memory.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub struct Lanes(pub [f32; LANES]);

impl Lanes {
    /// Puts one number into all lanes.
    pub const fn all(value: f32) -> Self {
        Self([value; LANES])
    }
}

/// Returns the first lane with the least number, and that number; any lane if one is NaN.
#[inline(always)]
pub fn find_least<T: Copy + PartialOrd>(numbers: &[T; LANES]) -> (usize, T) {
    let mut least = *numbers;
    for half in [4, 2, 1] {
        for l in 0..half {
            least[l] = if least[l + half] < least[l] { least[l + half] } else { least[l] };
        }
    }
    let least = least[0];
    let mut bits = 0u32;
    for l in 0..LANES {
        bits |= u32::from(numbers[l] == least) << l;
    }
    ((bits.trailing_zeros() as usize).min(LANES - 1), least)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_lane_is_the_first_of_the_least_numbers() {
        for first in 0..LANES {
            for second in first..LANES {
                let mut lanes = Lanes::all(f32::INFINITY);
                (lanes.0[first], lanes.0[second]) = (-1.5, -1.5);
                assert_eq!(find_least(&lanes.0), (first, -1.5));
                lanes.0[second] = -2.0;
                assert_eq!(find_least(&lanes.0), (second, -2.0));
            }
        }
        assert_eq!(find_least(&[0.0; LANES]), (0, 0.0));
    }
}
