//! One frame of a tracker: the ropes move from their last state to where the images show them.

use super::bias;
use super::camera::{Camera, Pixel};
use super::evidence;
use super::motion::{self, Equations, Lower, Prior, add_outer, find_tangents};
use super::openings::{self, Look, Table, weigh_pull};
use super::rope::{Rope, SAMPLES, length};
use super::tips;
use super::view::{Samples, Seen};
use crate::geometry::Point;
use crate::geometry::{advance, dot, sub};

const MIN_PIXELS: usize = 30; // of all images: with fewer, nothing is seen
const WINDOW: usize = 2 * SAMPLES; // samples on each side over which residuals are averaged
const LEAST_MOTION: f64 = 0.004; // radii: standard deviation of a node's unforeseen motion
const NOTICED: f64 = 0.06; // radii: mean residuals below this are noise
const NOTICED_NOISE: f64 = 0.2; // of the depth noise: likewise
const MOTION_SHARE: f64 = 0.7; // of a mean residual's square that is taken for motion
const MOST_MOTION: f64 = 6.0; // radii
const HIDDEN_LEAST: f64 = 0.2; // radii: standard deviation of a hidden node
const HIDDEN_MORE: f64 = 0.8; // radii: that a frame adds
const TIPS_SD: f64 = 0.25; // radii: standard deviation of a slide that both tips show
const TIP_NOISE: f64 = 0.8; // radii: tips missed by less in one frame are ragged
const TIPS_NOISE: f64 = 0.2; // radii: likewise, in the mean of the last frames
const SLID_SHARE: f64 = 0.3; // of the last frame in that mean
const SLIDE_RATE: f64 = 0.7; // of the distance by which tips are missed
const SLIDE_MOVED: f64 = 0.2; // of the unforeseen motion
const SLIDE_SEEN: f64 = 0.03; // radii: of sliding, where a tip was seen
const SLIDE_HIDDEN: f64 = 0.12; // radii: likewise, where none was
const GAIN: f64 = 0.65; // of new velocities
const STEADY: f64 = 0.25; // radii: velocities of a rope at rest change half as much where a node is this near to its prediction
const FADE_AGE: f64 = 0.1; // s: hidden for longer, velocities fade
const FADE: f64 = 0.85; // a frame of 1/30 s
const LOST_FADE: f64 = 0.6; // a frame of 1/30 s, where nothing is seen
const FRAME: f64 = 1.0 / 30.0; // s
const MOST_VARIANCE: f64 = 12.0; // radii: standard deviation of a node
const HIDDEN_NODE: f64 = 0.4; // share of its samples below which a node is hidden
const MOST_COVERED: f64 = 8.0; // radii of an end that a gripper may cover
const COVER_SHARE: f64 = 0.05; // of what is covered now in the mean of the last frames

/// What a frame is asked with.
#[derive(Clone, Copy)]
pub struct Options {
    pub steps: usize,
    /// Time since the last state, s.
    pub elapsed: f64,
    /// Share of a new bias of depth that is taken.
    pub bias_gain: f64,
    /// Whether the ropes were laid anew, so that the prediction says little.
    pub free: bool,
}

/// What a frame says of one rope, beside its state.
pub struct Found {
    pub covariances: Vec<[Point; 3]>,
    /// Share of each node's samples that pixels support.
    pub seen: Vec<f64>,
    pub hidden: Vec<bool>,
    /// Share of the samples that a camera saw through.
    pub through: f64,
    /// By how much both tips say that the rope is longer than its nodes, metres; None if one was not seen.
    pub longer: Option<f64>,
}

/// What a frame says.
pub struct Outcome {
    pub ropes: Vec<Found>,
    /// Share of the ropes' pixels that no rope explains.
    pub unexplained: f64,
    pub pixels: usize,
    /// Standard deviation of each camera's depth, radii.
    pub noise: Vec<f64>,
}

/// Moves the ropes to where the images show them.
pub fn update(
    cameras: &mut [Camera<'_>],
    ropes: &mut [Rope],
    table: Option<Table>,
    options: Options,
) -> Outcome {
    let read: Vec<(Vec<Pixel>, f64)> = cameras.iter().map(Camera::read).collect();
    let pixels: usize = read.iter().map(|(list, each)| (list.len() as f64 * each) as usize).sum();
    let before: Vec<Vec<Point>> = ropes.iter().map(|rope| rope.nodes.clone()).collect();
    for rope in ropes.iter_mut() {
        for (node, &v) in rope.nodes.iter_mut().zip(&rope.velocities) {
            *node = advance(*node, options.elapsed, v);
        }
    }
    if pixels < MIN_PIXELS && ropes.iter().all(|rope| rope.holds.is_empty()) {
        let found = ropes.iter_mut().map(|rope| coast(rope, options.elapsed)).collect();
        return Outcome { ropes: found, unexplained: 0.0, pixels, noise: vec![0.0; cameras.len()] };
    }
    let samples = Samples::new(ropes);
    let mut priors: Vec<Prior> = vec![];
    let mut factors = vec![];
    let mut longer = vec![None; ropes.len()];
    let mut looks: Vec<Look> = vec![];
    for step in 0..options.steps {
        let progress = step as f64 / (options.steps - 1).max(1) as f64;
        looks = cameras
            .iter()
            .zip(&read)
            .map(|(camera, (list, each))| {
                let seen = Seen::new(camera, &samples, ropes);
                let evidence = evidence::measure(camera, list, *each, &samples, &seen, progress);
                let openings = openings::look(camera, &samples, &seen, &evidence, table);
                (seen, evidence, openings)
            })
            .collect();
        if step == 0 {
            priors = foresee(cameras, &samples, &looks, ropes, options);
        }
        if step + 1 == options.steps {
            bias::learn(cameras, &samples, &looks, table, options.bias_gain);
        }
        factors.clear();
        for (number, rope) in ropes.iter_mut().enumerate() {
            let mut equations = Equations::new(rope.len());
            for j in samples.starts[number]..samples.starts[number + 1] {
                let (information, product) = gather(cameras, &looks, j);
                equations.add_place(&samples.weights[j], &information, product);
            }
            add_pulls(cameras, &looks, &samples, number, &mut equations);
            let prior = &mut priors[number];
            let (tips, covered) =
                add_tips(cameras, &read, &looks, &samples, number, progress, prior, rope, &mut equations);
            let both = tips[0].zip(tips[1]).filter(|_| covered == [false; 2]);
            longer[number] = both.map(|(first, last)| first + last);
            if step == 0 {
                let slid = find_slide(tips);
                rope.slid = slid.map(|x| rope.slid.map_or(x, |mean| mean + SLID_SHARE * (x - mean)));
                prior.slack = measure_slack(rope, slid, prior.surprise);
            }
            equations.add_prior(rope, prior, &find_tangents(&rope.nodes), table);
            factors.push(equations.step(rope));
        }
    }
    let mut found = vec![];
    for (number, rope) in ropes.iter_mut().enumerate() {
        let covariances = factors[number]
            .as_ref()
            .map_or_else(|| vec![[[0.0; 3]; 3]; rope.len()], |f| motion::list_covariances(f, rope.len()));
        let times = (options.elapsed, priors[number].slack);
        let mut own = settle(rope, &before[number], covariances, &samples, number, &looks, times);
        own.longer = longer[number];
        found.push(own);
    }
    let bare: f64 = cameras
        .iter()
        .zip(&read)
        .map(|(camera, (list, each))| {
            let seen = Seen::new(camera, &samples, ropes);
            evidence::find_unexplained(camera, list, &samples, &seen) * list.len() as f64 * each
        })
        .sum();
    Outcome {
        ropes: found,
        unexplained: bare / pixels.max(1) as f64,
        pixels,
        noise: looks.iter().map(|look| look.1.noise).collect(),
    }
}

/// Lets a rope go on where nothing is seen.
fn coast(rope: &mut Rope, elapsed: f64) -> Found {
    let fade = LOST_FADE.powf(elapsed / FRAME);
    let step = rope.fastest() * elapsed;
    let count = rope.len();
    for i in 0..count {
        rope.velocities[i] = rope.velocities[i].map(|x| fade * x);
        rope.age[i] += elapsed;
        let more = (HIDDEN_MORE * rope.radius).powi(2) + (0.5 * step).powi(2);
        rope.variance[i] = (rope.variance[i] + more).min((MOST_VARIANCE * rope.radius).powi(2));
        rope.noise[i] = (2.0 * rope.radius).powi(2);
    }
    rope.slid = None;
    let spread = |v: f64| [[v, 0.0, 0.0], [0.0, v, 0.0], [0.0, 0.0, v]];
    Found {
        covariances: rope.variance.iter().map(|&v| spread(v)).collect(),
        seen: vec![0.0; count],
        hidden: vec![true; count],
        through: 0.0,
        longer: None,
    }
}

/// Returns what the prediction says, from how wrong it was: residuals that neighbours share are motion, the rest noise.
fn foresee(
    cameras: &[Camera<'_>],
    samples: &Samples,
    looks: &[Look],
    ropes: &mut [Rope],
    options: Options,
) -> Vec<Prior> {
    let mut residuals = vec![[0.0; 3]; samples.len()];
    let mut on = vec![0.0; samples.len()];
    for (camera, (seen, evidence, _)) in cameras.iter().zip(looks) {
        for j in (0..samples.len()).filter(|&j| evidence.on[j]) {
            let own: Point = std::array::from_fn(|k| {
                evidence.across[j] * seen.lateral[j][k] + evidence.deep[j] * seen.deep[j][k]
            });
            let world = camera.turn(own);
            for k in 0..3 {
                residuals[j][k] += world[k];
            }
            on[j] += 1.0;
        }
    }
    let noise = looks.iter().map(|look| look.1.noise).fold(0.0, f64::max);
    let noticed = NOTICED.max(NOTICED_NOISE * noise);
    let mut priors = vec![];
    for (number, rope) in ropes.iter_mut().enumerate() {
        let (start, stop) = (samples.starts[number], samples.starts[number + 1]);
        let (r, count) = (rope.radius, rope.len());
        let mut largest = 0.0f64;
        for i in 0..count {
            let middle = start + i * SAMPLES;
            let around = middle.saturating_sub(WINDOW).max(start)..(middle + WINDOW + 1).min(stop);
            let weight: f64 = on[around.clone()].iter().sum();
            if weight > SAMPLES as f64 {
                let mut mean = [0.0; 3];
                for j in around {
                    for k in 0..3 {
                        mean[k] += residuals[j][k] / weight;
                    }
                }
                let squared = dot(mean, mean);
                largest = largest.max(squared);
                let more =
                    (MOTION_SHARE * (squared - (noticed * r).powi(2))).clamp(0.0, (MOST_MOTION * r).powi(2));
                rope.noise[i] = (LEAST_MOTION * r).powi(2) + more;
            } else {
                let step = HIDDEN_MORE * length(rope.velocities[i]) * options.elapsed;
                rope.noise[i] =
                    rope.noise[i].max((HIDDEN_LEAST * r).powi(2)) + (HIDDEN_MORE * r).powi(2) + step * step;
            }
        }
        let seen: Vec<usize> = (0..count).filter(|&i| rope.age[i] == 0.0).collect();
        let away = |i: usize| {
            let near = seen.iter().map(|&s| s.abs_diff(i)).min().unwrap_or(count / 2);
            near as f64 * rope.spacing
        };
        priors.push(Prior {
            base: rope.nodes.clone(),
            sd: (0..count).map(|i| (rope.variance[i] + rope.noise[i]).sqrt()).collect(),
            slack: SLIDE_HIDDEN * r,
            moved: (rope.fastest() * options.elapsed).max(largest.sqrt() - noticed * r),
            surprise: (largest.sqrt() - noticed * r).max(0.0),
            hidden: (0..count).map(|i| (rope.age[i] > 0.0).then(|| away(i))).collect(),
            last: rope.last.clone(),
            free: options.free,
        });
    }
    priors
}

/// Returns by how far the tips say that a rope slid, towards its last node, metres; None if no tip was seen.
fn find_slide(tips: [Option<f64>; 2]) -> Option<f64> {
    match tips {
        [Some(first), Some(last)] => Some(0.5 * (last - first)),
        [Some(first), None] => Some(-first),
        [None, last] => last,
    }
}

/// Returns by how much a rope may slide along itself in a frame, metres: what is far beyond the noise of tips is a slide.
fn measure_slack(rope: &Rope, slid: Option<f64>, surprise: f64) -> f64 {
    let r = rope.radius;
    let beyond = |way: Option<f64>, noise: f64| way.map_or(0.0, |x| x.abs() - noise * r);
    let missed = beyond(slid, TIP_NOISE).max(beyond(rope.slid, TIPS_NOISE)).max(0.0);
    let least = if slid.is_some() { SLIDE_SEEN } else { SLIDE_HIDDEN };
    least * r + SLIDE_RATE * missed + SLIDE_MOVED * surprise
}

/// Returns what all cameras say of a sample: information and its product with the residual, world frame.
fn gather(cameras: &[Camera<'_>], looks: &[Look], j: usize) -> (Lower, Point) {
    let (mut information, mut product) = ([0.0; 6], [0.0; 3]);
    for (camera, (seen, evidence, _)) in cameras.iter().zip(looks) {
        let [across, deep] = evidence.weights[j];
        for (w, residual, d) in
            [(across, evidence.across[j], seen.lateral[j]), (deep, evidence.deep[j], seen.deep[j])]
        {
            if w > 0.0 {
                let d = camera.turn(d);
                information = add_outer(information, d, w);
                product = advance(product, w * residual, d);
            }
        }
    }
    (information, product)
}

fn add_pulls(
    cameras: &[Camera<'_>],
    looks: &[Look],
    samples: &Samples,
    number: usize,
    equations: &mut Equations,
) {
    let own = samples.starts[number]..samples.starts[number + 1];
    for (camera, (_, _, openings)) in cameras.iter().zip(looks) {
        for &(j, direction, distance) in openings.pulls.iter().filter(|pull| own.contains(&pull.0)) {
            let w = weigh_pull(distance, samples.radius[j], motion::SAMPLES_A_NODE);
            let d = camera.turn(direction);
            equations.add_place(&samples.weights[j], &add_outer([0.0; 6], d, w), d.map(|x| w * distance * x));
        }
    }
}

#[allow(clippy::too_many_arguments)] // all of one step
fn add_tips(
    cameras: &[Camera<'_>],
    read: &[(Vec<Pixel>, f64)],
    looks: &[Look],
    samples: &Samples,
    number: usize,
    progress: f64,
    prior: &Prior,
    rope: &mut Rope,
    equations: &mut Equations,
) -> ([Option<f64>; 2], [bool; 2]) {
    let is_firm = prior.hides_middle();
    let mut missed = [None; 2];
    let mut covered_ends = [false; 2];
    for ((camera, (_, each)), (seen, evidence, _)) in cameras.iter().zip(read).zip(looks) {
        for end in 0..2 {
            let at = (progress, prior.moved + prior.slack);
            let most = MOST_COVERED * rope.radius;
            let covered = rope.covers[end].filter(|&length| length < most);
            let Some(tip) =
                tips::find(camera, samples, seen, evidence, *each, number, end, at, (covered, is_firm))
            else {
                continue;
            };
            if progress == 1.0 {
                rope.covers[end] = match (tip.is_covered, rope.covers[end]) {
                    (false, _) => None,
                    (true, None) => Some(-tip.beyond),
                    // where the middle is hidden, nothing else tells where the rope slides
                    (true, Some(length)) if is_firm => Some(length),
                    (true, Some(length)) => Some(length + COVER_SHARE * (-tip.beyond - length)),
                };
            }
            // the other end, where it is seen, tells better where the rope slides
            let is_told = rope.covers[1 - end].is_none() && !is_firm;
            if tip.is_covered && (covered.is_none() || is_told) {
                continue;
            }
            let j = if end == 0 { samples.starts[number] } else { samples.starts[number + 1] - 1 };
            let d = camera.turn(tip.direction);
            let information = add_outer([0.0; 6], d, tip.weight);
            equations.add_place(&samples.weights[j], &information, d.map(|x| tip.weight * tip.missed * x));
            missed[end] = Some(tip.missed);
            covered_ends[end] = tip.is_covered;
        }
    }
    (missed, covered_ends)
}

/// Returns how much of a change of velocity is taken; half of the most where it moves a node by `noise` in a frame.
fn find_gain(way: f64, noise: f64) -> f64 {
    GAIN * way * way / (way * way + noise * noise)
}

/// Takes the new positions as the state: velocities, variances, and what was seen.
fn settle(
    rope: &mut Rope,
    before: &[Point],
    covariances: Vec<[Point; 3]>,
    samples: &Samples,
    number: usize,
    looks: &[Look],
    (elapsed, slack): (f64, f64),
) -> Found {
    let (start, stop) = (samples.starts[number], samples.starts[number + 1]);
    let count = rope.len();
    let on = |j: usize| looks.iter().any(|look| look.1.on[j]);
    let tangents = find_tangents(&rope.nodes);
    // along the rope, and the rest
    let changes: Vec<[f64; 4]> = (0..count)
        .map(|i| {
            let v = sub(rope.nodes[i], before[i]).map(|x| x / elapsed);
            let change = sub(v, rope.velocities[i]);
            let slide = dot(change, tangents[i]);
            let [x, y, z] = advance(change, -slide, tangents[i]);
            [slide, x, y, z]
        })
        .collect();
    // tips alone tell that the whole rope slides, so a change of that speed is as sure as they are
    let common = changes.iter().map(|change| change[0]).sum::<f64>() / count as f64;
    let steady = GAIN * slack * slack / (slack * slack + (TIPS_SD * rope.radius).powi(2));
    let mut found =
        Found { covariances, seen: vec![0.0; count], hidden: vec![false; count], through: 0.0, longer: None };
    for i in 0..count {
        let middle = start + i * SAMPLES;
        let around = middle.saturating_sub(2).max(start)..(middle + 3).min(stop);
        let share = around.clone().filter(|&j| on(j)).count() as f64 / around.len() as f64;
        let covered = looks.iter().all(|look| look.2.hidden[middle]);
        found.seen[i] = share;
        found.hidden[i] = share < HIDDEN_NODE || covered;
        let [slide, ..] = changes[i];
        let aside = [changes[i][1], changes[i][2], changes[i][3]];
        let speed = length(advance(rope.velocities[i], -dot(rope.velocities[i], tangents[i]), tangents[i]));
        let noise = STEADY * rope.radius / (1.0 + speed * elapsed / rope.radius);
        let across = find_gain(length(aside) * elapsed, noise);
        let stretch = slide - common;
        let along = find_gain(stretch * elapsed, noise) * stretch + steady * common;
        let v = advance(advance(rope.velocities[i], across, aside), along, tangents[i]);
        if found.hidden[i] {
            rope.age[i] += elapsed;
        } else {
            rope.age[i] = 0.0;
            rope.last[i] = rope.nodes[i];
        }
        let fade = if rope.age[i] > FADE_AGE { FADE.powf(elapsed / FRAME) } else { 1.0 };
        rope.velocities[i] = v.map(|x| fade * x);
        // along the rope, the tips tell more than a node's own pixels
        let (c, t) = (&found.covariances[i], tangents[i]);
        let along: f64 = (0..3).map(|k| t[k] * dot(c[k], t)).sum();
        let across = 0.5 * (c[0][0] + c[1][1] + c[2][2] - along);
        rope.variance[i] = across.max(0.0).min((MOST_VARIANCE * rope.radius).powi(2));
    }
    let through = (start..stop).filter(|&j| looks.iter().any(|look| look.2.through[j])).count();
    found.through = through as f64 / (stop - start) as f64;
    found
}
