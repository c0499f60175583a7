//! The middles of a mask's strips: where the distance from the edge is largest.

use crate::images::bits::Bits;
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
    let Some([columns, rows]) = Bits::pack(mask, width).find_bounds() else { return Vec::new() };
    // what is outside in this part is the nearest outside
    let [(left, right), (top, bottom)] = [(columns, width), (rows, mask.len() / width)]
        .map(|(own, size)| (own.start.saturating_sub(1), (own.end + 1).min(size)));
    let values = (top..bottom).flat_map(|row| &mask[row * width..][left..right]).copied().collect();
    let part = Image { width: right - left, height: bottom - top, values };
    let away = measure_distances(&part, true, part.width + part.height);
    let mut found = Vec::new();
    let mut largest = vec![0.0f32; part.width];
    for run in find_blobs(&part, true, true).runs {
        let beside = run.begin.saturating_sub(1)..(run.end + 1).min(part.width);
        largest[beside.clone()].fill(0.0);
        for y in run.row.saturating_sub(1)..(run.row + 2).min(part.height) {
            let row = &away.values[y * part.width..][beside.clone()];
            largest[beside.clone()].iter_mut().zip(row).for_each(|(most, &away)| *most = most.max(away));
        }
        for x in run.begin..run.end {
            let own = away.at(x, run.row);
            let near = &largest[x.saturating_sub(1)..(x + 2).min(part.width)];
            if own > least && near.iter().all(|&most| most <= own) {
                let pixel = (top + run.row) * width + left + x;
                found.push(Middle { pixel, away: own, blob: run.blob });
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

    #[test]
    fn middles_are_the_pixels_that_no_neighbor_exceeds() {
        let (width, height) = (70, 50);
        let mut state = 3u64;
        for _ in 0..20 {
            let mut mask = vec![false; width * height];
            // rectangles, some of them at the border
            for _ in 0..6 {
                let mut draw = |most: usize| {
                    state =
                        state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 33) as usize % most
                };
                let (left, top, wide, high) = (draw(width), draw(height), 1 + draw(30), 1 + draw(12));
                for y in top..(top + high).min(height) {
                    mask[y * width + left..y * width + (left + wide).min(width)].fill(true);
                }
            }
            let image = Image { width, height, values: mask.clone() };
            let away = measure_distances(&image, true, width + height);
            let blobs = find_blobs(&image, true, true);
            let mut expected = Vec::new();
            for run in &blobs.runs {
                for x in run.begin..run.end {
                    let own = away.at(x, run.row);
                    let mut near = (run.row.saturating_sub(1)..(run.row + 2).min(height))
                        .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| (x, y)));
                    if own > 1.5 && near.all(|(x, y)| away.at(x, y) <= own) {
                        expected.push(Middle { pixel: run.row * width + x, away: own, blob: run.blob });
                    }
                }
            }
            assert!(!expected.is_empty());
            assert_eq!(find_middles(&mask, width, 1.5), expected);
        }
    }
}
