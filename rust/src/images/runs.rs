//! Masks that are read and filled by runs of a row.

use std::ops::Range;

use crate::geometry::cut_off;

/// A mask that is read and filled by runs of a row.
pub trait Mask {
    /// Its columns and rows.
    fn size(&self) -> [usize; 2];

    /// Returns the first column of a row from `from` on with a value, or the number of columns if there is none.
    fn find_next(&self, row: usize, from: usize, value: bool) -> usize;

    /// Fills columns of a row.
    fn fill(&mut self, row: usize, columns: Range<usize>, value: bool);
}

/// Returns the pixels of `count` < 2³² that lie between two numbers, both included.
#[inline(always)]
pub fn list_between(low: f64, high: f64, count: usize) -> Range<usize> {
    let first = cut_off(low);
    let first = first as usize + usize::from(f64::from(first) < low);
    let last = if high >= 0.0 { (cut_off(high) as usize + 1).min(count) } else { 0 };
    first.min(last)..last
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_between_two_numbers_are_those_by_floor_and_ceil() {
        let numbers =
            [-1e300, -2.5, -1.0, -0.5, -0.0, 0.0, 0.3, 1.0, 1.5, 6.999_999_999_999_999, 7.0, 8.2, 1e300];
        for (low, high) in numbers.into_iter().flat_map(|low| numbers.map(|high| (low, high))) {
            let expected: Vec<usize> = (0..8).filter(|&k| k as f64 >= low && k as f64 <= high).collect();
            assert_eq!(list_between(low, high, 8).collect::<Vec<_>>(), expected, "{low} to {high}");
        }
        assert!(list_between(f64::INFINITY, f64::NEG_INFINITY, 8).is_empty());
        assert!(list_between(0.0, f64::NAN, 8).is_empty());
    }
}
