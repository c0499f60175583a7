//! Tests of tracked ropes: splines, the search for samples, and one frame of a simulated rope.

use proptest::prelude::*;

use super::camera::Camera;
use super::nearest::Nearest;
use super::openings::Table;
use super::rope::{Hold, Rope, Weights};
use super::update::{Options, update};
use crate::clouds::depth::Pinhole;
use crate::geometry::{Point, RigidMotion};

const RADIUS: f64 = 0.004; // metres
const FAR: f64 = 0.8; // metres from the camera to the table
const SIZE: [usize; 2] = [320, 240]; // pixels
const FOCAL: f64 = 300.0; // pixels

proptest! {
    #[test]
    fn a_spline_follows_a_straight_line(count in 6usize..30, share in 0.0f64..1.0) {
        let at = share * (count - 1) as f64;
        let nodes: Vec<Point> = (0..count).map(|i| [2.0 * i as f64, 1.0, -(i as f64)]).collect();
        let weights = Weights::new(at, count);
        let (place, slope) = (weights.place(&nodes), weights.direction(&nodes));
        for (value, expected) in place.into_iter().zip([2.0 * at, 1.0, -at]) {
            prop_assert!((value - expected).abs() < 1e-9);
        }
        for (value, expected) in slope.into_iter().zip([2.0, 0.0, -1.0]) {
            prop_assert!((value - expected).abs() < 1e-9);
        }
    }

    #[test]
    fn the_nearest_sample_is_that_of_all(
        raw in prop::collection::vec((-0.1f64..0.1, -0.1f64..0.1, 0.7f64..0.9), 1..60),
        p in (-0.1f64..0.1, -0.1f64..0.1, 0.75f64..0.85),
        gate in 0.005f64..0.06,
    ) {
        let project = |[x, y, z]: Point| [FOCAL * x / z + 160.0, FOCAL * y / z + 120.0];
        let places: Vec<Point> = raw.iter().map(|&(x, y, z)| [x, y, z]).collect();
        let pixels: Vec<[f64; 2]> = places.iter().map(|&place| project(place)).collect();
        let p = [p.0, p.1, p.2];
        let found = Nearest::new(&places, &pixels, SIZE[0], SIZE[1], 1.0 / FOCAL).find(p, project(p), gate, 0.6);
        let distance = |q: &Point| {
            ((p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (0.6 * (p[2] - q[2])).powi(2)).sqrt()
        };
        let least = places.iter().map(distance).fold(f64::INFINITY, f64::min);
        // rings of cells are bounded by the distance in the image, to a share
        match found {
            Some((i, d)) => {
                prop_assert!((distance(&places[i]) - d).abs() < 1e-12);
                prop_assert!(d < gate && d <= 1.6 * least + 1e-12);
            }
            None => prop_assert!(least > 0.6 * gate),
        }
    }
}

/// Draws a straight rope along x over a table, shifted in y; x runs from −0.1 to 0.1 m.
fn draw(shift: f64) -> (Vec<f64>, Vec<bool>) {
    let (mut depth, mut mask) = (vec![FAR; SIZE[0] * SIZE[1]], vec![false; SIZE[0] * SIZE[1]]);
    let axis = FAR - RADIUS;
    for v in 0..SIZE[1] {
        for u in 0..SIZE[0] {
            let [x, y] = [(u as f64 - 160.0) / FOCAL * axis, (v as f64 - 120.0) / FOCAL * axis];
            let across = y - shift;
            if x.abs() < 0.1 && across.abs() < RADIUS {
                depth[v * SIZE[0] + u] = axis - (RADIUS * RADIUS - across * across).sqrt();
                mask[v * SIZE[0] + u] = true;
            }
        }
    }
    (depth, mask)
}

fn make_rope() -> Rope {
    let count = 20;
    let spacing = 0.2 / (count - 1) as f64;
    let nodes: Vec<Point> = (0..count).map(|i| [i as f64 * spacing - 0.1, 0.0, FAR - RADIUS]).collect();
    Rope {
        velocities: vec![[0.0; 3]; count],
        variance: vec![1e-6; count],
        noise: vec![1e-6; count],
        last: nodes.clone(),
        age: vec![0.0; count],
        radius: RADIUS,
        spacing,
        slid: None,
        covers: [None; 2],
        holds: vec![],
        nodes,
    }
}

fn see<'a>(depth: &'a [f64], mask: &'a [bool]) -> Camera<'a> {
    Camera {
        depth,
        mask,
        occluders: None,
        width: SIZE[0],
        pinhole: Pinhole { focal: [FOCAL; 2], center: [160.0, 120.0] },
        pose: RigidMotion::identity(),
        delay: 0.0,
        bias: 0.0,
    }
}

const OPTIONS: Options = Options { steps: 7, elapsed: 1.0 / 30.0, bias_gain: 0.0, free: false };
const TABLE: Table = Table { normal: [0.0, 0.0, -1.0], offset: -FAR };

#[test]
fn a_rope_follows_its_pixels() {
    let (depth, mask) = draw(0.006);
    let mut ropes = [make_rope()];
    let outcome = update(&mut [see(&depth, &mask)], &mut ropes, Some(TABLE), OPTIONS);
    for node in &ropes[0].nodes {
        assert!((node[1] - 0.006).abs() < 0.25 * RADIUS, "{node:?}");
        assert!((node[2] - (FAR - RADIUS)).abs() < 0.2 * RADIUS, "{node:?}");
    }
    assert!(ropes[0].velocities.iter().all(|v| v[1] > 0.05));
    assert_eq!(outcome.unexplained, 0.0);
    assert!(outcome.ropes[0].hidden.iter().all(|hidden| !hidden));
    let traces = outcome.ropes[0].covariances.iter().map(|c| c[0][0] + c[1][1] + c[2][2]);
    assert!(traces.into_iter().all(|trace| trace > 0.0 && trace < RADIUS * RADIUS));
}

#[test]
fn what_covers_a_rope_hides_it_and_a_hold_moves_it() {
    let (mut depth, mut mask) = draw(0.0);
    for v in 0..SIZE[1] {
        for u in 170..SIZE[0] {
            (depth[v * SIZE[0] + u], mask[v * SIZE[0] + u]) = (0.5, false);
        }
    }
    let mut ropes = [make_rope()];
    let goal = [0.098, 0.004, FAR - RADIUS];
    ropes[0].holds.push(Hold { at: 19.0, point: goal, sd: 0.001 });
    let outcome = update(&mut [see(&depth, &mask)], &mut ropes, Some(TABLE), OPTIONS);
    assert!(outcome.ropes[0].hidden[14..].iter().all(|hidden| *hidden));
    assert!(outcome.ropes[0].hidden[..10].iter().all(|hidden| !hidden));
    let end = ropes[0].nodes[19];
    assert!((end[1] - goal[1]).abs() < 0.002, "{end:?}");
    assert!(ropes[0].nodes[3][1].abs() < 0.1 * RADIUS);
}

#[test]
fn a_rope_that_slides_is_found_by_its_tips() {
    let (depth, mask) = draw(0.0);
    let mut ropes = [make_rope()];
    for node in &mut ropes[0].nodes {
        node[0] += 0.01;
    }
    for _ in 0..4 {
        update(&mut [see(&depth, &mask)], &mut ropes, Some(TABLE), OPTIONS);
    }
    assert!((ropes[0].nodes[0][0] + 0.1).abs() < RADIUS, "{:?}", ropes[0].nodes[0]);
}

#[test]
fn a_tip_that_sticks_out_of_what_covers_the_rope_is_found() {
    let (mut depth, mut mask) = draw(0.0);
    for v in 0..SIZE[1] {
        for u in 170..190 {
            (depth[v * SIZE[0] + u], mask[v * SIZE[0] + u]) = (0.5, false);
        }
    }
    let mut ropes = [make_rope()];
    for node in &mut ropes[0].nodes {
        node[0] -= 0.003;
    }
    ropes[0].covers[1] = Some(0.0);
    for _ in 0..4 {
        update(&mut [see(&depth, &mask)], &mut ropes, Some(TABLE), OPTIONS);
    }
    assert!((ropes[0].nodes[19][0] - 0.1).abs() < RADIUS, "{:?}", ropes[0].nodes[19]);
}
