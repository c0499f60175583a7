//! Segments, zones and ports of a mask's skeleton.

use super::planar::{Place, distance, length, resampled, smoothed};
use super::skeleton::Net;
use crate::images::strokes::Strokes;
use crate::images::thinning::thinned;

const WIDE: f64 = 1.35; // the skeleton of more than one strand is farther than this from the edge, image radii
const ZONE_PAD: f64 = 0.3; // margin of zones around the mask's width at a junction, image radii
/// Length of spurs out of the strand that they leave, image radii: for most readings, and for those that look for ends
/// beside another strand.
pub const SPURS: [f64; 2] = [0.35, -0.4];
const MAX_STACK: f64 = 12.0; // length of a stack of two strands between two zones at most, image radii

/// The pruned skeleton of a mask, and the zones where strands merge.
pub struct Skeleton {
    net: Net,
    /// Whether each pixel is in a zone.
    zone: Vec<bool>,
    /// Places of the pixels in the image.
    places: Vec<Place>,
    /// Distance from the mask's edge, pixels.
    depth: Vec<f64>,
    scale: f64,
}

/// A stretch with one strand.
#[derive(Debug, Clone)]
pub struct Segment {
    /// Nodes, half a radius apart.
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
    /// Whether each segment is so short that it may be nothing, with one end at a zone and the other free.
    pub stubs: Vec<bool>,
}

impl Skeleton {
    /// Prunes spurs of a mask's skeleton that reach out at most `spur` image radii, and finds zones.
    pub fn new(strokes: &Strokes, radius_px: f64, spur: f64) -> Self {
        let scale = strokes.scale as f64;
        let [width, height] = strokes.size;
        let mut pixels = strokes.skeleton.clone();
        let depth_at = |k: usize| strokes.depth(k);
        let (net, junction) = loop {
            let net = Net::new(pixels, width);
            let junction: Vec<bool> = (0..net.len()).map(|i| net.near(i).len() >= 3).collect();
            let gone = find_spurs(&net, &junction, spur * radius_px, radius_px, scale, depth_at);
            if gone.is_empty() {
                break (net, junction);
            }
            let mut kept = vec![true; net.len()];
            for i in gone {
                kept[i as usize] = false;
            }
            let left = net.pixels.iter().zip(&kept).filter(|&(_, &kept)| kept).map(|(&k, _)| k);
            pixels = thinned(left, width, height);
        };
        let place = |k: usize| strokes.original(k % width, k / width);
        let places: Vec<Place> = net.pixels.iter().map(|&k| place(k)).collect();
        let depth: Vec<f64> = net.pixels.iter().map(|&k| depth_at(k)).collect();
        let zone = find_zones(&net, &junction, &places, &depth, radius_px, scale);
        Self { net, zone, places, depth, scale }
    }

    /// Divides the skeleton into segments and zones.
    ///
    /// Pixels of `hidden` join zones. With `contract`, so does a short stretch between two zones with odd numbers of
    /// ports: two strands may be stacked there.
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
                .filter(|(long, _)| contract && *long < MAX_STACK * radius_px)
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

    /// Returns whether two skeletons have the same lines, and so the same zones.
    pub fn is_same(&self, other: &Self) -> bool {
        self.net.pixels == other.net.pixels
    }

    /// Returns the index of a pixel in the magnified image.
    pub fn pixel(&self, i: u32) -> usize {
        self.net.pixels[i as usize]
    }

    /// Returns the place of a pixel in the image.
    pub fn place(&self, i: u32) -> Place {
        self.places[i as usize]
    }

    /// Returns the distance of a pixel from the mask's edge, pixels.
    pub fn depth(&self, i: u32) -> f64 {
        self.depth[i as usize]
    }

    /// Returns the pixel of a zone that is nearest to a place; the first of several.
    pub fn nearest(&self, zone: &[u32], to: Place) -> Option<u32> {
        let away = |i: u32| {
            let place = self.place(i);
            (place[0] - to[0]).powi(2) + (place[1] - to[1]).powi(2)
        };
        let squares = zone.iter().map(|&i| (away(i), i));
        squares.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, i)| i)
    }

    /// Finds the shortest ways through a zone's pixels from one of them.
    pub fn ways<'a>(&'a self, zone: &'a [u32], first: u32) -> Ways<'a> {
        let mut before = vec![u32::MAX; zone.len()];
        let mut queue = std::collections::VecDeque::from([first]);
        let at = |i: u32| zone.binary_search(&i).ok();
        if let Some(k) = at(first) {
            before[k] = first;
        }
        while let Some(i) = queue.pop_front() {
            for &n in self.net.near(i as usize) {
                if let Some(k) = at(n)
                    && before[k] == u32::MAX
                {
                    before[k] = i;
                    queue.push_back(n);
                }
            }
        }
        Ways { skeleton: self, zone, first, before }
    }
}

/// The shortest ways through a zone's pixels from one of them.
pub struct Ways<'a> {
    skeleton: &'a Skeleton,
    zone: &'a [u32],
    first: u32,
    /// The pixel before each pixel of the zone; `u32::MAX` if no way leads there.
    before: Vec<u32>,
}

impl Ways<'_> {
    /// Returns the places on the way to a pixel; None if there is no way.
    pub fn to(&self, last: u32) -> Option<Vec<Place>> {
        let mut way = vec![self.skeleton.place(last)];
        let mut i = last;
        while i != self.first {
            i = self.before[self.zone.binary_search(&i).ok()?];
            if i == u32::MAX {
                return None;
            }
            way.push(self.skeleton.place(i));
        }
        way.reverse();
        Some(way)
    }
}

/// Finds pixels of branches that are no strands: the shortest branch of each junction, so that a fork at an end keeps
/// one.
fn find_spurs(
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
            // a separate piece
            if (line.path.len() as f64) < 2.0 * radius_px * scale && lines.len() > 1 {
                gone.extend(&line.path);
            }
        } else if a == 0 || b == 0 {
            let j = a.max(b) as usize;
            let long = measure_line(net, &line.path) / scale;
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

/// Measures the length of a line of pixels.
fn measure_line(net: &Net, path: &[u32]) -> f64 {
    path.windows(2).map(|w| net.step(w[0], w[1])).sum()
}

/// Finds the pixels of zones: where the mask is wide, and near junctions.
fn find_zones(
    net: &Net,
    junction: &[bool],
    places: &[Place],
    depth: &[f64],
    radius_px: f64,
    scale: f64,
) -> Vec<bool> {
    let n = net.len();
    let junctions: Vec<usize> = (0..n).filter(|&i| junction[i]).collect();
    let reach = |j: usize| depth[j] + ZONE_PAD * radius_px;
    let farthest = junctions.iter().map(|&j| reach(j)).fold(0.0, f64::max);
    // pixels and junctions ascend row by row; those in rows farther away reach no pixel
    let (mut first, mut last) = (0, 0);
    let row = |i: usize| places[i][1];
    let mut zone: Vec<bool> = (0..n)
        .map(|i| {
            while last < junctions.len() && row(junctions[last]) <= row(i) + farthest {
                last += 1;
            }
            while first < last && row(junctions[first]) < row(i) - farthest {
                first += 1;
            }
            let nearest = junctions[first..last]
                .iter()
                .map(|&j| (distance(places[i], places[j]), j))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            depth[i] > WIDE * radius_px || nearest.is_some_and(|(away, j)| away < reach(j))
        })
        .collect();
    for _ in 0..2 {
        // short single strands beside a zone belong to it
        let single: Vec<bool> = zone.iter().map(|z| !z).collect();
        for group in list_members(net, &single) {
            let touches = group.iter().any(|&i| net.near(i).iter().any(|&k| zone[k as usize]));
            if (group.len() as f64) < 1.2 * radius_px * scale && touches {
                group.iter().for_each(|&i| zone[i] = true);
            }
        }
        // short wide pieces without a junction are one strand
        for group in list_members(net, &zone) {
            let long = group.len() as f64 / scale;
            let wide = group.iter().map(|&i| depth[i]).fold(0.0, f64::max);
            if !group.iter().any(|&i| junction[i])
                && (long < radius_px || (wide < 1.5 * radius_px && long < 3.0 * radius_px))
            {
                group.iter().for_each(|&i| zone[i] = false);
            }
        }
    }
    // a tip inside a zone is the end of a rope: its last pixels become a segment
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

/// Lists the pixels of each connected group of chosen pixels.
fn list_members(net: &Net, chosen: &[bool]) -> Vec<Vec<usize>> {
    let (numbers, count) = net.groups(chosen);
    let mut members = vec![Vec::new(); count];
    for (i, &number) in numbers.iter().enumerate() {
        if number != 0 {
            members[number as usize - 1].push(i);
        }
    }
    members
}
