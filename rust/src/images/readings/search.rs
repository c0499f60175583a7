//! Whole readings of a mask: all ways to join all ports of its zones, the likeliest first.

use std::collections::{BTreeMap, BinaryHeap, HashSet};

use super::ends::lead_on;
use super::gaps::{KnownCurves, join_pieces};
use super::links::{TAIL, Votes, price_course};
use super::network::{Network, SPURS, Skeleton};
use super::pairings::{Pairings, UNCOVERED, Zone, rank_pairings};
use super::planar::{Place, cleaned, distance, length, resampled};
use super::refine::refined;
use crate::images::bits::Bits;
use crate::images::image::find_blobs;
use crate::images::runs::{Mask, list_between};
use crate::images::silhouette::Silhouette;
use crate::parallel;

const ROPE: f64 = 5.0; // cost of each rope if their number is not known
const RING: f64 = 6.0; // cost of a ring
const TOO_FEW: f64 = 8.0; // cost of each missing rope if their number is known
const STACKED: f64 = 1.0; // cost of a reading that takes a stretch for two strands
const MIN_BARE: f64 = 0.4; // larger uncovered pieces of mask may hold a rope's end, squared image radii
const TIPS: f64 = 1.0; // cost of a reading that keeps short branches of the skeleton
const GAPS: usize = 4; // ways to join pieces over gaps in the mask that are kept
const MAX_STACK: f64 = 25.0; // length of stretches that may hide two strands at most, image radii
const STACKS: usize = 4; // stretches of this kind that are tried
const MAX_WAYS: usize = 600; // whole ways that are put together in one reading of the skeleton at most
const MAX_WORK: usize = 2_000_000; // work on them at most: squared numbers of zones and of chains
const CHAIN_WORK: usize = 16; // weight of a squared number of chains in that work
const MAX_CHAINS: usize = 100; // chains of a reading at most; more are no ropes
const MAX_TRIED: usize = 1_000_000; // ways of single zones that are tried, in all zones together

/// A whole reading of one view.
#[derive(Debug, Clone)]
pub struct Reading {
    pub cost: f64,
    /// The part of the cost that chains do not show: ends inside zones, kisses, gaps.
    fixed: f64,
    /// Nodes of each rope, half a radius apart.
    pub chains: Vec<Vec<Place>>,
    /// The number of ropes that were rings and have been opened.
    pub rings: usize,
}

/// Where a port leads.
#[derive(Clone)]
struct Lead<'a> {
    to: Option<usize>,
    pairings: &'a Pairings,
    joint: usize,
    turned: bool,
}

/// One reading of a skeleton, and its extra cost.
struct Candidate<'a> {
    skeleton: &'a Skeleton,
    network: Network,
    more: f64,
    /// For each zone its ports, and the number of its pairings among all known ones.
    zones: Vec<(Vec<usize>, usize)>,
}

/// The key of a zone: its pixels, and for each port the end, the middle and the length of its segment.
type ZoneName = (Vec<usize>, Vec<(usize, usize, usize)>);

/// Finds likely readings of a mask, the best first, all different.
pub fn find_readings(silhouette: &Silhouette, ropes: Option<usize>, most: usize) -> Vec<Reading> {
    let radius_px = silhouette.radius_px;
    let votes = Votes::new(silhouette);
    let skeletons = parallel::map(&SPURS, |&spur| Skeleton::new(&silhouette.strokes, radius_px, spur));
    let [pruned, bushy] = [&skeletons[0], &skeletons[1]];
    let different = if bushy.is_same(pruned) { vec![] } else { vec![(bushy, TIPS)] };
    let ways = parallel::map(&[vec![(pruned, 0.0)], different].concat(), |&(skeleton, more)| {
        list_candidates(skeleton, radius_px, more)
    });
    let mut candidates: Vec<Candidate> = ways.into_iter().flatten().collect();
    // a zone that is equal in two candidates is solved once
    let mut numbers: BTreeMap<ZoneName, usize> = BTreeMap::new();
    let mut places: Vec<(usize, usize)> = Vec::new();
    for (number, candidate) in candidates.iter_mut().enumerate() {
        for zone in 0..candidate.network.zones.len() {
            let (ports, name) = name_zone(candidate.skeleton, &candidate.network, zone);
            let known = *numbers.entry(name).or_insert_with(|| {
                places.push((number, zone));
                places.len() - 1
            });
            candidate.zones.push((ports, known));
        }
    }
    let zones: Vec<Zone> = places
        .iter()
        .map(|&(candidate, number)| {
            let Candidate { skeleton, network, zones, .. } = &candidates[candidate];
            let ports = zones[number].0.iter().map(|&p| network.ports[p]).collect();
            Zone { skeleton, network, number, ports }
        })
        .collect();
    let pairings = rank_pairings(silhouette, &votes, &zones, MAX_TRIED / zones.len().max(1));
    let found = parallel::map(&candidates, |candidate| search(silhouette, candidate, &pairings, ropes, most));
    let mut found = found.concat();
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut kept: Vec<Reading> = Vec::new();
    let mut courses: Vec<Vec<Vec<Place>>> = Vec::new();
    for reading in found {
        if kept.len() >= most {
            break;
        }
        let course = sample_courses(&reading.chains);
        if !courses.iter().any(|k| is_alike(k, &course, radius_px)) {
            kept.push(reading);
            courses.push(course);
        }
    }
    let mut kept = parallel::map(&kept, |reading| settle(silhouette, &votes, reading));
    kept.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    kept
}

/// Prices the reading with these chains, without its ends, kisses and gaps.
pub fn price(silhouette: &Silhouette, chains: &[Vec<Place>]) -> f64 {
    price_beside(silhouette, chains, find_uncovered(silhouette, chains).0)
}

/// As [`price`], where the uncovered area of mask is known.
fn price_beside(silhouette: &Silhouette, chains: &[Vec<Place>], uncovered: f64) -> f64 {
    chains.iter().map(|c| price_course(silhouette, c)).sum::<f64>() + UNCOVERED * uncovered
}

/// Extends and refines the chains of a reading, and prices it again.
fn settle(silhouette: &Silhouette, votes: &Votes, reading: &Reading) -> Reading {
    let mut chains = reading.chains.clone();
    let (mut uncovered, mut bare) = find_uncovered(silhouette, &chains);
    for round in 0..2 {
        let led = lead_on(silhouette, &chains, &bare);
        if round > 0 && led == chains {
            break;
        }
        chains = refined(silhouette, votes, &led);
        (uncovered, bare) = find_uncovered(silhouette, &chains);
    }
    Reading { cost: reading.fixed + price_beside(silhouette, &chains, uncovered), chains, ..*reading }
}

/// Returns the area of mask that no chain covers, squared image radii, and the middle and area of each large piece of
/// it.
fn find_uncovered(silhouette: &Silhouette, chains: &[Vec<Place>]) -> (f64, Vec<(Place, f64)>) {
    let radius_px = silhouette.radius_px;
    let ([left, top], _) = silhouette.frame();
    let mut bare = Bits::pack(&silhouette.mask.values, silhouette.mask.width);
    let [width, height] = bare.size();
    let reach = 1.2 * radius_px + 0.3;
    for x in chains.iter().flatten() {
        let (u, v) = (x[0] - left, x[1] - top);
        for row in list_between(v - reach, v + reach, height) {
            let half = (reach * reach - (row as f64 - v).powi(2)).max(0.0).sqrt();
            bare.fill(row, list_between(u - half, u + half, width), false);
        }
    }
    let found = find_blobs(&bare, true, true);
    let mut sums = vec![[0.0; 2]; found.sizes.len()];
    for run in &found.runs {
        let count = (run.end - run.begin) as f64;
        sums[run.blob][0] += count * (0.5 * (run.begin + run.end - 1) as f64 + left);
        sums[run.blob][1] += count * (run.row as f64 + top);
    }
    let mut stretches = Vec::new();
    let mut total = 0.0;
    for (number, &size) in found.sizes.iter().enumerate() {
        let area = size as f64 / (radius_px * radius_px);
        total += area;
        if area > MIN_BARE {
            stretches.push((sums[number].map(|s| s / size as f64), area));
        }
    }
    (total, stretches)
}

/// Reads one skeleton: as it is, and with stretches taken for two strands.
fn list_candidates(skeleton: &Skeleton, radius_px: f64, tips: f64) -> Vec<Candidate<'_>> {
    let of = |network, more| Candidate { skeleton, network, more, zones: Vec::new() };
    let plain = skeleton.read(radius_px, false, &[]);
    let mut stretches: Vec<(f64, Vec<u32>)> = plain
        .segments
        .iter()
        .filter(|s| s.zones[0] != 0 && s.zones[1] != 0 && s.zones[0] != s.zones[1])
        .map(|s| (length(&s.points), s.path.clone()))
        .filter(|(long, _)| *long < MAX_STACK * radius_px)
        .collect();
    stretches.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut seen = HashSet::from([plain.zones.clone()]);
    let mut found = vec![of(plain, tips)];
    let hidden = std::iter::once(Vec::new()).chain(stretches.into_iter().take(STACKS).map(|(_, path)| path));
    for path in hidden {
        let network = skeleton.read(radius_px, true, &path);
        if seen.insert(network.zones.clone()) {
            found.push(of(network, if path.is_empty() { tips } else { STACKED + tips }));
        }
    }
    found
}

/// Returns the ports of a zone, in an order that does not depend on the reading, and the zone's key.
fn name_zone(skeleton: &Skeleton, network: &Network, zone: usize) -> (Vec<usize>, ZoneName) {
    let key = |p: usize| {
        let port = network.ports[p];
        let path = &network.segments[port.segment].path;
        let end = path[if port.end == 0 { 0 } else { path.len() - 1 }];
        (skeleton.pixel(end), skeleton.pixel(path[path.len() / 2]), path.len())
    };
    let mut ports: Vec<usize> =
        (0..network.ports.len()).filter(|&p| network.ports[p].zone as usize == zone + 1).collect();
    ports.sort_by_key(|&p| (key(p), p));
    let pixels = network.zones[zone].iter().map(|&i| skeleton.pixel(i)).collect();
    let keys = ports.iter().map(|&p| key(p)).collect();
    (ports, (pixels, keys))
}

/// Sorts chains by length and samples them, for [`is_alike`].
fn sample_courses(chains: &[Vec<Place>]) -> Vec<Vec<Place>> {
    let mut chains: Vec<(f64, &Vec<Place>)> = chains.iter().map(|c| (length(c), c)).collect();
    chains.sort_by(|x, y| x.0.total_cmp(&y.0));
    chains.iter().map(|(long, c)| resampled(c, (long / 80.0).max(1e-6))).collect()
}

/// Returns whether two readings run through the same places in the same order, within a radius.
fn is_alike(a: &[Vec<Place>], b: &[Vec<Place>], radius_px: f64) -> bool {
    a.len() == b.len()
        && a.iter().zip(b).all(|(p, q)| {
            let n = p.len().min(q.len());
            let near = |turned: bool| {
                (0..n).all(|i| distance(p[i], if turned { q[q.len() - 1 - i] } else { q[i] }) <= radius_px)
            };
            near(false) || near(true)
        })
}

/// Finds ways through all zones of one reading of the skeleton, the cheapest first.
fn search(
    silhouette: &Silhouette,
    candidate: &Candidate,
    pairings: &[Pairings],
    ropes: Option<usize>,
    most: usize,
) -> Vec<Reading> {
    let radius_px = silhouette.radius_px;
    let network = &candidate.network;
    let zones: Vec<(&[usize], &Pairings)> =
        candidate.zones.iter().map(|(ports, known)| (&ports[..], &pairings[*known])).collect();
    let price = |choice: &[usize]| -> f64 {
        choice.iter().zip(&zones).map(|(&i, (_, p))| p.ways.get(i).map_or(0.0, |w| w.cost)).sum()
    };
    let mut found = Vec::new();
    let mut known = KnownCurves::default();
    let mut heap = BinaryHeap::new();
    let first = vec![0; zones.len()];
    let mut seen = HashSet::from([first.clone()]);
    heap.push((std::cmp::Reverse(Ordered(price(&first))), first));
    let (mut tried, mut work) = (0, 0);
    while let Some((std::cmp::Reverse(Ordered(cost)), choice)) = heap.pop() {
        parallel::go_on();
        tried += 1;
        work += zones.len().pow(2);
        if tried > MAX_WAYS || work > MAX_WORK || found.len() >= 4 * most {
            break;
        }
        let (mut chains, rings) = assemble(network, &zones, &choice, radius_px);
        if chains.iter().any(|c| length(c) > 2.0 * radius_px) {
            chains.retain(|c| length(c) > 2.0 * radius_px);
        }
        let fixed: f64 =
            choice.iter().zip(&zones).map(|(&i, (_, p))| p.ways.get(i).map_or(0.0, |w| w.fixed)).sum();
        work += CHAIN_WORK * chains.len().pow(2);
        let ways = if chains.len() > MAX_CHAINS {
            vec![]
        } else {
            join_pieces(silhouette, &chains, ropes, ROPE, GAPS, &mut known)
        };
        for way in ways {
            let number = match ropes {
                Some(ropes) => TOO_FEW * ropes.saturating_sub(way.chains.len()) as f64,
                None => ROPE * way.chains.len() as f64,
            };
            let more = candidate.more + RING * rings as f64 + number;
            found.push(Reading {
                cost: cost + more + way.cost,
                fixed: fixed + more + way.fixed,
                chains: way.chains,
                rings,
            });
        }
        for (k, (_, pairings)) in zones.iter().enumerate() {
            if choice[k] + 1 < pairings.ways.len() {
                let mut next = choice.clone();
                next[k] += 1;
                if seen.insert(next.clone()) {
                    heap.push((std::cmp::Reverse(Ordered(price(&next))), next));
                }
            }
        }
    }
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    found.truncate(most);
    found
}

/// A number with a total order.
#[derive(PartialEq)]
struct Ordered(f64);

impl Eq for Ordered {}

impl PartialOrd for Ordered {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Ordered {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// Returns the chains of one choice of ways, and the number of rings.
fn assemble(
    network: &Network,
    zones: &[(&[usize], &Pairings)],
    choice: &[usize],
    radius_px: f64,
) -> (Vec<Vec<Place>>, usize) {
    let mut next: Vec<Option<Lead<'_>>> = vec![None; network.ports.len()];
    let mut used = vec![false; network.segments.len()];
    let mut hidden_ends = Vec::new();
    for ((ports, pairings), &way) in zones.iter().zip(choice) {
        let Some(way) = pairings.ways.get(way) else { continue };
        for &joint in &way.joints {
            let (a, b) = pairings.joints[joint].ports;
            let lead = |to: Option<usize>, turned: bool| Lead { to, pairings, joint, turned };
            next[ports[a]] = Some(lead(b.map(|b| ports[b]), false));
            match b {
                Some(b) => next[ports[b]] = Some(lead(Some(ports[a]), true)),
                None if pairings.joints[joint].link.dropped => used[network.ports[ports[a]].segment] = true,
                None => hidden_ends.push(ports[a]),
            }
        }
    }
    let mut port_of = vec![[None; 2]; network.segments.len()];
    for (i, port) in network.ports.iter().enumerate() {
        port_of[port.segment][port.end] = Some(i);
    }
    let mut chains = Vec::new();
    // from free ends of segments, then from ends inside zones
    let free: Vec<(usize, usize, Option<usize>)> = (0..network.segments.len())
        .flat_map(|k| [(k, 0), (k, 1)])
        .filter(|&(k, end)| port_of[k][end].is_none_or(|p| next[p].is_none()))
        .map(|(k, end)| (k, 1 - end, None))
        .collect();
    let inside = hidden_ends.iter().map(|&p| (network.ports[p].segment, 1 - network.ports[p].end, Some(p)));
    for (segment, leave, port) in free.into_iter().chain(inside) {
        if used[segment] {
            continue;
        }
        let mut points = Vec::new();
        if let Some(way) = port.and_then(|p| next[p].as_ref()) {
            points.extend(way.pairings.joints[way.joint].link.middle[1..].iter().rev());
        }
        points.extend(walk(network, &port_of, &next, &mut used, segment, leave));
        chains.push(points);
    }
    let mut rings = 0;
    for segment in 0..network.segments.len() {
        if !used[segment] {
            rings += 1;
            chains.push(walk(network, &port_of, &next, &mut used, segment, 1));
        }
    }
    let chains = chains.iter().filter(|c| c.len() > 1).map(|c| cleaned(c, 0.5 * radius_px)).collect();
    (chains, rings)
}

/// Walks from a segment on, leaving it at its end `leave`, to a rope's end or back to the start.
fn walk(
    network: &Network,
    port_of: &[[Option<usize>; 2]],
    next: &[Option<Lead<'_>>],
    used: &mut [bool],
    mut segment: usize,
    mut leave: usize,
) -> Vec<Place> {
    let mut points: Vec<Place> = Vec::new();
    while !used[segment] {
        used[segment] = true;
        let own = &network.segments[segment].points;
        if leave == 1 {
            points.extend(own);
        } else {
            points.extend(own.iter().rev());
        }
        let Some(way) = port_of[segment][leave].and_then(|p| next[p].as_ref()) else { break };
        let link = &way.pairings.joints[way.joint].link;
        let Some(to) = way.to else {
            points.extend(&link.middle[1..]);
            break;
        };
        // the fitted tail replaces the segment's own
        points.truncate(points.len() - TAIL.min(own.len()));
        let far = link.tails[if way.turned { 0 } else { 1 }];
        let keep = if far < link.full.len() { link.full.len() - far } else { link.full.len() };
        if way.turned {
            points.extend(link.full.iter().rev().take(keep));
        } else {
            points.extend(&link.full[..keep]);
        }
        let port = network.ports[to];
        segment = port.segment;
        leave = 1 - port.end;
    }
    points
}
