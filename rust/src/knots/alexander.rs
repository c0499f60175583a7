//! The Alexander polynomial of a diagram, exactly.
//!
//! Each crossing gives a row: 1 - t for the arc that passes over, t and -1 for those that end below it, left and right of
//! the upper strand. The determinant without one row and column is the polynomial, but for a factor of a power of t and
//! a sign. It is worked out modulo a prime at as many places as it has coefficients. (J. W. Alexander: Topological
//! invariants of knots and links, 1928.)

use super::code::GaussCode;

/// Diagrams with more crossings have no answer: coefficients, at most 2 to the number of crossings, must stay below half
/// the prime.
pub const MOST_CROSSINGS: usize = 48;

/// 2^61 - 1, a prime.
const PRIME: u64 = (1 << 61) - 1;
/// A root of unity modulo the prime, and its order.
const ROOT: u64 = 484_083_891_529_811_867;
const ORDER: u64 = 31;

/// Coefficients from the lowest to the highest power: a palindrome with the sum 1. None for too many crossings.
pub fn alexander(code: &GaussCode) -> Option<Vec<i64>> {
    let crossings = code.crossings();
    if crossings > MOST_CROSSINGS {
        return None;
    }
    if crossings < 3 {
        return Some(vec![1]);
    }
    let rows = rows(code);
    let values: Vec<u64> = (0..crossings as u64).map(|t| minor(&rows, t)).collect();
    let coefficients: Vec<i64> = interpolated(&values)
        .into_iter()
        .map(|x| if x > PRIME / 2 { x as i64 - PRIME as i64 } else { x as i64 })
        .collect();
    let first = coefficients.iter().position(|&x| x != 0)?;
    let last = coefficients.iter().rposition(|&x| x != 0)?;
    let sign: i64 = coefficients.iter().sum();
    Some(coefficients[first..=last].iter().map(|&x| sign * x).collect())
}

/// A number that all diagrams of knots with the same polynomial share: a power of its value at a root of unity, in which
/// factors of powers of t and signs go out. None for too many crossings.
pub fn mark(code: &GaussCode) -> Option<u64> {
    match code.crossings() {
        0..3 => Some(1),
        3..=MOST_CROSSINGS => Some(power(minor(&rows(code), ROOT), 2 * ORDER)),
        _ => None,
    }
}

/// By crossing: the arcs over it, left and right of it.
fn rows(code: &GaussCode) -> Vec<[usize; 3]> {
    let crossings = code.crossings();
    // arcs end where the knot passes below; the last goes on as the first
    let mut arc = 0;
    let mut rows = vec![[0; 3]; crossings];
    for visit in &code.visits {
        let row = &mut rows[visit.crossing as usize];
        if visit.over {
            row[0] = arc;
            continue;
        }
        let next = (arc + 1) % crossings;
        [row[1], row[2]] = if code.signs[visit.crossing as usize] > 0 { [next, arc] } else { [arc, next] };
        arc = next;
    }
    rows
}

/// The determinant without the last row and column at a value of t, by elimination. Rows are scaled, not divided: one
/// division at the end undoes it.
fn minor(rows: &[[usize; 3]], t: u64) -> u64 {
    let size = rows.len() - 1;
    let mut matrix = vec![0; size * size];
    for (row, &[over, left, right]) in rows[..size].iter().enumerate() {
        for (arc, value) in [(over, sum(1, PRIME - t)), (left, t), (right, PRIME - 1)] {
            if arc < size {
                matrix[row * size + arc] = sum(matrix[row * size + arc], value);
            }
        }
    }
    let (mut determinant, mut scale) = (1, 1);
    for k in 0..size {
        let Some(pivot) = (k..size).find(|&row| matrix[row * size + k] != 0) else { return 0 };
        if pivot != k {
            (0..size).for_each(|column| matrix.swap(pivot * size + column, k * size + column));
            determinant = PRIME - determinant;
        }
        let (above, below) = matrix.split_at_mut((k + 1) * size);
        let above = &above[k * size..];
        determinant = product(determinant, above[k]);
        for row in below.chunks_exact_mut(size).filter(|row| row[k] != 0) {
            let factor = PRIME - row[k];
            for column in k + 1..size {
                row[column] = sum(product(above[k], row[column]), product(factor, above[column]));
            }
            scale = product(scale, above[k]);
        }
    }
    product(determinant, inverse(scale))
}

/// Coefficients of the polynomial that has these values at 0, 1, 2 and so on, by Newton's divided differences.
fn interpolated(values: &[u64]) -> Vec<u64> {
    let count = values.len();
    let mut differences = values.to_vec();
    for step in 1..count {
        let inverse = inverse(step as u64);
        for k in (step..count).rev() {
            differences[k] = product(sum(differences[k], PRIME - differences[k - 1]), inverse);
        }
    }
    let mut coefficients = vec![0; count];
    for k in (0..count).rev() {
        // times (t - k), plus the next difference
        for power in (0..count).rev() {
            let lower = if power > 0 { coefficients[power - 1] } else { differences[k] };
            coefficients[power] = sum(lower, product(PRIME - k as u64, coefficients[power]));
        }
    }
    coefficients
}

fn sum(a: u64, b: u64) -> u64 {
    let sum = a + b;
    if sum >= PRIME { sum - PRIME } else { sum }
}

fn product(a: u64, b: u64) -> u64 {
    let wide = u128::from(a) * u128::from(b);
    sum((wide as u64) & PRIME, (wide >> 61) as u64)
}

/// By Fermat's little theorem.
fn inverse(a: u64) -> u64 {
    power(a, PRIME - 2)
}

fn power(mut base: u64, mut exponent: u64) -> u64 {
    let mut answer = 1;
    while exponent > 0 {
        if exponent & 1 == 1 {
            answer = product(answer, base);
        }
        base = product(base, base);
        exponent >>= 1;
    }
    answer
}
