//! Curves through zones, from port to port, fitted to the mask's edge.

use super::lookup::{Block, Lookup};
use super::network::{Network, Port};
use super::planar::{Place, bending, distance, hermite, length, resampled, smoothed, unit};
use super::stiffness::Stiffness;
use crate::geometry::cut_off;
use crate::images::silhouette::{Edge, Silhouette};
use crate::images::surroundings::Shown;
use crate::simd::{LANES, find_least, kernel};

pub const STEP: f64 = 0.5; // distance between the nodes of a curve, image radii
pub const TAIL: usize = 8; // nodes of a segment that are fitted together with a curve through its zone
pub const FIT_BENDING: [f64; 2] = [3.0, 10.0]; // weights of bending and of its change in the fit
const DAMPING: f64 = 1e-3; // limits steps of nodes that nothing else holds
pub const EDGE_SD: f64 = 0.25; // lateral standard deviation of the edge, image radii
pub const EDGE_SHARE: f64 = 0.5; // share of edge places that are independent
const MAX_VOTE: f64 = 3.0; // largest distance of an edge's vote from the first curve, image radii
const NEAR: usize = 3; // nodes on each side of the last nearest one in which the nearest one is sought
pub const BENDING: f64 = 3.0; // cost of bending, for each r ∫ κ² ds
pub const CHANGE: f64 = 5.0; // cost of changes of bending, for each r³ ∫ κ'² ds
const OUTSIDE: f64 = 1.5; // cost of tube outside the mask
const WITHIN: f64 = 0.8; // distance of an axis from the mask's edge, inside, image radii: its tube is in the mask
const MAX_OUTSIDE: f64 = 1.8; // image radii that the tube leaves the mask: farther away are gaps
const KINK: f64 = 5.0; // cost of a kink
const MAX_TURN: f64 = 1.0; // a larger turn between nodes is a kink, radians
const FREE_END: f64 = 5.0; // cost of an end inside a zone
const DROPPED: f64 = 1.5; // cost of a stub that is dropped
const TRIAL: usize = 3; // steps of a fit after which hopeless curves are given up
/// A curve is hopeless if it costs this many times as much as two ends and the mask that it can cover.
const HOPELESS: f64 = 2.0;
const BARE: f64 = 2.0; // cost of uncovered mask, for each radius of the curve
const ALIKE: f64 = 0.25; // distance from another curve below which a fit ends as that curve, image radii
const GOOD: f64 = 0.5; // a curve that costs less needs no other start
const MAX_LENGTH: f64 = 100.0; // length of a curve through a zone at most, image radii

/// A curve from a port to another, or to a rope's end inside the zone.
#[derive(Debug, Clone)]
pub struct Link {
    /// Nodes with the tails of the segments that it joins.
    pub full: Vec<Place>,
    /// Nodes between the ports.
    pub middle: Vec<Place>,
    /// Numbers of nodes of `full` that are the first and the second segment's tail.
    pub tails: [usize; 2],
    pub cost: f64,
    /// Whether the segment is a stub that is dropped.
    pub dropped: bool,
}

/// Two ports of a zone, and the skeleton's way between them.
#[derive(Debug, Clone)]
pub struct Passage {
    tails: [Vec<Place>; 2],
    /// Empty if the skeleton does not lead from one to the other.
    way: Vec<Place>,
}

impl Passage {
    pub fn new(tails: [Vec<Place>; 2], way: Option<Vec<Place>>) -> Self {
        Self { tails, way: way.unwrap_or_default() }
    }

    /// Returns the bits of its numbers, which equal passages share.
    pub fn bits(&self) -> Vec<u64> {
        let parts = [&self.tails[0], &self.tails[1], &self.way];
        let lengths = parts.map(|part| part.len() as u64);
        let numbers = parts.into_iter().flatten().flatten().map(|number| number.to_bits());
        lengths.into_iter().chain(numbers).collect()
    }
}

/// Votes of a mask's edges for the axis: places a radius inside.
pub struct Votes {
    pub places: Vec<Place>,
    pub lookup: Lookup,
    /// The edges' normals, sorted as the places in it.
    pub normals: Vec<Block>,
}

impl Votes {
    pub fn new(silhouette: &Silhouette) -> Self {
        let radius_px = silhouette.radius_px;
        let vote = |e: &Edge| [e.at[0] - radius_px * e.normal[0], e.at[1] - radius_px * e.normal[1]];
        let places: Vec<Place> = silhouette.boundary.iter().map(vote).collect();
        let lookup = Lookup::new(&places, radius_px);
        let normals = lookup.sort(|k| silhouette.boundary[k].normal);
        Self { places, lookup, normals }
    }
}

/// Fits a polyline to the mask: the edge is a radius away, the tube is inside, and bending is small.
///
/// `anchors` holds each node with a weight in 1/radius². None if the curve cannot belong to a good reading, or comes
/// near the `known` curve from another start.
pub fn fit(
    silhouette: &Silhouette,
    votes: &Votes,
    p: &[Place],
    anchors: &[f64],
    known: &[Place],
) -> Option<Vec<Place>> {
    let radius_px = silhouette.radius_px;
    let n = p.len();
    let h = length(p) / (n - 1) as f64 / radius_px;
    let stiffness = Stiffness::new(h, FIT_BENDING, anchors.to_vec(), DAMPING);
    let mut x = p.to_vec();
    let near = votes.lookup.near(p, MAX_VOTE * radius_px);
    let edges: Vec<(Place, &Edge)> =
        near.iter().map(|&(k, _)| (votes.places[k], &silhouette.boundary[k])).collect();
    let mut nearest: Vec<(Place, usize, f64)> =
        near.iter().map(|&(k, nearest)| (votes.places[k], nearest, 0.0)).collect();
    // with nodes at infinity before and after
    let mut padded = [0, 1].map(|_| vec![f64::INFINITY; n + NEAR + LANES]);
    for iteration in 0..8 {
        let most_cost = HOPELESS * (2.0 * FREE_END + BARE * h * (n - 1) as f64);
        if iteration == TRIAL && price_curve(silhouette, &x) > most_cost {
            return None;
        }
        if is_alike(&x, known, ALIKE * radius_px) {
            return None;
        }
        let reach = if iteration < 4 { 1.3 } else { 0.8 };
        let mut equations = stiffness.equations(&x, p, radius_px);
        let tangents: Vec<Place> = (0..n)
            .map(|i| {
                let (a, b) = (x[i.saturating_sub(1)], x[(i + 1).min(n - 1)]);
                unit([b[0] - a[0], b[1] - a[1]])
            })
            .collect();
        for (padded, c) in padded.iter_mut().zip(0..) {
            for (to, node) in padded[NEAR..].iter_mut().zip(&x) {
                *to = node[c];
            }
        }
        move_to_nearest(&mut nearest, &padded);
        for ((vote, edge), &(_, k, least)) in edges.iter().zip(&nearest) {
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
            equations.add(k, [-normal[0], -normal[1]], residual, weight);
        }
        for (i, &node) in x.iter().enumerate() {
            let missing = 0.9 - silhouette.distance(node) / radius_px;
            if missing > 0.0 && !silhouette.hidden(node) {
                let g = silhouette.gradient(node);
                equations.add(i, [-g[0], -g[1]], missing, 4.0 * h);
            }
        }
        let Some((step, most)) = equations.solve() else { break };
        let scale = (0.7 / most.max(1e-9)).min(1.0) * radius_px;
        for (node, step) in x.iter_mut().zip(step) {
            for c in 0..2 {
                node[c] += scale * step[c];
            }
        }
        if most.min(0.7) < 0.02 {
            break;
        }
    }
    Some(x)
}

kernel! {
    /// Moves from the last nearest node of each place to the nearest of those within `NEAR` of it; sets its squared
    /// distance. Nodes move little, so the nearest one is there. `padded` has their coordinates after `NEAR` others.
    fn move_to_nearest<S>(_, places: &mut [(Place, usize, f64)], padded: &[Vec<f64>; 2]) {
        for (place, number, square) in places {
            let (x, y) = (&padded[0][*number..][..LANES], &padded[1][*number..][..LANES]);
            let mut squares = [f64::INFINITY; LANES];
            for l in 0..LANES {
                squares[l] = (place[0] - x[l]).powi(2) + (place[1] - y[l]).powi(2);
            }
            squares[2 * NEAR + 1..].fill(f64::INFINITY);
            let (lane, least) = find_least(&squares);
            (*number, *square) = (*number + lane.min(2 * NEAR) - NEAR, least);
        }
    }
}

/// Returns whether two polylines run through the same places, at equal shares of their nodes.
fn is_alike(p: &[Place], q: &[Place], within: f64) -> bool {
    if q.len() < 2 {
        return false;
    }
    let scale = (q.len() - 1) as f64 / (p.len() - 1) as f64;
    p.iter().enumerate().all(|(i, &x)| {
        let at = i as f64 * scale;
        let k = (cut_off(at) as usize).min(q.len() - 2);
        let t = at - k as f64;
        distance(x, [0, 1].map(|c| q[k][c] + t * (q[k + 1][c] - q[k][c]))) <= within
    })
}

/// Returns the nodes of a segment before a port, the port last.
pub fn take_tail(network: &Network, port: Port) -> Vec<Place> {
    let points = &network.segments[port.segment].points;
    let n = points.len().min(TAIL);
    if port.end == 1 {
        points[points.len() - n..].to_vec()
    } else {
        points[..n].iter().rev().copied().collect()
    }
}

/// Returns the direction at the end of a tail.
fn find_direction(tail: &[Place], nodes: usize) -> Place {
    let (a, b) = (tail[tail.len().saturating_sub(nodes)], tail[tail.len() - 1]);
    if tail.len() < 2 { [0.0; 2] } else { unit([b[0] - a[0], b[1] - a[1]]) }
}

/// Finds the best curve through a passage.
pub fn make_link(silhouette: &Silhouette, votes: &Votes, passage: &Passage) -> Option<Link> {
    let radius_px = silhouette.radius_px;
    let [ta, tb] = &passage.tails;
    let (a, b) = (ta[ta.len() - 1], tb[tb.len() - 1]);
    let (da, db) = (find_direction(ta, 5), find_direction(tb, 5));
    let mut starts = Vec::new();
    if passage.way.len() > 2 {
        // as wide as 3 r s passes over the s pixels of a magnified mask to each of the image
        let passes = 3.0 * radius_px / silhouette.strokes.scale as f64;
        starts.push(smoothed(&resampled(&passage.way, 1.0), passes.ceil() as usize));
    }
    starts.push(hermite(a, da, b, [-db[0], -db[1]]));
    let mut best: Option<Link> = None;
    for start in starts {
        if length(&start) > MAX_LENGTH * radius_px || best.as_ref().is_some_and(|b| b.cost < GOOD) {
            continue;
        }
        let mut full: Vec<Place> = ta[..ta.len() - 1].to_vec();
        if distance(start[0], a) >= radius_px {
            full.push(a);
        }
        full.extend(&start);
        full.extend(tb[..tb.len() - 1].iter().rev());
        let full = resampled(&full, STEP * radius_px);
        let n = full.len();
        if n < 5 {
            continue;
        }
        let (na, nb, total) = (length(ta), length(tb), length(&full));
        let at = |i: usize| total * i as f64 / (n - 1) as f64;
        let anchors: Vec<f64> = (0..n)
            .map(|i| if at(i) < na - radius_px || at(i) > total - nb + radius_px { 1.0 } else { 0.0 })
            .collect();
        let known = best.as_ref().map_or(&[][..], |link| &link.full);
        let Some(full) = fit(silhouette, votes, &full, &anchors, known) else { continue };
        let cost = price_curve(silhouette, &full);
        if best.as_ref().is_none_or(|b| cost < b.cost) {
            let first = (0..n).find(|&i| at(i) >= na).unwrap_or(n);
            let last = (0..n).find(|&i| at(i) >= total - nb).unwrap_or(n);
            let middle = full[first.saturating_sub(1)..(last + 1).max(first + 1).min(n)].to_vec();
            best = Some(Link { full, middle, tails: [first, n - last], cost, dropped: false });
        }
    }
    best
}

/// Prices a curve: bending, its change, tube outside the mask, kinks.
pub fn price_curve(silhouette: &Silhouette, p: &[Place]) -> f64 {
    price_ways_out(silhouette, p, |out, _| out)
}

/// Prices a rope's whole course: as a curve, but farther from the mask only where the camera saw through.
///
/// The rest of a gap is priced where pieces are joined.
pub fn price_course(silhouette: &Silhouette, p: &[Place]) -> f64 {
    price_ways_out(silhouette, p, |out, x| {
        let gap = out > MAX_OUTSIDE && !matches!(silhouette.shown(x), Shown::Behind);
        if gap { 0.0 } else { out.min(MAX_OUTSIDE) }
    })
}

/// Prices bends, kinks, and at each place that nothing hides, how far the tube leaves the mask, image radii.
fn price_ways_out(silhouette: &Silhouette, p: &[Place], weigh: impl Fn(f64, Place) -> f64) -> f64 {
    let bare = |x: Place| {
        if silhouette.hidden(x) {
            return 0.0;
        }
        weigh((WITHIN - silhouette.distance(x) / silhouette.radius_px).max(0.0), x)
    };
    let outside: f64 = p.iter().map(|&x| bare(x)).sum::<f64>() * STEP;
    let (bent, change) = bending(p, silhouette.radius_px);
    let sharp = p.windows(3).any(|w| {
        let (d, e) = ([w[1][0] - w[0][0], w[1][1] - w[0][1]], [w[2][0] - w[1][0], w[2][1] - w[1][1]]);
        (d[0] * e[1] - d[1] * e[0]).atan2(d[0] * e[0] + d[1] * e[1]).abs() > MAX_TURN
    });
    BENDING * bent + CHANGE * change + OUTSIDE * outside + if sharp { KINK } else { 0.0 }
}

/// Makes a rope's end inside a zone: straight from a port as far as the mask reaches. A stub may be dropped.
pub fn make_free_end(silhouette: &Silhouette, network: &Network, port: Port) -> Link {
    let radius_px = silhouette.radius_px;
    if network.stubs[port.segment] {
        let full = network.segments[port.segment].points.clone();
        let middle = vec![full[0]];
        return Link { full, middle, tails: [0, 0], cost: DROPPED, dropped: true };
    }
    let tail = take_tail(network, port);
    let d = find_direction(&tail, 6);
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
