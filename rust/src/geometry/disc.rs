//! Discs of pixels.

use crate::parallel::go_on;

/// Returns the number of pairs of a disc's pixels at each distance in rows and columns, and the side of that square.
///
/// The disc has the pixels at most `reach` from its middle one. Distances are 0, 1, ..., -2, -1.
pub fn count_disc_pairs(reach: f64) -> (Vec<f64>, usize) {
    let whole = reach as i64;
    let widths: Vec<i64> = (-whole..=whole)
        .map(|row| (0..=whole).rev().find(|&column| (row as f64).hypot(column as f64) <= reach).unwrap_or(-1))
        .collect();
    let reached = 2 * whole + 1;
    let count = |down: i64, across: i64| -> i64 {
        go_on();
        let rows = widths.iter().zip(&widths[down as usize..]);
        // rows are intervals around the middle column
        rows.map(|(&one, &other)| (one.min(other + across) - (-one).max(across - other) + 1).max(0)).sum()
    };
    // the sign of a distance makes no difference
    let quarter: Vec<f64> = (0..reached)
        .flat_map(|down| (0..reached).map(move |across| (down, across)))
        .map(|(down, across)| count(down, across) as f64)
        .collect();
    let size = (4 * whole + 1) as usize;
    let away = |k: usize| k.min(size - k);
    let pairs =
        (0..size * size).map(|k| quarter[away(k / size) * reached as usize + away(k % size)]).collect();
    (pairs, size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_counted_at_all_distances() {
        for reach in [1.0, 1.9, 3.2, 5.0] {
            let whole = reach as i64;
            let inside: Vec<[i64; 2]> = (-whole..=whole)
                .flat_map(|row| (-whole..=whole).map(move |column| [row, column]))
                .filter(|&[row, column]| (row as f64).hypot(column as f64) <= reach)
                .collect();
            let (pairs, size) = count_disc_pairs(reach);
            let mut expected = vec![0.0; size * size];
            for one in &inside {
                for other in &inside {
                    let [down, across] = [0, 1].map(|k| (one[k] - other[k]).rem_euclid(size as i64) as usize);
                    expected[down * size + across] += 1.0;
                }
            }
            assert_eq!(pairs, expected);
        }
    }
}
