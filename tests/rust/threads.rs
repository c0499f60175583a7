//! Answers of every kernel are equal bit for bit for any number of threads. This test has a binary of its own, because
//! the number of threads belongs to the process.

mod fixtures;

use fixtures::{Random, hills, motion, moved, tube};
use strand::{
    IcpOptions, Neighbors, Objective, Point, RigidMotion, Viewpoints, centerline, count_neighbors,
    estimate_normals, icp, num_threads, radius_outlier_mask, set_num_threads, trace_chains,
};

/// Returns the bits of all numbers that the kernels return for one cloud.
fn answers(surface: &[Point], normals: &[Point]) -> Vec<u64> {
    let mut bits = Vec::new();
    let mut numbers = |values: &[f64]| bits.extend(values.iter().map(|x| x.to_bits()));
    for neighbors in [Neighbors::Nearest(12), Neighbors::Within(0.4)] {
        let found = estimate_normals(surface, neighbors, Viewpoints::One([3.0, 20.0, 9.0])).unwrap();
        numbers(found.normals.as_flattened());
        numbers(&found.variation);
    }
    let counts = count_neighbors(surface, 0.3).unwrap();
    numbers(&counts.iter().map(|&count| count as f64).collect::<Vec<_>>());
    let mask = radius_outlier_mask(surface, 0.3, 8).unwrap();
    numbers(&mask.iter().map(|&kept| f64::from(kept)).collect::<Vec<_>>());
    let axis = centerline(surface, normals, 1.0, 20).unwrap();
    numbers(axis.points.as_flattened());
    numbers(&axis.indices.iter().map(|&i| i as f64).collect::<Vec<_>>());
    for chain in trace_chains(&axis.points, 0.3, 0.8, None).unwrap() {
        numbers(&chain.iter().map(|&i| i as f64).collect::<Vec<_>>());
    }

    let (target, target_normals) = hills(6000, 3);
    let source = moved(&hills(5000, 4).0, &motion([0.02, 0.01, -0.03], [0.02, 0.01, 0.0]));
    for objective in [Objective::PointToPoint, Objective::PointToPlane(&target_normals)] {
        let options = IcpOptions {
            start: RigidMotion::identity(),
            max_correspondence_distance: 0.1,
            max_iterations: 10,
            tolerance: 0.0,
        };
        let found = icp(&source, &target, objective, &options).unwrap();
        numbers(found.transformation.to_rows().as_flattened());
        numbers(&[found.fitness, found.inlier_rmse, found.iterations as f64]);
    }

    // a lattice with tied distances, so sparse beside the dense points that the tree finds its neighbours
    let grid = |count: u32, spacing: f64, start: f64| {
        (0..count * count * count).map(move |i| {
            [i / (count * count), i / count % count, i % count].map(|k| start + spacing * f64::from(k))
        })
    };
    let uneven: Vec<Point> = grid(14, 0.01, 0.0).chain(grid(7, 4.0, 1.0)).collect();
    let found = estimate_normals(&uneven, Neighbors::Nearest(12), Viewpoints::One([3.0, 20.0, 9.0])).unwrap();
    numbers(found.normals.as_flattened());
    numbers(&found.variation);
    // halfway between points
    let source: Vec<Point> = uneven.iter().map(|p| p.map(|x| x + 2.0)).collect();
    let options = IcpOptions {
        start: RigidMotion::identity(),
        max_correspondence_distance: 5.0,
        max_iterations: 3,
        tolerance: 0.0,
    };
    let found = icp(&source, &uneven, Objective::PointToPoint, &options).unwrap();
    numbers(found.transformation.to_rows().as_flattened());
    numbers(&[found.fitness, found.inlier_rmse, found.iterations as f64]);
    bits
}

#[test]
fn answers_are_the_same_bits_for_any_number_of_threads() {
    let (mut surface, mut normals) = tube(8000, 16.0, 1);
    let mut random = Random(2);
    // some points coincide, some are off the surface
    for _ in 0..300 {
        let p = random.point();
        surface.extend([surface[0], [16.0 * p[0].abs(), 3.0 * p[1], 3.0 * p[2]]]);
        normals.extend([normals[0], [0.0, 1.0, 0.0]]);
    }
    assert!(num_threads() >= 1);
    set_num_threads(1);
    let expected = answers(&surface, &normals);
    for threads in [2, 3, 7, 1, 0] {
        set_num_threads(threads);
        assert!(threads == 0 || num_threads() == threads);
        assert!(answers(&surface, &normals) == expected, "{threads} threads");
    }
    // a number above the largest allowed is reduced to it
    set_num_threads(usize::MAX);
    assert!(num_threads() <= 256);
}
