//! Ways to join the ports of a zone, ranked.

use std::collections::HashMap;

use super::links::{Link, Passage, Votes, make_free_end, make_link};
use super::network::{Network, Port, Skeleton};
use super::planar::{Place, cross, distance, nearest};
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

/// The mask that the links of a zone should cover.
struct Region {
    origin: Place,
    step: f64,
    width: usize,
    height: usize,
    /// The number of each pixel in that mask; `NONE` elsewhere.
    numbers: Vec<u32>,
    /// The number of these pixels.
    count: usize,
}

const NONE: u32 = u32::MAX;

impl Region {
    /// Takes the mask around a zone, without what segments cover.
    fn new(silhouette: &Silhouette, skeleton: &Skeleton, network: &Network, zone: &[u32]) -> Self {
        let radius_px = silhouette.radius_px;
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for &i in zone {
            let p = skeleton.place(i);
            for c in 0..2 {
                low[c] = low[c].min(p[c] - 5.0 * radius_px);
                high[c] = high[c].max(p[c] + 5.0 * radius_px);
            }
        }
        let step = (radius_px / 5.0).floor().max(1.0);
        let origin = [low[0].floor(), low[1].floor()];
        let width = ((high[0] - origin[0]) / step) as usize + 2;
        let height = ((high[1] - origin[1]) / step) as usize + 2;
        let mut region = Self { origin, step, width, height, numbers: Vec::new(), count: 0 };
        let mut inside = vec![false; width * height];
        for &i in zone.iter().step_by(silhouette.strokes.scale) {
            region.stamp(&[skeleton.place(i); 2], skeleton.depth(i) + 0.5 * radius_px, &mut inside, true);
        }
        for (k, value) in inside.iter_mut().enumerate() {
            *value = *value && silhouette.distance(region.place(k)) > 0.0;
        }
        for (segment, &stub) in network.segments.iter().zip(&network.stubs) {
            let near = |p: &Place| (0..2).all(|c| p[c] > low[c] && p[c] < high[c]);
            if !stub && segment.points.iter().any(near) {
                region.stamp(&segment.points, 1.2 * radius_px + 0.3, &mut inside, false);
            }
        }
        region.numbers = vec![NONE; inside.len()];
        for (number, _) in region.numbers.iter_mut().zip(&inside).filter(|(_, inside)| **inside) {
            *number = region.count as u32;
            region.count += 1;
        }
        region
    }

    fn place(&self, k: usize) -> Place {
        [
            self.origin[0] + self.step * (k % self.width) as f64,
            self.origin[1] + self.step * (k / self.width) as f64,
        ]
    }

    /// Sets the pixels within a distance of a polyline.
    fn stamp(&self, p: &[Place], reach: f64, pixels: &mut [bool], value: bool) {
        self.visit(p, reach, |k, is_near| {
            if pixels[k] != value && is_near() {
                pixels[k] = value;
            }
        });
    }

    /// Calls with each pixel that may be within a distance of a polyline, and with a test whether it is.
    fn visit(&self, p: &[Place], reach: f64, mut call: impl FnMut(usize, &dyn Fn() -> bool)) {
        for pair in p.windows(2) {
            let ends = |c: usize, count: usize| {
                let (a, b) = (pair[0][c].min(pair[1][c]) - reach, pair[0][c].max(pair[1][c]) + reach);
                let first = ((a - self.origin[c]) / self.step).ceil().max(0.0) as usize;
                let last = ((b - self.origin[c]) / self.step).floor();
                (first, if last < 0.0 { 0 } else { (last as usize + 1).min(count) })
            };
            let ((left, right), (top, bottom)) = (ends(0, self.width), ends(1, self.height));
            let d = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
            let square = (d[0] * d[0] + d[1] * d[1]).max(1e-12);
            for y in top..bottom {
                for x in left..right {
                    call(y * self.width + x, &|| {
                        let e = [
                            self.origin[0] + self.step * x as f64 - pair[0][0],
                            self.origin[1] + self.step * y as f64 - pair[0][1],
                        ];
                        let t = ((e[0] * d[0] + e[1] * d[1]) / square).clamp(0.0, 1.0);
                        (e[0] - t * d[0]).powi(2) + (e[1] - t * d[1]).powi(2) <= reach * reach
                    });
                }
            }
        }
    }

    /// Returns a bit for each of its pixels that a curve covers.
    fn covered(&self, p: &[Place], reach: f64) -> Vec<u64> {
        let mut bits = vec![0u64; self.count.div_ceil(64)];
        self.visit(p, reach, |k, is_near| {
            let number = self.numbers[k] as usize;
            if self.numbers[k] != NONE && bits[number / 64] >> (number % 64) & 1 == 0 && is_near() {
                bits[number / 64] |= 1 << (number % 64);
            }
        });
        bits
    }

    /// Returns the area that no cover covers, squared pixels.
    fn find_uncovered(&self, covers: &[&Vec<u64>]) -> f64 {
        let covered: u32 = (0..self.count.div_ceil(64))
            .map(|word| covers.iter().fold(0, |w, c| w | c[word]).count_ones())
            .sum();
        (self.count - covered as usize) as f64 * self.step * self.step
    }
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
    let Zone { skeleton, network, ports, .. } = zone;
    let partners = choose_partners(network, ports);
    (0..ports.len())
        .flat_map(|a| (a + 1..ports.len()).map(move |b| (a, b)))
        .filter(|&(a, b)| {
            let long = network.segments[ports[a].segment].points.len() >= 8;
            partners[a][b] && (ports[a].segment != ports[b].segment || long)
        })
        .map(|(a, b)| ((a, b), Passage::new(skeleton, network, [ports[a], ports[b]])))
        .collect()
}

/// Ranks the ways to join the ports of a zone by links or by free ends; tries at most `most` of them.
fn rank_ways(silhouette: &Silhouette, zone: &Zone, mut joints: Vec<Joint>, most: usize) -> Pairings {
    let Zone { skeleton, network, number, ports } = zone;
    let radius_px = silhouette.radius_px;
    for (a, &port) in ports.iter().enumerate() {
        joints.push(Joint { ports: (a, None), link: make_free_end(silhouette, network, port) });
    }
    let region = Region::new(silhouette, skeleton, network, &network.zones[*number]);
    let covers: Vec<Vec<u64>> =
        joints.iter().map(|j| region.covered(&j.link.full, 1.2 * radius_px + 0.3)).collect();
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
        least: &least,
        region: &region,
        covers: &covers,
        radius_px,
        kisses: HashMap::new(),
        left: [most.min(MAX_TRIED), MAX_WORK],
        ways: Vec::new(),
    };
    let all: Vec<usize> = (0..ports.len()).collect();
    search.join(&all, &mut Vec::new(), 0.0);
    let ways = search.ways;
    Pairings { joints, ways }
}

/// The enumeration of ways.
struct Search<'a> {
    joints: &'a [Joint],
    /// The least cost that each port adds.
    least: &'a [f64],
    region: &'a Region,
    covers: &'a [Vec<u64>],
    radius_px: f64,
    kisses: HashMap<(usize, usize), f64>,
    /// The remaining tries and joints.
    left: [usize; 2],
    /// The best ways so far, the best first.
    ways: Vec<Way>,
}

impl Search<'_> {
    /// Joins the remaining ports: the first of them in every way that is not too expensive.
    fn join(&mut self, rest: &[usize], chosen: &mut Vec<usize>, cost: f64) {
        let work = self.joints.len() * rest.len();
        if self.left[0] == 0 || self.left[1] < work {
            return;
        }
        self.left = [self.left[0] - 1, self.left[1] - work];
        let at_least = cost + rest.iter().map(|&port| self.least[port]).sum::<f64>();
        if self.ways.len() == MAX_KEPT && at_least - 1e-9 > self.ways[MAX_KEPT - 1].cost {
            return;
        }
        let Some(&a) = rest.first() else {
            let kisses = self.kisses(chosen);
            let ends = chosen.iter().map(|&k| &self.joints[k]).filter(|j| j.ports.1.is_none());
            let fixed = kisses + ends.map(|j| j.link.cost).sum::<f64>();
            let covers: Vec<&Vec<u64>> = chosen.iter().map(|&k| &self.covers[k]).collect();
            let bare = UNCOVERED * self.region.find_uncovered(&covers) / (self.radius_px * self.radius_px);
            let cost = cost + kisses + bare;
            let rank = self.ways.partition_point(|way| way.cost <= cost);
            if rank < MAX_KEPT {
                self.ways.insert(rank, Way { cost, fixed, joints: chosen.clone() });
                self.ways.truncate(MAX_KEPT);
            }
            return;
        };
        let mut options: Vec<(f64, usize)> = self
            .joints
            .iter()
            .enumerate()
            .filter(|(_, j)| match j.ports {
                (p, None) => p == a,
                (p, Some(q)) => (p == a && rest.contains(&q)) || (q == a && rest.contains(&p)),
            })
            .map(|(k, j)| (j.link.cost, k))
            .collect();
        options.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        options.truncate(if rest.len() > 6 { 6 } else { 12 });
        for (more, k) in options {
            let (p, q) = self.joints[k].ports;
            let left: Vec<usize> = rest.iter().copied().filter(|&r| r != p && Some(r) != q).collect();
            chosen.push(k);
            self.join(&left, chosen, cost + more);
            chosen.pop();
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
