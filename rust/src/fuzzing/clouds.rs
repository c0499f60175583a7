//! Kernels of point clouds: neighbours, normals, registration.

use super::bytes::{Bytes, require_finite};
use crate::clouds::apparent_radius::apparent_radii;
use crate::clouds::density::{occupied_voxels, typical_neighbors, variances_around};
use crate::clouds::proximity::squared_distances;
use crate::geometry::{Point, dot, squared_distance};
use crate::{
    IcpOptions, Neighbors, Objective, Viewpoints, centerline, count_neighbors, estimate_normals, icp,
    radius_outlier_mask, register_in_turn, trace_chains,
};

const SQUARES: f64 = 1e-140; // radii below this have squares that lose digits

pub fn count_around(mut bytes: Bytes<'_>) {
    let (radius, wanted, viewpoint) = (bytes.length(), bytes.below(8), bytes.point());
    let (points, others) = (bytes.points(80), bytes.points(20));
    let counts = count_neighbors(&points, radius);
    let kept = radius_outlier_mask(&points, radius, wanted);
    assert_eq!(counts.is_ok(), kept.is_ok());
    if let (Ok(counts), Ok(kept), true) = (counts, kept, radius > SQUARES) {
        for (i, &p) in points.iter().enumerate() {
            assert_eq!(kept[i], counts[i] >= wanted);
            let near = points.iter().filter(|&&q| squared_distance(q, p) <= radius * radius).count();
            assert_eq!(counts[i] + 1, near);
        }
    }
    if let Ok(count) = typical_neighbors(&points, radius) {
        assert!(count <= points.len());
    }
    if let Ok(count) = occupied_voxels(&[&points, &others], radius) {
        assert!(count <= points.len() + others.len());
    }
    if let Ok(squares) = squared_distances(&points, &others) {
        for (&square, &p) in squares.iter().zip(&points) {
            let least = others.iter().map(|&q| squared_distance(p, q)).fold(f64::INFINITY, f64::min);
            assert!(square == least || (square - least).abs() <= 1e-12 * least, "{square:e} {least:e}");
        }
    }
    if let Ok(variances) = variances_around(&points, &others, radius, wanted) {
        assert!(!variances.as_flattened().iter().any(|&x| x < 0.0));
    }
    if let Ok(strips) = apparent_radii(&points, viewpoint, radius, 9) {
        assert!(strips.iter().all(|strip| strip.radius <= radius && strip.footprint >= 0.0));
    }
}

pub fn estimate_surfaces(mut bytes: Bytes<'_>) {
    let (radius, near, wanted) = (bytes.length(), bytes.length(), bytes.below(24));
    let (viewpoint, within) = (bytes.point(), bytes.flag());
    let points = bytes.points(80);
    let neighbors = if within { Neighbors::Within(radius) } else { Neighbors::Nearest(wanted) };
    if let Ok(found) = estimate_normals(&points, neighbors, Viewpoints::One(viewpoint)) {
        for (&normal, &variation) in found.normals.iter().zip(&found.variation) {
            assert!(normal == [0.0; 3] || (dot(normal, normal) - 1.0).abs() < 1e-9, "{normal:?}");
            assert!((0.0..=0.334).contains(&variation), "{variation}");
        }
        if let Ok(axis) = centerline(&points, &found.normals, radius, wanted) {
            require_finite(&axis.points);
            assert!(axis.indices.is_sorted() && axis.indices.iter().all(|&i| i < points.len()));
        }
    }
    if let Ok(chains) = trace_chains(&points, near, radius, wanted.checked_sub(1)) {
        let nodes: Vec<usize> = chains.concat();
        let mut once = nodes.clone();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), nodes.len(), "a node twice");
        for pair in chains.iter().flat_map(|chain| chain.windows(2)) {
            let square = squared_distance(points[pair[0]], points[pair[1]]);
            assert!(near < SQUARES || (near * near < square && square <= radius * radius), "{square:e}");
        }
    }
}

pub fn register(mut bytes: Bytes<'_>) {
    let options = IcpOptions {
        max_correspondence_distance: bytes.length(),
        max_iterations: bytes.below(6),
        tolerance: bytes.number(),
        start: if bytes.flag() { bytes.motion() } else { IcpOptions::default().start },
    };
    if !options.start.translation.iter().all(|x| x.is_finite()) {
        return;
    }
    let (source, mut target) = (bytes.points(60), bytes.points(60));
    if bytes.flag() {
        let moved = bytes.ordinary_motion();
        target = source.iter().map(|&p| moved.apply(p)).collect();
    }
    let normals: Vec<Point> = target.iter().map(|_| bytes.unit()).collect();
    let check = |found: crate::IcpResult| {
        require_finite(&found.transformation.to_rows());
        let rotation = found.transformation.rotation;
        assert!((rotation * rotation.transpose() - nalgebra::Matrix3::identity()).amax() < 1e-6);
        assert!((0.0..=1.0).contains(&found.fitness) && found.iterations <= options.max_iterations);
        let most = options.max_correspondence_distance * (1.0 + 1e-9);
        assert!((0.0..=most).contains(&found.inlier_rmse), "{} {most}", found.inlier_rmse);
    };
    for objective in [Objective::PointToPoint, Objective::PointToPlane(&normals)] {
        if let Ok(found) = icp(&source, &target, objective, &options) {
            check(found);
        }
    }
    if let Ok(found) = register_in_turn(&[&source, &target, &source], &options) {
        found.into_iter().for_each(check);
    }
}
