//! The pixels of ropes whose colours are known: those nearer to a rope's colour than to the background around.

use super::sums::Sums;
use super::{Planes, color, difference2, size};
use crate::images::image::Image;
use crate::parallel;

const NEAR: f32 = 2.5; // half widths from a mask: a rope's pixels lie within, and two pixels on
const AWAY: f32 = 2.0; // half widths from a mask: the background begins there, and two pixels on
const FAR: f32 = 10.0; // half widths from a mask: pieces of a rope that something hides lie within, and two pixels on
const AROUND: f64 = 10.0; // half widths: reach of the background's mean
const CELL: usize = 2; // pixels: side of the squares with one mean
const MIN_SHARE: f32 = 0.05; // share of background around
const MAX_BACKGROUND: f32 = 12.0; // Lab: a colour that differs more from the background is none of it
const SURE: f32 = 0.5; // of the difference from the background: such pieces differ less from the rope
const UNLIKE: f32 = 0.5; // of the contrast: pixels that differ more from a rope's colour are no part of it
const ROPE_SHADE: [f32; 2] = [0.85, 1.12]; // a rope's light, third root, over its mean
const TABLE_SHADE: [f32; 2] = [0.72, 1.05]; // the table's light in shadows, third root
const BLACK: f32 = -16.0; // Lab: light of black on lines of one hue
const THIN: f32 = 3.0; // pixels: half width of ropes whose edge pixels count by their share of rope
const EDGE: f32 = 0.45; // the least share

/// A pixel near ropes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Drawn {
    /// The rope's label; 0 for none.
    pub label: i32,
    /// Difference from the background in more or less light; 0 far from ropes.
    pub from_ground: f32,
}

/// Draws ropes of some labels and colours. `rough` is a mask of them, and `away` each pixel's distance from it.
pub fn draw_ropes(
    lab: &Planes,
    rough: &[bool],
    away: &[f32],
    ropes: &[(i32, [f32; 3])],
    half_width: f32,
) -> Image<Drawn> {
    let [width, height] = size(lab);
    let beside = AWAY * half_width + 2.0;
    let no_ground = (0..width * height).filter(|&k| away[k] <= beside);
    let table = Sums::of_all(lab, CELL).without(&Sums::of_some(lab, CELL, no_ground));
    let everywhere = table.total();
    let mut drawn = Image::filled(width, height, Drawn::default());
    parallel::rows(&mut drawn.values, width, |first, part| {
        for (n, to) in part.iter_mut().enumerate() {
            let k = first * width + n;
            if away[k] > FAR * half_width + 2.0 {
                continue;
            }
            let (x, y) = (k % width / CELL, k / width / CELL);
            let (own, share) = table.mean(x, y, AROUND * f64::from(half_width));
            let ground = if share < MIN_SHARE { everywhere } else { own };
            *to = draw(color(lab, k), ground, rough[k], away[k], ropes, half_width);
        }
    });
    drawn
}

fn draw(
    pixel: [f32; 3],
    ground: [f32; 3],
    rough: bool,
    away: f32,
    ropes: &[(i32, [f32; 3])],
    half_width: f32,
) -> Drawn {
    let from_ground = measure_from_line(pixel, ground, TABLE_SHADE);
    let (mut best, mut share, mut label) = (f32::INFINITY, 0.0f32, 0);
    for &(number, rope) in ropes {
        let mut own = measure_from_line(pixel, rope, ROPE_SHADE);
        let contrast2 = difference2(rope, ground);
        // what is like neither belongs to something else
        if own > UNLIKE * contrast2.sqrt() + MAX_BACKGROUND {
            own = f32::INFINITY;
        }
        let part: f32 = (0..3).map(|p| (pixel[p] - ground[p]) * (rope[p] - ground[p])).sum();
        share = share.max(part / contrast2.max(1e-9));
        if own <= best {
            (best, label) = (own, number);
        }
    }
    // farther away, only what is surely rope counts: it may be hidden in between
    let farther = away > NEAR * half_width + 2.0;
    let limit = if farther { (SURE * from_ground).min(MAX_BACKGROUND) } else { from_ground };
    let like = best < limit || (half_width < THIN && rough && share > EDGE);
    Drawn { label: if like { label } else { 0 }, from_ground }
}

/// Returns the difference of a colour from another in more or less light.
fn measure_from_line(pixel: [f32; 3], other: [f32; 3], shade: [f32; 2]) -> f32 {
    let (own, full) = ([pixel[0] - BLACK, pixel[1], pixel[2]], [other[0] - BLACK, other[1], other[2]]);
    let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let part = (dot(own, full) / dot(full, full).max(1e-9)).clamp(shade[0], shade[1]);
    difference2(own, full.map(|value| part * value)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::distances::measure_distances;

    #[test]
    fn a_rope_is_drawn_as_wide_as_it_is_and_its_shadow_is_background() {
        let (width, height) = (90, 70);
        let across = |k: usize| (k % width).abs_diff(40);
        // a shadow beside the rope has the table's hue
        let shade = |k: usize| if (44..50).contains(&(k % width)) { 0.8 } else { 1.0 };
        let planes =
            [60.0f32, 10.0, 20.0].map(|value| Image { width, height, values: vec![value; width * height] });
        let mut planes = planes;
        for k in 0..width * height {
            let rope = across(k) <= 3;
            let table = [76.0 * shade(k) - 16.0, 10.0 * shade(k), 20.0 * shade(k)];
            let own = if rope { [30.0, 50.0, 20.0] } else { table };
            (0..3).for_each(|p| planes[p].values[k] = own[p]);
        }
        let rough = Image { width, height, values: (0..width * height).map(|k| across(k) <= 1).collect() };
        let away = measure_distances(&rough, false, 60);
        let drawn = draw_ropes(&planes, &rough.values, &away.values, &[(7, [30.0, 50.0, 20.0])], 3.0);
        for k in 0..width * height {
            assert_eq!(drawn.values[k].label, if across(k) <= 3 { 7 } else { 0 }, "{k}");
            assert_eq!(drawn.values[k].from_ground > MAX_BACKGROUND, across(k) <= 3);
        }
    }
}
