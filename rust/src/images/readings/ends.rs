//! Ends of ropes in the image: the last place with mask that no other strand explains.

use super::planar::{Place, distance, resampled, unit};
use crate::images::silhouette::Silhouette;
use crate::images::surroundings::Shown;

const STEP: f64 = 0.25; // distance between nodes, image radii
/// Share of a cross-section that is mask without another strand, at least, where the rope continues.
const MIN_SHARE: f64 = 0.35;
const REACH: f64 = 7.0; // range beyond the skeleton's end in which the rope's end is sought, image radii
const UNDER: f64 = 0.75; // depth of a hidden end under another strand, image radii
/// Cost of the turn of an extended end, for each squared radian and for each radius of its length.
const EXTENSION_TURN: f64 = 3.0;
const EXTENSION_LENGTH: f64 = 0.1; // cost of an extended end, for each radius of its length
const EXTENSION_GAIN: f64 = 1.5; // gain of an extended end, for each squared radius of uncovered mask that it reaches
const MAX_EXTENSION: f64 = 16.0; // length of an extension at most, image radii
/// Cost of an extended end outside the mask where depth may show a rope, for each radius.
const EXTENSION_BARE: f64 = 0.5;
/// Curvatures that are tried beside the rope's last one, 1 / image radii.
const BENDS: [f64; 6] = [0.1, -0.1, 0.2, -0.2, 0.3, -0.3];
const OWN_NODES: usize = 24; // the last nodes of a chain that do not count as another strand

/// Extends chains to the end of the mask, with nodes half a radius apart.
///
/// The last radius of a skeleton turns to a corner of the rope's end and is removed. From there the chain continues
/// straight or with its last bend, whichever explains more of the mask.
pub fn extend(silhouette: &Silhouette, chains: &[Vec<Place>]) -> Vec<Vec<Place>> {
    let radius_px = silhouette.radius_px;
    let dense: Vec<Vec<Place>> = chains.iter().map(|c| resampled(c, STEP * radius_px)).collect();
    (0..dense.len())
        .map(|number| {
            let mut chain = dense[number].clone();
            for _ in 0..2 {
                chain.reverse();
                let own = if chain.len() > 40 { chain.len() - OWN_NODES } else { 0 };
                let others = || {
                    let of_others =
                        dense.iter().enumerate().filter(|&(k, _)| k != number).flat_map(|(_, c)| c);
                    chain[..own].iter().chain(of_others)
                };
                if let Some(longer) = extend_end(silhouette, &chain, others) {
                    chain = longer;
                }
            }
            resampled(&chain, 0.5 * radius_px)
        })
        .collect()
}

/// Extends a chain's last end to the end of the mask; None if no place near it shows the rope.
fn extend_end<'a, I: Iterator<Item = &'a Place>>(
    silhouette: &Silhouette,
    chain: &[Place],
    others: impl Fn() -> I,
) -> Option<Vec<Place>> {
    let radius_px = silhouette.radius_px;
    let cut = if chain.len() > 30 { 4 } else { 1 };
    let base = &chain[..chain.len() - cut];
    if base.len() < 2 {
        return None;
    }
    let last = base[base.len() - 1];
    let near: Vec<Place> =
        others().filter(|x| distance(**x, last) < (REACH + 10.0) * radius_px).copied().collect();
    let back = base[base.len() - 1 - 12.min(base.len() - 1)];
    let heading = unit([last[0] - back[0], last[1] - back[1]]);
    let recent = &base[base.len() - 24.min(base.len())..];
    let (curvature, span) = measure_curvature(recent);
    let mut best: Option<(f64, Vec<Place>)> = None;
    let first = base.len().saturating_sub(32).max(2);
    // as long as the path does not bend, all ways are equal
    let straight: Vec<f64> =
        (first..base.len() - 1).map(|i| measure_unexplained(silhouette, base, i, &near)).collect();
    let as_before = [0.0, 0.5, 1.0].map(|share| share * curvature);
    let more = BENDS.map(|bend| 0.5 * curvature + bend / radius_px);
    for bend in as_before.into_iter().chain(more) {
        let start = heading[1].atan2(heading[0]) + bend * span / 4.0;
        let mut path = base.to_vec();
        for i in 1..(REACH / STEP) as usize {
            let angle = start + bend * i as f64 * STEP * radius_px;
            let x = path[path.len() - 1];
            path.push([x[0] + angle.cos() * STEP * radius_px, x[1] + angle.sin() * STEP * radius_px]);
        }
        let stop = (first..path.len())
            .find(|&i| silhouette.distance(path[i]) <= 0.2)
            .map_or(path.len() - first, |i| i - first);
        let known = straight.len().min(stop);
        let more = (first + known..first + stop).map(|i| measure_unexplained(silhouette, &path, i, &near));
        let shares: Vec<f64> = straight[..known].iter().copied().chain(more).collect();
        let Some(good) = find_last_shown(&shares) else { continue };
        let explained: f64 = shares[..=good].iter().sum();
        let end = if good + 2 >= stop { good } else { (good + (UNDER / STEP) as usize).min(stop - 1) };
        if best.as_ref().is_none_or(|(most, _)| explained > most + 0.7) {
            path.truncate(first + end + 1);
            best = Some((explained, path));
        }
    }
    best.map(|(_, path)| path)
}

/// Returns the curvature of a short polyline, and the distance between its ends.
fn measure_curvature(p: &[Place]) -> (f64, f64) {
    let (a, b, c) = (p[0], p[p.len() / 2], p[p.len() - 1]);
    let span = distance(a, c);
    if p.len() <= 12 {
        return (0.0, span);
    }
    let (d, e) = (unit([b[0] - a[0], b[1] - a[1]]), unit([c[0] - b[0], c[1] - b[1]]));
    ((d[0] * e[1] - d[1] * e[0]) / (span / 2.0 + 1e-9), span)
}

/// Returns the share of a node's cross-section that is mask without another strand.
fn measure_unexplained(silhouette: &Silhouette, path: &[Place], i: usize, others: &[Place]) -> f64 {
    let radius_px = silhouette.radius_px;
    let (a, b) = (path[i - 1], path[(i + 1).min(path.len() - 1)]);
    let t = unit([b[0] - a[0], b[1] - a[1]]);
    let covers = 1.15 * radius_px + 0.4;
    let reach = covers + 0.71 * radius_px;
    let squared = |x: Place, o: Place| (x[0] - o[0]).powi(2) + (x[1] - o[1]).powi(2);
    let near: Vec<Place> = others.iter().filter(|o| squared(path[i], **o) < reach * reach).copied().collect();
    let shown = [-0.7, -0.35, 0.0, 0.35, 0.7]
        .iter()
        .filter(|&&offset| {
            let x = [path[i][0] - offset * radius_px * t[1], path[i][1] + offset * radius_px * t[0]];
            silhouette.holds(x) && !near.iter().any(|&o| squared(x, o) < covers * covers)
        })
        .count();
    shown as f64 / 5.0
}

/// Returns the last node that shows the rope: of the first run of such nodes, or of a later run at least a radius long.
fn find_last_shown(shares: &[f64]) -> Option<usize> {
    let mut found = None;
    let mut i = 0;
    while i < shares.len() {
        if shares[i] < MIN_SHARE {
            i += 1;
            continue;
        }
        let begin = i;
        while i < shares.len() && shares[i] >= MIN_SHARE {
            i += 1;
        }
        if found.is_none() || i - begin >= 4 {
            found = Some(i - 1);
        }
    }
    found
}

/// Extends the ends of chains to uncovered mask. An end may be hidden under or beside another strand before it is seen
/// again.
///
/// `bare` holds the middles of uncovered pieces of mask and their areas in squared image radii.
pub fn lead_on(silhouette: &Silhouette, chains: &[Vec<Place>], bare: &[(Place, f64)]) -> Vec<Vec<Place>> {
    let radius_px = silhouette.radius_px;
    let mut chains = chains.to_vec();
    for &(goal, area) in bare {
        let mut best: Option<(f64, usize, bool, Vec<Place>)> = None;
        for (number, chain) in chains.iter().enumerate() {
            for first in [false, true] {
                if chain.len() < 12 {
                    continue;
                }
                let from = |i: usize| if first { chain[i] } else { chain[chain.len() - 1 - i] };
                // the last nodes of an end inside a zone are uncertain
                for back in [2, 6, 10] {
                    let (end, before) =
                        (from(back.min(chain.len() - 8)), from(back.min(chain.len() - 8) + 5));
                    let heading = unit([end[0] - before[0], end[1] - before[1]]);
                    let Some(way) = make_arc(end, heading, goal, radius_px) else { continue };
                    let Some(bare) = price_bare(silhouette, &way) else { continue };
                    let far = distance(end, goal);
                    let turn = {
                        let d = unit([goal[0] - end[0], goal[1] - end[1]]);
                        2.0 * (heading[0] * d[1] - heading[1] * d[0])
                            .atan2(heading[0] * d[0] + heading[1] * d[1])
                    };
                    let cost = EXTENSION_TURN * turn * turn * radius_px / far
                        + EXTENSION_LENGTH * far / radius_px
                        + bare;
                    if cost < EXTENSION_GAIN * area && best.as_ref().is_none_or(|b| cost < b.0) {
                        let kept: Vec<Place> =
                            (back.min(chain.len() - 8)..chain.len()).rev().map(from).collect();
                        let longer = kept.into_iter().chain(way).collect();
                        best = Some((cost, number, first, longer));
                    }
                }
            }
        }
        if let Some((_, number, first, mut longer)) = best {
            if first {
                longer.reverse();
            }
            chains[number] = resampled(&longer, 0.5 * radius_px);
        }
    }
    chains
}

/// Prices the part of a way outside the mask, with nodes half a radius apart; None if the camera sees through there.
fn price_bare(silhouette: &Silhouette, way: &[Place]) -> Option<f64> {
    let mut price = 0.0;
    for &x in way.iter().filter(|x| silhouette.distance(**x) < 0.3 * silhouette.radius_px) {
        price += 0.5
            * match silhouette.shown(x) {
                Shown::Before => 0.0,
                Shown::Level => EXTENSION_BARE,
                Shown::Unknown | Shown::Behind => return None,
            };
    }
    Some(price)
}

/// Returns an arc of a circle from a place and direction to another place; None if it is long or turns too much.
fn make_arc(from: Place, heading: Place, to: Place, radius_px: f64) -> Option<Vec<Place>> {
    let far = distance(from, to);
    let d = unit([to[0] - from[0], to[1] - from[1]]);
    let half = (heading[0] * d[1] - heading[1] * d[0]).atan2(heading[0] * d[0] + heading[1] * d[1]);
    let curvature = 2.0 * half.sin() / far.max(1e-9);
    if far < 0.5 * radius_px
        || far > MAX_EXTENSION * radius_px
        || half.abs() > 1.2
        || curvature.abs() * radius_px > 0.5
    {
        return None;
    }
    let long = if half.abs() < 1e-6 { far } else { 2.0 * half / curvature };
    let n = (long / (0.5 * radius_px)).ceil() as usize;
    let start = heading[1].atan2(heading[0]);
    let mut way = Vec::with_capacity(n);
    let mut x = from;
    for i in 0..n {
        let step = long / n as f64;
        let angle = start + curvature * step * (i as f64 + 0.5);
        x = [x[0] + step * angle.cos(), x[1] + step * angle.sin()];
        way.push(x);
    }
    Some(way)
}
