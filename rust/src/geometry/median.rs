//! Medians.

pub const MEDIAN_TO_SD: f64 = 1.4826; // standard deviation of a normal distribution, medians of the absolute deviation

/// Returns the median: the mean of the middle two of an even number of values; None without values.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let half = values.len() / 2;
    let odd = values.len() % 2 == 1;
    let (below, &mut upper, _) = values.select_nth_unstable_by(half, f64::total_cmp);
    Some(if odd { upper } else { 0.5 * (upper + below.iter().copied().fold(f64::NEG_INFINITY, f64::max)) })
}

/// Returns the middle value, or the upper of the middle two; panics without values.
pub fn upper_median(values: &mut [f64]) -> f64 {
    let half = values.len() / 2;
    *values.select_nth_unstable_by(half, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_those_of_sorted_values() {
        assert_eq!(median(vec![]), None);
        assert_eq!(median(vec![3.0, -1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, -1.0, 2.0, 3.0]), Some(2.5));
        assert_eq!(upper_median(&mut [3.0, -1.0, 2.0]), 2.0);
        assert_eq!(upper_median(&mut [4.0, -1.0, 2.0, 3.0]), 3.0);
    }
}
