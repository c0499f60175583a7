//! Hierarchies against brute force.

use std::sync::Mutex;

use super::crowded::{Crowded, Sum};
use super::remaining::Remaining;
use super::*;
use proptest::prelude::*;

/// Makes many points in few places, on a lattice, in a dense spot, anywhere and far out.
fn cloud() -> impl Strategy<Value = Vec<Point>> {
    let lattice = prop::array::uniform3(-2i32..2).prop_map(|p| p.map(|x| f64::from(x) * 0.5));
    let spot = prop::array::uniform3(-2.0f64..2.0).prop_map(|p| p.map(|x| 0.25 + 1e-9 * x));
    let free = prop::array::uniform3(-2.0f64..2.0);
    let far = prop::array::uniform3(-2.0f64..2.0).prop_map(|p| [p[0] * 1e12, p[1], p[2]]);
    let point = prop_oneof![8 => lattice, 4 => Just([0.25; 3]), 4 => spot, 4 => free, 1 => far];
    prop::collection::vec(point, 0..200)
}

fn any_limit() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), Just(0.25), Just(1.0), Just(1e-18), 0.01f64..9.0, Just(1e30)]
}

impl Sum for (usize, u64) {
    fn and(self, other: Self) -> Self {
        (self.0 + other.0, self.1 + other.1)
    }
}

proptest! {
    #[test]
    fn a_hierarchy_finds_what_brute_force_finds(points in cloud(), limit in any_limit()) {
        let hierarchy = Hierarchy::new(points.iter().copied());
        for &center in points.iter().chain(&[[0.3, 0.1, -0.2]]) {
            let expected: Vec<usize> =
                (0..points.len()).filter(|&j| squared_distance(points[j], center) <= limit).collect();
            let runs = hierarchy.runs_near(center, limit);
            prop_assert!(runs.windows(2).all(|pair| pair[0].end < pair[1].start));
            let mut found: Vec<usize> = runs.into_iter().flatten().map(|i| hierarchy.order[i] as usize).collect();
            found.retain(|&j| squared_distance(points[j], center) <= limit);
            found.sort_unstable();
            prop_assert_eq!(&found, &expected);
        }
    }

    #[test]
    fn sums_are_those_of_brute_force(points in cloud(), limit in any_limit(), open: u64) {
        let crowded = Crowded::default();
        let is_open = |i: usize| open & (1 << (i % 64)) != 0;
        crowded.add((0..points.len()).filter(|&i| is_open(i)));
        let found = Mutex::new(vec![None; points.len()]);
        crowded.answer(
            &points,
            limit.sqrt(),
            |i| (1, i as u64),
            |sum| sum,
            |i, &sum| assert!(found.lock().unwrap()[i].replace(sum).is_none()),
        );
        let limit = limit.sqrt() * limit.sqrt();
        for (i, found) in found.into_inner().unwrap().into_iter().enumerate() {
            let near = |&j: &usize| squared_distance(points[j], points[i]) <= limit;
            let near: Vec<u64> = (0..points.len()).filter(near).map(|j| j as u64).collect();
            prop_assert_eq!(found, is_open(i).then_some((near.len(), near.iter().sum())));
        }
    }

    #[test]
    fn what_remains_is_what_was_not_taken(points in cloud(), limits in prop::collection::vec(any_limit(), 1..6)) {
        let hierarchy = Hierarchy::new(points.iter().copied());
        let mut remaining = Remaining::new(&hierarchy);
        let mut left: Vec<usize> = (0..points.len()).collect();
        for (n, limit) in limits.into_iter().enumerate() {
            let center = points.get(7 * n).copied().unwrap_or([0.1, 0.0, 0.0]);
            let squared = |i: usize| squared_distance(points[i], center);
            let nearer = |&a: &usize, &b: &usize| squared(a).total_cmp(&squared(b)).then(a.cmp(&b));
            let of_all = (0..points.len()).filter(|&i| squared(i) <= 4.0 * limit).min_by(nearer);
            prop_assert_eq!(hierarchy.nearest(center, 4.0 * limit), of_all);
            let mut taken = Vec::new();
            remaining.take(center, limit, |i| taken.push(i));
            taken.sort_unstable();
            let expected: Vec<usize> = left.iter().copied().filter(|&i| squared(i) <= limit).collect();
            prop_assert_eq!(taken, expected);
            left.retain(|&i| squared(i) > limit);
            let within = left.iter().copied().filter(|&i| squared(i) <= 4.0 * limit);
            prop_assert_eq!(remaining.nearest(center, 4.0 * limit), within.min_by(nearer));
        }
    }
}
