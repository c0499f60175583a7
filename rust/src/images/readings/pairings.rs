//! Ways to join the ports of a zone, ranked.

use std::collections::HashMap;

use rustc_hash::FxHashMap;

use super::links::{Link, Passage, Votes, make_free_end, make_link, take_tail};
use super::network::{Network, Port, Skeleton};
use super::planar::{Place, cross, distance, nearest};
use super::region::{Cover, Region};
use crate::images::silhouette::Silhouette;
use crate::parallel;

pub const UNCOVERED: f64 = 0.8; // cost of uncovered mask, for each squared radius
const KISS: f64 = 2.5; // cost of two strands that touch without crossing
const KISSES: f64 = 1.7; // strands touch if their axes are nearer than this, image radii
const MAX_KEPT: usize = 6; // ways that are kept at most
const MAX_TRIED: usize = 20_000; // ways that are tried at most
const MAX_PORTS: usize = 24; // ports of a zone at most that are all joined with each other
const PARTNERS: usize = 16; // nearest partners of each port in larger zones
/// Joints that are examined at most.
const MAX_WORK: usize = MAX_TRIED * MAX_PORTS * MAX_PORTS * MAX_PORTS;

/// A zone of a reading of a skeleton, and its ports.
pub struct Zone<'a> {
    pub skeleton: &'a Skeleton,
    pub network: &'a Network,
    /// Its number among the network's zones.
    pub number: usize,
    pub ports: Vec<Port>,
}

/// A link between two ports of a zone, or from a port to a rope's end.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Their numbers among the zone's ports.
    pub ports: (usize, Option<usize>),
    pub link: Link,
}

/// Ways to join the ports of a zone.
#[derive(Debug, Clone)]
pub struct Pairings {
    pub joints: Vec<Joint>,
    /// The ways, the best first.
    pub ways: Vec<Way>,
}

/// A way to join all ports of a zone.
#[derive(Debug, Clone)]
pub struct Way {
    pub cost: f64,
    /// The part of its cost for ends, dropped stubs and kisses.
    pub fixed: f64,
    pub joints: Vec<usize>,
}

/// Returns how much two curves touch without crossing: 1 if they coincide, 0 if they cross or stay apart.
///
/// Strands rarely touch by accident; crossings are more common.
fn measure_kiss(p: &[Place], q: &[Place], radius_px: f64) -> f64 {
    match nearest(p, q, KISSES * radius_px) {
        Some(away) if !cross(p, q) => ((KISSES - away / radius_px) / 0.7).clamp(0.0, 1.0),
        _ => 0.0,
    }
}

/// Returns which pairs of a zone's ports are worth a link: all, unless there are many ports.
fn choose_partners(network: &Network, ports: &[Port]) -> Vec<Vec<bool>> {
    let n = ports.len();
    let mut chosen = vec![vec![n <= MAX_PORTS; n]; n];
    if n <= MAX_PORTS {
        return chosen;
    }
    let places: Vec<Place> = ports
        .iter()
        .map(|port| {
            let points = &network.segments[port.segment].points;
            points[if port.end == 0 { 0 } else { points.len() - 1 }]
        })
        .collect();
    for a in 0..n {
        let mut others: Vec<usize> = (0..n).filter(|&b| b != a).collect();
        others.sort_by(|&b, &c| {
            distance(places[a], places[b]).total_cmp(&distance(places[a], places[c])).then(b.cmp(&c))
        });
        for &b in &others[..PARTNERS] {
            chosen[a][b] = true;
            chosen[b][a] = true;
        }
    }
    chosen
}

/// Ranks the ways to join the ports of each zone; tries at most `most` ways of each.
pub fn rank_pairings(silhouette: &Silhouette, votes: &Votes, zones: &[Zone], most: usize) -> Vec<Pairings> {
    let passages = parallel::map(zones, list_passages);
    // zones of different readings share passages
    let mut different: Vec<&Passage> = Vec::new();
    let mut known: HashMap<Vec<u64>, usize> = HashMap::new();
    let mut find_number = |passage| {
        *known.entry(Passage::bits(passage)).or_insert_with(|| {
            different.push(passage);
            different.len() - 1
        })
    };
    let numbers: Vec<Vec<usize>> =
        passages.iter().map(|own| own.iter().map(|(_, passage)| find_number(passage)).collect()).collect();
    let links = parallel::map(&different, |passage| make_link(silhouette, votes, passage));
    let all: Vec<usize> = (0..zones.len()).collect();
    parallel::map(&all, |&zone| {
        let own = passages[zone].iter().zip(&numbers[zone]);
        let joints = own.filter_map(|(&((a, b), _), &number)| {
            Some(Joint { ports: (a, Some(b)), link: links[number].clone()? })
        });
        rank_ways(silhouette, &zones[zone], joints.collect(), most)
    })
}

/// Returns the pairs of a zone's ports that are worth a link, with the passages between them.
fn list_passages(zone: &Zone) -> Vec<((usize, usize), Passage)> {
    let Zone { skeleton, network, ports, number } = zone;
    let partners = choose_partners(network, ports);
    let pixels = &network.zones[*number];
    let tails: Vec<Vec<Place>> = ports.iter().map(|&port| take_tail(network, port)).collect();
    let nearest: Vec<Option<u32>> =
        tails.iter().map(|tail| skeleton.nearest(pixels, tail[tail.len() - 1])).collect();
    let mut passages = Vec::new();
    for a in 0..ports.len() {
        let ways = nearest[a].map(|first| skeleton.ways(pixels, first));
        let long = network.segments[ports[a].segment].points.len() >= 8;
        for b in a + 1..ports.len() {
            if partners[a][b] && (ports[a].segment != ports[b].segment || long) {
                let way = ways.as_ref().zip(nearest[b]).and_then(|(ways, last)| ways.to(last));
                passages.push(((a, b), Passage::new([tails[a].clone(), tails[b].clone()], way)));
            }
        }
    }
    passages
}

/// Ranks the ways to join the ports of a zone by links or by free ends; tries at most `most` of them.
fn rank_ways(silhouette: &Silhouette, zone: &Zone, mut joints: Vec<Joint>, most: usize) -> Pairings {
    let Zone { skeleton, network, number, ports } = zone;
    let radius_px = silhouette.radius_px;
    for (a, &port) in ports.iter().enumerate() {
        joints.push(Joint { ports: (a, None), link: make_free_end(silhouette, network, port) });
    }
    let region = Region::new(silhouette, skeleton, network, &network.zones[*number]);
    let covers: Vec<Cover> = joints.iter().map(|j| region.cover(&j.link.full)).collect();
    let mut least = vec![f64::INFINITY; ports.len()];
    for joint in &joints {
        match joint.ports {
            (a, None) => least[a] = least[a].min(joint.link.cost),
            (a, Some(b)) => {
                least[a] = least[a].min(0.5 * joint.link.cost);
                least[b] = least[b].min(0.5 * joint.link.cost);
            }
        }
    }
    let mut search = Search {
        joints: &joints,
        options: sort_options(&joints, ports.len()),
        taken: vec![false; ports.len()],
        least: &least,
        region: &region,
        covers: &covers,
        radius_px,
        kisses: FxHashMap::default(),
        left: [most.min(MAX_TRIED), MAX_WORK],
        ways: Vec::new(),
    };
    search.join(ports.len(), &mut Vec::new(), 0.0);
    let ways = search.ways;
    Pairings { joints, ways }
}

/// Lists the joints of each port, the cheapest first.
fn sort_options(joints: &[Joint], ports: usize) -> Vec<Vec<usize>> {
    let mut options = vec![Vec::new(); ports];
    for (k, joint) in joints.iter().enumerate() {
        let (a, b) = joint.ports;
        options[a].push(k);
        if let Some(b) = b {
            options[b].push(k);
        }
    }
    for own in &mut options {
        own.sort_by(|&x, &y| joints[x].link.cost.total_cmp(&joints[y].link.cost));
    }
    options
}

/// The enumeration of ways.
struct Search<'a> {
    joints: &'a [Joint],
    options: Vec<Vec<usize>>,
    /// Which ports are joined.
    taken: Vec<bool>,
    /// The least cost that each port adds.
    least: &'a [f64],
    region: &'a Region,
    covers: &'a [Cover],
    radius_px: f64,
    kisses: FxHashMap<(usize, usize), f64>,
    /// The remaining tries and joints.
    left: [usize; 2],
    /// The best ways so far, the best first.
    ways: Vec<Way>,
}

impl Search<'_> {
    /// Joins the `rest` of the ports: the first of them in every way that is not too expensive.
    fn join(&mut self, rest: usize, chosen: &mut Vec<usize>, cost: f64) {
        let work = self.joints.len() * rest;
        if self.left[0] == 0 || self.left[1] < work {
            return;
        }
        self.left = [self.left[0] - 1, self.left[1] - work];
        let free = self.taken.iter().zip(self.least).filter(|(taken, _)| !**taken);
        let at_least = cost + free.map(|(_, least)| least).sum::<f64>();
        if self.ways.len() == MAX_KEPT && at_least - 1e-9 > self.ways[MAX_KEPT - 1].cost {
            return;
        }
        let Some(port) = self.taken.iter().position(|taken| !taken) else {
            self.keep(chosen, cost);
            return;
        };
        let mut options = if rest > 6 { 6 } else { 12 };
        for i in 0..self.options[port].len() {
            let k = self.options[port][i];
            let (a, b) = self.joints[k].ports;
            if self.taken[a] || b.is_some_and(|b| self.taken[b]) {
                continue;
            }
            if options == 0 {
                break;
            }
            options -= 1;
            self.take(k, true);
            chosen.push(k);
            self.join(rest - if b.is_some() { 2 } else { 1 }, chosen, cost + self.joints[k].link.cost);
            chosen.pop();
            self.take(k, false);
        }
    }

    /// Says that a joint's ports are joined, or that they are not.
    fn take(&mut self, joint: usize, taken: bool) {
        let (a, b) = self.joints[joint].ports;
        self.taken[a] = taken;
        if let Some(b) = b {
            self.taken[b] = taken;
        }
    }

    /// Prices a whole way, and keeps it if it is among the best.
    fn keep(&mut self, chosen: &[usize], cost: f64) {
        let kisses = self.kisses(chosen);
        let ends = chosen.iter().map(|&k| &self.joints[k]).filter(|j| j.ports.1.is_none());
        let fixed = kisses + ends.map(|j| j.link.cost).sum::<f64>();
        let covers: Vec<&Cover> = chosen.iter().map(|&k| &self.covers[k]).collect();
        let bare = UNCOVERED * self.region.find_uncovered(&covers) / (self.radius_px * self.radius_px);
        let cost = cost + kisses + bare;
        let rank = self.ways.partition_point(|way| way.cost <= cost);
        if rank < MAX_KEPT {
            self.ways.insert(rank, Way { cost, fixed, joints: chosen.to_vec() });
            self.ways.truncate(MAX_KEPT);
        }
    }

    /// Prices the kisses of a way's links.
    fn kisses(&mut self, chosen: &[usize]) -> f64 {
        let mut cost = 0.0;
        for (i, &k) in chosen.iter().enumerate() {
            for &l in &chosen[i + 1..] {
                if self.joints[k].ports.1.is_some() && self.joints[l].ports.1.is_some() {
                    let (joints, radius_px) = (self.joints, self.radius_px);
                    let new = || measure_kiss(&joints[k].link.full, &joints[l].link.full, radius_px);
                    cost += KISS * *self.kisses.entry((k.min(l), k.max(l))).or_insert_with(new);
                }
            }
        }
        cost
    }
}
