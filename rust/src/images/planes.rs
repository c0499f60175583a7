//! Planes that many points lie on.

use crate::geometry::Point;
use crate::simd::kernel;

/// Returns the number of the plane that most points are nearer to than a width, the first of equal ones; None without
/// planes.
pub fn find_fullest(normals: &[Point], offsets: &[f64], points: &[Point], width: f64) -> Option<usize> {
    let along = [0, 1, 2].map(|axis| points.iter().map(|point| point[axis]).collect::<Vec<f64>>());
    let mut best = None;
    for (number, (&normal, &offset)) in normals.iter().zip(offsets).enumerate() {
        let count = count_near(normal, offset, &along, width);
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, number));
        }
    }
    best.map(|(_, number)| number)
}

kernel! {
    /// Counts the points, given by axis, that are nearer to a plane than a width.
    fn count_near<S>(_, normal: Point, offset: f64, along: &[Vec<f64>; 3], width: f64) -> u64 {
        let [x, y, z] = along;
        x.iter()
            .zip(y)
            .zip(z)
            .map(|((x, y), z)| {
                let away = (normal[0] * x + normal[1] * y + normal[2] * z - offset).abs();
                u64::from(away < width)
            })
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_the_fullest_planes_is_found() {
        let points: Vec<Point> = (0..50).map(|i| [f64::from(i), f64::from(i * i % 7), 0.0]).collect();
        let normals = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]];
        assert_eq!(find_fullest(&normals, &[3.0, 0.0, 0.0, 1.0], &points, 0.1), Some(1));
        assert_eq!(find_fullest(&normals, &[3.0, 9.0, 9.0, 1.0], &points, 0.1), Some(3));
        assert_eq!(find_fullest(&[], &[], &points, 0.1), None);
    }
}
