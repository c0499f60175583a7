//! Every kernel against brute force on difficult random clouds.
//!
//! Scales reach from 1e-9 to 1e12. Some clouds are far from the origin, have points that pile up, outliers, or lattice
//! distances equal to the radius. Some radii are below rounding, or above all distances.
//!
//! The generator is seeded and its own, because proptest is too slow for hundreds of large clouds a second. A few
//! seconds run with the other tests. For hours, with other seeds:
//!
//! `STRAND_FUZZ_SECONDS=3600 STRAND_FUZZ_SEED=7 cargo test --release --test kernels fuzz -- --nocapture`
//!
//! A failure names its seed. Add it to `FOUND`; those seeds always run.

use std::time::{Duration, Instant};

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use strand::{
    IcpOptions, Neighbors, Objective, Point, Viewpoints, centerline, count_neighbors, estimate_normals, icp,
    radius_outlier_mask, trace_chains, trace_tubes,
};

use crate::fixtures::{Random, sine_between};

/// Seeds that once failed.
const FOUND: [u64; 9] = [3, 115, 124, 222, 228, 1_000_000_024, 1_000_000_029, 1_000_000_306, 7_000_005_269];
const FEWEST: u64 = 200; // seeds that always run, so that a slow machine tests something
const SECONDS: f64 = 2.0;
/// One of this many clouds is so large that its cells are crowded; some of its points are compared.
const LARGE_EVERY: u64 = 190;
const LARGE: usize = 20_000;
const COMPARED: usize = 40;

/// A cloud, the arguments of its kernels, and the points that are compared.
struct Case {
    points: Vec<Point>,
    normals: Vec<Point>,
    radius: f64,
    /// Largest error of a coordinate.
    rounding: f64,
    k: usize,
    wanted: usize,
    compared: Vec<usize>,
}

fn below(random: &mut Random, count: usize) -> usize {
    ((random.uniform() * count as f64) as usize).min(count - 1)
}

/// Returns ten to a random power between two.
fn power(random: &mut Random, low: f64, high: f64) -> f64 {
    10f64.powf(low + (high - low) * random.uniform())
}

/// Makes a cloud of size about 1 from several layouts.
fn layouts(random: &mut Random, count: usize) -> Vec<Point> {
    let mut points: Vec<Point> = Vec::with_capacity(count);
    while points.len() < count {
        let part = 1 + below(random, count - points.len());
        let (middle, way, size) = (random.point(), random.point(), power(random, -9.0, 0.0));
        let steps = f64::from(1 << below(random, 4));
        let layout = below(random, 9);
        for _ in 0..part {
            let p = random.point();
            points.push(match layout {
                0 => p,
                1 => middle,
                2 => [0.0; 3],
                3 => std::array::from_fn(|k| middle[k] + size * p[k]),
                4 => p.map(|x| (x * steps).round() / steps),
                5 => way.map(|x| x * p[0]),
                6 => [p[0], p[1], middle[2]],
                7 => p.map(|x| x * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2])),
                // a tube
                _ => {
                    let (sin, cos) = (9.0 * p[1]).sin_cos();
                    [p[0], middle[1] + 0.05 * cos, middle[2] + 0.05 * sin]
                }
            });
        }
    }
    for _ in 0..below(random, 4) {
        let (i, j) = (below(random, count), below(random, count));
        points[i] = points[j];
    }
    if random.uniform() < 0.2 {
        let i = below(random, count);
        points[i] = random.point().map(|x| x * power(random, 1.0, 9.0));
    }
    if random.uniform() < 0.1 {
        let apart = power(random, 1.0, 7.0);
        points.iter_mut().step_by(2).for_each(|p| p[0] += apart);
    }
    points
}

fn case(seed: u64) -> Case {
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let large = seed % LARGE_EVERY == LARGE_EVERY - 1;
    let count = if large { LARGE } else { 1 + below(&mut random, 120) };
    let mut points = layouts(&mut random, count);
    let unit = if random.uniform() < 0.5 { 1.0 } else { power(&mut random, -9.0, 12.0) };
    let offset = match below(&mut random, 4) {
        0 => random.point().map(|x| x * power(&mut random, 0.0, 16.0)),
        _ => [0.0; 3],
    };
    for p in &mut points {
        *p = std::array::from_fn(|k| unit * (p[k] + offset[k]));
    }
    let largest = points.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
    let radius = match below(&mut random, 8) {
        // exactly at the distance
        0 | 1 => {
            let (i, j) = (below(&mut random, count), below(&mut random, count));
            let d = squared(points[i], points[j]).sqrt();
            if d > 0.0 { d } else { unit }
        }
        2 => unit * 0.5f64.powi(below(&mut random, 5) as i32),
        3 => (largest * f64::EPSILON * random.uniform()).max(1e-30),
        4 => unit * power(&mut random, -12.0, 14.0),
        _ => unit * power(&mut random, -2.0, 0.3),
    };
    let normals = (0..count)
        .map(|i| if i % 17 == 3 { [0.0; 3] } else { Vector3::from(random.point()).normalize().into() })
        .collect();
    let compared =
        if large { (0..COMPARED).map(|_| below(&mut random, count)).collect() } else { (0..count).collect() };
    let (k, wanted) = (3 + below(&mut random, 20), below(&mut random, 12));
    Case { points, normals, radius, rounding: f64::EPSILON * (largest + radius), k, wanted, compared }
}

fn squared(a: Point, b: Point) -> f64 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

/// Compares a normal and its surface variation with brute force.
fn compare_normal(normal: Point, variation: f64, near: &[Point]) {
    let first = near[0];
    let relative: Vec<Vector3<f64>> = near.iter().map(|&q| Vector3::from(q) - Vector3::from(first)).collect();
    let size = relative.iter().fold(0.0, |size: f64, d| size.max(d.amax()));
    if near.len() < 3 || size == 0.0 {
        assert_eq!((normal, variation), ([0.0; 3], 0.0));
        return;
    }
    let mean = relative.iter().sum::<Vector3<f64>>() / (size * relative.len() as f64);
    let covariance: Matrix3<f64> =
        relative.iter().map(|d| (d / size - mean) * (d / size - mean).transpose()).sum::<Matrix3<f64>>()
            / relative.len() as f64;
    let eigen = SymmetricEigen::try_new(covariance, f64::EPSILON, 10_000).unwrap();
    let mut columns = [0, 1, 2];
    columns.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let [low, middle, high] = columns.map(|i| eigen.eigenvalues[i].max(0.0));
    let length = Vector3::from(normal).norm();
    assert!(length == 0.0 || (length - 1.0).abs() < 1e-12);
    // in between, rounding in sums about a place in the neighbourhood decides, and where most points of a large
    // neighbourhood coincide
    let lost = 1e-13 / high;
    if middle <= 1e-15 * high {
        assert_eq!(length, 0.0, "a line");
    } else if middle > (1e-9 + lost) * high {
        assert!(length > 0.0, "eigenvalues {low:e} {middle:e} {high:e}");
        assert!((variation - low / (low + middle + high)).abs() < 1e-9 + lost);
        let certain = (middle - low) / high;
        if certain > 1e-6 {
            let sine = sine_between(normal, eigen.eigenvectors.column(columns[0]).into_owned().into());
            assert!(sine <= (1e-11 + lost) / certain, "{sine:e}, {certain:e}, {low:e} {middle:e} {high:e}");
        }
    }
}

/// Compares all kernels with brute force; returns how many answers for single points it compared.
fn run(seed: u64) -> usize {
    let Case { points, normals, radius, rounding, k, wanted, compared } = case(seed);
    let camera = Viewpoints::One([0.3, -0.2, 5.0]);
    let limit = radius * radius;
    let near = |i: usize| -> Vec<usize> {
        (0..points.len()).filter(|&j| squared(points[j], points[i]) <= limit).collect()
    };

    let counts = count_neighbors(&points, radius).unwrap();
    let kept = radius_outlier_mask(&points, radius, wanted).unwrap();
    let within = estimate_normals(&points, Neighbors::Within(radius), camera).unwrap();
    let nearest =
        (points.len() >= k).then(|| estimate_normals(&points, Neighbors::Nearest(k), camera).unwrap());
    let axis = centerline(&points, &normals, 0.5 * radius, wanted).unwrap();
    let mut cases = 0;
    for &i in &compared {
        let around = near(i);
        assert_eq!(counts[i], around.len() - 1, "neighbours of {i}");
        assert_eq!(kept[i], around.len() > wanted);
        let places: Vec<Point> = around.iter().map(|&j| points[j]).collect();
        compare_normal(within.normals[i], within.variation[i], &places);
        cases += 3;
        if let Some(nearest) = &nearest {
            let mut sorted: Vec<Point> = points.clone();
            let by = |a: &Point, b: &Point| squared(*a, points[i]).total_cmp(&squared(*b, points[i]));
            sorted.select_nth_unstable_by(k - 1, by);
            let last = squared(sorted[k - 1], points[i]);
            // of several points at the last distance, those that coincide are equal
            let mut as_far = points.iter().filter(|p| squared(**p, points[i]) == last);
            let one = as_far.next();
            if as_far.all(|p| Some(p) == one) {
                compare_normal(nearest.normals[i], nearest.variation[i], &sorted[..k]);
                cases += 1;
            }
        }
        let taking: Vec<usize> = around.into_iter().filter(|&j| normals[j] != [0.0; 3]).collect();
        let row = axis.indices.binary_search(&i);
        assert_eq!(row.is_ok(), normals[i] != [0.0; 3] && taking.len() >= wanted);
        if let Ok(row) = row {
            for c in 0..3 {
                let sum: f64 =
                    taking.iter().map(|&j| points[j][c] - points[i][c] - 0.5 * radius * normals[j][c]).sum();
                let off = axis.points[row][c] - points[i][c] - sum / taking.len() as f64;
                assert!(off.abs() <= 64.0 * rounding, "an axis point is off by {off:e} of {rounding:e}");
            }
        }
        cases += 1;
    }
    cases + compare_pairs(&points, &compared, radius) + compare_chains(&points, &compared, radius, seed)
}

/// Compares the first pairs of a registration.
fn compare_pairs(points: &[Point], compared: &[usize], radius: f64) -> usize {
    // every second point with all others: some coincide
    let (source, target): (Vec<Point>, Vec<Point>) = (
        compared.iter().step_by(2).map(|&i| points[i]).collect(),
        points.iter().skip(1).step_by(2).chain(points.iter().take(1)).copied().collect(),
    );
    let options =
        IcpOptions { max_correspondence_distance: radius, max_iterations: 0, ..IcpOptions::default() };
    let found = icp(&source, &target, Objective::PointToPoint, &options).unwrap();
    let nearest = |p: &Point| target.iter().map(|&q| squared(q, *p)).fold(f64::INFINITY, f64::min);
    let paired: Vec<f64> = source.iter().map(nearest).filter(|&square| square <= radius * radius).collect();
    assert_eq!(found.fitness, paired.len() as f64 / source.len() as f64, "fitness");
    let mean = (paired.iter().sum::<f64>() / paired.len().max(1) as f64).sqrt();
    assert!((found.inlier_rmse - mean).abs() <= 1e-9 * mean, "{} for {mean}", found.inlier_rmse);
    let options = IcpOptions { max_iterations: 3, ..options };
    let moved = icp(&source, &target, Objective::PointToPoint, &options).unwrap();
    assert!(moved.transformation.to_rows().iter().flatten().all(|x| x.is_finite()));
    assert!((0.0..=1.0).contains(&moved.fitness) && moved.inlier_rmse <= radius * (1.0 + 1e-12));
    // lists that were made at earlier poses have the nearest points at the last one
    let there: Vec<Point> = source.iter().map(|&p| moved.transformation.apply(p)).collect();
    let size = target.iter().chain(&there).flatten().fold(radius, |most, x| f64::max(most, x.abs()));
    let apart: Vec<f64> = there.iter().map(|p| nearest(p).sqrt()).collect();
    let count = |reach: f64| apart.iter().filter(|&&away| away <= reach).count() as f64;
    let paired = moved.fitness * source.len() as f64;
    let slack = 1e-14 * size + 1e-9 * radius;
    assert!(count(radius - slack) - 0.5 < paired && paired < count(radius + slack) + 0.5, "{paired} pairs");
    if count(radius - slack) == count(radius + slack) {
        let squares = apart.iter().filter(|&&away| away <= radius).map(|away| away * away);
        let mean = (squares.sum::<f64>() / paired.max(1.0)).sqrt();
        assert!((moved.inlier_rmse - mean).abs() <= slack, "{} for {mean}", moved.inlier_rmse);
    }
    source.len()
}

/// Checks invariants of all chains.
fn compare_chains(points: &[Point], compared: &[usize], far: f64, seed: u64) -> usize {
    let near = far * [0.01, 0.3, 0.5, 0.9][(seed % 4) as usize];
    if near <= 0.0 || near >= far {
        return 0;
    }
    let chains = trace_chains(points, near, far, None).unwrap();
    let nodes: Vec<usize> = chains.concat();
    let mut is_node = vec![false; points.len()];
    for &node in &nodes {
        assert!(!std::mem::replace(&mut is_node[node], true), "a node twice");
    }
    for pair in chains.iter().flat_map(|chain| chain.windows(2)) {
        let step = squared(points[pair[0]], points[pair[1]]);
        assert!(near * near < step && step <= far * far, "a step of {step:e}");
    }
    for &i in compared {
        let close = nodes.iter().filter(|&&node| squared(points[node], points[i]) <= near * near).count();
        assert!(close > 0, "no node near {i}");
        assert!(!is_node[i] || close == 1, "two nodes near each other");
    }
    compared.len()
}

/// Checks that traced tubes are finite; they have no brute force.
fn trace(seed: u64) {
    let Case { points, radius, .. } = case(seed);
    for arc in trace_tubes(&points, Viewpoints::One([0.3, -0.2, 5.0]), radius, 4).unwrap() {
        assert!(arc.nodes.len() >= 4 && arc.nodes.len() == arc.support.len());
        assert!(arc.nodes.iter().flatten().chain(&arc.support).all(|x| x.is_finite()));
    }
}

fn asked(name: &str) -> Option<f64> {
    std::env::var(name).ok().map(|value| value.parse().unwrap_or_else(|_| panic!("{name}: {value}")))
}

#[test]
fn fuzz() {
    let (seconds, first) = (asked("STRAND_FUZZ_SECONDS").unwrap_or(SECONDS), asked("STRAND_FUZZ_SEED"));
    let first = first.unwrap_or(0.0) as u64 * 1_000_000_000;
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    let (mut cases, mut clouds) = (0, 0);
    let more = (first..).take_while(|seed| seed - first < FEWEST || Instant::now() < end);
    let (mut failed, keep_on) = (Vec::new(), asked("STRAND_FUZZ_SECONDS").is_some());
    for seed in FOUND.into_iter().chain(more) {
        let compared = std::panic::catch_unwind(|| {
            if seed % 10 == 0 {
                trace(seed);
            }
            run(seed)
        });
        match compared {
            Ok(compared) => cases += compared,
            Err(_) => {
                eprintln!("seed {seed} failed");
                failed.push(seed);
                assert!(keep_on && failed.len() < 20, "seeds {failed:?}");
            }
        }
        clouds += 1;
    }
    println!("{cases} answers for single points compared, of {clouds} clouds from seed {first} on");
    assert!(failed.is_empty(), "seeds {failed:?}");
}
