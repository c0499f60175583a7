//! Planes that many points lie on.

use crate::geometry::median::{MEDIAN_TO_SD, median};
use crate::geometry::{Point, cross, dot, eigen_symmetric, sub};
use crate::simd::kernel;

/// How a plane is sought.
#[derive(Debug, Clone, Copy)]
pub struct PlaneSearch {
    /// Points this near a plane lie on it at first.
    pub width: f64,
    /// The area of the parallelogram of three points, and the sine of its angle: with less, they fix no plane.
    pub least: [f64; 2],
    /// The share of the points that lie on the plane before it is fitted.
    pub share: f64,
    /// Fits by least squares.
    pub rounds: usize,
    /// The number of points that lie on the plane after each.
    pub fewest: usize,
    /// Standard deviations of the points about the plane, and a least width: points this near lie on it after a fit. None:
    /// the width stays.
    pub adaptive: Option<[f64; 2]>,
}

/// A plane normal·x = offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundPlane {
    pub normal: Point,
    pub offset: f64,
    /// The share of the points that lie on it.
    pub share: f64,
}

/// Finds the plane through three corners that most of some points lie on, the first of equal ones, and fits it to all points
/// on it; None if too few points lie on it.
pub fn find_plane(
    points: &[Point],
    compared: &[Point],
    corners: &[[Point; 3]],
    search: &PlaneSearch,
) -> Option<FoundPlane> {
    let mut width = search.width;
    let (mut normal, mut offset) = select_plane(compared, corners, search)?;
    let mut near = select_near(points, normal, offset, width);
    if near.len() < 3 || (near.len() as f64) < search.share * points.len() as f64 {
        return None;
    }
    for _ in 0..search.rounds {
        let sum = near.iter().fold([0.0; 3], |sum, p| [0, 1, 2].map(|k| sum[k] + p[k]));
        let middle = sum.map(|sum| sum / near.len() as f64);
        let mut products = [0.0; 6];
        for [x, y, z] in near.iter().map(|&p| sub(p, middle)) {
            for (sum, product) in products.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
                *sum += product;
            }
        }
        normal = eigen_symmetric(&products).vectors[0];
        offset = dot(normal, middle);
        if let Some([deviations, least]) = search.adaptive {
            let sizes = near.iter().map(|&p| dot(sub(p, middle), normal).abs()).collect();
            width = (deviations * MEDIAN_TO_SD * median(sizes)?).max(least);
        }
        near = select_near(points, normal, offset, width);
        if near.len() < search.fewest {
            return None;
        }
    }
    Some(FoundPlane { normal, offset, share: near.len() as f64 / points.len() as f64 })
}

/// Returns the plane through three corners that most points lie on.
fn select_plane(points: &[Point], corners: &[[Point; 3]], search: &PlaneSearch) -> Option<(Point, f64)> {
    let along = [0, 1, 2].map(|axis| points.iter().map(|point| point[axis]).collect::<Vec<f64>>());
    let [min_area, min_sine] = search.least;
    let mut best = None;
    for &[first, second, third] in corners {
        let edges = [sub(second, first), sub(third, first)];
        let normal = cross(edges[0], edges[1]);
        let area = dot(normal, normal).sqrt();
        let [one, other] = edges.map(|edge| dot(edge, edge).sqrt());
        if !(area > min_area && area > min_sine * one * other) {
            continue;
        }
        let normal = normal.map(|x| x / area);
        let offset = dot(normal, first);
        let count = count_near(normal, offset, &along, search.width);
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, (normal, offset)));
        }
    }
    best.map(|(_, plane)| plane)
}

fn select_near(points: &[Point], normal: Point, offset: f64, width: f64) -> Vec<Point> {
    points.iter().copied().filter(|&p| (dot(normal, p) - offset).abs() < width).collect()
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

    const SEARCH: PlaneSearch =
        PlaneSearch { width: 0.1, least: [1e-9, 0.0], share: 0.3, rounds: 2, fewest: 3, adaptive: None };

    #[test]
    fn the_fullest_plane_is_found_and_fitted() {
        // a slope, and points above it
        let mut points: Vec<Point> =
            (0..60).map(|i| [f64::from(i), f64::from(i * i % 7), 0.5 * f64::from(i)]).collect();
        points.extend((0..30).map(|i| [f64::from(i), f64::from(i % 5), 90.0]));
        points[3][2] += 0.04;
        let corners = [[points[70], points[71], points[75]], [points[1], points[9], points[20]]];
        let found = find_plane(&points, &points, &corners, &SEARCH).unwrap();
        assert!((found.share - 60.0 / 90.0).abs() < 1e-12);
        let slope = [0.5, 0.0, -1.0].map(|x: f64| x / 1.25f64.sqrt());
        assert!((dot(found.normal, slope).abs() - 1.0).abs() < 1e-5 && found.offset.abs() < 0.02);
        let wide = PlaneSearch { adaptive: Some([3.0, 1e3]), ..SEARCH };
        assert_eq!(find_plane(&points, &points, &corners, &wide).unwrap().share, 1.0);
    }

    #[test]
    fn few_points_and_corners_on_a_line_fix_no_plane() {
        let points: Vec<Point> = (0..50).map(|i| [f64::from(i), f64::from(i * i % 7), 0.0]).collect();
        let line = [[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]];
        assert_eq!(find_plane(&points, &points, &line, &SEARCH), None);
        assert_eq!(find_plane(&points, &points, &[], &SEARCH), None);
        let corners = [[points[0], points[1], points[2]]];
        assert!(find_plane(&points, &points, &corners, &SEARCH).is_some());
        let many = PlaneSearch { fewest: 51, ..SEARCH };
        assert_eq!(find_plane(&points, &points, &corners, &many), None);
        let high = [[[0.0, 0.0, 9.0], [1.0, 0.0, 9.0], [0.0, 1.0, 9.0]]];
        assert_eq!(find_plane(&points, &points, &high, &SEARCH), None);
    }
}
