//! Limits that several structures share.

pub const POINTS_PER_PART: usize = 1 << 12; // points that one task of a parallel pass over a cloud works on
/// The hierarchy takes over where the cells around a batch of points, or a point, hold more points than this.
pub const CROWDED: usize = 1 << 14;
pub const WIDE: f64 = 16.0; // the hierarchy also takes over where cells are this many times as wide as the caller asked for
pub const SHORTEST: f64 = 1e-150; // shorter distances count as this, metres: double precision loses their squares
