//! Distances to the nearest of other points.

use rayon::prelude::*;

use crate::checks::check_finite;
use crate::error::Result;
use crate::geometry::{Point, squared_distance};
use crate::index::hierarchy::Hierarchy;
use crate::parallel;
use crate::simd::{BATCH, kernel};

const POINTS_PER_TASK: usize = 1024; // points that one task works on
const FEW: usize = 16; // points: for so few, an index of the others costs more than it saves
/// The same where only distances are asked for: many are compared at once.
const MANY: usize = 256;

/// Returns the number of the nearest of `others` to each point, the first among equals; None if there are none.
pub(crate) fn nearest(points: &[Point], others: &[Point]) -> Result<Vec<Option<usize>>> {
    check_finite("points", points)?;
    check_finite("others", others)?;
    if points.len() <= FEW {
        return Ok(points.iter().map(|&p| find_nearest(p, others)).collect());
    }
    Ok(parallel::run(|| {
        let boxes = Hierarchy::new(others.iter().copied());
        let nearest = |&p: &Point| boxes.nearest(p, f64::INFINITY);
        points.par_iter().with_min_len(POINTS_PER_TASK).map(nearest).collect()
    }))
}

/// Returns the number of the nearest of `others` to a point by comparing all, the first among equals.
fn find_nearest(point: Point, others: &[Point]) -> Option<usize> {
    let mut found = (f64::INFINITY, None);
    for (number, &other) in others.iter().enumerate() {
        let distance = squared_distance(point, other);
        if distance < found.0 || found.1.is_none() {
            found = (distance, Some(number));
        }
    }
    found.1
}

/// Returns the squared distance of each point to the nearest of `others`, m²; infinity if there are none.
pub(crate) fn squared_distances(points: &[Point], others: &[Point]) -> Result<Vec<f64>> {
    if points.len() <= MANY {
        check_finite("points", points)?;
        check_finite("others", others)?;
        return Ok(compare_all(points, others));
    }
    let measure =
        |(p, i): (&Point, Option<usize>)| i.map_or(f64::INFINITY, |i| squared_distance(*p, others[i]));
    Ok(points.iter().zip(nearest(points, others)?).map(measure).collect())
}

kernel! {
    /// Returns the least squared distance of each point from `others` by comparing all.
    fn compare_all<S>(_, points: &[Point], others: &[Point]) -> Vec<f64> {
        let mut least = vec![f64::INFINITY; points.len()];
        for (least, points) in least.chunks_mut(BATCH).zip(points.chunks(BATCH)) {
            let mut batch = [[0.0; BATCH]; 3];
            for (l, p) in points.iter().enumerate() {
                for k in 0..3 {
                    batch[k][l] = p[k];
                }
            }
            let mut nearest = [f64::INFINITY; BATCH];
            for other in others {
                for l in 0..BATCH {
                    let d = [batch[0][l] - other[0], batch[1][l] - other[1], batch[2][l] - other[2]];
                    let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                    nearest[l] = if square < nearest[l] { square } else { nearest[l] };
                }
            }
            least.copy_from_slice(&nearest[..points.len()]);
        }
        least
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_counts() {
        let others: Vec<Point> = (0..100).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let points = [[3.4, 1.0, 0.0], [-2.0, 0.0, 0.0], [50.5, 0.0, 0.0]];
        let expected = [3.4f64 - 3.0, 2.0, 0.5].map(|x| x * x);
        assert_eq!(
            squared_distances(&points, &others).unwrap(),
            [expected[0] + 1.0, expected[1], expected[2]]
        );
        // the first among equals
        let twice = [[3.0, 0.0, 0.0], [4.0, 0.0, 0.0], [3.0, 0.0, 0.0]];
        assert_eq!(
            nearest(&[[3.4, 1.0, 0.0], [3.5, 0.0, 0.0], [9.0, 0.0, 0.0]], &twice).unwrap(),
            [Some(0), Some(0), Some(1)]
        );
        assert_eq!(nearest(&points[..1], &[]).unwrap(), [None]);
        // with an index as without
        let many: Vec<Point> = (0..3 * FEW).map(|i| [0.9 * i as f64, (i * i % 7) as f64, 0.0]).collect();
        let each: Vec<_> = many.iter().map(|&p| find_nearest(p, &others)).collect();
        assert_eq!(nearest(&many, &others).unwrap(), each);
        assert_eq!(squared_distances(&points[..1], &[]).unwrap(), [f64::INFINITY]);
        assert!(squared_distances(&[[f64::NAN; 3]], &others).is_err());
        assert!(squared_distances(&points, &[[f64::NAN; 3]]).is_err());
    }
}
