//! The pixels that support each node.

use super::camera::RopeView;
use super::grid::Grid;
use super::places::Place2;
use crate::geometry::{Point, cross};

const REACH: f64 = 1.5; // pixels farther than this from every node support none, image radii

/// Counts for each node the pixels nearest to it. Where ropes lie over each other, a pixel counts for the one in front.
pub fn count_support(
    view: &RopeView,
    correction: &[f64; 6],
    pixels: &[Place2],
    chains: &[Vec<Point>],
    radius: f64,
) -> Vec<Vec<i64>> {
    let [a, b, c, d, e, f] = *correction;
    let radius_px = view.silhouette.radius_px;
    let mut counts: Vec<Vec<i64>> = chains.iter().map(|n| vec![0; n.len()]).collect();
    let (origin, size) = view.silhouette.frame();
    let side = REACH * radius_px;
    let is_near = |p: Place2| {
        (0..2).all(|k| p[k] >= origin[k] - side && p[k] < origin[k] + size[k] as f64 + 2.0 * side)
    };
    let mut places: Vec<Place2> = Vec::new();
    let mut nodes: Vec<(usize, usize, f64)> = Vec::new();
    for (chain, points) in chains.iter().enumerate() {
        for (i, &x) in points.iter().enumerate() {
            let y = view.seen(x);
            let turned = cross([a, b, c], y);
            let y = [y[0] + turned[0] + d, y[1] + turned[1] + e, y[2] + turned[2] + f];
            let at = view.projected(y);
            if y[2] > 0.0 && is_near(at) {
                places.push(at);
                nodes.push((chain, i, y[2]));
            }
        }
    }
    let mut grid = Grid::default();
    grid.fill(&places, (origin, size), side);
    for &pixel in pixels.iter().filter(|&&pixel| is_near(pixel)) {
        let mut best: Option<(f64, usize)> = None;
        for &(n, at) in grid.around(pixel, side).flatten() {
            let square = (at[0] - pixel[0]).powi(2) + (at[1] - pixel[1]).powi(2);
            if square >= side * side {
                continue;
            }
            // a strand in front hides the one behind
            let (.., z) = nodes[n as usize];
            let rank = square.sqrt() / radius_px + 0.5 * z / radius;
            if best.is_none_or(|b| rank < b.0) {
                best = Some((rank, n as usize));
            }
        }
        if let Some((_, n)) = best {
            counts[nodes[n].0][nodes[n].1] += 1;
        }
    }
    counts
}
