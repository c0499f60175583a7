//! Kernels of images: depth, heights, blobs, outlines, strips of colour.

use super::bytes::{Bytes, require_finite};
use crate::clouds::crop::{DepthView, crop, crop_images};
use crate::clouds::depth::{self, Pinhole};
use crate::clouds::visibility::{Observed, Visibility, VisibilityView};
use crate::geometry::Point;
use crate::images::color::drawing::draw_ropes;
use crate::images::color::lab::convert_to_lab;
use crate::images::color::pieces::find_pieces;
use crate::images::color::strips::{StripOptions, find_strips};
use crate::images::distances::measure_distances;
use crate::images::heights::{DepthPixels, Smoothing, Standing, find_standing, measure_heights};
use crate::images::image::{Image, find_blobs};
use crate::images::outline::find_short_outline;

pub fn read_images(mut bytes: Bytes<'_>) {
    let (width, height) = (1 + bytes.below(14), 1 + bytes.below(14));
    let what = bytes.below(3);
    match what {
        0 => read_depth(bytes, width, height),
        1 => read_flags(bytes, width, height),
        _ => read_colors(bytes, width, height),
    }
}

/// Returns depths near a few values, with some that are odd.
fn draw_depth(bytes: &mut Bytes<'_>, pixels: usize) -> Vec<f64> {
    let (base, step) = (bytes.length(), bytes.length());
    let depth = |_| match bytes.byte() {
        0..=24 => 0.0,
        25..=39 => bytes.number(),
        other => base + f64::from(other) / 256.0 * step,
    };
    (0..pixels).map(depth).collect()
}

fn read_depth(mut bytes: Bytes<'_>, width: usize, height: usize) {
    let camera = Pinhole {
        focal: [bytes.length(), bytes.length()].map(|x| if x > 0.0 { x } else { 5.0 }),
        center: [bytes.number(), bytes.number()],
    };
    let pose = bytes.motion();
    let (farthest, radius, normal, nearest) = (bytes.length(), bytes.length(), bytes.unit(), bytes.number());
    let (first, open) = (bytes.below(256), bytes.flag());
    let own = draw_depth(&mut bytes, width * height);
    let points = depth::unproject(&own, width, camera);
    let everywhere = vec![true; own.len()];
    same(&depth::unproject_masked(&own, &everywhere, width, camera), &points);

    let mut bounds = [bytes.point(), bytes.point()];
    if let Some(&corner) = points.get(first) {
        bounds[0] = pose.apply(corner);
    }
    if open {
        bounds[1] = [f64::INFINITY; 3];
    }
    let expected: Vec<Point> = crop(&points, &pose, bounds).into_iter().map(|i| points[i]).collect();
    let view = DepthView { depth: &own, width, camera, pose };
    let found = crop_images(&[view], bounds);
    require_finite(&found[0]);
    same(&found[0], &expected);

    if farthest.is_nan() {
        return;
    }
    let Ok((clean, dropped)) = depth::cleaned(own.clone(), farthest) else { return };
    assert!(dropped <= own.len() && clean.iter().all(|&z| (0.0..=farthest).contains(&z)));
    let finite: Vec<Point> = points.into_iter().filter(|p| p.iter().all(|x| x.abs() < 1e100)).collect();
    let behind = depth::seen_behind(&clean, width, camera, &pose, &finite, nearest);
    assert_eq!(behind.len(), finite.len());
    assert!(depth::bends(&clean, width, camera, &finite, 1 + first).iter().all(|&bend| bend >= 0.0));
    let seen = DepthPixels { depth: &clean, width, camera, pose };
    let (above, counts) = measure_heights(&seen, (normal, radius), None);
    let kernel = [0.5, 0.25, 0.125];
    let smoothing = Smoothing { range: [-1.0, 1.0], kernel: &kernel, share: 0.3 };
    let limits = Standing { smoothing, edge: 0.1 };
    assert_eq!(find_standing(&above, &counts, width, &limits).len(), clean.len());

    for observed in [Observed::Points(&finite), Observed::Image(&clean, width, camera)] {
        let view = VisibilityView { observed, about: &finite, pose };
        let Ok(space) = Visibility::new(&[view]) else { continue };
        let (free, hidden) = (space.free(&finite, radius), space.occluded(&finite, radius));
        if let (Ok(free), Ok(hidden)) = (free, hidden) {
            assert!(free.iter().zip(&hidden).all(|(free, hidden)| !(free & hidden)));
            assert!(space.seen_through(&finite, normal, radius).is_ok());
        }
    }
}

/// Panics unless points have the same bits.
fn same(found: &[Point], expected: &[Point]) {
    let bits = |points: &[Point]| points.iter().map(|p| p.map(f64::to_bits)).collect::<Vec<_>>();
    assert_eq!(bits(found), bits(expected));
}

fn read_flags(mut bytes: Bytes<'_>, width: usize, height: usize) {
    let (most, weight, steps) = (1 + bytes.below(32), bytes.length() as f32, bytes.below(40));
    let mut byte = 0;
    let flags = |k: usize| {
        if k.is_multiple_of(8) {
            byte = bytes.byte();
        }
        byte >> (k % 8) & 1 == 1
    };
    let mask = Image { width, height, values: (0..width * height).map(flags).collect() };
    for diagonal in [true, false] {
        let blobs = find_blobs(&mask, true, diagonal);
        assert_eq!(blobs.sizes.iter().sum::<usize>(), mask.values.iter().filter(|&&own| own).count());
    }
    let place = |k: usize| [(k % width) as f64, (k / width) as f64];
    let found = measure_distances(&mask, true, most).values;
    for (k, &distance) in found.iter().enumerate() {
        let to = |j: usize| (place(k)[0] - place(j)[0]).hypot(place(k)[1] - place(j)[1]);
        let least = (0..found.len()).filter(|&j| !mask.values[j]).map(to).fold(f64::INFINITY, f64::min);
        if least <= most as f64 {
            assert!((f64::from(distance) - least).abs() < 1e-5, "{distance} {least}");
        } else {
            assert!(f64::from(distance) > most as f64, "{distance} {most}");
        }
    }
    let values = (0..width * height).map(|_| bytes.number() as f32).collect();
    let outline = find_short_outline(&Image { width, height, values }, weight, steps);
    assert_eq!(outline.values.len(), width * height);
}

fn read_colors(mut bytes: Bytes<'_>, width: usize, height: usize) {
    let (aside, half_width, signed) = (0.1, bytes.length().min(1e6) as f32, bytes.flag());
    let max_width = bytes.length().clamp(0.1, 100.0);
    let colors: Vec<u8> = (0..3 * width * height).map(|_| bytes.byte()).collect();
    let planes = convert_to_lab(&colors, width);
    assert!(planes.iter().all(|plane| plane.values.iter().all(|x| x.abs() < 200.0)));
    let options = StripOptions { max_width, min_contrast: 2.0, noise: 1.5, aside, signed };
    let strips = find_strips(&planes, &options);
    for band in find_pieces(&planes, &planes, true, &strips) {
        assert!(band.pieces.iter().all(|piece| piece.length.is_finite() && piece.contrast.is_finite()));
        assert!(band.labels.values.iter().all(|&label| label as usize <= band.pieces.len()));
    }
    let rough: Vec<bool> = colors.chunks_exact(3).map(|color| color[0] > 128).collect();
    let away = measure_distances(&Image { width, height, values: rough.clone() }, false, 64).values;
    let drawn = draw_ropes(&planes, &rough, &away, &[(1, [50.0, 20.0, 20.0]), (2, [20.0; 3])], half_width);
    assert!(drawn.values.iter().all(|one| (0..=2).contains(&one.label) && one.from_ground >= 0.0));
}
