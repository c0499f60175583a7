//! The outlier filter against brute force.

use crate::fixtures::{any_cloud, any_motion, cases, distance, free_cloud, moved, order, reordered, scaled};
use proptest::prelude::*;
use strand::{Error, Point, count_neighbors, radius_outlier_mask};

fn counted(points: &[Point], radius: f64) -> Vec<usize> {
    points.iter().map(|&p| points.iter().filter(|&&q| distance(p, q) <= radius).count() - 1).collect()
}

fn any_radius() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.125), Just(0.5), Just(1.0), Just(2.5), 0.01f64..3.0]
}

proptest! {
    #![proptest_config(cases(200))]

    #[test]
    fn counts_and_mask_are_those_of_brute_force(
        points in any_cloud(250), radius in any_radius(), wanted in 0usize..12,
    ) {
        let expected = counted(&points, radius);
        prop_assert_eq!(&count_neighbors(&points, radius).unwrap(), &expected);
        let kept: Vec<bool> = expected.iter().map(|&count| count >= wanted).collect();
        prop_assert_eq!(radius_outlier_mask(&points, radius, wanted).unwrap(), kept);
    }

    #[test]
    fn the_order_of_the_points_does_not_matter(points in any_cloud(150), radius in any_radius(), seed: u64) {
        let order = order(seed, points.len());
        prop_assert_eq!(
            count_neighbors(&reordered(&points, &order), radius).unwrap(),
            reordered(&count_neighbors(&points, radius).unwrap(), &order)
        );
    }

    #[test]
    fn rigid_motions_and_units_do_not_matter(
        points in free_cloud(1, 150), radius in 0.05f64..1.0, motion in any_motion(),
    ) {
        let margin = points
            .iter()
            .flat_map(|&p| points.iter().map(move |&q| (distance(p, q) - radius).abs()))
            .fold(f64::INFINITY, f64::min);
        prop_assume!(margin > 1e-12);
        let counts = count_neighbors(&points, radius).unwrap();
        prop_assert_eq!(&count_neighbors(&moved(&points, &motion), radius).unwrap(), &counts);
        for unit in [1e-80, 1e-3, 1e80] {
            prop_assert_eq!(&count_neighbors(&scaled(&points, unit), radius * unit).unwrap(), &counts);
        }
    }
}

#[test]
fn the_boundary_counts() {
    let points = [[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, 5.0]];
    assert_eq!(count_neighbors(&points, 5.0).unwrap(), [2, 1, 1]);
    assert_eq!(count_neighbors(&points, 5.0 * (1.0 - 1e-15)).unwrap(), [0, 0, 0]);
}

#[test]
fn no_points_give_no_answers_and_one_point_has_no_neighbours() {
    assert!(radius_outlier_mask(&[], 1.0, 3).unwrap().is_empty());
    assert!(count_neighbors(&[], 1.0).unwrap().is_empty());
    assert_eq!(count_neighbors(&[[1.0, 2.0, 3.0]], 1.0).unwrap(), [0]);
    assert_eq!(radius_outlier_mask(&[[1.0, 2.0, 3.0]], 1.0, 0).unwrap(), [true]);
    assert_eq!(radius_outlier_mask(&[[1.0, 2.0, 3.0]], 1.0, usize::MAX).unwrap(), [false]);
}

#[test]
fn coincident_points_count_each_other() {
    let points = vec![[0.3, -0.1, 7.0]; 500];
    assert!(count_neighbors(&points, 1e-9).unwrap().iter().all(|&count| count == 499));
    assert!(radius_outlier_mask(&points, 1e-9, 499).unwrap().iter().all(|&kept| kept));
}

#[test]
fn radii_far_from_the_scale_of_the_cloud_are_answered() {
    let points = [[0.0; 3], [0.0; 3], [0.25, 0.0, 0.0], [0.0, 0.5, 1.0]];
    assert_eq!(count_neighbors(&points, 1e99).unwrap(), [3, 3, 3, 3]);
    assert_eq!(count_neighbors(&points, 1e-300).unwrap(), [1, 1, 0, 0]);
    assert_eq!(count_neighbors(&points, f64::MIN_POSITIVE / 4.0).unwrap(), [1, 1, 0, 0]);
    // extents and radii whose reciprocals are infinite
    let tiny = [[0.0; 3], [1e-310, 0.0, 0.0], [0.0, 0.0, 2e-310]];
    for radius in [1e-310, 1e-308, 1e-300, 1.0] {
        assert_eq!(count_neighbors(&tiny, radius).unwrap(), [2, 2, 2]);
    }
}

#[test]
fn wrong_arguments_are_named() {
    for bad in [f64::NAN, f64::INFINITY, -1e100] {
        let error = radius_outlier_mask(&[[0.0; 3], [0.0, bad, 0.0]], 1.0, 1).unwrap_err();
        assert!(matches!(error, Error::InvalidArgument { name: "points", .. }));
        assert!(error.to_string().contains("row 1"), "{error}");
    }
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e100] {
        let points = [[0.0; 3]];
        assert!(matches!(
            radius_outlier_mask(&points, bad, 1),
            Err(Error::InvalidArgument { name: "radius", .. })
        ));
        assert!(matches!(count_neighbors(&points, bad), Err(Error::InvalidArgument { name: "radius", .. })));
    }
}
