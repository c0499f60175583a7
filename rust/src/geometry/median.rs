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

const MANY: usize = 4096; // fewer values are selected from at once
const SAMPLE: usize = 512; // values that show where the median lies, about
const SPAN: usize = 32; // ranks of the sample on each side of its median between which that of all values lies

/// Returns what [`median`] does, of many values without NaN, which `list` lists anew each time.
pub fn median_of_many<I: Iterator<Item = f64>>(list: impl Fn() -> I) -> Option<f64> {
    let count = list().count();
    if count < MANY {
        return median(list().collect());
    }
    let mut sample: Vec<f64> = list().step_by(count / SAMPLE).collect();
    sample.sort_unstable_by(f64::total_cmp);
    let middle = sample.len() / 2;
    let (low, high) = (sample[middle - SPAN], sample[middle + SPAN]);
    let mut below = 0;
    let mut near = Vec::new();
    for value in list() {
        below += usize::from(value < low);
        if value >= low && value <= high {
            near.push(value);
        }
    }
    // both middle values of an even number must be among these
    let Some(half) = (count / 2).checked_sub(below).filter(|&half| half > 0 && half < near.len()) else {
        return median(list().collect());
    };
    let odd = count % 2 == 1;
    let (before, &mut upper, _) = near.select_nth_unstable_by(half, f64::total_cmp);
    Some(if odd { upper } else { 0.5 * (upper + before.iter().copied().fold(f64::NEG_INFINITY, f64::max)) })
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
        for count in [0, 5, 5000, 20_001, 30_000] {
            for distinct in [1, 3, 1_000_003] {
                let many: Vec<f64> = (0..count).map(|i| f64::from(i * 7919 % distinct)).collect();
                assert_eq!(median_of_many(|| many.iter().copied()), median(many));
            }
        }
        let rising: Vec<f64> = (0..9000).map(f64::from).collect();
        assert_eq!(median_of_many(|| rising.iter().copied()), Some(4499.5));
        assert_eq!(upper_median(&mut [3.0, -1.0, 2.0]), 2.0);
        assert_eq!(upper_median(&mut [4.0, -1.0, 2.0, 3.0]), 3.0);
    }
}
