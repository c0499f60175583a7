//! Pixels beside the ropes in an image: those of their table, and pieces that masks lost.

use super::bits::Bits;
use super::image::{Run, find_blobs};
use super::runs::Mask;

/// Pixels of an image, row by row.
#[derive(Default)]
pub struct Pixels {
    pub rows: Vec<i64>,
    pub columns: Vec<i64>,
    /// Metres.
    pub depths: Vec<f64>,
}

/// Returns pixels with depth in the box around a mask, `reach` pixels wider, that are farther than `margin` pixels from
/// it. It looks at the corners and sides of a square around each of about twice `count` pixels on a grid.
pub fn select_beside(mask: &Bits, depth: &[f64], reach: usize, margin: usize, count: f64) -> Pixels {
    let [width, height] = mask.size();
    let mut found = Pixels::default();
    let Some([columns, rows]) = mask.find_bounds() else { return found };
    let around = |own: &std::ops::Range<usize>, size: usize| {
        own.start.saturating_sub(reach)..own.end.saturating_add(reach).min(size)
    };
    let (columns, rows) = (around(&columns, width), around(&rows, height));
    let area = (rows.len() * columns.len()) as f64;
    let step = ((area / (2.0 * count)).sqrt() as usize).max(1);
    let near =
        |at: usize, size: usize| [at.saturating_sub(margin), at, at.saturating_add(margin).min(size - 1)];
    for row in rows.step_by(step) {
        let beside = near(row, height);
        for column in columns.clone().step_by(step) {
            let z = depth[row * width + column];
            let free = || near(column, width).iter().all(|&x| beside.iter().all(|&y| !mask.at(x, y)));
            if z > 0.0 && free() {
                found.rows.push(row as i64);
                found.columns.push(column as i64);
                found.depths.push(z);
            }
        }
    }
    found
}

/// A connected piece of pixels in a part of an image.
pub struct Piece {
    /// The part's first row and column.
    pub corner: [usize; 2],
    /// The part's rows and columns.
    pub size: [usize; 2],
    /// Which pixels of the part are the piece's, row by row.
    pub values: Vec<bool>,
}

/// Returns the connected pieces of chosen pixels farther than `reach` pixels from a mask, with `margin` pixels around
/// each. `sizes` tells which numbers of pixels they may have.
pub fn find_pieces(
    chosen: &Bits,
    mask: &Bits,
    reach: f64,
    sizes: impl Fn(usize) -> bool,
    margin: usize,
) -> Vec<Piece> {
    let mut lost = mask.grown(reach);
    for (lost, chosen) in lost.words.iter_mut().zip(&chosen.words) {
        *lost = chosen & !*lost;
    }
    let found = find_blobs(&lost, true, true);
    let [width, height] = mask.size();
    let mut owned: Vec<Vec<&Run>> = vec![Vec::new(); found.sizes.len()];
    for run in found.runs.iter().filter(|run| sizes(found.sizes[run.blob])) {
        owned[run.blob].push(run);
    }
    let pieces = owned.iter().filter(|runs| !runs.is_empty()).map(|runs| {
        let first = runs.iter().map(|run| run.begin).min().unwrap_or(0).saturating_sub(margin);
        let last = runs.iter().map(|run| run.end).max().unwrap_or(0);
        let wide = last.saturating_add(margin).min(width) - first;
        let top = runs[0].row.saturating_sub(margin);
        let high = (runs[runs.len() - 1].row + 1).saturating_add(margin).min(height) - top;
        let mut values = vec![false; wide * high];
        for run in runs {
            values[(run.row - top) * wide..][run.begin - first..run.end - first].fill(true);
        }
        Piece { corner: [top, first], size: [high, wide], values }
    });
    pieces.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clouds::depth::has_return;
    use crate::images::image::Image;

    #[test]
    fn pixels_beside_a_mask_keep_their_distance() {
        let (width, height) = (90, 70);
        let inside = |k: usize| (20..60).contains(&(k % width)) && (30..40).contains(&(k / width));
        let mask = Image { width, height, values: (0..width * height).map(inside).collect() };
        let depth: Vec<f64> = (0..width * height).map(|k| if k % 5 == 0 { 0.0 } else { k as f64 }).collect();
        let found = select_beside(&Bits::pack(&mask.values, mask.width), &depth, 10, 4, 1e6);
        let expected: Vec<usize> = (0..width * height)
            .filter(|&k| {
                let (x, y) = (k % width, k / width);
                let around = (10..70).contains(&x) && (20..50).contains(&y);
                around && !((16..64).contains(&x) && (26..44).contains(&y)) && has_return(depth[k])
            })
            .collect();
        let pixels = found.rows.iter().zip(&found.columns).map(|(&y, &x)| y as usize * width + x as usize);
        assert!(pixels.eq(expected.iter().copied()));
        assert!(found.depths.iter().zip(expected).all(|(&z, k)| z == depth[k]));
        let fewer = select_beside(&Bits::pack(&mask.values, mask.width), &depth, 10, 4, 50.0);
        assert!(fewer.rows.iter().all(|row| (row - 20) % 4 == 0));
        assert!(select_beside(&Bits::new(9, 9), &[1.0; 81], 3, 2, 10.0).rows.is_empty());
    }

    #[test]
    fn pieces_beside_a_mask_are_found_by_their_size() {
        let rows = [
            "##......##", //
            "##......##", //
            ".......#..", //
            "...#......", //
            "..........",
        ];
        let read = |of: u8| -> Bits {
            let values: Vec<bool> = rows
                .iter()
                .flat_map(|row| row.bytes().enumerate().map(move |(x, c)| c == of && x > 1))
                .collect();
            Bits::pack(&values, 10)
        };
        let mut mask = Bits::new(10, 5);
        (0..2).for_each(|row| mask.fill(row, 0..2, true));
        let found = find_pieces(&read(b'#'), &mask, 1.5, |size| size > 1, 1);
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].corner, found[0].size), ([0, 6], [4, 4]));
        assert_eq!(found[0].values.iter().filter(|&&value| value).count(), 5);
        // a piece at a distance of 2√2
        assert_eq!(find_pieces(&read(b'#'), &mask, 2.8, |_| true, 0).len(), 2);
        assert_eq!(find_pieces(&read(b'#'), &mask, 2.9, |_| true, 0).len(), 1);
    }
}
