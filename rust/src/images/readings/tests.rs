//! Readings of drawn masks with known ropes.

use super::ends::extend;
use super::links::{Votes, fit};
use super::lookup::Across;
use super::planar::{self, Place, distance, length, resampled};
use super::search::{Reading, find_readings, price};
use crate::images::bits::Bits;
use crate::images::image::{Image, find_blobs};
use crate::images::parts::turn_blobs;
use crate::images::silhouette::Silhouette;
use crate::images::thinning::find_skeleton;

const RADIUS_PX: f64 = 8.0; // the ropes' radius, pixels
const WIDTH: usize = 240;
const HEIGHT: usize = 200;

/// Returns the silhouette of ropes with flat ends.
fn silhouette(ropes: &[Vec<Place>]) -> Silhouette {
    let beyond = |x: Place, end: Place, before: Place| {
        let out = [end[0] - before[0], end[1] - before[1]];
        distance(x, end) < RADIUS_PX && (x[0] - end[0]) * out[0] + (x[1] - end[1]) * out[1] > 0.0
    };
    let covers = |rope: &Vec<Place>, x: Place| {
        let n = rope.len();
        distance_to(x, rope) < RADIUS_PX
            && !beyond(x, rope[0], rope[1])
            && !beyond(x, rope[n - 1], rope[n - 2])
    };
    let mask: Vec<bool> = (0..WIDTH * HEIGHT)
        .map(|k| ropes.iter().any(|rope| covers(rope, [(k % WIDTH) as f64, (k / WIDTH) as f64])))
        .collect();
    Silhouette::of_rope(&mask, WIDTH, RADIUS_PX).unwrap()
}

/// Returns the distance of a place from a polyline.
fn distance_to(x: Place, p: &[Place]) -> f64 {
    p.windows(2)
        .map(|w| {
            let d = [w[1][0] - w[0][0], w[1][1] - w[0][1]];
            let e = [x[0] - w[0][0], x[1] - w[0][1]];
            let t = ((e[0] * d[0] + e[1] * d[1]) / (d[0] * d[0] + d[1] * d[1])).clamp(0.0, 1.0);
            distance(e, [t * d[0], t * d[1]])
        })
        .fold(f64::INFINITY, f64::min)
}

fn line(a: Place, b: Place) -> Vec<Place> {
    resampled(&[a, b], 0.5 * RADIUS_PX)
}

/// Returns the deviation of two polylines in either direction, with places matched by their share of the length.
fn deviation(p: &[Place], q: &[Place]) -> f64 {
    let [p, q] = [p, q].map(|c| resampled(c, length(c) / 60.0));
    let most = |turned: bool| {
        (0..p.len()).map(|i| distance(p[i], q[if turned { q.len() - 1 - i } else { i }])).fold(0.0, f64::max)
    };
    assert_eq!(p.len(), q.len());
    most(false).min(most(true))
}

/// Returns the deviation of a reading from the ropes; infinite for another number of ropes.
fn away(silhouette: &Silhouette, reading: &Reading, ropes: &[Vec<Place>]) -> f64 {
    let chains = extend(silhouette, &reading.chains);
    if chains.len() != ropes.len() {
        return f64::INFINITY;
    }
    let nearest = |rope: &Vec<Place>| chains.iter().map(|c| deviation(c, rope)).fold(f64::INFINITY, f64::min);
    ropes.iter().map(nearest).fold(0.0, f64::max)
}

#[test]
fn thinning_keeps_connections_and_holes() {
    let mut state = 7u64;
    let (mut most_holes, mut most_parts) = (0, 0);
    for _ in 0..40 {
        let mut noise = Image::filled(90, 70, 0.0f32);
        for value in &mut noise.values {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *value = (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
        }
        let smooth = noise.smoothed(2.5);
        let mut mask = Image::filled(90, 70, false);
        for y in 3..67 {
            for x in 3..87 {
                mask.values[90 * y + x] = smooth.at(x, y) > 0.0;
            }
        }
        // specks may vanish: silhouettes have none
        turn_blobs(&mut mask, true, true, |size| size < 40);
        let count = |image: &Image<bool>| {
            (find_blobs(image, true, true).sizes.len(), find_blobs(image, false, false).sizes.len() - 1)
        };
        let mut lines = Image::filled(90, 70, false);
        for k in find_skeleton(&Bits::pack(&mask.values, mask.width)) {
            assert!(mask.values[k]);
            lines.values[k] = true;
        }
        assert_eq!(count(&lines), count(&mask));
        most_parts = most_parts.max(count(&mask).0);
        most_holes = most_holes.max(count(&mask).1);
        let set = |image: &Image<bool>| image.values.iter().filter(|&&v| v).count();
        assert!(3 * set(&lines) < set(&mask));
    }
    assert!(most_parts > 3 && most_holes > 3, "{most_parts}, {most_holes}");
}

/// Returns a random polyline of `n` nodes, whose steps are up to `step` pixels long.
fn wander(n: usize, step: f64, state: &mut u64) -> Vec<Place> {
    let mut draw = || {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) as f64 / f64::from(1u32 << 31) - 0.5
    };
    let mut at = [9.0 * draw(), 9.0 * draw()];
    let mut nodes = vec![at];
    for _ in 1..n {
        at = at.map(|x| x + 1.4 * step * draw());
        nodes.push(at);
    }
    nodes
}

#[test]
fn polylines_cross_where_two_of_their_segments_do() {
    let (mut state, mut crossing) = (5, 0);
    for k in 0..400 {
        let p = wander(1 + k % 30, 2.0, &mut state);
        let q = wander(1 + k % 23, [0.0, 0.3, 4.0][k % 3], &mut state);
        let meet = |s: &[Place], t: &[Place]| planar::cross_segments(s[0], s[1], t[0], t[1]).is_some();
        let expected = p.windows(2).any(|s| q.windows(2).any(|t| meet(s, t)));
        assert_eq!(planar::cross(&p, &q), expected, "{k}");
        crossing += usize::from(expected);
    }
    // straight lines from afar
    for k in 0..200 {
        let step = [1.0, 0.7, 2.3, 0.05][k % 4];
        let q: Vec<Place> = (0..60).map(|i| [0.137 * k as f64 + (30.0 - f64::from(i)) * step, 0.1]).collect();
        let p = [[0.3, -0.2 - 0.4 * (k % 5) as f64], [0.3, 0.4]];
        let meet = |t: &[Place]| planar::cross_segments(p[0], p[1], t[0], t[1]).is_some();
        let expected = q.windows(2).any(meet);
        assert_eq!(planar::cross(&p, &q), expected, "{k}");
        crossing += usize::from(expected);
    }
    assert!((100..500).contains(&crossing), "{crossing}");
}

#[test]
fn polylines_have_their_lengths_bends_and_crossings() {
    let quarter: Vec<Place> = (0..=200)
        .map(|i| f64::from(i) / 200.0 * std::f64::consts::FRAC_PI_2)
        .map(|a| [50.0 * a.cos(), 50.0 * a.sin()])
        .collect();
    let long = 50.0 * std::f64::consts::FRAC_PI_2;
    assert!((length(&quarter) - long).abs() < 1e-3 * long);
    let even = resampled(&quarter, 4.0);
    assert!(distance(even[0], quarter[0]) + distance(even[even.len() - 1], quarter[200]) < 1e-9);
    for pair in even.windows(2) {
        assert!((distance(pair[0], pair[1]) - long / (even.len() - 1) as f64).abs() < 1e-2);
    }
    // r ∫ κ² ds = r L / R²; the curvature does not change
    let (bent, change) = planar::bending(&even, 8.0);
    assert!((bent / (8.0 * long / 2500.0) - 1.0).abs() < 0.1, "{bent}");
    assert!(change < 0.1 * bent, "{change}");
    assert!(planar::bending(&line([0.0, 0.0], [80.0, 30.0]), 8.0).0 < 1e-9);
    let (a, b) = (line([0.0, 0.0], [60.0, 0.0]), line([30.0, -30.0], [30.0, 50.0]));
    assert!(planar::cross(&a, &b) && !planar::cross(&a, &line([0.0, 9.0], [60.0, 9.0])));
    let (t, u) = planar::cross_segments([0.0, 0.0], [60.0, 0.0], [30.0, -30.0], [30.0, 50.0]).unwrap();
    assert!((t - 0.5).abs() < 1e-12 && (u - 0.375).abs() < 1e-12);
    assert_eq!(planar::cross_segments([0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]), None);
    assert!((planar::nearest(&a, &line([0.0, 9.0], [60.0, 9.0]), 20.0).unwrap() - 9.0).abs() < 1e-12);
    let cubic = planar::hermite([0.0, 0.0], [1.0, 0.0], [40.0, 20.0], [1.0, 0.0]);
    assert!(distance(cubic[0], [0.0, 0.0]) < 1e-9 && distance(cubic[39], [40.0, 20.0]) < 1e-9);
    assert!((cubic[1][1] / cubic[1][0]).abs() < 0.05);
    let twice: Vec<Place> = a.iter().flat_map(|&x| [x, x]).collect();
    assert!(planar::cleaned(&twice, 4.0).iter().all(|x| x[1].abs() < 1e-12));
}

#[test]
fn a_curve_is_fitted_to_an_arc() {
    let arc: Vec<Place> = (0..=120)
        .map(|i| 0.4 + f64::from(i) / 120.0 * 2.2)
        .map(|a| [120.0 + 70.0 * a.cos(), 60.0 + 70.0 * a.sin()])
        .collect();
    let seen = silhouette(std::slice::from_ref(&arc));
    let start: Vec<Place> = resampled(&arc, 0.5 * RADIUS_PX)
        .iter()
        .enumerate()
        .map(|(i, x)| [x[0] + 3.0 * (i as f64).sin(), x[1] + 3.0 * (2.0 * i as f64).cos()])
        .collect();
    let found = fit(&seen, &Votes::new(&seen), &start, &vec![0.0; start.len()], &[]).unwrap();
    for x in &found[4..found.len() - 4] {
        let off = (x[0] - 120.0).hypot(x[1] - 60.0) - 70.0;
        assert!(off.abs() < 0.1 * RADIUS_PX, "{off}");
    }
}

#[test]
fn votes_have_the_normals_of_their_edges() {
    let seen = silhouette(&[line([30.0, 60.0], [205.0, 130.0])]);
    let votes = Votes::new(&seen);
    for (turned, expected) in [(false, 0), (true, seen.boundary.len())] {
        let directions: Vec<Place> = (seen.boundary.iter())
            .map(|edge| if turned { [-edge.normal[1], edge.normal[0]] } else { edge.normal })
            .collect();
        let across = Across { nodes: &directions, places: &votes.normals, below: 0.01 };
        let found = votes.lookup.find_across(&votes.places, 1e-9, &across);
        assert_eq!(found.iter().flatten().count(), expected);
    }
}

#[test]
fn a_strip_is_one_rope_from_end_to_end() {
    let rope = line([30.0, 60.0], [205.0, 130.0]);
    let seen = silhouette(std::slice::from_ref(&rope));
    // a rope has its price if the number of ropes is not known
    for (ropes, price) in [(None, 5.0), (Some(1), 0.0)] {
        let found = find_readings(&seen, ropes, 6);
        assert!(away(&seen, &found[0], std::slice::from_ref(&rope)) < 0.5 * RADIUS_PX);
        assert_eq!(found[0].rings, 0);
        assert!(found[0].cost < price + 2.0, "{}", found[0].cost);
    }
    // the cost is that of its chains, and moving them makes it more expensive
    let aside: Vec<Place> = rope.iter().map(|x| [x[0], x[1] + 0.7 * RADIUS_PX]).collect();
    assert!(price(&seen, &[aside]) > price(&seen, &[rope]) + 5.0);
}

#[test]
fn strips_that_cross_go_straight_on() {
    for slope in [0.4, 0.9, 3.0] {
        let d = planar::unit([1.0, slope]);
        let ends = |s: f64| {
            [[120.0 - 80.0 * d[0], 100.0 - s * 80.0 * d[1]], [120.0 + 80.0 * d[0], 100.0 + s * 80.0 * d[1]]]
        };
        let ropes = [1.0, -1.0].map(|s| line(ends(s)[0], ends(s)[1]));
        let seen = silhouette(&ropes);
        for count in [None, Some(2)] {
            let found = find_readings(&seen, count, 6);
            let off = away(&seen, &found[0], &ropes);
            assert!(off < 0.6 * RADIUS_PX, "slope {slope}, {count:?} ropes: {off}");
        }
    }
}

#[test]
fn a_loop_that_crosses_itself_is_one_rope() {
    // a loop with two legs
    let rope: Vec<Place> = (0..=300)
        .map(|i| f64::from(i) / 150.0 - 1.0)
        .map(|t| [120.0 + 130.0 * (t * t * t - 0.55 * t), 170.0 - 140.0 * (1.0 - t * t)])
        .collect();
    let seen = silhouette(std::slice::from_ref(&rope));
    for ropes in [None, Some(1)] {
        let found = find_readings(&seen, ropes, 6);
        let off = away(&seen, &found[0], std::slice::from_ref(&rope));
        assert!(off < RADIUS_PX, "{ropes:?}: {off}");
        assert_eq!(found[0].rings, 0);
    }
}

#[test]
fn strips_that_touch_are_two_ropes() {
    // side by side in the middle, apart at their ends
    let rope = |side: f64| -> Vec<Place> {
        (0..=100)
            .map(|i| f64::from(i) / 50.0 - 1.0)
            .map(|t| [120.0 + 95.0 * t, 100.0 + side * (RADIUS_PX + 38.0 * t * t * t * t)])
            .collect()
    };
    let ropes = [rope(1.0), rope(-1.0)];
    let seen = silhouette(&ropes);
    let found = find_readings(&seen, Some(2), 6);
    assert!(found[0].chains.len() == 2);
    assert!(found.iter().any(|reading| away(&seen, reading, &ropes) < 0.6 * RADIUS_PX));
}

#[test]
fn gaps_are_joined_where_the_ropes_are_counted() {
    let pieces = [line([25.0, 70.0], [100.0, 90.0]), line([131.0, 98.0], [215.0, 120.0])];
    let whole = line([25.0, 70.0], [215.0, 120.0]);
    let seen = silhouette(&pieces);
    let found = find_readings(&seen, Some(1), 6);
    assert!(away(&seen, &found[0], std::slice::from_ref(&whole)) < 0.6 * RADIUS_PX);
    let open = find_readings(&seen, None, 6);
    assert!(away(&seen, &open[0], &pieces) < 0.6 * RADIUS_PX);
    let unbroken = find_readings(&silhouette(&[whole]), Some(1), 6);
    assert!(found[0].cost > unbroken[0].cost + 2.0);
}

#[test]
fn an_end_under_another_strand_lies_under_it() {
    let over = line([20.0, 90.0], [220.0, 100.0]);
    let under = line([110.0, 185.0], [123.0, 95.0]);
    let seen = silhouette(&[over.clone(), under.clone()]);
    for ropes in [None, Some(2)] {
        let found = find_readings(&seen, ropes, 6);
        let off = away(&seen, &found[0], &[over.clone(), under.clone()]);
        assert!(off < 1.7 * RADIUS_PX, "{ropes:?}: {off}");
        let straight =
            extend(&seen, &found[0].chains).iter().map(|c| deviation(c, &over)).fold(1e9, f64::min);
        assert!(straight < 0.6 * RADIUS_PX, "{ropes:?}: {straight}");
    }
}
