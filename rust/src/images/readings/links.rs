//! Curves through zones: from port to port, fitted to the mask's edge.

use super::lookup::Lookup;
use super::network::{Network, Port, Skeleton};
use super::planar::{Place, apart, bending, hermite, length, resampled, smoothed, unit};
use crate::geometry::banded::{Bordered, PLANAR};
use crate::images::silhouette::{Edge, Silhouette};

/// Nodes of a curve are this far apart, radii.
pub const STEP: f64 = 0.5;
/// Nodes of a segment that a curve through its zone is fitted together with.
pub const TAIL: usize = 8;
/// Weights of bending and of its change in the fit.
pub const FIT_BENDING: [f64; 2] = [3.0, 10.0];
/// The edge's lateral deviation, radii, and the share of edge that is independent.
pub const EDGE_SD: f64 = 0.25;
pub const EDGE_SHARE: f64 = 0.5;
/// Edges that want the axis farther than this from a curve at first are not its own, radii.
const FARTHEST: f64 = 3.0;
/// Nodes on each side of the last nearest one that are asked.
const NEAR: usize = 3;
/// What bending, its change, and tube outside the mask cost.
pub const BENDING: f64 = 3.0;
pub const CHANGE: f64 = 5.0;
const OUTSIDE: f64 = 1.5;
const KINK: f64 = 5.0;
/// A curve that turns more than this between nodes has a kink, radians.
const SHARPEST: f64 = 1.0;
/// What an end inside a zone costs, and a stub that is nothing.
const FREE_END: f64 = 5.0;
const DROPPED: f64 = 1.5;
/// A fit is given up after so many steps if its curve then costs this many times what two ends and all the mask that it
/// can cover do: for an end, and for each radius of the curve.
const TRIAL: usize = 3;
const HOPELESS: f64 = 2.0;
const BARE: f64 = 2.0;
/// A curve that costs less than this is not tried from another start.
const GOOD: f64 = 0.5;
/// Longer curves through a zone are not tried, radii.
const LONGEST: f64 = 100.0;

/// A curve from a port on: to another, or to a rope's end inside the zone.
#[derive(Debug, Clone)]
pub struct Link {
    /// With the tails of the segments that it joins.
    pub full: Vec<Place>,
    /// Between the ports.
    pub middle: Vec<Place>,
    /// How many nodes of `full` are the first segment's tail, and the second's.
    pub tails: [usize; 2],
    pub cost: f64,
    /// The segment is a stub that is left out.
    pub dropped: bool,
}

/// Where a mask's edges want the axis of a rope: a radius inside.
pub struct Votes {
    places: Vec<Place>,
    lookup: Lookup,
}

impl Votes {
    pub fn new(silhouette: &Silhouette) -> Self {
        let radius_px = silhouette.radius_px;
        let vote = |e: &Edge| [e.at[0] - radius_px * e.normal[0], e.at[1] - radius_px * e.normal[1]];
        let places: Vec<Place> = silhouette.boundary.iter().map(vote).collect();
        let lookup = Lookup::new(&places, radius_px);
        Self { places, lookup }
    }

    /// Those near a polyline: their numbers, ascending, and the node that is nearest to each.
    fn near(&self, p: &[Place], within: f64) -> Vec<(usize, usize)> {
        let mut nearest = vec![(within * within, usize::MAX); self.places.len()];
        for (i, node) in p.iter().enumerate() {
            self.lookup.visit(*node, within, |k| {
                let vote = self.places[k];
                let square = (vote[0] - node[0]).powi(2) + (vote[1] - node[1]).powi(2);
                if square < nearest[k].0 {
                    nearest[k] = (square, i);
                }
            });
        }
        nearest.iter().enumerate().filter(|(_, n)| n.1 != usize::MAX).map(|(k, n)| (k, n.1)).collect()
    }
}

/// Moves a polyline so that the mask's edge is a radius away, its tube is in the mask and it bends little.
///
/// `anchors`: how much each node is held, in units of 1/radius². None if the curve would be no part of a good reading.
pub fn fitted(silhouette: &Silhouette, votes: &Votes, p: &[Place], anchors: &[f64]) -> Option<Vec<Place>> {
    let radius_px = silhouette.radius_px;
    let n = p.len();
    let h = length(p) / (n - 1) as f64 / radius_px;
    let smooth = smoothness(n, h, FIT_BENDING);
    let mut x = p.to_vec();
    let mut edges: Vec<(Place, Edge, usize)> = votes
        .near(p, FARTHEST * radius_px)
        .into_iter()
        .map(|(k, nearest)| (votes.places[k], silhouette.boundary[k], nearest))
        .collect();
    for iteration in 0..8 {
        let most_cost = HOPELESS * (2.0 * FREE_END + BARE * h * (n - 1) as f64);
        if iteration == TRIAL && curve_cost(silhouette, &x) > most_cost {
            return None;
        }
        let reach = if iteration < 4 { 1.3 } else { 0.8 };
        let mut matrix = Bordered::<PLANAR>::zeros(2 * n, 0);
        let mut right = vec![0.0; 2 * n];
        for i in 0..n {
            for (k, &weight) in smooth[i].iter().enumerate() {
                let Some(j) = i.checked_sub(k) else { continue };
                for c in 0..2 {
                    matrix.add_band(2 * i + c, 2 * j + c, weight);
                    right[2 * i + c] -= weight * x[j][c] / radius_px;
                    if j != i {
                        right[2 * j + c] -= weight * x[i][c] / radius_px;
                    }
                }
            }
            for c in 0..2 {
                matrix.add_band(2 * i + c, 2 * i + c, anchors[i] + 1e-3);
                right[2 * i + c] -= anchors[i] * (x[i][c] - p[i][c]) / radius_px;
            }
        }
        let mut add = |i: usize, along: Place, residual: f64, weight: f64| {
            matrix.add_band(2 * i, 2 * i, weight * along[0] * along[0]);
            matrix.add_band(2 * i + 1, 2 * i + 1, weight * along[1] * along[1]);
            matrix.add_band(2 * i + 1, 2 * i, weight * along[0] * along[1]);
            for c in 0..2 {
                right[2 * i + c] -= weight * along[c] * residual;
            }
        };
        let tangents: Vec<Place> = (0..n)
            .map(|i| {
                let (a, b) = (x[i.saturating_sub(1)], x[(i + 1).min(n - 1)]);
                unit([b[0] - a[0], b[1] - a[1]])
            })
            .collect();
        for (vote, edge, last) in &mut edges {
            // nodes move little: the nearest one is near the last nearest one
            let range = last.saturating_sub(NEAR)..(*last + NEAR + 1).min(n);
            let mut least = f64::INFINITY;
            let mut k = 0;
            for i in range {
                let d = (vote[0] - x[i][0]).powi(2) + (vote[1] - x[i][1]).powi(2);
                if d < least {
                    (least, k) = (d, i);
                }
            }
            *last = k;
            if k == 0 || k == n - 1 || least > (1.5 * reach * radius_px).powi(2) {
                continue;
            }
            let normal = edge.normal;
            let residual = ((vote[0] - x[k][0]) * normal[0] + (vote[1] - x[k][1]) * normal[1]) / radius_px;
            let along = (tangents[k][0] * normal[0] + tangents[k][1] * normal[1]).abs();
            if residual.abs() >= reach || along >= 0.45 {
                continue;
            }
            let weight = (1.0 - (residual / reach).powi(2)).powi(2) * EDGE_SHARE * edge.weight
                / radius_px
                / (EDGE_SD * EDGE_SD);
            add(k, [-normal[0], -normal[1]], residual, weight);
        }
        for (i, &node) in x.iter().enumerate() {
            let missing = 0.9 - silhouette.distance(node) / radius_px;
            if missing > 0.0 && !silhouette.hidden(node) {
                let g = silhouette.gradient(node);
                add(i, [-g[0], -g[1]], missing, 4.0 * h);
            }
        }
        let Some(factor) = matrix.factor() else { break };
        let (step, _) = factor.solve(&right, &[]);
        let most = step.iter().fold(0.0f64, |m, s| m.max(s.abs()));
        let scale = (0.7 / most.max(1e-9)).min(1.0) * radius_px;
        for i in 0..n {
            for c in 0..2 {
                x[i][c] += scale * step[2 * i + c];
            }
        }
        if most.min(0.7) < 0.02 {
            break;
        }
    }
    Some(x)
}

/// Lower rows of the matrix of bending and its change: for each node itself and the three before it.
pub fn smoothness(n: usize, h: f64, weights: [f64; 2]) -> Vec<[f64; 4]> {
    let mut rows = vec![[0.0; 4]; n];
    let mut add = |taps: &[f64], weight: f64| {
        for start in 0..(n + 1).saturating_sub(taps.len()) {
            for (i, a) in taps.iter().enumerate() {
                for (j, b) in taps.iter().enumerate().take(i + 1) {
                    rows[start + i][i - j] += weight * a * b;
                }
            }
        }
    };
    add(&[1.0, -2.0, 1.0], weights[0] / h.powi(3));
    add(&[-1.0, 3.0, -3.0, 1.0], weights[1] / h.powi(5));
    rows
}

/// The nodes of a segment before a port, the port last.
pub fn tail(network: &Network, port: Port) -> Vec<Place> {
    let points = &network.segments[port.segment].points;
    let n = points.len().min(TAIL);
    if port.end == 1 {
        points[points.len() - n..].to_vec()
    } else {
        points[..n].iter().rev().copied().collect()
    }
}

/// The direction in which a tail ends.
fn direction(tail: &[Place], nodes: usize) -> Place {
    let (a, b) = (tail[tail.len().saturating_sub(nodes)], tail[tail.len() - 1]);
    if tail.len() < 2 { [0.0; 2] } else { unit([b[0] - a[0], b[1] - a[1]]) }
}

/// The best curve through a zone between two ports.
pub fn link(
    silhouette: &Silhouette,
    votes: &Votes,
    skeleton: &Skeleton,
    network: &Network,
    ports: [Port; 2],
) -> Option<Link> {
    let radius_px = silhouette.radius_px;
    let [ta, tb] = ports.map(|p| tail(network, p));
    let (a, b) = (ta[ta.len() - 1], tb[tb.len() - 1]);
    let (da, db) = (direction(&ta, 5), direction(&tb, 5));
    let zone = &network.zones[ports[0].zone as usize - 1];
    let mut starts = Vec::new();
    if let Some(way) = skeleton.way(zone, a, b)
        && way.len() > 2
    {
        starts.push(smoothed(&way, (3.0 * radius_px * silhouette.scale as f64) as usize));
    }
    starts.push(hermite(a, da, b, [-db[0], -db[1]]));
    let mut best: Option<Link> = None;
    for start in starts {
        if length(&start) > LONGEST * radius_px || best.as_ref().is_some_and(|b| b.cost < GOOD) {
            continue;
        }
        let mut full: Vec<Place> = ta[..ta.len() - 1].to_vec();
        if apart(start[0], a) >= radius_px {
            full.push(a);
        }
        full.extend(&start);
        full.extend(tb[..tb.len() - 1].iter().rev());
        let full = resampled(&full, STEP * radius_px);
        let n = full.len();
        if n < 5 {
            continue;
        }
        let (na, nb, total) = (length(&ta), length(&tb), length(&full));
        let at = |i: usize| total * i as f64 / (n - 1) as f64;
        let anchors: Vec<f64> = (0..n)
            .map(|i| if at(i) < na - radius_px || at(i) > total - nb + radius_px { 1.0 } else { 0.0 })
            .collect();
        let Some(full) = fitted(silhouette, votes, &full, &anchors) else { continue };
        let cost = curve_cost(silhouette, &full);
        if best.as_ref().is_none_or(|b| cost < b.cost) {
            let first = (0..n).find(|&i| at(i) >= na).unwrap_or(n);
            let last = (0..n).find(|&i| at(i) >= total - nb).unwrap_or(n);
            let middle = full[first.saturating_sub(1)..(last + 1).max(first + 1).min(n)].to_vec();
            best = Some(Link { full, middle, tails: [first, n - last], cost, dropped: false });
        }
    }
    best
}

/// What a curve costs: bending, its change, tube outside the mask, kinks.
pub fn curve_cost(silhouette: &Silhouette, p: &[Place]) -> f64 {
    let radius_px = silhouette.radius_px;
    let (bent, change) = bending(p, radius_px);
    let bare = |x: Place| {
        if silhouette.hidden(x) { 0.0 } else { (0.8 - silhouette.distance(x) / radius_px).max(0.0) }
    };
    let outside: f64 = p.iter().map(|&x| bare(x)).sum::<f64>() * STEP;
    let sharp = p.windows(3).any(|w| {
        let (d, e) = ([w[1][0] - w[0][0], w[1][1] - w[0][1]], [w[2][0] - w[1][0], w[2][1] - w[1][1]]);
        (d[0] * e[1] - d[1] * e[0]).atan2(d[0] * e[0] + d[1] * e[1]).abs() > SHARPEST
    });
    BENDING * bent + CHANGE * change + OUTSIDE * outside + if sharp { KINK } else { 0.0 }
}

/// A rope's end inside a zone: straight on from a port as far as the mask reaches; a stub may be nothing.
pub fn free_end(silhouette: &Silhouette, network: &Network, port: Port) -> Link {
    let radius_px = silhouette.radius_px;
    if network.stubs[port.segment] {
        let full = network.segments[port.segment].points.clone();
        let middle = vec![full[0]];
        return Link { full, middle, tails: [0, 0], cost: DROPPED, dropped: true };
    }
    let tail = tail(network, port);
    let d = direction(&tail, 6);
    let mut middle = vec![tail[tail.len() - 1]];
    for _ in 0..24 {
        let x = middle[middle.len() - 1];
        let next = [x[0] + d[0] * STEP * radius_px, x[1] + d[1] * STEP * radius_px];
        if silhouette.distance(next) < 0.35 * radius_px {
            break;
        }
        middle.push(next);
    }
    let tails = [tail.len(), 0];
    let full = tail.iter().chain(&middle[1..]).copied().collect();
    Link { full, middle, tails, cost: FREE_END, dropped: false }
}
