//! Surroundings and mended masks of a rope on a table.

use super::mending::mend;
use super::silhouette::Silhouette;
use super::surroundings::{Shown, Surroundings};

const RADIUS: f64 = 0.004;
const RADIUS_PX: f64 = 8.0; // the ropes\' radius, pixels
const WIDTH: usize = 200;
const HEIGHT: usize = 120;

/// Returns the depth and the mask of a straight rope at row 60 on a tilted table, with some noise.
fn rope() -> (Vec<f64>, Vec<bool>) {
    let inside = |k: usize| ((k / WIDTH) as f64 - 60.0).abs() < RADIUS_PX && (20..180).contains(&(k % WIDTH));
    let depth = (0..WIDTH * HEIGHT)
        .map(|k| {
            let table = 1.0 / (2.0 + 1e-3 * (k % WIDTH) as f64 + 5e-4 * (k / WIDTH) as f64);
            let noise = 0.2 * RADIUS * ((k * 7919 % 1013) as f64 / 506.0 - 1.0);
            table + noise - if inside(k) { 1.7 * RADIUS } else { 0.0 }
        })
        .collect();
    (depth, (0..WIDTH * HEIGHT).map(inside).collect())
}

fn surroundings(depth: &[f64], mask: &[bool]) -> (Silhouette, Surroundings) {
    let silhouette = Silhouette::of_rope(mask, WIDTH, RADIUS_PX).unwrap();
    let found = Surroundings::new(depth, mask, WIDTH, &silhouette.ropes(), RADIUS).unwrap();
    (silhouette, found)
}

/// Returns the silhouette of a rope whose middle is hidden by a bar 50 mm in front of it.
pub fn behind_a_bar() -> Silhouette {
    let (mut depth, mut mask) = rope();
    for k in (0..WIDTH * HEIGHT).filter(|k| (80..120).contains(&(k % WIDTH))) {
        (depth[k], mask[k]) = (depth[k] - 0.05, false);
    }
    let (silhouette, found) = surroundings(&depth, &mask);
    silhouette.amid(Some(found))
}

#[test]
fn a_bar_hides_and_a_table_shows() {
    let (depth, mask) = rope();
    let (_, open) = surroundings(&depth, &mask);
    assert!(!open.hides() && open.tells());
    assert_eq!(open.at([100.0, 60.0]), Shown::Level);
    assert_eq!(open.at([100.0, 90.0]), Shown::Behind);
    let barred = behind_a_bar();
    for (place, shown) in [
        ([100.0, 60.0], Shown::Before),
        ([100.0, 100.0], Shown::Before),
        ([50.0, 60.0], Shown::Level),
        ([50.0, 90.0], Shown::Behind),
    ] {
        assert_eq!(barred.shown(place), shown, "{place:?}");
    }
    assert!(barred.hidden([100.0, 60.0]) && !barred.hidden([50.0, 60.0]));
}

#[test]
fn thin_ropes_at_the_border_are_judged_pixel_by_pixel() {
    // two pixels wide, along the image's upper border
    let on_rope = |k: usize| k / WIDTH < 2;
    let mask: Vec<bool> = (0..WIDTH * HEIGHT).map(on_rope).collect();
    let height = |k: usize| match k % WIDTH {
        90..110 if !on_rope(k) => 0.05,
        _ if on_rope(k) => 2.0 * RADIUS,
        _ => 0.0,
    };
    let depth: Vec<f64> = (0..WIDTH * HEIGHT).map(|k| 0.5 - height(k)).collect();
    let silhouette = Silhouette::of_rope(&mask, WIDTH, 1.0).unwrap();
    let found = Surroundings::new(&depth, &mask, WIDTH, &silhouette.ropes(), RADIUS).unwrap();
    for (place, shown) in [
        ([50.0, 0.0], Shown::Level),
        ([0.0, 1.0], Shown::Level),
        ([(WIDTH - 1) as f64, 1.0], Shown::Level),
        ([50.0, 4.0], Shown::Behind),
        ([89.0, 3.0], Shown::Behind),
        ([90.0, 3.0], Shown::Before),
        ([109.0, 3.0], Shown::Before),
        ([110.0, 3.0], Shown::Behind),
        ([50.0, -3.0], Shown::Unknown),
    ] {
        assert_eq!(found.at(place), shown, "{place:?}");
    }
}

#[test]
fn what_has_no_depth_hides_where_most_of_the_surroundings_have() {
    let (mut depth, mut mask) = rope();
    for k in (0..WIDTH * HEIGHT).filter(|k| (80..120).contains(&(k % WIDTH))) {
        (depth[k], mask[k]) = (f64::NAN, false);
    }
    assert!(surroundings(&depth, &mask).1.hidden([100.0, 60.0]));
    for k in (0..WIDTH * HEIGHT).filter(|&k| !mask[k]) {
        depth[k] = 0.0;
    }
    let (_, alone) = surroundings(&depth, &mask);
    assert!(!alone.hides() && !alone.tells());
}

#[test]
fn bits_that_a_segmenter_lost_or_took_are_told_by_depth() {
    let (depth, mask) = rope();
    let disc = |k: usize, x: f64, y: f64, r: f64| ((k % WIDTH) as f64 - x).hypot((k / WIDTH) as f64 - y) < r;
    let lost = |k: usize| disc(k, 70.0, 58.0, 4.0) || disc(k, 130.0, 53.0, 4.0);
    let taken = |k: usize| disc(k, 100.0, 70.0, 4.0) || disc(k, 60.0, 90.0, 7.0);
    let rough: Vec<bool> = (0..mask.len()).map(|k| mask[k] && !lost(k) || taken(k)).collect();
    let (silhouette, found) = surroundings(&depth, &rough);
    let better = mend(&depth, &rough, WIDTH, &silhouette, &found).unwrap();
    let wrong = |m: &[bool]| m.iter().zip(&mask).filter(|(a, b)| a != b).count();
    assert!(wrong(&rough) > 200 && wrong(&better) < 60, "{} of {}", wrong(&better), wrong(&rough));
    // with noise as wide as a rope, depth does not decide
    let wide: Vec<f64> = depth
        .iter()
        .enumerate()
        .map(|(k, z)| z + 2.0 * RADIUS * ((k * 7907 % 1009) as f64 / 504.0 - 1.0))
        .collect();
    let (silhouette, found) = surroundings(&wide, &rough);
    assert!(!found.tells() && mend(&wide, &rough, WIDTH, &silhouette, &found).is_none());
}
