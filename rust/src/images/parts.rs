//! Pieces and holes of a mask: counted, filled, removed. Nets and noise have far more of them than ropes.

use super::image::{Blobs, Image, find_blobs};
use super::runs::Mask;

/// Fills holes of chosen sizes. Pixels connected to the border are outside.
pub fn fill_holes(mask: &mut impl Mask, chosen: impl Fn(usize) -> bool) {
    let (found, enclosed) = find_holes(mask);
    for run in found.runs.iter().filter(|run| enclosed[run.blob] && chosen(found.sizes[run.blob])) {
        mask.fill(run.row, run.begin..run.end, true);
    }
}

/// Flips the values of blobs of chosen sizes; `of` and `diagonal` as in [`find_blobs`].
pub fn turn_blobs(mask: &mut impl Mask, of: bool, diagonal: bool, chosen: impl Fn(usize) -> bool) {
    let found = find_blobs(mask, of, diagonal);
    for run in found.runs.iter().filter(|run| chosen(found.sizes[run.blob])) {
        mask.fill(run.row, run.begin..run.end, !of);
    }
}

/// Finds the blobs outside a mask, and whether it encloses each.
fn find_holes(mask: &impl Mask) -> (Blobs, Vec<bool>) {
    let found = find_blobs(mask, false, false);
    let [width, height] = mask.size();
    let mut enclosed = vec![true; found.sizes.len()];
    for run in &found.runs {
        enclosed[run.blob] &= run.begin > 0 && run.end < width && run.row > 0 && run.row + 1 < height;
    }
    (found, enclosed)
}

/// The parts of a mask that are too large for specks and gaps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parts {
    /// Pixels of the largest piece.
    pub largest: usize,
    pub pieces: usize,
    /// Enclosed holes.
    pub holes: usize,
}

/// Counts the pieces of a mask of at least `piece` pixels, and its enclosed holes of at least `hole` pixels.
pub fn count_parts(mask: &Image<bool>, piece: f64, hole: f64) -> Parts {
    let own = find_blobs(mask, true, true).sizes;
    let (around, enclosed) = find_holes(mask);
    let large = |size: usize, least: f64| size as f64 >= least;
    Parts {
        largest: own.iter().copied().max().unwrap_or(0),
        pieces: own.iter().filter(|&&size| large(size, piece)).count(),
        holes: around
            .sizes
            .iter()
            .zip(enclosed)
            .filter(|&(&size, enclosed)| enclosed && large(size, hole))
            .count(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn enclosed_holes_and_large_pieces_count() {
        let rows = ["#####..", "#.#.#.#", "#####..", ".....##", "...#...", "..#.#.#", "...#..."];
        let values = rows.iter().flat_map(|row| row.bytes().map(|c| c == b'#')).collect();
        let mask = Image { width: 7, height: 7, values };
        // diagonal neighbours are connected, and a diamond of them encloses a hole
        assert_eq!(count_parts(&mask, 1.0, 1.0), Parts { largest: 15, pieces: 4, holes: 3 });
        assert_eq!(count_parts(&mask, 2.0, 2.0), Parts { largest: 15, pieces: 2, holes: 0 });
    }
}
