//! Axis points against a brute-force eq. 16–18, and on tubes.

use crate::fixtures::{
    FAR_AWAY, Random, any_cloud, any_motion, cases, distance, free_cloud, moved, order, reordered, scaled,
    shifted, tube,
};
use nalgebra::Vector3;
use proptest::prelude::*;
use strand::{Error, Point, RigidMotion, centerline};

/// Returns unit vectors, and sometimes the zero vector.
fn some_normals(count: usize, seed: u64) -> Vec<Point> {
    let mut random = Random(seed);
    (0..count)
        .map(|_| match Vector3::from(random.point()).try_normalize(0.0) {
            Some(n) if random.uniform() < 0.85 => n.into(),
            _ => [0.0; 3],
        })
        .collect()
}

/// Returns the indices and c̄ of the points with enough neighbours, relative to `origin`.
fn averaged(
    points: &[Point],
    normals: &[Point],
    radius: f64,
    least: usize,
    origin: Point,
) -> Vec<(usize, Point)> {
    let surface: Vec<usize> = (0..points.len()).filter(|&i| normals[i] != [0.0; 3]).collect();
    let relative = |p: Point| Vector3::from(p) - Vector3::from(origin);
    surface
        .iter()
        .filter_map(|&i| {
            let near: Vec<Vector3<f64>> = surface
                .iter()
                .filter(|&&j| distance(points[i], points[j]) <= 2.0 * radius)
                .map(|&j| relative(points[j]) - radius * Vector3::from(normals[j]))
                .collect();
            let count = near.len();
            (count >= least).then(|| (i, (near.into_iter().sum::<Vector3<f64>>() / count as f64).into()))
        })
        .collect()
}

proptest! {
    #![proptest_config(cases(150))]

    #[test]
    fn axis_points_are_those_of_the_equations(
        points in any_cloud(150), radius in prop_oneof![Just(0.25), Just(0.5), 0.05f64..1.5],
        least in 0usize..10, seed: u64,
    ) {
        let normals = some_normals(points.len(), seed);
        let origin = points.first().copied().unwrap_or_default();
        let expected = averaged(&points, &normals, radius, least, origin);
        let found = centerline(&points, &normals, radius, least).unwrap();
        prop_assert_eq!(&found.indices, &expected.iter().map(|&(i, _)| i).collect::<Vec<_>>());
        for (&got, &(i, want)) in found.points.iter().zip(&expected) {
            let want = shifted(&[want], origin)[0];
            // a few units in the last place of the input
            let largest = points[i].iter().chain(&origin).fold(1.0, |most: f64, x| most.max(x.abs()));
            prop_assert!(distance(got, want) <= 1e-15 * largest, "{got:?} for {want:?}");
        }
    }

    #[test]
    fn order_frame_and_unit_do_not_matter(
        points in free_cloud(1, 100), radius in 0.05f64..0.5, least in 0usize..8, motion in any_motion(),
        seed: u64,
    ) {
        let normals = some_normals(points.len(), seed);
        let found = centerline(&points, &normals, radius, least).unwrap();
        let same = |points: &[Point], other: &[Point], tolerance: f64| {
            points.len() == other.len() && points.iter().zip(other).all(|(&a, &b)| distance(a, b) < tolerance)
        };

        let turn = RigidMotion { translation: Vector3::zeros(), ..motion };
        let turned = centerline(&moved(&points, &motion), &moved(&normals, &turn), radius, least).unwrap();
        prop_assert_eq!(&turned.indices, &found.indices);
        prop_assert!(same(&turned.points, &moved(&found.points, &motion), 1e-13));

        let unit = 1e-3;
        let small = centerline(&scaled(&points, unit), &normals, radius * unit, least).unwrap();
        prop_assert_eq!(&small.indices, &found.indices);
        prop_assert!(same(&small.points, &scaled(&found.points, unit), 1e-16));

        let order = order(seed, points.len());
        let (points, normals) = (reordered(&points, &order), reordered(&normals, &order));
        let shuffled = centerline(&points, &normals, radius, least).unwrap();
        let mut back: Vec<(usize, Point)> =
            shuffled.indices.iter().map(|&i| order[i]).zip(shuffled.points.iter().copied()).collect();
        back.sort_by_key(|&(i, _)| i);
        prop_assert_eq!(&back.iter().map(|&(i, _)| i).collect::<Vec<_>>(), &found.indices);
        prop_assert!(same(&back.iter().map(|&(_, p)| p).collect::<Vec<_>>(), &found.points, 1e-14));
    }
}

#[test]
fn points_of_a_tube_go_to_its_axis() {
    let (points, normals) = tube(5000, 20.0, 1);
    for origin in [[0.0; 3], FAR_AWAY] {
        let found = centerline(&shifted(&points, origin), &normals, 1.0, 20).unwrap();
        assert!(found.points.len() > 4900);
        for (&c, &i) in found.points.iter().zip(&found.indices) {
            let axis: Point = std::array::from_fn(|k| c[k] - origin[k]);
            assert!(axis[1].hypot(axis[2]) < 1e-10, "{axis:?}");
            assert!((axis[0] - points[i][0]).abs() <= 2.0);
        }
    }
}

#[test]
fn the_side_that_a_camera_sees_is_enough() {
    let (points, normals) = tube(5000, 20.0, 2);
    let (seen, their): (Vec<Point>, Vec<Point>) =
        points.iter().zip(&normals).filter(|(_, n)| n[2] > 0.3).map(|(p, n)| (*p, *n)).unzip();
    let found = centerline(&seen, &their, 1.0, 20).unwrap();
    assert!(found.points.len() > 1500);
    assert!(found.points.iter().all(|c| c[1].hypot(c[2]) < 1e-12));
}

#[test]
fn the_count_includes_the_point_itself_and_the_boundary() {
    let points = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [5.0, 0.0, 0.0]];
    let normals = [[0.0, 0.0, 1.0]; 3];
    let found = centerline(&points, &normals, 1.0, 2).unwrap();
    assert_eq!(found.indices, [0, 1]);
    assert_eq!(found.points, [[1.0, 0.0, -1.0]; 2]);
    assert_eq!(centerline(&points, &normals, 1.0, 1).unwrap().indices, [0, 1, 2]);
    assert_eq!(centerline(&points, &normals, 1.0, 0).unwrap().indices, [0, 1, 2]);
    assert!(centerline(&points, &normals, 1.0, 3).unwrap().points.is_empty());
}

#[test]
fn points_without_a_normal_take_no_part() {
    let points = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]];
    let normals = [[0.0, 0.0, 1.0], [0.0; 3], [0.0, 0.0, 1.0]];
    let found = centerline(&points, &normals, 1.0, 2).unwrap();
    assert_eq!(found.indices, [0, 2]);
    assert!(found.points.iter().all(|&c| distance(c, [0.1, 0.0, -1.0]) < 1e-15));
    assert!(centerline(&points, &[[0.0; 3]; 3], 1.0, 0).unwrap().points.is_empty());
    assert!(centerline(&[], &[], 1.0, 0).unwrap().points.is_empty());
}

#[test]
fn coincident_points_and_a_huge_radius_are_answered() {
    let points = [[0.25, 0.5, -1.0]; 400];
    let found = centerline(&points, &[[0.0, 1.0, 0.0]; 400], 0.125, 400).unwrap();
    assert!(found.points.iter().all(|&c| distance(c, [0.25, 0.375, -1.0]) < 1e-14));
    let found = centerline(&points, &[[0.0, 1.0, 0.0]; 400], 1e99, 400).unwrap();
    assert!(found.points.iter().all(|c| c.iter().all(|x| x.is_finite())));
}

/// Returns the name of the refused argument.
fn refused(points: &[Point], normals: &[Point], radius: f64) -> &'static str {
    match centerline(points, normals, radius, 1) {
        Err(Error::InvalidArgument { name, .. }) => name,
        other => panic!("{other:?}"),
    }
}

#[test]
fn wrong_arguments_are_named() {
    let (points, normals) = tube(5, 1.0, 3);
    for bad in [f64::NAN, f64::INFINITY, 1e100] {
        assert_eq!(refused(&[[bad, 0.0, 0.0]; 5], &normals, 1.0), "points");
        assert_eq!(refused(&points, &[[bad, 0.0, 0.0]; 5], 1.0), "normals");
    }
    assert_eq!(refused(&points, &normals[..4], 1.0), "normals");
    for length in [0.5, 0.99, 1.01, 2.0, 1e-3] {
        assert_eq!(refused(&points, &scaled(&normals, length), 1.0), "normals");
    }
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e100] {
        assert_eq!(refused(&points, &normals, bad), "radius");
    }
    // rounded to single precision, they are still unit vectors
    let rounded: Vec<Point> = normals.iter().map(|n| n.map(|x| f64::from(x as f32))).collect();
    assert!(centerline(&points, &rounded, 1.0, 1).is_ok());
}
