//! The pixels that support each node.

use super::camera::RopeView;
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
    let cells = size.map(|n| (n as f64 / side) as usize + 3);
    let cell = |p: Place2| -> Option<usize> {
        let at: [f64; 2] = std::array::from_fn(|k| ((p[k] - origin[k]) / side).floor() + 1.0);
        let inside = (0..2).all(|k| at[k] >= 0.0 && at[k] < cells[k] as f64);
        inside.then(|| at[1] as usize * cells[0] + at[0] as usize)
    };
    let mut nodes: Vec<(usize, usize, Place2, f64)> = Vec::new();
    let mut lists: Vec<Vec<u32>> = vec![Vec::new(); cells[0] * cells[1]];
    for (chain, points) in chains.iter().enumerate() {
        for (i, &x) in points.iter().enumerate() {
            let y = view.seen(x);
            let turned = cross([a, b, c], y);
            let y = [y[0] + turned[0] + d, y[1] + turned[1] + e, y[2] + turned[2] + f];
            let at = view.projected(y);
            if let Some(k) = cell(at).filter(|_| y[2] > 0.0) {
                lists[k].push(nodes.len() as u32);
                nodes.push((chain, i, at, y[2]));
            }
        }
    }
    for &pixel in pixels {
        let Some(k) = cell(pixel) else { continue };
        let mut best: Option<(f64, usize)> = None;
        for row in -1i64..=1 {
            for column in -1i64..=1 {
                let other = k as i64 + row * cells[0] as i64 + column;
                let Some(list) = usize::try_from(other).ok().and_then(|k| lists.get(k)) else { continue };
                for &n in list {
                    let (_, _, at, z) = nodes[n as usize];
                    let square = (at[0] - pixel[0]).powi(2) + (at[1] - pixel[1]).powi(2);
                    if square >= side * side {
                        continue;
                    }
                    // a strand in front hides the one behind
                    let rank = square.sqrt() / radius_px + 0.5 * z / radius;
                    if best.is_none_or(|b| rank < b.0) {
                        best = Some((rank, n as usize));
                    }
                }
            }
        }
        if let Some((_, n)) = best {
            counts[nodes[n].0][nodes[n].1] += 1;
        }
    }
    counts
}
