//! What a mask's skeleton says: stretches where one strand is seen, zones where strands merge, and ports between them.

use super::planar::{Place, apart, length, resampled, smoothed};
use super::skeleton::Net;
use crate::images::image::Image;
use crate::images::silhouette::Silhouette;
use crate::images::thinning::thinned;

/// A skeleton is wider than one strand where its distance from the edge is above this, radii.
const WIDE: f64 = 1.35;
/// Zones reach this much farther than the mask's width at a junction, radii.
const ZONE_PAD: f64 = 0.3;
/// Branches of a skeleton that reach no farther than this out of the strand that they leave are spurs, radii: of most
/// readings, and of those that look for ends beside another strand.
pub const SPURS: [f64; 2] = [0.35, -0.4];
/// Stretches between two zones with odd numbers of ports that hide two strands are shorter than this, radii.
const STACK: f64 = 12.0;

/// The pruned skeleton of a mask, and where strands merge.
pub struct Skeleton {
    net: Net,
    /// Which pixels are in zones.
    zone: Vec<bool>,
    /// Places of the pixels in the image.
    places: Vec<Place>,
    /// Distance from the mask's edge, pixels.
    depth: Vec<f64>,
    scale: f64,
}

/// A stretch where one strand is seen.
#[derive(Debug, Clone)]
pub struct Segment {
    /// Half a radius apart.
    pub points: Vec<Place>,
    /// The zone at each end, from 1 on; 0 for none.
    pub zones: [u32; 2],
    /// Pixels of the skeleton, in order.
    pub path: Vec<u32>,
}

/// An end of a segment at a zone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Port {
    pub segment: usize,
    /// 0: the segment's first point, 1: its last.
    pub end: usize,
    pub zone: u32,
}

/// One reading of a skeleton.
pub struct Network {
    pub segments: Vec<Segment>,
    pub ports: Vec<Port>,
    /// Pixels of each zone, ascending.
    pub zones: Vec<Vec<u32>>,
    /// Segments so short that they may be nothing: one end at a zone, the other free.
    pub stubs: Vec<bool>,
}

impl Skeleton {
    /// Thins a mask, prunes spurs that reach out no farther than `spur` radii, and finds zones.
    pub fn new(silhouette: &Silhouette, spur: f64) -> Self {
        let radius_px = silhouette.radius_px;
        let scale = silhouette.scale as f64;
        let width = silhouette.inside.width;
        let mut numbers = Image::filled(width, silhouette.inside.height, 0u32);
        let mut pixels = silhouette.skeleton.clone();
        let depth_at = |k: usize| f64::from(silhouette.depth.values[k]);
        let (net, junction) = loop {
            let net = Net::new(pixels, width, &mut numbers);
            let junction: Vec<bool> = (0..net.len()).map(|i| net.near(i).len() >= 3).collect();
            let gone = spurs(&net, &junction, spur * radius_px, radius_px, scale, depth_at);
            if gone.is_empty() {
                break (net, junction);
            }
            let mut kept = vec![true; net.len()];
            for i in gone {
                kept[i as usize] = false;
            }
            let left = net.pixels.iter().zip(&kept).filter(|&(_, &kept)| kept).map(|(&k, _)| k);
            pixels = thinned(left, width, silhouette.inside.height);
        };
        let place = |k: usize| silhouette.original(k % width, k / width);
        let places: Vec<Place> = net.pixels.iter().map(|&k| place(k)).collect();
        let depth: Vec<f64> = net.pixels.iter().map(|&k| depth_at(k)).collect();
        let zone = zones(&net, &junction, &places, &depth, radius_px, scale);
        Self { net, zone, places, depth, scale }
    }

    /// Reads it as segments and zones.
    ///
    /// With `contract`, a short single strand between two zones with odd numbers of ports becomes zone: two strands may be
    /// stacked there. Pixels of `hidden` become zone too.
    pub fn read(&self, radius_px: f64, contract: bool, hidden: &[u32]) -> Network {
        let mut zone = self.zone.clone();
        for &i in hidden {
            zone[i as usize] = true;
        }
        loop {
            let (numbers, count) = self.net.groups(&zone);
            let single: Vec<bool> = zone.iter().map(|z| !z).collect();
            let mut segments = Vec::new();
            let mut ports = Vec::new();
            for line in self.net.lines(&single, &numbers) {
                let raw: Vec<Place> = line.path.iter().map(|&i| self.places[i as usize]).collect();
                let smooth = smoothed(&raw, (3.0 * self.scale) as usize);
                let points = if length(&smooth) > 0.5 * radius_px {
                    resampled(&smooth, 0.5 * radius_px)
                } else {
                    smooth
                };
                let zones = if line.path.len() == 1 { [line.ends[0], 0] } else { line.ends };
                for (end, &number) in zones.iter().enumerate() {
                    if number != 0 {
                        ports.push(Port { segment: segments.len(), end, zone: number });
                    }
                }
                segments.push(Segment { points, zones, path: line.path });
            }
            let odd = |z: u32| z != 0 && ports.iter().filter(|p| p.zone == z).count() % 2 == 1;
            let hides = segments
                .iter()
                .filter(|s| s.zones[0] != s.zones[1] && odd(s.zones[0]) && odd(s.zones[1]))
                .map(|s| (length(&s.points), s))
                .filter(|(long, _)| contract && *long < STACK * radius_px)
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, segment)) = hides {
                for &i in &segment.path {
                    zone[i as usize] = true;
                }
                continue;
            }
            let stubs = segments
                .iter()
                .map(|s| (s.zones[0] == 0) != (s.zones[1] == 0) && length(&s.points) < 2.0 * radius_px)
                .collect();
            let mut zones = vec![Vec::new(); count];
            for (i, &number) in numbers.iter().enumerate() {
                if number != 0 {
                    zones[number as usize - 1].push(i as u32);
                }
            }
            return Network { segments, ports, zones, stubs };
        }
    }

    /// Whether two are the same lines, and so the same zones.
    pub fn is_same(&self, other: &Self) -> bool {
        self.net.pixels == other.net.pixels
    }

    /// The place of a pixel in the magnified image.
    pub fn pixel(&self, i: u32) -> usize {
        self.net.pixels[i as usize]
    }

    /// Where pixels lie in the image.
    pub fn place(&self, i: u32) -> Place {
        self.places[i as usize]
    }

    /// How far pixels are from the mask's edge, pixels.
    pub fn depth(&self, i: u32) -> f64 {
        self.depth[i as usize]
    }

    /// The shortest way through a zone's pixels between those nearest to two places.
    pub fn way(&self, zone: &[u32], from: Place, to: Place) -> Option<Vec<Place>> {
        let nearest = |x: Place| {
            zone.iter().copied().min_by(|&a, &b| apart(self.place(a), x).total_cmp(&apart(self.place(b), x)))
        };
        let (first, last) = (nearest(from)?, nearest(to)?);
        let at = |i: u32| zone.binary_search(&i).ok();
        let mut before = vec![u32::MAX; zone.len()];
        before[at(first)?] = first;
        let mut queue = std::collections::VecDeque::from([first]);
        while let Some(i) = queue.pop_front() {
            if i == last {
                break;
            }
            for &n in self.net.near(i as usize) {
                if let Some(k) = at(n)
                    && before[k] == u32::MAX
                {
                    before[k] = i;
                    queue.push_back(n);
                }
            }
        }
        let mut way = vec![self.place(last)];
        let mut i = last;
        while i != first {
            let b = before[at(i)?];
            if b == u32::MAX {
                return None;
            }
            i = b;
            way.push(self.place(i));
        }
        way.reverse();
        Some(way)
    }
}

/// Pixels of branches that are no strands: the shortest one of each junction, so that an end's fork keeps a prong.
fn spurs(
    net: &Net,
    junction: &[bool],
    spur: f64,
    radius_px: f64,
    scale: f64,
    depth: impl Fn(usize) -> f64,
) -> Vec<u32> {
    let (numbers, count) = net.groups(junction);
    let mut wide = vec![0.0f64; count + 1];
    for (i, &number) in numbers.iter().enumerate() {
        if number != 0 {
            wide[number as usize] = wide[number as usize].max(depth(net.pixels[i]));
        }
    }
    let single: Vec<bool> = junction.iter().map(|j| !j).collect();
    let lines = net.lines(&single, &numbers);
    let mut gone = Vec::new();
    let mut shortest: Vec<Option<(f64, usize)>> = vec![None; count + 1];
    for (k, line) in lines.iter().enumerate() {
        let [a, b] = line.ends;
        if a == 0 && b == 0 {
            // a crumb
            if (line.path.len() as f64) < 2.0 * radius_px * scale && lines.len() > 1 {
                gone.extend(&line.path);
            }
        } else if a == 0 || b == 0 {
            let j = a.max(b) as usize;
            let long = line_length(net, &line.path) / scale;
            if long < wide[j] + spur && shortest[j].is_none_or(|(least, _)| long < least) {
                shortest[j] = Some((long, k));
            }
        }
    }
    for (_, k) in shortest.into_iter().flatten() {
        gone.extend(&lines[k].path);
    }
    gone
}

/// The length of a line of pixels.
fn line_length(net: &Net, path: &[u32]) -> f64 {
    path.windows(2).map(|w| net.step(w[0], w[1])).sum()
}

/// Which pixels are in zones: where the mask is wide, and near junctions.
fn zones(
    net: &Net,
    junction: &[bool],
    places: &[Place],
    depth: &[f64],
    radius_px: f64,
    scale: f64,
) -> Vec<bool> {
    let n = net.len();
    let junctions: Vec<usize> = (0..n).filter(|&i| junction[i]).collect();
    let mut zone: Vec<bool> = (0..n)
        .map(|i| {
            let nearest = junctions
                .iter()
                .map(|&j| (apart(places[i], places[j]), j))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            depth[i] > WIDE * radius_px
                || nearest.is_some_and(|(away, j)| away < depth[j] + ZONE_PAD * radius_px)
        })
        .collect();
    for _ in 0..2 {
        // short single strands beside a zone belong to it
        let single: Vec<bool> = zone.iter().map(|z| !z).collect();
        for group in members(net, &single) {
            let touches = group.iter().any(|&i| net.near(i).iter().any(|&k| zone[k as usize]));
            if (group.len() as f64) < 1.2 * radius_px * scale && touches {
                group.iter().for_each(|&i| zone[i] = true);
            }
        }
        // short wide bits without a junction are one strand
        for group in members(net, &zone) {
            let long = group.len() as f64 / scale;
            let wide = group.iter().map(|&i| depth[i]).fold(0.0, f64::max);
            if !group.iter().any(|&i| junction[i])
                && (long < radius_px || (wide < 1.5 * radius_px && long < 3.0 * radius_px))
            {
                group.iter().for_each(|&i| zone[i] = false);
            }
        }
    }
    // a tip inside a zone is a rope's end: its last pixels become a segment
    let tips: Vec<usize> = (0..n).filter(|&i| zone[i] && net.near(i).len() == 1).collect();
    for tip in tips {
        let mut stub = vec![tip];
        let mut front = vec![tip];
        for _ in 0..((0.5 * radius_px * scale) as usize).max(3) {
            let mut next = Vec::new();
            for &i in &front {
                for &k in net.near(i) {
                    if !stub.contains(&(k as usize)) {
                        stub.push(k as usize);
                        next.push(k as usize);
                    }
                }
            }
            front = next;
        }
        stub.iter().for_each(|&i| zone[i] = false);
    }
    zone
}

/// Pixels of each connected group of chosen ones.
fn members(net: &Net, chosen: &[bool]) -> Vec<Vec<usize>> {
    let (numbers, count) = net.groups(chosen);
    let mut members = vec![Vec::new(); count];
    for (i, &number) in numbers.iter().enumerate() {
        if number != 0 {
            members[number as usize - 1].push(i);
        }
    }
    members
}
