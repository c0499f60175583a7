//! The middles of a mask's strips: where the distance from the edge is largest.

use crate::images::distances::measure_distances;
use crate::images::image::{Image, find_blobs};

/// A pixel in the middle of a strip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Middle {
    /// Its index in the mask.
    pub pixel: usize,
    /// Its distance from the nearest pixel outside the mask, pixels.
    pub away: f32,
    /// The number of its blob, in the order of their first pixels.
    pub blob: usize,
}

/// Returns the pixels of a mask that are at least as far from its edge as their neighbours, and farther than `least`
/// pixels, row by row within each run. Beyond the border counts as mask.
pub fn find_middles(mask: &[bool], width: usize, least: f32) -> Vec<Middle> {
    let height = mask.len() / width.max(1);
    let rows: Vec<usize> =
        (0..height).filter(|&y| mask[y * width..(y + 1) * width].contains(&true)).collect();
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return Vec::new() };
    let top = first.saturating_sub(1);
    let high = (last + 2).min(height) - top;
    // what is outside in this part is the nearest outside
    let part = Image { width, height: high, values: mask[top * width..(top + high) * width].to_vec() };
    let away = measure_distances(&part, true, width + height);
    let mut found = Vec::new();
    for run in find_blobs(&part, true, true).runs {
        let near = run.row.saturating_sub(1)..(run.row + 2).min(high);
        for x in run.begin..run.end {
            let own = away.at(x, run.row);
            let beside = x.saturating_sub(1)..(x + 2).min(width);
            if own > least && near.clone().all(|y| beside.clone().all(|x| away.at(x, y) <= own)) {
                found.push(Middle { pixel: (top + run.row) * width + x, away: own, blob: run.blob });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn middles_of_strips_and_their_blobs_are_found() {
        let (width, height) = (40, 30);
        // a strip of five rows, and one of three that ends at the border
        let inside = |x: usize, y: usize| {
            ((4..36).contains(&x) && (6..11).contains(&y)) || (x >= 30 && (20..23).contains(&y))
        };
        let mask: Vec<bool> = (0..width * height).map(|k| inside(k % width, k / width)).collect();
        let found = find_middles(&mask, width, 1.5);
        for middle in &found {
            let (x, y) = (middle.pixel % width, middle.pixel / width);
            assert_eq!((middle.blob, middle.away), if y < 15 { (0, 3.0) } else { (1, 2.0) }, "{x}, {y}");
            assert!(y == 8 || y == 21);
        }
        let at = |k: usize| [k % width, k / width];
        let columns = |row: usize| {
            found.iter().map(|m| at(m.pixel)).filter(|m| m[1] == row).map(|m| m[0]).collect::<Vec<_>>()
        };
        assert_eq!(columns(8), (6..34).collect::<Vec<_>>());
        assert_eq!(columns(21), (31..40).collect::<Vec<_>>());
        assert!(find_middles(&mask, width, 3.0).is_empty());
        assert!(find_middles(&vec![false; 1200], width, 1.5).is_empty());
        assert!(find_middles(&[], 0, 1.5).is_empty());
    }
}
