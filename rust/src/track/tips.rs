//! Where a rope ends, by counting its pixels along it.

use super::camera::Camera;
use super::evidence::{Evidence, is_precise};
use super::view::{Samples, Seen};
use crate::geometry::Point;
use crate::geometry::advance;
use crate::geometry::median::upper_median;

const BIN: f64 = 0.5; // radii
const FROM: f64 = -8.0; // radii from the tip, inwards
const TO: f64 = 9.0; // radii from the tip, outwards
const ACROSS: f64 = 1.6; // radii: pixels that count lie this near to the axis
const SOLID: f64 = 0.5; // fill from which a bin holds rope
const BARE: f64 = 0.3; // fill below which a bin holds none
const RUN: usize = 3; // bins of the shortest stretch of rope
const GAP: usize = 2; // bins without rope that a stretch bridges
const HOLE: usize = 7; // bins without rope between two stretches of one rope
const COVERED_HOLE: f64 = 0.5; // share of a longer hole that something hides
const LEAST_FILL: f64 = 0.3; // of a whole bin, inside the rope
const NEARER: f64 = 2.6; // radii: something this much nearer hides the rope
const BESIDE: f64 = 3.2; // radii: likewise, beside the tip
const GRIPPING: f64 = 0.3; // radii: a gripper that holds the rope is this much nearer
const GRIPPING_NOISE: f64 = 1.0; // of the depth noise: it is nearer by this much more
const GRIPPING_PIXELS: usize = 6; // on every other row and column, that show it
const WINDOW: f64 = 1.6; // radii: half the width of the place beside the tip
const OPEN: f64 = 0.5; // radii: a tip below something is only moved out, by more than this
const MOST: f64 = 8.0; // radii: a tip is moved by no more in a step
const TIP_SD: f64 = 0.35; // radii
const COVER_SD: f64 = 1.0; // radii: of an end that something covers
const COVER_FIRM: f64 = 0.2; // radii: likewise, where the rope's middle is hidden
const LOOSE: f64 = 1.5; // radii: tips missed by this distance count half

/// The end of a rope as an image shows it.
#[derive(Clone, Copy)]
pub struct Tip {
    /// How far the rope is seen beyond its last node, metres; negative if it is seen no more before it.
    pub beyond: f64,
    /// By how much the last node is wrong, metres.
    pub missed: f64,
    /// Whether something covers the rope from there on.
    pub is_covered: bool,
    /// Outwards along the rope, camera's frame.
    pub direction: Point,
    pub weight: f64,
}

/// Finds one end of a rope: its first (`end` 0) or its last (1). `moved` is the way of the fastest node in a frame,
/// and `covered` the length of rope that something has covered at this end, metres.
#[allow(clippy::too_many_arguments)] // all of one image
pub fn find(
    camera: &Camera<'_>,
    samples: &Samples,
    seen: &Seen,
    evidence: &Evidence,
    each: f64,
    rope: usize,
    end: usize,
    (progress, moved): (f64, f64),
    (covered, is_firm): (Option<f64>, bool),
) -> Option<Tip> {
    let (start, stop) = (samples.starts[rope], samples.starts[rope + 1]);
    let tip = if end == 0 { start } else { stop - 1 };
    let sign = if end == 0 { -1.0 } else { 1.0 };
    let (r, step) = (samples.radius[tip], samples.step[tip]);
    let outwards = seen.tangents[tip].map(|x| sign * x);
    let bins = ((TO - FROM) / BIN) as usize;
    let precise = is_precise(evidence.noise);
    let deep = (6.0 + 3.0 * evidence.noise) * r;
    let mut counts = vec![0.0; bins];
    for m in &evidence.matches {
        if m.sample < start || m.sample >= stop || m.across.abs() >= ACROSS * r || m.deep.abs() >= deep {
            continue;
        }
        let own = if precise { m.along_image } else { m.along };
        let x = ((m.sample as f64 - tip as f64) * step + own) * sign / r;
        if x > FROM && x < TO {
            // just below TO the quotient rounds up
            counts[(((x - FROM) / BIN) as usize).min(bins - 1)] += each;
        }
    }
    let area = 2.0 * seen.width(camera, tip, r) * seen.width(camera, tip, BIN * r) * seen.sine[tip];
    let middle = |k: usize| FROM + BIN * (k as f64 + 0.5);
    let place = |k: usize| {
        let x = middle(k) * r;
        if x > 0.0 {
            return advance(seen.places[tip], x, outwards);
        }
        let inner = tip as f64 + (sign * x / step).round();
        seen.places[inner.clamp(start as f64, (stop - 1) as f64) as usize]
    };
    let raw: Vec<f64> = counts.iter().map(|count| count / area.max(1.0)).collect();
    let pixel_of = |k: usize| camera.project(place(k));
    let is_hidden = |k: usize| {
        let [u, v] = pixel_of(k);
        let index = camera.index(u, v);
        index.is_none() || camera.is_before(index, place(k)[2] - NEARER * r)
    };
    let hidden: Vec<bool> = (0..bins).map(is_hidden).collect();
    let inside: Vec<f64> =
        (0..bins).filter(|&k| middle(k) < -1.0 && raw[k] > 0.2 && !hidden[k]).map(|k| raw[k]).collect();
    let usual = upper_median(&inside).unwrap_or(1.0);
    let fill: Vec<f64> = raw.iter().map(|x| (x / usual.max(LEAST_FILL)).clamp(0.0, 1.0)).collect();
    let (first, last) = find_run(&fill, &hidden)?;
    let mut beyond = (middle(last) - 0.5 * BIN + fill[last] * BIN) * r;
    if let Some(next) = fill.get(last + 1) {
        beyond += next * BIN * r;
    }
    let is_blocked = last + 1 < bins && {
        let reach = WINDOW * seen.width(camera, tip, r);
        let near = |k: usize| {
            let [u, v] = pixel_of(k);
            let z = place(k)[2];
            let [far, near] = camera.count_before(
                [u, v],
                reach,
                z - BESIDE * r,
                z - (GRIPPING + GRIPPING_NOISE * evidence.noise) * r,
            );
            camera.index(u, v).is_none() || far > 0 || near >= GRIPPING_PIXELS
        };
        let other = |k: usize| {
            let [u, v] = pixel_of(k);
            fill[k] < BARE && camera.index(u, v).is_some_and(|i| camera.mask[i])
        };
        (last..(last + 4).min(bins)).any(near) || (last + 1..(last + 3).min(bins)).all(other)
    };
    if first > 0 && middle(first) > 0.0 {
        return None;
    }
    beyond = beyond.clamp(-MOST * r, MOST * r);
    // a gripper that covers an end moves with it: as much of the rope is hidden as before
    let is_covered = is_blocked && (covered.is_some() || beyond < OPEN * r);
    let missed = if is_covered { beyond + covered.unwrap_or(-beyond) } else { beyond };
    let loose = LOOSE * r + 2.0 * moved;
    let doubt = 1.0 + (missed / loose).powi(2);
    // an end that is seen counts wherever it is; what covers another one may have let it go
    let cover = if is_firm { COVER_FIRM * doubt.sqrt() } else { COVER_SD * doubt };
    let sd = if is_covered { cover } else { TIP_SD * doubt.sqrt() } * r * (1.0 + 2.0 * (1.0 - progress));
    Some(Tip { beyond, missed, is_covered, direction: outwards, weight: 1.0 / (sd * sd) })
}

/// Returns first and last bin of the stretch of rope that begins farthest inside. It goes on beyond holes in the mask, and
/// beyond what hides the rope, such as a gripper from which the tip sticks out.
fn find_run(fill: &[f64], hidden: &[bool]) -> Option<(usize, usize)> {
    let mut runs: Vec<(usize, usize, usize)> = Vec::new();
    for k in (0..fill.len()).filter(|&k| fill[k] > SOLID) {
        match runs.last_mut() {
            Some(run) if k - run.1 <= GAP => *run = (run.0, k, run.2 + 1),
            _ => runs.push((k, k, 1)),
        }
    }
    let begin = runs.iter().position(|run| run.2 >= RUN).unwrap_or(0);
    let mut found = *runs.get(begin)?;
    for run in &runs[begin + 1..] {
        let hole = found.1 + 1..run.0;
        let covered = hole.clone().filter(|&k| hidden[k]).count();
        if run.2 >= RUN && (hole.len() < HOLE || covered as f64 >= COVERED_HOLE * hole.len() as f64) {
            found.1 = run.1;
        }
    }
    Some((found.0, found.1))
}
