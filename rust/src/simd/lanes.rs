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
