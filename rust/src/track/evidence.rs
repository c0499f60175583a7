//! What the pixels of one image say of the samples: how far off they lie, across the rope and in depth.

use super::camera::{Camera, Pixel};
use super::nearest::Nearest;
use super::slopes::Slopes;
use super::view::{Samples, Seen};
use crate::geometry::Point;
use crate::geometry::advance;
use crate::geometry::median::measure_spread;

const DEEP: f64 = 0.6; // weight of a difference of depth when pixels look for their sample
const FIRST_GATE: f64 = 9.0; // radii: distance of a pixel from its sample in the first step
const LAST_GATE: f64 = 3.0; // radii: distance of a pixel from its sample in the last step
const SURFACE: f64 = 0.8; // radii: mean distance from the surface to the axis
const OUTSIDE: f64 = 1.5; // radii: in late steps, pixels farther across do not count
const LATE: f64 = 0.6; // of all steps
const MIDDLE: f64 = 0.6; // radii: depth is read from pixels this near to the middle
const SIDE_WEIGHT: f64 = 0.15; // of depth beside the middle
const MIN_SINE: f64 = 0.4; // of the angle between rope and ray, when depth is turned into the axis
const LEAST_NOISE: f64 = 0.08; // radii: depth noise
const MOST_NOISE: f64 = 1.5; // radii: depth noise
const PRECISE: f64 = 0.24; // radii: below this depth noise, the image's places along a rope are better than depth's
const ROUND: f64 = 0.4; // radii: below this depth noise, depth shows that a rope is round
const LATERAL_SD: f64 = 0.12; // radii: of a sample's mean across the rope
const DEPTH_SD: f64 = 0.1; // radii: of a sample's mean depth, without noise
const CORRELATED: f64 = 6.0; // pixels that share their error of depth
const FULL: f64 = 0.6; // share of the width that is seen where both edges are
const MIN_PART: f64 = 0.12; // share of the width below which a sample is not seen
const MIN_PIXELS: f64 = 1.5; // below which a sample is not seen
const FAR: f64 = 4.0; // radii: lateral residuals of this size count half
const EXPLAINED: f64 = 2.2; // radii in the image: pixels farther from all samples are not explained
const BEFORE: f64 = 6.0; // radii: pixels this much nearer than their sample are not explained

/// The sample that a pixel belongs to, and where it lies from there, metres.
#[derive(Clone, Copy)]
pub struct Match {
    pub sample: usize,
    pub across: f64,
    pub deep: f64,
    pub along: f64,
    /// Along the rope as the image shows it.
    pub along_image: f64,
    /// Beyond the first or the last sample.
    pub beyond: bool,
    pub weight: f64,
}

/// What one image says.
pub struct Evidence {
    pub matches: Vec<Match>,
    /// Standard deviation of depth, radii of the first rope.
    pub noise: f64,
    /// Share of a sample's width that its pixels fill.
    pub part: Vec<f64>,
    /// Whether pixels support a sample.
    pub on: Vec<bool>,
    /// Mean residual across the rope and in depth, metres.
    pub across: Vec<f64>,
    pub deep: Vec<f64>,
    /// Weight of both, 1/m².
    pub weights: Vec<[f64; 2]>,
}

/// Matches pixels with samples and averages their residuals. `progress` runs from 0 in the first step to 1.
pub fn measure(
    camera: &Camera<'_>,
    pixels: &[Pixel],
    each: f64,
    samples: &Samples,
    seen: &Seen,
    progress: f64,
) -> Evidence {
    let matches = match_pixels(camera, pixels, samples, seen, progress);
    let radius = samples.radius.first().copied().unwrap_or(1.0);
    let noise = measure_noise(&matches, radius);
    let count = samples.len();
    let (mut number, mut all, mut deep_all) = (vec![0.0; count], vec![0.0; count], vec![0.0; count]);
    let (mut across, mut deep) = (vec![0.0; count], vec![0.0; count]);
    let mut slopes = vec![Slopes::default(); count];
    for m in matches.iter().filter(|m| m.weight > 0.0 && !m.beyond) {
        let r = samples.radius[m.sample];
        let scale = 2.5 * (noise * radius).max(0.3 * r).max(2.0 * r * (1.0 - progress));
        let side = if m.across.abs() < MIDDLE * r { 1.0 } else { SIDE_WEIGHT };
        let near = 1.0 / (1.0 + (m.deep / scale).powi(2));
        let w = side * near;
        number[m.sample] += each;
        all[m.sample] += 1.0;
        deep_all[m.sample] += w;
        across[m.sample] += m.across;
        deep[m.sample] += w * m.deep;
        slopes[m.sample].add(m.across, m.deep, r, near * near);
    }
    let mut evidence = Evidence {
        matches,
        noise,
        part: vec![0.0; count],
        on: vec![false; count],
        across: vec![0.0; count],
        deep: vec![0.0; count],
        weights: vec![[0.0; 2]; count],
    };
    let loose = 1.0 + 3.0 * (1.0 - progress);
    for j in 0..count {
        let r = samples.radius[j];
        let width = seen.width(camera, j, r);
        let full = 2.0 * width * seen.width(camera, j, samples.step[j]) * seen.sine[j];
        let part = (number[j] / full.max(1.0)).min(1.0);
        let on = number[j] > (MIN_PART * full).max(MIN_PIXELS);
        evidence.part[j] = part;
        evidence.on[j] = on;
        if !on {
            continue;
        }
        let mean = across[j] / all[j];
        let whole = part > FULL;
        let sd = LATERAL_SD * r * (1.0 / part.max(0.05)).sqrt() * if whole { 1.0 } else { 3.0 };
        let by_mask = 1.0 / ((sd * loose).powi(2) * (1.0 + (mean / (FAR * r)).powi(2)));
        let (way, w) = if noise < ROUND { slopes[j].solve(r, noise * radius * loose) } else { (0.0, 0.0) };
        evidence.across[j] = (by_mask * mean + w * way) / (by_mask + w);
        evidence.weights[j][0] = by_mask + w;
        if deep_all[j] > 0.0 {
            evidence.deep[j] = deep[j] / deep_all[j];
            let random = (noise * radius).powi(2) * CORRELATED / number[j].max(1.0);
            let sd = ((DEPTH_SD * r).powi(2) + random).sqrt() * if whole { 1.0 } else { 2.0 };
            evidence.weights[j][1] = 1.0 / (sd * loose).powi(2);
        }
    }
    evidence
}

fn match_pixels(
    camera: &Camera<'_>,
    pixels: &[Pixel],
    samples: &Samples,
    seen: &Seen,
    progress: f64,
) -> Vec<Match> {
    let radius = samples.radius.iter().copied().fold(0.0, f64::max);
    let gate = (FIRST_GATE + (LAST_GATE - FIRST_GATE) * progress) * radius;
    let nearest = index(camera, seen);
    let mut is_end = vec![0i8; samples.len()];
    for pair in samples.starts.windows(2) {
        is_end[pair[0]] = -1;
        is_end[pair[1] - 1] = 1;
    }
    let mut matches = Vec::with_capacity(pixels.len());
    for pixel in pixels {
        let inner = camera.lift(pixel.u, pixel.v, pixel.z + SURFACE * radius);
        let Some((j, _)) = nearest.find(inner, [pixel.u, pixel.v], gate, DEEP) else { continue };
        let r = samples.radius[j];
        let first = seen.split(j, inner)[0];
        let inside = (r * r - first.abs().min(0.95 * r).powi(2)).max(0.0).sqrt();
        let surface = camera.lift(pixel.u, pixel.v, pixel.z - camera.bias);
        let axis = advance(surface, inside / seen.sine[j].max(MIN_SINE), seen.rays[j]);
        let [across, deep, along] = seen.split(j, axis);
        let [gu, gv] = seen.along[j];
        let [u, v] = seen.pixels[j];
        let least = (0.3 * camera.pinhole.focal[0] / seen.places[j][2]).powi(2);
        let along_image = ((pixel.u - u) * gu + (pixel.v - v) * gv) / (gu * gu + gv * gv).max(least);
        let counts = across.abs() < OUTSIDE * r || progress < LATE;
        let beyond = f64::from(is_end[j]) * along > 1.2 * samples.step[j];
        let weight = if counts { 1.0 } else { 0.0 };
        matches.push(Match { sample: j, across, deep, along, along_image, beyond, weight });
    }
    matches
}

fn index<'a>(camera: &Camera<'_>, seen: &'a Seen) -> Nearest<'a> {
    let pixel = 1.0 / camera.pinhole.focal[0];
    Nearest::new(&seen.places, &seen.pixels, camera.width, camera.height(), pixel)
}

/// Returns the standard deviation of depth about the ropes, radii.
fn measure_noise(matches: &[Match], radius: f64) -> f64 {
    let deep: Vec<f64> = matches.iter().filter(|m| m.weight > 0.0).map(|m| m.deep).collect();
    let enough = (deep.len() > 20).then_some(deep);
    enough.and_then(measure_spread).map_or(1.0, |(_, sd)| (sd / radius).clamp(LEAST_NOISE, MOST_NOISE))
}

/// Tells whether depth is so precise that the image gives places along a rope.
pub fn is_precise(noise: f64) -> bool {
    noise < PRECISE
}

/// Returns the share of the pixels that no rope explains. The image decides, because pixels at an edge may show the depth
/// of what lies behind; only what is far nearer than the rope is something else.
pub fn find_unexplained(camera: &Camera<'_>, pixels: &[Pixel], samples: &Samples, seen: &Seen) -> f64 {
    let flat: Vec<Point> = seen.pixels.iter().map(|&[u, v]| [u, v, 0.0]).collect();
    let nearest = Nearest::new(&flat, &seen.pixels, camera.width, camera.height(), 1.0);
    let widest = (0..samples.len()).map(|j| seen.width(camera, j, samples.radius[j])).fold(0.0, f64::max);
    let is_bare = |pixel: &&Pixel| {
        let place = [pixel.u, pixel.v];
        nearest.find([pixel.u, pixel.v, 1.0], place, EXPLAINED * widest, 0.0).is_none_or(|(j, d)| {
            let r = samples.radius[j];
            d > EXPLAINED * seen.width(camera, j, r) || pixel.z < seen.places[j][2] - BEFORE * r
        })
    };
    pixels.iter().filter(is_bare).count() as f64 / pixels.len().max(1) as f64
}
