//! The region of strips of one width: pixels nearer to the rope's colour than to the background's.

use super::sums::Sums;
use super::{Planes, color, difference2, median, size};
use crate::images::distances::measure_distances;
use crate::images::image::Image;

const ROUNDS: usize = 2; // estimates of the background
const BESIDE: f32 = 0.7; // half widths from a rope's edge: the background begins there, and one pixel on
const NEAR: f32 = 1.2; // half widths from strips: a region ends there, and one pixel on
const SMOOTHED: f64 = 3.5; // pixels: colours of wider strips are means of 3 x 3 pixels
const CLOSED: f64 = 2.0; // pixels: regions of wider strips are closed by a pixel
const AROUND: f64 = 3.0; // half widths: reach of the background's mean, less 2 pixels
const FAR_AROUND: f64 = 6.0; // half widths: reach where that shows too little background
const MIN_SHARE: f32 = 0.1; // share of background around
const MIN_FAR_SHARE: f32 = 0.02; // share of background farther around
const WEAK: f32 = 0.4; // of the usual contrast: what contrasts less is no rope
const MIDDLE: f32 = 0.5; // from the background's colour to the rope's: pixels beyond it are rope
const MIDDLE_OF_STRIP: f32 = 0.4; // the same on strips

/// A region, and the colour of the background near it.
pub struct Region {
    pub mask: Image<bool>,
    /// Valid near the mask.
    pub background: Vec<[f32; 3]>,
}

/// Finds the region of strips, given the pixels in their middles and their half width.
pub fn find_region(planes: &Planes, core: &Image<bool>, half_width: f64) -> Region {
    let [width, height] = size(planes);
    let limit = NEAR * half_width as f32 + 1.0;
    let from_core = measure_distances(core, false, limit.ceil() as usize + 1);
    let near: Vec<usize> = (0..width * height).filter(|&k| from_core.values[k] < limit).collect();
    let cell = (half_width as usize).max(1);
    let ropes = Sums::of_some(planes, cell, near.iter().copied().filter(|&k| core.values[k]));
    let all = Sums::of_all(planes, cell);
    let [columns, rows] = ropes.size();
    let cell_of = |k: usize| k / width / cell * columns + k % width / cell;
    let mut needed = vec![false; columns * rows];
    near.iter().for_each(|&k| needed[cell_of(k)] = true);
    let mut mask = core.clone();
    let mut background = vec![[0.0f32; 3]; width * height];
    let mut evidence = vec![(0.0f32, 0.0f32); near.len()];
    let colors: Vec<[f32; 3]> = if half_width < SMOOTHED {
        near.iter().map(|&k| color(planes, k)).collect()
    } else {
        near.iter().map(|&k| mean_around(planes, k % width, k / width)).collect()
    };
    for _ in 0..ROUNDS {
        let beside = BESIDE * half_width as f32 + 1.0;
        let away = measure_distances(&mask, false, beside.ceil() as usize + 1);
        let ropes_and_edges = (0..width * height).filter(|&k| away.values[k] <= beside);
        let table = all.without(&Sums::of_some(planes, cell, ropes_and_edges));
        let everywhere = table.total();
        // colours of the background and the rope in each cell
        let mut around = vec![([0.0f32; 3], [0.0f32; 3], 0.0f32); columns * rows];
        for c in (0..columns * rows).filter(|&c| needed[c]) {
            let (i, j) = (c % columns, c / columns);
            let (own, share) = table.mean(i, j, AROUND * half_width + 2.0);
            let ground = if share > MIN_SHARE {
                own
            } else {
                let (farther, far_share) = table.mean(i, j, FAR_AROUND * half_width);
                if far_share > MIN_FAR_SHARE { farther } else { everywhere }
            };
            let (rope, share) = ropes.mean(i, j, half_width + 1.0);
            around[c] = (ground, rope, if share > 0.0 { difference2(rope, ground) } else { 0.0 });
        }
        for ((&k, own), found) in near.iter().zip(&colors).zip(&mut evidence) {
            let (ground, rope, contrast2) = around[cell_of(k)];
            background[k] = ground;
            let toward: f32 = (0..3).map(|p| (own[p] - ground[p]) * (rope[p] - ground[p])).sum();
            *found = (contrast2, toward / contrast2.max(1e-6));
        }
        let mut usual: Vec<f32> =
            near.iter().zip(&evidence).filter(|(k, _)| core.values[**k]).map(|(_, found)| found.0).collect();
        let least = WEAK * WEAK * median(&mut usual);
        mask.values.fill(false);
        for (&k, &(contrast2, part)) in near.iter().zip(&evidence) {
            let limit = if core.values[k] { MIDDLE_OF_STRIP } else { MIDDLE };
            mask.values[k] = contrast2 > least && part > limit;
        }
        if half_width > CLOSED {
            mask = closed(&mask);
        }
    }
    Region { mask, background }
}

/// Returns the mean colour of 3 x 3 pixels.
fn mean_around(planes: &Planes, x: usize, y: usize) -> [f32; 3] {
    let [width, height] = size(planes);
    let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
    for j in y.saturating_sub(1)..(y + 2).min(height) {
        for i in x.saturating_sub(1)..(x + 2).min(width) {
            let own = color(planes, j * width + i);
            sum = [0, 1, 2].map(|p| sum[p] + own[p]);
            count += 1.0;
        }
    }
    sum.map(|value| value / count)
}

/// Returns a mask grown by a pixel and shrunk again, with diagonal neighbours.
fn closed(mask: &Image<bool>) -> Image<bool> {
    let grown = combined(mask, |a, b| a | b);
    combined(&grown, |a, b| a & b)
}

/// Combines each pixel with its eight neighbours.
fn combined(mask: &Image<bool>, combine: impl Fn(bool, bool) -> bool) -> Image<bool> {
    let (w, h) = (mask.width, mask.height);
    let mut rows = mask.clone();
    for (to, from) in rows.values.chunks_exact_mut(w).zip(mask.values.chunks_exact(w)) {
        for (to, &before) in to[1..].iter_mut().zip(from) {
            *to = combine(*to, before);
        }
        for (to, &after) in to.iter_mut().zip(&from[1..]) {
            *to = combine(*to, after);
        }
    }
    let mut found = rows.clone();
    for y in 1..h {
        let (above, here) = ((y - 1) * w..y * w, y * w..(y + 1) * w);
        for (to, &other) in found.values[here.clone()].iter_mut().zip(&rows.values[above.clone()]) {
            *to = combine(*to, other);
        }
        for (to, &other) in found.values[above].iter_mut().zip(&rows.values[here]) {
            *to = combine(*to, other);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_is_as_wide_as_the_strip_that_it_grows_from() {
        let strip = |k: usize| (k % 80).abs_diff(40) <= 3;
        let planes = [30.0f32, 5.0, 8.0].map(|step| Image {
            width: 80,
            height: 60,
            values: (0..80 * 60).map(|k| 20.0 + if strip(k) { step } else { 0.0 }).collect(),
        });
        let values = (0..80 * 60).map(|k| (k % 80usize).abs_diff(40) <= 1).collect();
        let core = Image { width: 80, height: 60, values };
        let region = find_region(&planes, &core, 3.0);
        assert!((0..80 * 60).all(|k| region.mask.values[k] == strip(k)));
        assert!(difference2(region.background[40], [20.0; 3]) < 1e-3);
    }

    #[test]
    fn closing_fills_slits_and_keeps_the_rest() {
        let mut mask = Image::filled(9, 9, false);
        for (x, y) in [(2, 3), (4, 3), (6, 6)] {
            mask.values[y * 9 + x] = true;
        }
        let found = closed(&mask);
        let set: Vec<usize> = (0..81).filter(|&k| found.values[k]).collect();
        assert_eq!(set, [3 * 9 + 2, 3 * 9 + 3, 3 * 9 + 4, 6 * 9 + 6]);
    }
}
