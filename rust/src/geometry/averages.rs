//! Averages of values in groups.

/// Returns the number of values in each group, their mean and their mean square. Those of empty groups are 0.
///
/// A value comes with the number of its group; values of other groups do not count.
pub fn average_groups(
    values: impl Iterator<Item = (usize, f64)>,
    groups: usize,
) -> (Vec<i64>, Vec<f64>, Vec<f64>) {
    let (mut counts, mut means, mut squares) = (vec![0i64; groups], vec![0.0; groups], vec![0.0; groups]);
    for (group, value) in values.filter(|&(group, _)| group < groups) {
        counts[group] += 1;
        means[group] += value;
        squares[group] += value * value;
    }
    for (k, &count) in counts.iter().enumerate() {
        let count = count.max(1) as f64;
        means[k] /= count;
        squares[k] /= count;
    }
    (counts, means, squares)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_have_their_own_averages() {
        let values = [(2, 1.0), (0, -3.0), (2, 5.0), (7, 1.0)];
        let (counts, means, squares) = average_groups(values.into_iter(), 3);
        assert_eq!((counts, means, squares), (vec![1, 0, 2], vec![-3.0, 0.0, 3.0], vec![9.0, 0.0, 13.0]));
    }
}
