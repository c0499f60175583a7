//! The exact Alexander polynomial of a diagram.
//!
//! Each crossing gives a row of a matrix: 1 − t for the arc that passes over, t and −1 for the arcs that end below it,
//! on the left and right of the upper strand. Without one row and column, the determinant is the polynomial, up to a
//! sign and a power of t. It is computed modulo a prime at as many values of t as it has coefficients. (J. W.
//! Alexander: Topological invariants of knots and links, 1928.)

use super::code::GaussCode;

/// Crossings of a diagram at most. Coefficients, up to 2 to the number of crossings, must stay below half the prime.
pub const MAX_CROSSINGS: usize = 48;
const PRIME: u64 = (1 << 61) - 1; // 2^61 − 1, a prime
const ROOT: u64 = 484_083_891_529_811_867; // a root of unity modulo the prime
const ORDER: u64 = 31; // the order of that root

/// Returns the coefficients from the lowest power up, a palindrome with the sum 1; None for too many crossings.
pub fn compute_alexander(code: &GaussCode) -> Option<Vec<i64>> {
    let crossings = code.crossings();
    if crossings > MAX_CROSSINGS {
        return None;
    }
    if crossings < 3 {
        return Some(vec![1]);
    }
    let rows = find_rows(code);
    let values: Vec<u64> = (0..crossings as u64).map(|t| compute_minor(&rows, t)).collect();
    let coefficients: Vec<i64> = interpolate(&values)
        .into_iter()
        .map(|x| if x > PRIME / 2 { x as i64 - PRIME as i64 } else { x as i64 })
        .collect();
    let first = coefficients.iter().position(|&x| x != 0)?;
    let last = coefficients.iter().rposition(|&x| x != 0)?;
    let sign: i64 = coefficients.iter().sum();
    Some(coefficients[first..=last].iter().map(|&x| sign * x).collect())
}

/// Returns a number that depends only on the Alexander polynomial of the knot, not on the diagram.
///
/// It is a power of the polynomial's value at a root of unity; the power removes signs and powers of t. None for too
/// many crossings.
pub fn compute_mark(code: &GaussCode) -> Option<u64> {
    match code.crossings() {
        0..3 => Some(1),
        3..=MAX_CROSSINGS => Some(raise(compute_minor(&find_rows(code), ROOT), 2 * ORDER)),
        _ => None,
    }
}

/// Returns for each crossing the arcs over it, on its left, and on its right.
fn find_rows(code: &GaussCode) -> Vec<[usize; 3]> {
    let crossings = code.crossings();
    // an arc ends where the knot passes below; the last arc continues as the first
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

/// Returns the determinant without the last row and column at a value of t, by elimination. Rows are multiplied, not
/// divided; one division at the end corrects for that.
fn compute_minor(rows: &[[usize; 3]], t: u64) -> u64 {
    let size = rows.len() - 1;
    let mut matrix = vec![0; size * size];
    for (row, &[over, left, right]) in rows[..size].iter().enumerate() {
        for (arc, value) in [(over, add(1, PRIME - t)), (left, t), (right, PRIME - 1)] {
            if arc < size {
                matrix[row * size + arc] = add(matrix[row * size + arc], value);
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
        determinant = multiply(determinant, above[k]);
        for row in below.chunks_exact_mut(size).filter(|row| row[k] != 0) {
            let factor = PRIME - row[k];
            for column in k + 1..size {
                row[column] = add(multiply(above[k], row[column]), multiply(factor, above[column]));
            }
            scale = multiply(scale, above[k]);
        }
    }
    multiply(determinant, invert(scale))
}

/// Returns the coefficients of the polynomial with these values at 0, 1, 2, …, by Newton's divided differences.
fn interpolate(values: &[u64]) -> Vec<u64> {
    let count = values.len();
    let mut differences = values.to_vec();
    for step in 1..count {
        let inverse = invert(step as u64);
        for k in (step..count).rev() {
            differences[k] = multiply(add(differences[k], PRIME - differences[k - 1]), inverse);
        }
    }
    let mut coefficients = vec![0; count];
    for k in (0..count).rev() {
        // multiply by (t − k) and add the next difference
        for power in (0..count).rev() {
            let lower = if power > 0 { coefficients[power - 1] } else { differences[k] };
            coefficients[power] = add(lower, multiply(PRIME - k as u64, coefficients[power]));
        }
    }
    coefficients
}

fn add(a: u64, b: u64) -> u64 {
    let sum = a + b;
    if sum >= PRIME { sum - PRIME } else { sum }
}

fn multiply(a: u64, b: u64) -> u64 {
    let wide = u128::from(a) * u128::from(b);
    add((wide as u64) & PRIME, (wide >> 61) as u64)
}

/// Returns the inverse modulo the prime, by Fermat's little theorem.
fn invert(a: u64) -> u64 {
    raise(a, PRIME - 2)
}

fn raise(mut base: u64, mut exponent: u64) -> u64 {
    let mut answer = 1;
    while exponent > 0 {
        if exponent & 1 == 1 {
            answer = multiply(answer, base);
        }
        base = multiply(base, base);
        exponent >>= 1;
    }
    answer
}
