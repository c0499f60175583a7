//! Knots up to seven crossings, prime or composite, and their polynomials.
//!
//! Values are KnotInfo's (C. Livingston and A. H. Moore, knotinfo.org, 2025), with Rolfsen's names; those of composite
//! knots are products. Each entry is the mirror image that is called right: its alternating diagrams with the fewest
//! crossings have a positive writhe.

use super::jones::Laurent;

/// The handedness of a knot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Chirality {
    Right,
    Left,
    /// The knot is its own mirror image.
    None,
}

/// A knot of the table.
#[derive(Debug)]
pub struct Entry {
    pub name: &'static str,
    pub alexander: &'static [i64],
    /// The lowest exponent, and the coefficients from there up.
    pub jones: (i64, &'static [i64]),
    /// A knot with both polynomials, among prime knots up to twelve crossings and composite ones up to thirteen.
    pub twin: Option<Twin>,
}

/// A knot with the same polynomials as one of the table.
#[derive(Debug, PartialEq, Eq)]
pub struct Twin {
    pub name: &'static str,
    /// The fewest crossings of its diagrams.
    pub crossings: usize,
}

const fn entry(name: &'static str, alexander: &'static [i64], low: i64, jones: &'static [i64]) -> Entry {
    Entry { name, alexander, jones: (low, jones), twin: None }
}

const fn with_twin(name: &'static str, crossings: usize, entry: Entry) -> Entry {
    Entry { twin: Some(Twin { name, crossings }), ..entry }
}

/// The table. Composite knots of different handedness have entries of their own.
pub static TABLE: [Entry; 18] = [
    entry("0_1", &[1], 0, &[1]),
    entry("3_1", &[1, -1, 1], 1, &[1, 0, 1, -1]),
    entry("4_1", &[-1, 3, -1], -2, &[1, -1, 1, -1, 1]),
    with_twin("10_132", 10, entry("5_1", &[1, -1, 1, -1, 1], 2, &[1, 0, 1, -1, 1, -1])),
    entry("5_2", &[2, -3, 2], 1, &[1, -1, 2, -1, 1, -1]),
    entry("6_1", &[-2, 5, -2], -2, &[1, -1, 2, -2, 1, -1, 1]),
    with_twin("12n_25", 12, entry("6_2", &[-1, 3, -3, 3, -1], -1, &[1, -1, 2, -2, 2, -2, 1])),
    entry("6_3", &[1, -3, 5, -3, 1], -3, &[-1, 2, -2, 3, -2, 2, -1]),
    with_twin("12n_749", 12, entry("7_1", &[1, -1, 1, -1, 1, -1, 1], 3, &[1, 0, 1, -1, 1, -1, 1, -1])),
    entry("7_2", &[3, -5, 3], 1, &[1, -1, 2, -2, 2, -1, 1, -1]),
    with_twin("12n_523", 12, entry("7_3", &[2, -3, 3, -3, 2], 2, &[1, -1, 2, -2, 3, -2, 1, -1])),
    entry("7_4", &[4, -7, 4], 1, &[1, -2, 3, -2, 3, -2, 1, -1]),
    entry("7_5", &[2, -4, 5, -4, 2], 2, &[1, -1, 3, -3, 3, -3, 2, -1]),
    entry("7_6", &[-1, 5, -7, 5, -1], -1, &[1, -2, 3, -3, 4, -3, 2, -1]),
    entry("7_7", &[1, -5, 9, -5, 1], -3, &[-1, 3, -3, 4, -4, 3, -2, 1]),
    entry("3_1#3_1", &[1, -2, 3, -2, 1], 2, &[1, 0, 2, -2, 1, -2, 1]),
    entry("3_1#3_1", &[1, -2, 3, -2, 1], -3, &[-1, 1, -1, 3, -1, 1, -1]),
    entry("3_1#4_1", &[-1, 4, -5, 4, -1], -1, &[1, -1, 2, -3, 3, -2, 2, -1]),
];

/// Returns whether a knot of the table has this Alexander polynomial.
pub fn has_alexander(alexander: &[i64]) -> bool {
    TABLE.iter().any(|entry| entry.alexander == alexander)
}

/// Finds the knot with these polynomials: its number in the table, and its handedness.
pub fn find_named(alexander: &[i64], jones: &Laurent) -> Option<(usize, Chirality)> {
    let mirrored = mirrored(jones);
    let has = |entry: &Entry, jones: &Laurent| entry.jones.0 == jones.0 && entry.jones.1 == jones.1;
    TABLE.iter().enumerate().filter(|(_, entry)| entry.alexander == alexander).find_map(|(k, entry)| {
        match (has(entry, jones), has(entry, &mirrored)) {
            (true, true) => Some((k, Chirality::None)),
            (true, false) => Some((k, Chirality::Right)),
            (false, true) => Some((k, Chirality::Left)),
            (false, false) => None,
        }
    })
}

/// Returns the polynomial of the mirror image.
fn mirrored((low, coefficients): &Laurent) -> Laurent {
    (-(low + coefficients.len() as i64 - 1), coefficients.iter().rev().copied().collect())
}
