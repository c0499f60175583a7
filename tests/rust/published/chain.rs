//! Greedy tracing against brute force and on curves.

use std::f64::consts::TAU;

use crate::fixtures::{
    FAR_AWAY, Random, any_cloud, any_motion, cases, distance, free_cloud, moved, order, reordered, scaled,
    shifted,
};
use nalgebra::Vector3;
use proptest::prelude::*;
use strand::{Error, Point, trace_chains};

/// Traces as in fig. 9–10: the nearest target beyond `near` within `far`, from both sides of the base.
fn traced(points: &[Point], near: f64, far: f64, start: Option<usize>) -> Vec<Vec<usize>> {
    let mut targets: Vec<bool> = vec![true; points.len()];
    let center: Point =
        (points.iter().map(|&p| Vector3::from(p)).sum::<Vector3<f64>>() / points.len().max(1) as f64).into();
    let mut chains = Vec::new();
    let mut start = start;
    loop {
        let remote =
            |&a: &usize, &b: &usize| distance(points[a], center).total_cmp(&distance(points[b], center));
        let Some(base) = start.take().or_else(|| (0..points.len()).filter(|&i| targets[i]).max_by(remote))
        else {
            return chains;
        };
        let mut sides = [vec![], vec![]];
        for side in &mut sides {
            let mut node = base;
            loop {
                (0..points.len())
                    .filter(|&i| distance(points[i], points[node]) <= near)
                    .for_each(|i| targets[i] = false);
                let reach =
                    (0..points.len()).filter(|&i| targets[i] && distance(points[i], points[node]) <= far);
                let Some(next) = reach.min_by(|&a, &b| {
                    distance(points[a], points[node]).total_cmp(&distance(points[b], points[node]))
                }) else {
                    break;
                };
                side.push(next);
                node = next;
            }
        }
        let [one, other] = sides;
        chains.push(one.into_iter().rev().chain([base]).chain(other).collect());
    }
}

/// Asserts invariants of an answer.
fn check(points: &[Point], near: f64, far: f64, chains: &[Vec<usize>]) -> Result<(), TestCaseError> {
    let nodes: Vec<usize> = chains.concat();
    for chain in chains {
        for pair in chain.windows(2) {
            let step = distance(points[pair[0]], points[pair[1]]);
            prop_assert!(near < step && step <= far, "a step of {step}");
        }
    }
    for (count, &node) in nodes.iter().enumerate() {
        prop_assert!(nodes[..count].iter().all(|&other| distance(points[node], points[other]) > near));
    }
    for &p in points {
        prop_assert!(nodes.iter().any(|&node| distance(points[node], p) <= near), "no node near {p:?}");
    }
    Ok(())
}

fn reach() -> impl Strategy<Value = (f64, f64)> {
    (prop_oneof![Just(0.5), Just(1.0), 0.05f64..0.8], prop_oneof![Just(2.0), 1.01f64..4.0])
        .prop_map(|(near, ratio)| (near, near * ratio))
}

proptest! {
    #![proptest_config(cases(150))]

    #[test]
    fn every_point_is_near_a_node_and_steps_are_in_range(points in any_cloud(150), (near, far) in reach()) {
        let chains = trace_chains(&points, near, far, None).unwrap();
        check(&points, near, far, &chains)?;
        prop_assert!(chains.iter().all(|chain| !chain.is_empty()));
        prop_assert_eq!(chains.is_empty(), points.is_empty());
    }

    #[test]
    fn chains_are_those_of_brute_force(
        points in free_cloud(3, 150), (near, far) in reach(), start: prop::sample::Index,
    ) {
        prop_assert_eq!(trace_chains(&points, near, far, None).unwrap(), traced(&points, near, far, None));
        let start = start.index(points.len());
        let chains = trace_chains(&points, near, far, Some(start)).unwrap();
        prop_assert_eq!(&chains, &traced(&points, near, far, Some(start)));
        prop_assert!(chains[0].contains(&start));
    }

    #[test]
    fn order_frame_and_unit_do_not_matter(
        points in free_cloud(3, 120), (near, far) in reach(), motion in any_motion(), seed: u64,
    ) {
        let chains = trace_chains(&points, near, far, None).unwrap();
        prop_assert_eq!(&trace_chains(&moved(&points, &motion), near, far, None).unwrap(), &chains);
        for unit in [1e-60, 1e-3, 1e60] {
            let small = trace_chains(&scaled(&points, unit), near * unit, far * unit, None).unwrap();
            prop_assert_eq!(&small, &chains);
        }
        let order = order(seed, points.len());
        let shuffled = trace_chains(&reordered(&points, &order), near, far, None).unwrap();
        let back: Vec<Vec<usize>> = shuffled.iter().map(|chain| reordered(&order, chain)).collect();
        prop_assert_eq!(&back, &chains);
    }
}

/// Returns points about a curve over [0, 1], in random order, with the parameter of each.
fn scattered(curve: impl Fn(f64) -> Point, count: usize, scatter: f64, seed: u64) -> (Vec<Point>, Vec<f64>) {
    let mut random = Random(seed);
    (0..count)
        .map(|_| {
            let t = random.uniform();
            let (p, d) = (curve(t), random.point());
            (std::array::from_fn(|k| p[k] + scatter * d[k]), t)
        })
        .unzip()
}

fn line(t: f64) -> Point {
    [10.0 * t, 2.0 * t, -t]
}

fn circle(t: f64) -> Point {
    [2.0 * (TAU * t).cos(), 2.0 * (TAU * t).sin(), 0.5]
}

fn helix(t: f64) -> Point {
    [2.0 * (3.0 * TAU * t).cos(), 2.0 * (3.0 * TAU * t).sin(), 6.0 * t]
}

fn rises(values: &[f64]) -> bool {
    values.windows(2).all(|pair| pair[0] < pair[1])
}

/// Returns the parameters of a chain's nodes in ascending direction.
fn parameters(chain: &[usize], t: &[f64]) -> Vec<f64> {
    let mut along = reordered(t, chain);
    if along[0] > along[along.len() - 1] {
        along.reverse();
    }
    along
}

#[test]
fn a_line_and_a_helix_give_one_ordered_chain() {
    for (curve, count) in [(line as fn(f64) -> Point, 1500), (helix, 4000)] {
        for origin in [[0.0; 3], FAR_AWAY] {
            let (points, t) = scattered(curve, count, 0.02, 5);
            let points = shifted(&points, origin);
            let middle = (0..count).min_by(|&a, &b| (t[a] - 0.5).abs().total_cmp(&(t[b] - 0.5).abs()));
            for start in [None, middle] {
                let chains = trace_chains(&points, 0.2, 0.5, start).unwrap();
                assert_eq!(chains.len(), 1);
                check(&points, 0.2, 0.5, &chains).unwrap();
                let along = parameters(&chains[0], &t);
                assert!(rises(&along), "{along:?}");
                assert!(along[0] < 0.03 && along[along.len() - 1] > 0.97, "it goes from end to end");
                assert!(start.is_none_or(|start| chains[0].contains(&start)));
            }
        }
    }
}

#[test]
fn a_circle_gives_one_chain_once_around() {
    let (points, t) = scattered(circle, 2000, 0.02, 6);
    let chains = trace_chains(&points, 0.2, 0.5, None).unwrap();
    assert_eq!(chains.len(), 1);
    check(&points, 0.2, 0.5, &chains).unwrap();
    let along = reordered(&t, &chains[0]);
    let mut steps: Vec<f64> =
        along.windows(2).map(|pair| (pair[1] - pair[0] + 1.5).rem_euclid(1.0) - 0.5).collect();
    if steps[0] < 0.0 {
        steps.iter_mut().for_each(|step| *step = -*step);
    }
    assert!(steps.iter().all(|&step| step > 0.0), "always the same way around");
    let turn: f64 = steps.iter().sum();
    assert!((0.93..1.0).contains(&turn), "once around, not twice: {turn}");
    // the two ends of the chain are nearer to each other than the reach
    let ends = [chains[0][0], chains[0][chains[0].len() - 1]].map(|i| points[i]);
    assert!(distance(ends[0], ends[1]) <= 0.5);
}

#[test]
fn two_pieces_give_two_chains() {
    let (one, _) = scattered(line, 1000, 0.02, 7);
    let (other, _) = scattered(|t| shifted(&[line(0.6 * t)], [0.0, 0.0, 1.0])[0], 1000, 0.02, 8);
    let points = [one.clone(), other].concat();
    let chains = trace_chains(&points, 0.2, 0.5, None).unwrap();
    assert_eq!(chains.len(), 2);
    check(&points, 0.2, 0.5, &chains).unwrap();
    for chain in &chains {
        let pieces: Vec<bool> = chain.iter().map(|&i| i < one.len()).collect();
        assert!(
            pieces.iter().all(|&piece| piece == pieces[0]),
            "a chain does not jump from one to the other"
        );
    }
}

#[test]
fn the_base_is_the_point_farthest_from_the_centroid() {
    let (points, t) = scattered(line, 400, 0.0, 9);
    // more points on one side, so that the other end is farthest from the centroid
    let (heavy, other) = scattered(|t| line(0.2 * t), 800, 0.0, 10);
    let points = [points, heavy].concat();
    let t = [t, other.iter().map(|t| 0.2 * t).collect()].concat();
    let end = (0..points.len()).max_by(|&a, &b| t[a].total_cmp(&t[b])).unwrap();
    let chains = trace_chains(&points, 0.3, 0.6, None).unwrap();
    assert_eq!(chains.len(), 1);
    assert!([chains[0][0], chains[0][chains[0].len() - 1]].contains(&end));
}

#[test]
fn single_places_and_no_points_are_answered() {
    assert!(trace_chains(&[], 1.0, 2.0, None).unwrap().is_empty());
    assert_eq!(trace_chains(&[[1.0, 2.0, 3.0]], 1.0, 2.0, Some(0)).unwrap(), [[0]]);
    assert_eq!(trace_chains(&vec![[1.0, 2.0, 3.0]; 1000], 1.0, 2.0, Some(7)).unwrap(), [[7]]);
    let apart = [[0.0; 3], [10.0, 0.0, 0.0], [30.0, 0.0, 0.0]];
    assert_eq!(trace_chains(&apart, 1.0, 2.0, None).unwrap(), [[2], [0], [1]]);
    assert_eq!(trace_chains(&apart, 1e98, 1e99, None).unwrap(), [[2]]);
    assert_eq!(trace_chains(&apart, 1e-300, 1e-299, None).unwrap().len(), 3);
}

#[test]
fn the_range_is_open_at_near_and_closed_at_far() {
    let points = [[0.0; 3], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [6.0, 0.0, 0.0]];
    assert_eq!(trace_chains(&points, 1.0, 3.0, Some(0)).unwrap(), [[3, 2, 0]]);
    assert_eq!(trace_chains(&points, 0.9, 3.0, Some(0)).unwrap(), [[3, 2, 1, 0]]);
    assert_eq!(trace_chains(&points, 0.9, 2.9, Some(0)).unwrap(), [vec![2, 1, 0], vec![3]]);
}

/// Returns the name of the refused argument.
fn refused(points: &[Point], near: f64, far: f64, start: Option<usize>) -> &'static str {
    match trace_chains(points, near, far, start) {
        Err(Error::InvalidArgument { name, .. }) => name,
        other => panic!("{other:?}"),
    }
}

#[test]
fn wrong_arguments_are_named() {
    let points = [[0.0; 3], [1.0, 0.0, 0.0]];
    for bad in [f64::NAN, f64::INFINITY, 1e100] {
        assert_eq!(refused(&[[0.0; 3], [bad, 0.0, 0.0]], 1.0, 2.0, None), "points");
        assert_eq!(refused(&points, bad, 2.0, None), "near");
        assert_eq!(refused(&points, 1.0, bad, None), "far");
    }
    for bad in [0.0, -1.0] {
        assert_eq!(refused(&points, bad, 2.0, None), "near");
        assert_eq!(refused(&points, 1.0, bad, None), "far");
    }
    assert_eq!(refused(&points, 1.0, 1.0, None), "far");
    assert_eq!(refused(&points, 2.0, 1.0, None), "far");
    assert_eq!(refused(&points, 1.0, 2.0, Some(2)), "start");
    assert_eq!(refused(&[], 1.0, 2.0, Some(0)), "start");
}
