//! Whole numbers drawn by chance, the same in every call: those that NumPy's default generator draws with the seed 0.

// state of PCG64 that NumPy makes of the seed
const START: u128 = 0x1aa1_b534_5996_452d_0958_5eb7_a695_61e3;
const STEP: u128 = 0x418d_dadb_3af7_1a82_5881_33bc_4478_73a9;
const FACTOR: u128 = 0x2360_ed05_1fc6_5da4_4385_df64_9fcc_f645;

/// A stream of 32-bit numbers: PCG64 of O'Neill (2014), XSL-RR, whose numbers of 64 bits give their low half first.
struct Stream {
    state: u128,
    high: Option<u32>,
}

impl Stream {
    fn next(&mut self) -> u32 {
        if let Some(high) = self.high.take() {
            return high;
        }
        self.state = self.state.wrapping_mul(FACTOR).wrapping_add(STEP);
        let mixed = ((self.state >> 64) as u64 ^ self.state as u64).rotate_right((self.state >> 122) as u32);
        self.high = Some((mixed >> 32) as u32);
        mixed as u32
    }
}

/// Draws numbers from 0 on that are below a bound, all equally likely (Lemire 2019); None without memory.
///
/// The bound is not 0.
pub fn draw_numbers(below: u32, count: usize) -> Option<Vec<i64>> {
    let mut stream = Stream { state: START, high: None };
    // products whose low half is less would make some numbers likelier
    let least = below.wrapping_neg() % below;
    let mut draw = || {
        loop {
            let product = u64::from(stream.next()) * u64::from(below);
            if product as u32 >= least {
                return (product >> 32) as i64;
            }
        }
    };
    let mut numbers = Vec::new();
    numbers.try_reserve_exact(count).ok()?;
    numbers.extend((0..count).map(|_| draw()));
    Some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_numpy() {
        // np.random.default_rng(0).integers(0, below, 6)
        assert_eq!(draw_numbers(10, 6).unwrap(), [8, 6, 5, 2, 3, 0]);
        assert_eq!(
            draw_numbers(3_000_000_000, 6).unwrap(),
            [2_551_872_677, 1_910_885_061, 1_533_409_439, 809_360_140, 923_488_268, 122_920_571]
        );
        assert_eq!(draw_numbers(1, 3).unwrap(), [0, 0, 0]);
    }
}
