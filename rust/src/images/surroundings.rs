//! Depth around the ropes of one camera: something in front of them, the ropes, the background, or nothing.
//!
//! A mask ends where a rope ends, where something hides it, or where a segmenter lost it. Depth distinguishes these
//! cases.

use crate::clouds::depth::has_return;
use crate::geometry::cut_off;
use crate::geometry::median::measure_spread;
use crate::images::distances::measure_distances;
use crate::images::image::{Image, find_blobs, find_runs};
use crate::images::relief::Relief;
use crate::parallel;
use crate::simd::kernel;

/// The depth at a place, relative to the ropes around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    /// No depth, or no decision from it.
    Unknown,
    /// Something in front of the ropes.
    Before,
    /// Something as deep as the ropes.
    Level,
    /// The background: the camera sees through.
    Behind,
}

const RANGE: f64 = 15.0; // range around the ropes, image radii
const CELL: f64 = 0.4; // side of a cell, image radii
const BESIDE: [f64; 2] = [1.5, 5.0]; // distances from the mask between which places count as beside it, image radii
const MIN_BEFORE: f64 = 2.5; // height of things in front of the ropes at least, radii
const MIN_AREA: f64 = 4.0; // area of things that hide ropes at least, squared image radii
const MAX_DISTANCE: f64 = 1.5; // distance of things that hide ropes from the mask at most, image radii
const MIN_AREA_UNSEEN: f64 = 9.0; // area of things without depth that hide ropes at least, squared image radii
const MAX_UNSEEN: f64 = 0.4; // share of places without depth beside the mask, above which these hide nothing
const LEVEL: f64 = 1.5; // places up to this far behind the ropes' surface may be rope, radii
const MIN_PLACES: usize = 20; // places beside the ropes at least that show the background
const TOGETHER: usize = 32; // places that are compared together

/// The pixels of ropes in an image.
pub struct Ropes<'a> {
    /// A part of the image.
    pub mask: &'a Image<bool>,
    /// Column and row of the part's first pixel.
    pub corner: [f64; 2],
    /// The ropes' radius, pixels.
    pub radius_px: f64,
}

/// A grid around the ropes of what the camera shows there.
#[derive(Debug, Clone)]
pub struct Surroundings {
    relief: Relief,
    low: [f64; 2],
    cell: f64,
    shown: Image<Shown>,
    /// Whether anything hides the ropes.
    hides: bool,
    radius: f64,
    limits: Limits,
}

/// Limits of heights above the ropes' surface, radii.
#[derive(Debug, Clone)]
struct Limits {
    /// Higher places are in front of the ropes.
    before: f64,
    /// Lower places are behind; None if depth does not decide.
    behind: Option<f64>,
    /// Lower places are behind despite the noise.
    far: f64,
    /// Share of the places beside the ropes without depth.
    unseen: f64,
}

impl Limits {
    /// Derives limits from places on the ropes and beside them; None if no place on a rope has depth.
    fn new(rope: &[bool], away: &[f32], ahead: &[f64]) -> Option<Self> {
        let on = find_runs(rope).flat_map(|run| &ahead[run]).copied().filter(|a| a.is_finite());
        let noise = measure_spread(on.collect())?.1;
        let mut beside = Vec::new();
        keep_beside(away, ahead, &mut beside);
        let unseen = beside.iter().filter(|a| a.is_nan()).count() as f64 / beside.len().max(1) as f64;
        let ground: Vec<f64> = beside.into_iter().filter(|a| *a < 0.5 * MIN_BEFORE).collect();
        let spread = (ground.len() >= MIN_PLACES).then_some(ground).and_then(measure_spread);
        let behind = spread.and_then(|(middle, wide)| {
            // midway, if depth separates the ropes from the background
            let limit = (0.5 * middle).max(-LEVEL);
            (middle < limit - wide && limit < -noise).then_some(limit)
        });
        Some(Self { before: MIN_BEFORE.max(4.0 * noise), behind, far: -LEVEL - 2.0 * noise, unseen })
    }

    /// Tells what the camera shows at places of some heights.
    fn judge(&self, ahead: &[f64], shown: &mut [Shown]) {
        match self.behind {
            Some(behind) => compare(ahead, [self.before, behind], Shown::Level, shown),
            None => compare(ahead, [self.before, self.far], Shown::Unknown, shown),
        }
    }
}

kernel! {
    /// Compares heights with the limits of what is in front of the ropes and behind them; others are `between`.
    fn compare<S>(_, ahead: &[f64], limits: [f64; 2], between: Shown, to: &mut [Shown]) {
        let [before, behind] = limits;
        for (to, &ahead) in to.iter_mut().zip(ahead) {
            let seen = if ahead < behind { Shown::Behind } else { between };
            let seen = if ahead > before { Shown::Before } else { seen };
            *to = if ahead.is_nan() { Shown::Unknown } else { seen };
        }
    }
}

kernel! {
    /// Adds the heights of places beside the ropes to others, given how far places are from the mask, image radii.
    fn keep_beside<S>(_, away: &[f32], ahead: &[f64], kept: &mut Vec<f64>) {
        let [near, distant] = BESIDE.map(|limit| limit as f32);
        for (away, ahead) in away.chunks(TOGETHER).zip(ahead.chunks(TOGETHER)) {
            let mut any = false;
            for &far in away {
                any |= (far > near) & (far < distant);
            }
            if any {
                // a branch for each place would often be mispredicted
                let (mut own, mut count) = ([0.0; TOGETHER], 0);
                for (&far, &height) in away.iter().zip(ahead) {
                    own[count] = height;
                    count += usize::from((far > near) & (far < distant));
                }
                kept.extend_from_slice(&own[..count]);
            }
        }
    }
}

kernel! {
    /// Turns depths of the ropes' surface into its distances from seen depths, radii; NaN where there is no return.
    fn turn_to_heights<S>(_, seen: &[f64], radius: f64, surface: &mut [f64]) {
        for (surface, &z) in surface.iter_mut().zip(seen) {
            *surface = if has_return(z) { (*surface - z) / radius } else { f64::NAN };
        }
    }
}

/// Lets large blobs of chosen places near the mask hide the ropes, makes other blobs unknown, and returns whether any
/// hides.
fn keep_large(
    shown: &mut Image<Shown>,
    away: &Image<f32>,
    chosen: impl Fn(usize) -> bool,
    large: f64,
) -> bool {
    let values = (0..shown.values.len()).map(chosen).collect();
    let found = find_blobs(&Image { width: shown.width, height: shown.height, values }, true, true);
    let mut near = vec![false; found.sizes.len()];
    for run in &found.runs {
        let far = &away.values[run.row * away.width..][run.begin..run.end];
        near[run.blob] |= far.iter().any(|&far| f64::from(far) < MAX_DISTANCE);
    }
    for run in &found.runs {
        let hides = near[run.blob] && found.sizes[run.blob] as f64 > large;
        let value = if hides { Shown::Before } else { Shown::Unknown };
        shown.values[run.row * shown.width..][run.begin..run.end].fill(value);
    }
    found.sizes.iter().zip(near).any(|(&size, near)| near && size as f64 > large)
}

impl Surroundings {
    /// Examines a depth image of `width` columns with its mask and the ropes in it; `radius` is the ropes' radius,
    /// metres.
    ///
    /// None if too little of the mask has depth.
    pub fn new(depth: &[f64], mask: &[bool], width: usize, ropes: &Ropes<'_>, radius: f64) -> Option<Self> {
        let &Ropes { mask: own, corner, radius_px } = ropes;
        let frame = [own.width, own.height];
        let first = corner.map(|c| c as isize);
        let (reach, size) = (RANGE * radius_px, [width, depth.len() / width.max(1)]);
        let low = corner.map(|c| (c - reach).max(0.0) as usize);
        let high = [0, 1].map(|c| ((corner[c] + frame[c] as f64 + reach) as usize).min(size[c]));
        let ropes = (low[1]..high[1]).flat_map(|y| {
            let row = y.wrapping_add_signed(-first[1]);
            let own = if row < frame[1] { &own.values[row * frame[0]..][..frame[0]] } else { &[] };
            let (mask, depth) = (&mask[y * width..], &depth[y * width..]);
            let columns = move |value: usize| value.wrapping_add_signed(first[0]);
            find_runs(own)
                .flatten()
                .map(columns)
                .filter(move |&x| (low[0]..high[0]).contains(&x) && mask[x])
                .map(move |x| [x as f64, y as f64, depth[x]])
        });
        let seen = Relief::keep_seen(ropes, radius_px)?;
        let cell = (CELL * radius_px).round().max(1.0);
        let step = cell as usize;
        let places = [0, 1].map(|c| -> Vec<usize> {
            (low[c]..high[c]).step_by(step).map(|from| (from + step / 2).min(high[c] - 1)).collect()
        });
        let [columns, rows] = &places;
        let (w, h) = (columns.len(), rows.len());
        let mut rope = Image::filled(w, h, false);
        let [within, across] = [0, 1].map(|c| {
            let count_before = |end: isize| places[c].partition_point(|&x| (x as isize) < end);
            count_before(first[c])..count_before(first[c] + frame[c] as isize)
        });
        for n in across {
            let own = &own.values[rows[n].wrapping_add_signed(-first[1]) * frame[0]..][..frame[0]];
            let rope = &mut rope.values[n * w..][within.clone()];
            for (rope, &x) in rope.iter_mut().zip(&columns[within.clone()]) {
                *rope = own[x.wrapping_add_signed(-first[0])];
            }
        }
        let (relief, mut away) = parallel::both(
            || Relief::new(&seen, low, high, radius_px),
            || measure_distances(&rope, false, (BESIDE[1] * radius_px / cell) as usize + 2),
        );
        let relief = relief?;
        let mut ahead = relief.depths(columns, rows);
        for (ahead, &y) in ahead.chunks_exact_mut(w.max(1)).zip(rows) {
            let row = &depth[y * width..][..width];
            if step == 1 {
                turn_to_heights(&row[low[0]..high[0]], radius, ahead);
            } else {
                let seen: Vec<f64> = columns.iter().map(|&x| row[x]).collect();
                turn_to_heights(&seen, radius, ahead);
            }
        }
        // distance from the mask, image radii
        away.values.iter_mut().for_each(|far| *far *= (cell / radius_px) as f32);
        let limits = Limits::new(&rope.values, &away.values, &ahead)?;
        let mut shown = Image::filled(w, h, Shown::Unknown);
        limits.judge(&ahead, &mut shown.values);
        let area = cell * cell / (radius_px * radius_px);
        let mut hides = keep_large(&mut shown, &away, |k| ahead[k] > limits.before, MIN_AREA / area);
        if limits.unseen < MAX_UNSEEN {
            hides |= keep_large(&mut shown, &away, |k| ahead[k].is_nan(), MIN_AREA_UNSEEN / area);
        }
        Some(Self { relief, low: low.map(|l| l as f64), cell, shown, hides, radius, limits })
    }

    /// Returns what the camera shows at a place.
    pub fn at(&self, uv: [f64; 2]) -> Shown {
        let [x, y] = [0, 1].map(|c| (uv[c] - self.low[c]) / self.cell);
        if x < 0.0 || y < 0.0 || x >= self.shown.width as f64 || y >= self.shown.height as f64 {
            return Shown::Unknown;
        }
        self.shown.at(cut_off(x) as usize, cut_off(y) as usize)
    }

    /// Returns whether something hides a place, or a place within a cell of it.
    pub fn hidden(&self, uv: [f64; 2]) -> bool {
        self.hides
            && [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
                .iter()
                .any(|d| self.at([uv[0] + d[0] * self.cell, uv[1] + d[1] * self.cell]) == Shown::Before)
    }

    /// Whether anything hides a part of the ropes.
    pub fn hides(&self) -> bool {
        self.hides
    }

    /// Whether depth separates the ropes from the background.
    pub fn tells(&self) -> bool {
        self.limits.behind.is_some()
    }

    /// Returns the height of a pixel above the ropes' surface, radii; None without a return.
    pub fn ahead(&self, uv: [f64; 2], z: f64) -> Option<f64> {
        has_return(z).then(|| (self.relief.depth(uv) - z) / self.radius)
    }

    /// Returns whether a height above the ropes' surface, radii, is that of the background.
    pub fn is_behind(&self, ahead: f64) -> bool {
        self.limits.behind.is_some_and(|limit| ahead < limit)
    }

    /// Returns whether a pixel of this depth lies in front of the ropes.
    pub fn before(&self, uv: [f64; 2], z: f64) -> bool {
        self.ahead(uv, z).is_some_and(|ahead| ahead > self.limits.before)
    }
}
