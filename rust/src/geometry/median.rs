//! Medians.

use crate::simd::kernel;

pub const MEDIAN_TO_SD: f64 = 1.4826; // standard deviation of a normal distribution, medians of the absolute deviation

/// Returns the median: the mean of the middle two of an even number of values; None without values.
pub fn median(values: Vec<f64>) -> Option<f64> {
    let (half, odd) = (values.len() / 2, values.len() % 2 == 1);
    select(values.into_iter(), half, odd)
}

/// Returns the value of a rank, or else the mean of it and the value before; None without values.
fn select(values: impl Iterator<Item = f64>, rank: usize, alone: bool) -> Option<f64> {
    // whole numbers are compared in less time
    let mut keys: Vec<i64> = values.map(turn_to_key).collect();
    if keys.is_empty() {
        return None;
    }
    let (below, &mut upper, _) = keys.select_nth_unstable(rank);
    let upper = turn_to_number(upper);
    let lower = || below.iter().copied().max().map_or(upper, turn_to_number);
    Some(if alone { upper } else { 0.5 * (lower() + upper) })
}

/// Returns a whole number; these have the order of `f64::total_cmp`.
fn turn_to_key(number: f64) -> i64 {
    let bits = number.to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

/// Undoes [`turn_to_key`].
fn turn_to_number(key: i64) -> f64 {
    f64::from_bits((key ^ (((key >> 63) as u64) >> 1) as i64) as u64)
}

const MANY: usize = 4096; // fewer values are selected from at once
const SAMPLE: usize = 512; // values that show where the median lies, about
const SPAN: usize = 32; // ranks of the sample on each side of its median between which that of all values lies
const TOGETHER: usize = 32; // values that are compared together

/// Returns what [`median`] does, of many values without NaN.
pub fn median_of_many(values: &[f64]) -> Option<f64> {
    select_middle(values, values.len() % 2 == 1)
}

/// Returns the middle value, or the upper of the middle two, of values without NaN; None without values.
pub fn upper_median(values: &[f64]) -> Option<f64> {
    select_middle(values, true)
}

/// Returns [`upper_median`], and a robust standard deviation about it; None without values.
pub fn measure_spread(mut values: Vec<f64>) -> Option<(f64, f64)> {
    let middle = upper_median(&values)?;
    values.iter_mut().for_each(|value| *value = (*value - middle).abs());
    Some((middle, MEDIAN_TO_SD * upper_median(&values)?))
}

/// Returns the value in the middle, or else the mean of it and the one before; None without values.
fn select_middle(values: &[f64], alone: bool) -> Option<f64> {
    let count = values.len();
    if count < MANY {
        return select(values.iter().copied(), count / 2, alone);
    }
    let mut sample: Vec<f64> = values.iter().step_by(count / SAMPLE).copied().collect();
    sample.sort_unstable_by(f64::total_cmp);
    let middle = sample.len() / 2;
    let mut near = Vec::new();
    let below = keep_between(values, sample[middle - SPAN], sample[middle + SPAN], &mut near);
    // the one before must be among these too
    match (count / 2).checked_sub(below).filter(|&half| half > 0 && half < near.len()) {
        Some(half) => select(near.into_iter(), half, alone),
        None => select(values.iter().copied(), count / 2, alone),
    }
}

kernel! {
    /// Adds values that are neither below a number nor above another to others; returns how many are below.
    fn keep_between<S>(_, values: &[f64], low: f64, high: f64, kept: &mut Vec<f64>) -> usize {
        let mut below = 0;
        for values in values.chunks(TOGETHER) {
            let (mut less, mut any) = (0u64, false);
            for &value in values {
                less += u64::from(value < low);
                any |= (value >= low) & (value <= high);
            }
            below += less as usize;
            if any {
                // a branch for each value would often be mispredicted
                let (mut own, mut count) = ([0.0; TOGETHER], 0);
                for &value in values {
                    own[count] = value;
                    count += usize::from((value >= low) & (value <= high));
                }
                kept.extend_from_slice(&own[..count]);
            }
        }
        below
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_those_of_sorted_values() {
        assert_eq!(median(vec![]), None);
        assert_eq!(median(vec![3.0, -1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, -1.0, 2.0, 3.0]), Some(2.5));
        assert_eq!(median(vec![-4.0, -1.0, -2.0, -3.0]), Some(-2.5));
        assert_eq!(median(vec![f64::INFINITY, -1e300, 0.0, f64::NEG_INFINITY, -1e-300]), Some(-1e-300));
        let numbers = [f64::NEG_INFINITY, -1e300, -1.0, -0.0, 0.0, 1e-300, 1.0, f64::INFINITY, f64::NAN];
        let keys = numbers.map(turn_to_key);
        assert!(
            keys.is_sorted() && keys.map(|key| turn_to_number(key).to_bits()) == numbers.map(f64::to_bits)
        );
        for count in [0, 5, 5000, 20_001, 30_000] {
            for distinct in [1, 3, 1_000_003] {
                let many: Vec<f64> = (0..count).map(|i| f64::from(i * 7919 % distinct)).collect();
                assert_eq!(median_of_many(&many), median(many.clone()));
                let mut sorted = many.clone();
                sorted.sort_unstable_by(f64::total_cmp);
                assert_eq!(upper_median(&many).as_ref(), sorted.get(sorted.len() / 2));
            }
        }
        let rising: Vec<f64> = (0..9000).map(f64::from).collect();
        assert_eq!(median_of_many(&rising), Some(4499.5));
        let step = rising.len() / SAMPLE;
        let hidden: Vec<f64> = (0..rising.len()).map(|i| f64::from(u8::from(i % step > 0))).collect();
        assert_eq!(median_of_many(&hidden), Some(1.0));
        assert_eq!(upper_median(&[3.0, -1.0, 2.0]), Some(2.0));
        assert_eq!(upper_median(&[4.0, -1.0, 2.0, 3.0]), Some(3.0));
        assert_eq!(measure_spread(vec![4.0, -1.0, 2.0, 3.0, 3.5]), Some((3.0, MEDIAN_TO_SD)));
        assert_eq!(measure_spread(vec![]), None);
    }
}
