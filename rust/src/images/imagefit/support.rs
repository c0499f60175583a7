//! The pixels that support each node.

use super::camera::RopeView;
use super::grid::Grid;
use super::outcome::ImageFit;
use super::places::Place2;
use super::prepared::Prepared;
use crate::geometry::{Point, cross};
use crate::parallel;

const REACH: f64 = 1.5; // pixels farther than this from every node support none, image radii
const PIXELS_PER_TASK: usize = 2048;
const SLACK: f64 = 1e-6; // pixels by which a search reaches farther than a better node, against rounding

/// Counts for each rope's nodes the pixels with depth nearest to them, and the views of these.
///
/// Where ropes lie over each other, a pixel counts for the one in front.
pub fn count_support(views: &[Prepared], fit: &ImageFit, radius: f64) -> Vec<(Vec<i64>, Vec<i64>)> {
    let mut support: Vec<(Vec<i64>, Vec<i64>)> =
        fit.nodes.iter().map(|n| (vec![0; n.len()], vec![0; n.len()])).collect();
    let seen: Vec<(&Prepared, &[f64; 6])> = views.iter().zip(&fit.corrections).collect();
    let found = parallel::map(&seen, |(view, correction)| {
        count_in_view(&view.rope_view(), correction, &view.covered, &fit.nodes, radius)
    });
    for counts in found {
        for ((counts, views), own) in support.iter_mut().zip(counts) {
            for ((count, views), own) in counts.iter_mut().zip(views).zip(own) {
                *count += own;
                *views += i64::from(own > 0);
            }
        }
    }
    support
}

/// Counts for each node the pixels of one view nearest to it.
fn count_in_view(
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
    // chain, number in it, and the part of its rank that its depth makes: a strand in front hides the one behind
    let mut nodes: Vec<(usize, usize, f64)> = Vec::new();
    for (chain, points) in chains.iter().enumerate() {
        for (i, &x) in points.iter().enumerate() {
            let y = view.seen(x);
            let turned = cross([a, b, c], y);
            let y = [y[0] + turned[0] + d, y[1] + turned[1] + e, y[2] + turned[2] + f];
            let at = view.projected(y);
            if y[2] > 0.0 && is_near(at) {
                places.push(at);
                nodes.push((chain, i, 0.5 * y[2] / radius));
            }
        }
    }
    let mut grid = Grid::default();
    grid.fill(&places, (origin, size), side);
    let find_nearest = |&pixel: &Place2| {
        let mut best: Option<(f64, usize)> = None;
        for &(n, at) in grid.around(pixel, side).flatten() {
            let square = (at[0] - pixel[0]).powi(2) + (at[1] - pixel[1]).powi(2);
            // most nodes are too far to be better, which their squares tell
            let hidden = nodes[n as usize].2;
            let reach = best.map_or(side, |b| side.min((b.0 - hidden) * radius_px + SLACK));
            if square >= reach * reach || reach <= 0.0 {
                continue;
            }
            let rank = square.sqrt() / radius_px + hidden;
            if best.is_none_or(|b| rank < b.0) {
                best = Some((rank, n as usize));
            }
        }
        best.map(|(_, n)| n)
    };
    let parts: Vec<&[Place2]> = pixels.chunks(PIXELS_PER_TASK).collect();
    let found: Vec<Vec<usize>> = parallel::map(&parts, |pixels| {
        pixels.iter().filter(|&&pixel| is_near(pixel)).filter_map(find_nearest).collect()
    });
    for n in found.into_iter().flatten() {
        let (chain, i, _) = nodes[n];
        counts[chain][i] += 1;
    }
    counts
}
