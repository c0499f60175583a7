//! Where ropes end in the image: the last place that shows mask which no other strand explains.

use super::planar::{Place, apart, resampled, unit};
use crate::images::silhouette::Silhouette;
use crate::images::surroundings::Shown;

/// Nodes are this far apart here, radii.
const STEP: f64 = 0.25;
/// A rope goes on where this share of its cross-section is mask that no other strand explains.
const SHARE: f64 = 0.35;
/// A rope's end is searched this far beyond the skeleton's, radii.
const REACH: f64 = 7.0;
/// An end that another strand hides lies this far under it, radii.
const UNDER: f64 = 0.75;
/// What it costs to lead an end on to mask that nothing covers: its turning, for each radius of its way, and what each
/// squared radius of that mask is worth; and how far it may be, radii.
const LED_TURN: f64 = 3.0;
const LED_LENGTH: f64 = 0.1;
const LED_GAIN: f64 = 1.5;
const LED_MOST: f64 = 16.0;
/// And each radius of it outside the mask, where depth shows that a rope may be.
const LED_BARE: f64 = 0.5;
/// Other bends than the rope's last that are tried, over a radius.
const BENDS: [f64; 6] = [0.1, -0.1, 0.2, -0.2, 0.3, -0.3];
/// Nodes nearer than this along a chain are no other strand, nodes.
const OWN: usize = 24;

/// Chains with their ends where the mask ends, nodes half a radius apart.
///
/// A skeleton's last radius turns to a corner of the rope's end, so it is left out; from there on straight, or as bent as
/// before, whichever explains more of the mask.
pub fn extended(silhouette: &Silhouette, chains: &[Vec<Place>]) -> Vec<Vec<Place>> {
    let radius_px = silhouette.radius_px;
    let dense: Vec<Vec<Place>> = chains.iter().map(|c| resampled(c, STEP * radius_px)).collect();
    (0..dense.len())
        .map(|number| {
            let mut chain = dense[number].clone();
            for _ in 0..2 {
                chain.reverse();
                let own = if chain.len() > 40 { chain.len() - OWN } else { 0 };
                let others = || {
                    let of_others =
                        dense.iter().enumerate().filter(|&(k, _)| k != number).flat_map(|(_, c)| c);
                    chain[..own].iter().chain(of_others)
                };
                if let Some(longer) = with_end(silhouette, &chain, others) {
                    chain = longer;
                }
            }
            resampled(&chain, 0.5 * radius_px)
        })
        .collect()
}

/// A chain with its last end where the mask ends; none if no place near its end shows the rope.
fn with_end<'a, I: Iterator<Item = &'a Place>>(
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
        others().filter(|x| apart(**x, last) < (REACH + 10.0) * radius_px).copied().collect();
    let back = base[base.len() - 1 - 12.min(base.len() - 1)];
    let heading = unit([last[0] - back[0], last[1] - back[1]]);
    let recent = &base[base.len() - 24.min(base.len())..];
    let (curvature, span) = curvature(recent);
    let mut best: Option<(f64, Vec<Place>)> = None;
    let first = base.len().saturating_sub(32).max(2);
    // as far as the path does not bend all ways are the same
    let straight: Vec<f64> =
        (first..base.len() - 1).map(|i| unexplained(silhouette, base, i, &near)).collect();
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
        let more = (first + known..first + stop).map(|i| unexplained(silhouette, &path, i, &near));
        let shares: Vec<f64> = straight[..known].iter().copied().chain(more).collect();
        let Some(good) = last_shown(&shares) else { continue };
        let explained: f64 = shares[..=good].iter().sum();
        let end = if good + 2 >= stop { good } else { (good + (UNDER / STEP) as usize).min(stop - 1) };
        if best.as_ref().is_none_or(|(most, _)| explained > most + 0.7) {
            path.truncate(first + end + 1);
            best = Some((explained, path));
        }
    }
    best.map(|(_, path)| path)
}

/// The curvature of a short polyline, and the distance between its ends.
fn curvature(p: &[Place]) -> (f64, f64) {
    let (a, b, c) = (p[0], p[p.len() / 2], p[p.len() - 1]);
    let span = apart(a, c);
    if p.len() <= 12 {
        return (0.0, span);
    }
    let (d, e) = (unit([b[0] - a[0], b[1] - a[1]]), unit([c[0] - b[0], c[1] - b[1]]));
    ((d[0] * e[1] - d[1] * e[0]) / (span / 2.0 + 1e-9), span)
}

/// The share of the cross-section at a node that is mask which no other strand covers.
fn unexplained(silhouette: &Silhouette, path: &[Place], i: usize, others: &[Place]) -> f64 {
    let radius_px = silhouette.radius_px;
    let (a, b) = (path[i - 1], path[(i + 1).min(path.len() - 1)]);
    let t = unit([b[0] - a[0], b[1] - a[1]]);
    let covers = 1.15 * radius_px + 0.4;
    let reach = covers + 0.71 * radius_px;
    let apart = |x: Place, o: Place| (x[0] - o[0]).powi(2) + (x[1] - o[1]).powi(2);
    let near: Vec<Place> = others.iter().filter(|o| apart(path[i], **o) < reach * reach).copied().collect();
    let shown = [-0.7, -0.35, 0.0, 0.35, 0.7]
        .iter()
        .filter(|&&offset| {
            let x = [path[i][0] - offset * radius_px * t[1], path[i][1] + offset * radius_px * t[0]];
            silhouette.distance(x) > 0.0 && !near.iter().any(|&o| apart(x, o) < covers * covers)
        })
        .count();
    shown as f64 / 5.0
}

/// The last node that shows the rope: of the first run of such nodes, or of a later one that is a radius long.
fn last_shown(shares: &[f64]) -> Option<usize> {
    let mut found = None;
    let mut i = 0;
    while i < shares.len() {
        if shares[i] < SHARE {
            i += 1;
            continue;
        }
        let begin = i;
        while i < shares.len() && shares[i] >= SHARE {
            i += 1;
        }
        if found.is_none() || i - begin >= 4 {
            found = Some(i - 1);
        }
    }
    found
}

/// Chains whose ends are led on to mask that no chain covers: an end may lie under or beside another strand for a while
/// before it shows again.
///
/// `bare`: middles of stretches of mask that nothing covers, and their areas in squared radii.
pub fn led_on(silhouette: &Silhouette, chains: &[Vec<Place>], bare: &[(Place, f64)]) -> Vec<Vec<Place>> {
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
                // the last nodes of an end inside a zone are a guess
                for back in [2, 6, 10] {
                    let (end, before) =
                        (from(back.min(chain.len() - 8)), from(back.min(chain.len() - 8) + 5));
                    let heading = unit([end[0] - before[0], end[1] - before[1]]);
                    let Some(way) = arc(end, heading, goal, radius_px) else { continue };
                    let Some(bare) = bare_price(silhouette, &way) else { continue };
                    let far = apart(end, goal);
                    let turn = {
                        let d = unit([goal[0] - end[0], goal[1] - end[1]]);
                        2.0 * (heading[0] * d[1] - heading[1] * d[0])
                            .atan2(heading[0] * d[0] + heading[1] * d[1])
                    };
                    let cost = LED_TURN * turn * turn * radius_px / far + LED_LENGTH * far / radius_px + bare;
                    if cost < LED_GAIN * area && best.as_ref().is_none_or(|b| cost < b.0) {
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

/// What it costs that a way leaves the mask, nodes half a radius apart; none if the camera sees through there.
fn bare_price(silhouette: &Silhouette, way: &[Place]) -> Option<f64> {
    let mut price = 0.0;
    for &x in way.iter().filter(|x| silhouette.distance(**x) < 0.3 * silhouette.radius_px) {
        price += 0.5
            * match silhouette.shown(x) {
                Shown::Before => 0.0,
                Shown::Level => LED_BARE,
                Shown::Unknown | Shown::Behind => return None,
            };
    }
    Some(price)
}

/// The arc of a circle that leaves a place in a direction and ends at another; none if it is long or turns too much.
fn arc(from: Place, heading: Place, to: Place, radius_px: f64) -> Option<Vec<Place>> {
    let far = apart(from, to);
    let d = unit([to[0] - from[0], to[1] - from[1]]);
    let half = (heading[0] * d[1] - heading[1] * d[0]).atan2(heading[0] * d[0] + heading[1] * d[1]);
    let curvature = 2.0 * half.sin() / far.max(1e-9);
    if far < 0.5 * radius_px
        || far > LED_MOST * radius_px
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
