//! A k-d tree that finds nearest points at any scale.

use std::cmp::Ordering;
use std::num::NonZeroUsize;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::geometry::Point;

/// A k-d tree over the distinct places of finite points. Any number of points may share a place.
///
/// Among points at the same distance, the choice depends on the points alone, not on the number of threads.
pub struct Tree {
    /// None without points.
    places: Option<ImmutableKdTree<f64, 3>>,
    /// Indices of the points, grouped by place.
    order: Vec<u32>,
    /// Where the group of each place begins, and the number of points at the end.
    starts: Vec<u32>,
}

impl Tree {
    /// Builds the tree of at most 2³² points.
    pub fn new(points: &[Point]) -> Self {
        let mut order: Vec<u32> = (0..points.len()).map(|i| i as u32).collect();
        let compare = |a: Point, b: Point| (0..3).fold(Ordering::Equal, |o, k| o.then(a[k].total_cmp(&b[k])));
        order.sort_unstable_by(|&i, &j| compare(points[i as usize], points[j as usize]).then(i.cmp(&j)));
        let (mut starts, mut places): (Vec<u32>, Vec<Point>) = (Vec::new(), Vec::new());
        for (position, &i) in order.iter().enumerate() {
            let place = points[i as usize];
            if places.last() != Some(&place) {
                starts.push(position as u32);
                places.push(place);
            }
        }
        starts.push(order.len() as u32);
        let places = (!places.is_empty())
            .then(|| ImmutableKdTree::new_from_slice(&places).expect("no more than 2³² places"));
        Self { places, order, starts }
    }

    /// Returns the indices of the `count` nearest points to a place, nearest first; fewer if there are not as many
    /// whose squared distance is at most `limit`.
    pub fn nearest(&self, center: Point, count: NonZeroUsize, limit: f64) -> impl Iterator<Item = usize> {
        let found = self.places.as_ref().map(|places| {
            let found =
                places.query(&center).nearest_n::<SquaredEuclidean<f64>>(count).within(limit).execute();
            found.into_iter().flat_map(|found| self.at(found.item))
        });
        found.into_iter().flatten().take(count.get())
    }

    /// Returns the indices of the points at a place.
    fn at(&self, place: impl Into<u64>) -> impl Iterator<Item = usize> {
        let place = place.into() as usize;
        let range = self.starts[place] as usize..self.starts[place + 1] as usize;
        self.order[range].iter().map(|&i| i as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::squared_distance;
    use proptest::prelude::*;

    /// Clouds as depth cameras make them: lattices, planes, lines, duplicates, and a far outlier.
    fn cloud() -> impl Strategy<Value = Vec<Point>> {
        let lattice = prop::array::uniform3(-4i32..4).prop_map(|p| p.map(|x| f64::from(x) * 0.5));
        let free = prop::array::uniform3(-2.0f64..2.0);
        let plane = prop::array::uniform3(-2.0f64..2.0).prop_map(|p| [p[0], p[1], 0.5]);
        let line = (-2.0f64..2.0).prop_map(|x| [x, 0.25, 0.5]);
        let far = prop::array::uniform3(-2.0f64..2.0).prop_map(|p| [p[0] * 1e7, p[1], p[2]]);
        prop::collection::vec(prop_oneof![8 => lattice, 4 => free, 4 => plane, 4 => line, 1 => far], 1..300)
    }

    proptest! {
        #[test]
        fn a_tree_finds_what_brute_force_finds(
            points in cloud(), center in prop::array::uniform3(-3.0f64..3.0), on_lattice: bool, count in 1usize..40,
        ) {
            let center = if on_lattice { center.map(f64::round) } else { center };
            let tree = Tree::new(&points);
            let mut expected: Vec<f64> = points.iter().map(|&p| squared_distance(p, center)).collect();
            expected.sort_by(f64::total_cmp);
            let found: Vec<usize> = tree.nearest(center, NonZeroUsize::new(count).unwrap(), f64::INFINITY).collect();
            let squares: Vec<f64> = found.iter().map(|&i| squared_distance(points[i], center)).collect();
            prop_assert_eq!(&squares[..], &expected[..count.min(points.len())]);
            // a limit that the last of them meets changes nothing
            let last = squares[squares.len() - 1];
            let limited: Vec<usize> = tree.nearest(center, NonZeroUsize::new(count).unwrap(), last).collect();
            prop_assert_eq!(limited.len(), found.len());
            let limited: Vec<f64> = limited.iter().map(|&i| squared_distance(points[i], center)).collect();
            prop_assert_eq!(&limited, &squares);
            // no point twice
            let distinct: std::collections::BTreeSet<usize> = found.iter().copied().collect();
            prop_assert_eq!(distinct.len(), found.len());
            let nearest = expected[0];
            let one = |limit: f64| tree.nearest(center, NonZeroUsize::MIN, limit).next();
            prop_assert_eq!(one(nearest).map(|i| squared_distance(points[i], center)), Some(nearest));
            prop_assert!(nearest == 0.0 || one(nearest.next_down()).is_none());
        }
    }

    #[test]
    fn a_tree_of_many_points_finds_the_nearest() {
        // low-discrepancy points on a wavy surface
        let at = |i: u32, step: f64| 4.0 * (f64::from(i) * step).fract();
        let points: Vec<Point> = (0..20_000)
            .map(|i| (at(i, 0.754_877_666), at(i, 0.569_840_291)))
            .map(|(x, y)| [x, y, 0.3 * (2.0 * x).sin() * y.cos()])
            .collect();
        let tree = Tree::new(&points);
        for i in 0..200 {
            let center = [at(i, 0.438_579_021), at(i, 0.324_718_957), at(i, 0.177_6) - 2.0];
            let mut expected: Vec<f64> = points.iter().map(|&p| squared_distance(p, center)).collect();
            expected.sort_by(f64::total_cmp);
            let found = tree.nearest(center, NonZeroUsize::new(30).unwrap(), f64::INFINITY);
            let squares: Vec<f64> = found.map(|i| squared_distance(points[i], center)).collect();
            assert_eq!(squares, expected[..30]);
        }
    }

    #[test]
    fn many_coincident_points_are_no_trouble() {
        let points = vec![[0.25, -1.0, 3.0]; 5000];
        let tree = Tree::new(&points);
        assert_eq!(tree.nearest([0.0; 3], NonZeroUsize::new(7).unwrap(), f64::INFINITY).count(), 7);
        assert_eq!(tree.nearest(points[0], NonZeroUsize::MIN, 0.0).count(), 1);
        let empty = Tree::new(&[]);
        assert_eq!(empty.nearest([0.0; 3], NonZeroUsize::MIN, f64::INFINITY).count(), 0);
    }
}
