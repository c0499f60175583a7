//! Plane normals against brute force and against surfaces with known normals.

use std::f64::consts::TAU;

use crate::fixtures::{
    FAR_AWAY, Random, any_cloud, any_motion, cases, distance, free_cloud, hills, moved, order, reordered,
    scaled, shifted, sine_between, tube,
};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use proptest::prelude::*;
use strand::{Error, Neighbors, Point, Viewpoints, estimate_normals};

const ORIGIN: Viewpoints = Viewpoints::One([0.0; 3]);

/// Returns the ascending eigenvalues of a neighbourhood's covariance, and the eigenvector of the least.
fn principal(neighbors: &[Point]) -> ([f64; 3], Point) {
    let first = Vector3::from(neighbors[0]);
    let relative: Vec<Vector3<f64>> = neighbors.iter().map(|&q| Vector3::from(q) - first).collect();
    let mean = relative.iter().sum::<Vector3<f64>>() / relative.len() as f64;
    let covariance: Matrix3<f64> =
        relative.iter().map(|d| (d - mean) * (d - mean).transpose()).sum::<Matrix3<f64>>()
            / relative.len() as f64;
    let eigen = SymmetricEigen::try_new(covariance, f64::EPSILON, 10_000).unwrap();
    let mut columns = [0, 1, 2];
    columns.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    (columns.map(|i| eigen.eigenvalues[i]), eigen.eigenvectors.column(columns[0]).into_owned().into())
}

fn within(points: &[Point], center: Point, radius: f64) -> Vec<Point> {
    points.iter().copied().filter(|&q| distance(q, center) <= radius).collect()
}

/// Returns the k nearest points; None if the k-th shares its distance with another.
fn nearest(points: &[Point], center: Point, k: usize) -> Option<Vec<Point>> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|&a, &b| distance(a, center).total_cmp(&distance(b, center)));
    let clear = sorted.len() == k || distance(sorted[k], center) > distance(sorted[k - 1], center) + 1e-9;
    sorted.truncate(k);
    clear.then_some(sorted)
}

/// Compares one answer with brute force.
fn agree(normal: Point, variation: f64, neighbors: &[Point]) -> Result<(), TestCaseError> {
    let length = Vector3::from(normal).norm();
    let ([low, middle, high], expected) = principal(neighbors);
    // between these two limits, rounding decides whether the neighbours are on a line
    let line = neighbors.len() < 3 || middle <= 1e-14 * high;
    if line {
        prop_assert_eq!(normal, [0.0; 3]);
        prop_assert_eq!(variation, 0.0);
    } else if middle > 1e-10 * high {
        prop_assert!((length - 1.0).abs() < 1e-12);
        prop_assert!((variation - (low / (low + middle + high)).max(0.0)).abs() < 1e-9);
        // a normal is as certain as the gap between its eigenvalue and the next is large
        let certain = (middle - low) / high;
        prop_assert!(sine_between(normal, expected) <= 1e-12 / certain.max(1e-13));
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(150))]

    #[test]
    fn a_radius_gives_what_brute_force_gives(
        points in any_cloud(120), radius in prop_oneof![Just(0.125), Just(0.5), Just(1.0), 0.1f64..3.0],
    ) {
        let found = estimate_normals(&points, Neighbors::Within(radius), ORIGIN).unwrap();
        for (i, &center) in points.iter().enumerate() {
            agree(found.normals[i], found.variation[i], &within(&points, center, radius))?;
        }
    }

    #[test]
    fn the_nearest_points_give_what_brute_force_gives(points in any_cloud(120), k in 3usize..20) {
        prop_assume!(points.len() >= k);
        let found = estimate_normals(&points, Neighbors::Nearest(k), ORIGIN).unwrap();
        for (i, &center) in points.iter().enumerate() {
            if let Some(neighbors) = nearest(&points, center, k) {
                agree(found.normals[i], found.variation[i], &neighbors)?;
            }
        }
    }

    #[test]
    fn the_nearest_points_in_general_position_give_what_brute_force_gives(
        points in free_cloud(20, 120), k in 3usize..20,
    ) {
        let found = estimate_normals(&points, Neighbors::Nearest(k), ORIGIN).unwrap();
        for (i, &center) in points.iter().enumerate() {
            agree(found.normals[i], found.variation[i], &nearest(&points, center, k).unwrap())?;
        }
    }

    #[test]
    fn normals_are_of_unit_length_or_zero_and_face_the_camera(
        points in any_cloud(150), viewpoint in prop::array::uniform3(-9.0f64..9.0), k in 3usize..12,
    ) {
        prop_assume!(points.len() >= k);
        let each = vec![viewpoint; points.len()];
        for neighbors in [Neighbors::Within(0.8), Neighbors::Nearest(k)] {
            let found = estimate_normals(&points, neighbors, Viewpoints::One(viewpoint)).unwrap();
            prop_assert_eq!(&estimate_normals(&points, neighbors, Viewpoints::Each(&each)).unwrap(), &found);
            for ((&n, &variation), &p) in found.normals.iter().zip(&found.variation).zip(&points) {
                let n = Vector3::from(n);
                prop_assert!(n == Vector3::zeros() || (n.norm() - 1.0).abs() < 1e-12);
                prop_assert!(n.dot(&(Vector3::from(viewpoint) - Vector3::from(p))) >= 0.0);
                prop_assert!((0.0..=1.0 / 3.0 + 1e-12).contains(&variation));
            }
        }
    }

    #[test]
    fn order_does_not_matter_and_rigid_motions_turn_the_normals(
        points in free_cloud(20, 80), motion in any_motion(),
        viewpoint in prop::array::uniform3(-9.0f64..9.0), seed: u64,
    ) {
        let camera = Viewpoints::One(viewpoint);
        for neighbors in [Neighbors::Nearest(9), Neighbors::Within(0.6)] {
            let found = estimate_normals(&points, neighbors, camera).unwrap();
            let order = order(seed, points.len());
            let other = estimate_normals(&reordered(&points, &order), neighbors, camera).unwrap();
            let moved_camera = Viewpoints::One(motion.apply(viewpoint));
            let turned = estimate_normals(&moved(&points, &motion), neighbors, moved_camera).unwrap();
            let mut compared = 0;
            for (row, &i) in order.iter().enumerate() {
                let local = match neighbors {
                    Neighbors::Nearest(k) => nearest(&points, points[i], k).unwrap(),
                    Neighbors::Within(radius) => within(&points, points[i], radius),
                };
                let ([low, middle, high], _) = principal(&local);
                let towards = Vector3::from(viewpoint) - Vector3::from(points[i]);
                let facing = Vector3::from(found.normals[i]).dot(&towards.normalize());
                if local.len() < 3 || middle < 1e-6 * high || middle - low < 1e-3 * high || facing < 1e-6 {
                    continue;
                }
                prop_assert!(distance(other.normals[row], found.normals[i]) < 1e-10);
                prop_assert!((other.variation[row] - found.variation[i]).abs() < 1e-12);
                let expected = motion.rotation * Vector3::from(found.normals[i]);
                prop_assert!(distance(turned.normals[i], expected.into()) < 1e-10);
                prop_assert!((turned.variation[i] - found.variation[i]).abs() < 1e-12);
                compared += 1;
            }
            // a small cloud may not have three points within the radius
            prop_assert!(compared > 0 || neighbors == Neighbors::Within(0.6) && points.len() < 40);
        }
    }
}

#[test]
fn units_do_not_matter() {
    let (points, _) = hills(300, 5);
    let viewpoint = [0.3, 0.2, 9.0];
    let expected = estimate_normals(&points, Neighbors::Nearest(10), Viewpoints::One(viewpoint)).unwrap();
    for unit in [1e-70, 1e-20, 1e-3, 1e3, 1e20, 1e98] {
        for neighbors in [Neighbors::Nearest(10), Neighbors::Within(0.2 * unit)] {
            let camera = Viewpoints::One(viewpoint.map(|x| x * unit));
            let found = estimate_normals(&scaled(&points, unit), neighbors, camera).unwrap();
            let same = match neighbors {
                Neighbors::Nearest(_) => expected.clone(),
                Neighbors::Within(_) => {
                    estimate_normals(&points, Neighbors::Within(0.2), Viewpoints::One(viewpoint)).unwrap()
                }
            };
            for (got, want) in found.normals.iter().zip(&same.normals) {
                assert!(distance(*got, *want) < 1e-9, "unit {unit:e}: {got:?} for {want:?}");
            }
        }
    }
}

#[test]
fn a_tilted_plane_has_its_normal_everywhere_also_far_away() {
    let normal = Vector3::new(0.2, -0.3, 0.9).normalize();
    let (u, v) =
        (Vector3::new(0.9, 0.0, -0.2).normalize(), normal.cross(&Vector3::new(0.9, 0.0, -0.2).normalize()));
    let mut random = Random(3);
    let plane: Vec<Point> = (0..500)
        .map(|_| {
            let [a, b, _] = random.point();
            (u * a + v * b).into()
        })
        .collect();
    for (origin, tolerance) in [([0.0; 3], 1e-12), (FAR_AWAY, 1e-8)] {
        let camera: Point = (Vector3::from(origin) - 4.0 * normal).into();
        let points = shifted(&plane, origin);
        for neighbors in [Neighbors::Nearest(12), Neighbors::Within(0.3)] {
            let found = estimate_normals(&points, neighbors, Viewpoints::One(camera)).unwrap();
            for (n, variation) in found.normals.iter().zip(&found.variation) {
                assert!(distance(*n, (-normal).into()) < tolerance, "{n:?}");
                assert!(*variation < tolerance);
            }
        }
    }
}

#[test]
fn a_sphere_has_radial_normals() {
    let count = 4000;
    let sphere: Vec<Point> = (0..count)
        .map(|i| {
            // golden angle, from pole to pole
            let z = 1.0 - (2 * i + 1) as f64 / count as f64;
            let angle = i as f64 * TAU * 0.618_033_988_749_895;
            let ring = (1.0 - z * z).sqrt();
            [ring * angle.cos(), ring * angle.sin(), z]
        })
        .collect();
    let outside = scaled(&sphere, 3.0);
    for neighbors in [Neighbors::Nearest(20), Neighbors::Within(0.12)] {
        let found = estimate_normals(&sphere, neighbors, Viewpoints::Each(&outside)).unwrap();
        for (n, p) in found.normals.iter().zip(&sphere) {
            assert!(distance(*n, *p) < 1f64.to_radians(), "{n:?} at {p:?}");
        }
        // points inside see the opposite side
        let inside = estimate_normals(&sphere, neighbors, ORIGIN).unwrap();
        assert!(inside.normals.iter().zip(&found.normals).all(|(a, b)| a.map(|x| -x) == *b));
    }
}

#[test]
fn a_tube_has_normals_across_its_axis() {
    let (points, normals) = tube(6000, 12.0, 11);
    let outside: Vec<Point> = points.iter().map(|p| [p[0], 5.0 * p[1], 5.0 * p[2]]).collect();
    for neighbors in [Neighbors::Nearest(30), Neighbors::Within(0.4)] {
        let found = estimate_normals(&points, neighbors, Viewpoints::Each(&outside)).unwrap();
        let mut angles: Vec<f64> =
            found.normals.iter().zip(&normals).map(|(a, b)| distance(*a, *b).to_degrees()).collect();
        angles.sort_by(f64::total_cmp);
        let (median, largest) = (angles[angles.len() / 2], angles[angles.len() - 1]);
        assert!(median < 1.5 && largest < 12.0, "median {median}, largest {largest} degrees");
        assert!(found.variation.iter().all(|&v| v < 0.05));
    }
}

#[test]
fn lines_and_single_places_have_no_normal() {
    let mut random = Random(7);
    for origin in [[0.0; 3], FAR_AWAY] {
        for _ in 0..50 {
            let direction = Vector3::from(random.point());
            let line: Vec<Point> =
                (0..40).map(|i| (Vector3::from(origin) + direction * (0.1 * f64::from(i))).into()).collect();
            let one = vec![random.point(); 40];
            let two = [vec![random.point(); 20], vec![random.point(); 20]].concat();
            for points in [&line, &one, &two] {
                for neighbors in [Neighbors::Nearest(3), Neighbors::Nearest(25), Neighbors::Within(1.0)] {
                    let found = estimate_normals(points, neighbors, ORIGIN).unwrap();
                    assert!(found.normals.iter().all(|n| *n == [0.0; 3]), "{neighbors:?} {found:?}");
                    assert!(found.variation.iter().all(|&v| v == 0.0));
                }
            }
        }
    }
}

#[test]
fn fewer_than_three_points_within_the_radius_have_no_normal() {
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [9.0, 0.0, 0.0], [9.0, 0.5, 0.0]];
    let found = estimate_normals(&points, Neighbors::Within(1.1), Viewpoints::One([0.0, 0.0, 1.0])).unwrap();
    assert_eq!(found.normals[0], [0.0, 0.0, 1.0]);
    assert_eq!(found.normals[1..], [[0.0; 3]; 4]);
}

#[test]
fn no_points_give_no_normals() {
    for neighbors in [Neighbors::Nearest(3), Neighbors::Within(1.0)] {
        let found = estimate_normals(&[], neighbors, Viewpoints::Each(&[])).unwrap();
        assert!(found.normals.is_empty() && found.variation.is_empty());
    }
}

#[test]
fn many_coincident_points_among_others_are_no_trouble() {
    let mut points = vec![[0.5, 0.5, 0.0]; 300];
    points.extend((0..100).map(|i| [f64::from(i % 10) * 0.1, f64::from(i / 10) * 0.1, 0.0]));
    let up = Viewpoints::One([0.0, 0.0, 1.0]);
    let found = estimate_normals(&points, Neighbors::Within(0.15), up).unwrap();
    assert!(found.normals.iter().all(|n| distance(*n, [0.0, 0.0, 1.0]) < 1e-12));
    let found = estimate_normals(&points, Neighbors::Nearest(5), up).unwrap();
    assert!(found.normals[..300].iter().all(|n| *n == [0.0; 3]), "all five in one place");
    assert!(found.normals[300..].iter().filter(|n| distance(**n, [0.0, 0.0, 1.0]) < 1e-12).count() > 90);
}

/// Returns the name of the refused argument.
fn refused(points: &[Point], neighbors: Neighbors, viewpoints: Viewpoints) -> &'static str {
    match estimate_normals(points, neighbors, viewpoints) {
        Err(Error::InvalidArgument { name, .. }) => name,
        other => panic!("{other:?}"),
    }
}

#[test]
fn wrong_arguments_are_named() {
    let points: Vec<Point> = (0..5).map(|i| [f64::from(i), f64::from(i * i), 0.0]).collect();
    let within = Neighbors::Within(1.0);
    for bad in [f64::NAN, f64::NEG_INFINITY, 1e100] {
        let spoilt = [[0.0; 3], [bad, 0.0, 0.0]];
        assert_eq!(refused(&spoilt, within, ORIGIN), "points");
        assert_eq!(refused(&points[..2], within, Viewpoints::One([0.0, bad, 0.0])), "viewpoint");
        assert_eq!(refused(&points[..2], within, Viewpoints::Each(&spoilt)), "viewpoint");
    }
    assert_eq!(refused(&points, within, Viewpoints::Each(&points[..4])), "viewpoint");
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e100] {
        assert_eq!(refused(&points, Neighbors::Within(bad), ORIGIN), "radius");
    }
    for k in 0..3 {
        assert_eq!(refused(&points, Neighbors::Nearest(k), ORIGIN), "k");
    }
    for k in [6, usize::MAX] {
        let error = estimate_normals(&points, Neighbors::Nearest(k), ORIGIN).unwrap_err();
        assert!(matches!(error, Error::NotEnoughData { name: "points", .. }), "{error}");
    }
}
