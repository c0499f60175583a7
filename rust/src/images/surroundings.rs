//! What one camera saw of the places where ropes may run: something before them, the ropes, what is behind them, or nothing.
//!
//! A mask ends where a rope ends, where something hides it, or where a segmenter lost it. Depth tells these apart.

use crate::clouds::depth::has_return;
use crate::geometry::median::upper_median;
use crate::images::image::{Image, blobs, distances};
use crate::images::relief::Relief;

/// What is seen of a place, against the ropes that are around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    /// No depth, or none that tells.
    Unknown,
    /// Something hides what is there.
    Before,
    /// As deep as the ropes.
    Level,
    /// The camera sees through to what is behind.
    Behind,
}

/// How far around the ropes is looked, radius_px.
const AROUND: f64 = 15.0;
/// Side of a cell, radius_px.
const CELL: f64 = 0.4;
/// Surroundings are this far from the mask, radius_px.
const BESIDE: [f64; 2] = [1.5, 5.0];
/// What hides stands this much before the ropes, radii, is as large as this, radius_px², and this near to the mask, radius_px.
const BEFORE: f64 = 2.5;
const LARGE: f64 = 4.0;
const NEAR: f64 = 1.5;
/// What has no depth hides if it is as large as this, radius_px², and less than this share of the surroundings.
const LARGE_UNSEEN: f64 = 9.0;
const MOST_UNSEEN: f64 = 0.4;
/// What is no deeper than this below the ropes' surface may be rope, radii.
const LEVEL: f64 = 1.5;
/// Fewest places beside the ropes that show what is behind them.
const FEWEST: usize = 20;

/// The pixels of ropes in an image.
pub struct Ropes<'a> {
    /// A part of the image.
    pub mask: &'a Image<bool>,
    /// Column and row of the part's first pixel.
    pub corner: [f64; 2],
    /// The ropes' radius, pixels.
    pub radius_px: f64,
}

/// A grid of what is shown.
#[derive(Debug, Clone)]
pub struct Surroundings {
    relief: Relief,
    low: [f64; 2],
    cell: f64,
    shown: Image<Shown>,
    /// Whether anything hides.
    hides: bool,
    radius: f64,
    limits: Limits,
}

/// What depths mean that are so far before the ropes' surface, radii.
#[derive(Debug, Clone)]
struct Limits {
    /// Above this they hide the ropes.
    before: f64,
    /// Below this they are behind; none if depth does not tell.
    behind: Option<f64>,
    /// Below this they are behind, whatever the noise.
    far: f64,
    /// The share of the surroundings without depth.
    unseen: f64,
}

impl Limits {
    /// Of places on the ropes and beside them; none if no rope has depth.
    fn new(rope: &[bool], away: &[f32], ahead: &[f64]) -> Option<Self> {
        let on: Vec<f64> =
            rope.iter().zip(ahead).filter(|(r, a)| **r && a.is_finite()).map(|(_, a)| *a).collect();
        if on.is_empty() {
            return None;
        }
        let noise = spread(on).1;
        let is_beside = |far: f32| f64::from(far) > BESIDE[0] && f64::from(far) < BESIDE[1];
        let beside: Vec<f64> =
            away.iter().zip(ahead).filter(|(far, _)| is_beside(**far)).map(|(_, a)| *a).collect();
        let unseen = beside.iter().filter(|a| a.is_nan()).count() as f64 / beside.len().max(1) as f64;
        let ground: Vec<f64> = beside.into_iter().filter(|a| *a < 0.5 * BEFORE).collect();
        let behind = (ground.len() >= FEWEST).then(|| spread(ground)).and_then(|(middle, wide)| {
            // midway, if depth tells the ropes from what is behind
            let limit = (0.5 * middle).max(-LEVEL);
            (middle < limit - wide && limit < -noise).then_some(limit)
        });
        Some(Self { before: BEFORE.max(4.0 * noise), behind, far: -LEVEL - 2.0 * noise, unseen })
    }

    fn shown(&self, ahead: f64) -> Shown {
        if ahead.is_nan() {
            Shown::Unknown
        } else if ahead > self.before {
            Shown::Before
        } else if ahead < self.behind.unwrap_or(self.far) {
            Shown::Behind
        } else if self.behind.is_some() {
            Shown::Level
        } else {
            Shown::Unknown
        }
    }
}

/// The middle, and the standard deviation that the middle of the distances from it shows.
fn spread(mut values: Vec<f64>) -> (f64, f64) {
    let middle = upper_median(&mut values);
    values.iter_mut().for_each(|value| *value = (*value - middle).abs());
    (middle, 1.4826 * upper_median(&mut values))
}

/// Makes blobs of chosen places hide what is there if they are large and near the mask, the others unknown; and tells whether
/// any hides.
fn keep_large(
    shown: &mut Image<Shown>,
    away: &Image<f32>,
    chosen: impl Fn(usize) -> bool,
    large: f64,
) -> bool {
    let values = (0..shown.values.len()).map(chosen).collect();
    let found = blobs(&Image { width: shown.width, height: shown.height, values }, true, true);
    let mut near = vec![false; found.sizes.len()];
    for run in &found.runs {
        let far = &away.values[run.row * away.width..][run.begin..run.end];
        near[run.blob] |= far.iter().any(|&far| f64::from(far) < NEAR);
    }
    for run in &found.runs {
        let hides = near[run.blob] && found.sizes[run.blob] as f64 > large;
        let value = if hides { Shown::Before } else { Shown::Unknown };
        shown.values[run.row * shown.width..][run.begin..run.end].fill(value);
    }
    found.sizes.iter().zip(near).any(|(&size, near)| near && size as f64 > large)
}

impl Surroundings {
    /// Of a depth image of `width` columns, its mask and the ropes in it; the ropes' radius in metres. None if too little of the
    /// mask has depth.
    pub fn new(depth: &[f64], mask: &[bool], width: usize, ropes: &Ropes<'_>, radius: f64) -> Option<Self> {
        let &Ropes { mask: own, corner, radius_px } = ropes;
        let frame = [own.width, own.height];
        let inside = |x: usize, y: usize| {
            let [i, j] = [x as f64 - corner[0], y as f64 - corner[1]];
            i >= 0.0
                && j >= 0.0
                && i < frame[0] as f64
                && j < frame[1] as f64
                && own.at(i as usize, j as usize)
        };
        let (reach, size) = (AROUND * radius_px, [width, depth.len() / width.max(1)]);
        let low = corner.map(|c| (c - reach).max(0.0) as usize);
        let high = [0, 1].map(|c| ((corner[c] + frame[c] as f64 + reach) as usize).min(size[c]));
        let on_rope = |x: usize, y: usize| mask[y * width + x] && inside(x, y);
        let relief = Relief::new(depth, width, on_rope, low, high, radius_px)?;
        let cell = (CELL * radius_px).round().max(1.0);
        let step = cell as usize;
        let [w, h] = [0, 1].map(|c| (high[c] - low[c]).div_ceil(step));
        let pixels: Vec<[usize; 2]> = (0..w * h)
            .map(|k| [k % w, k / w])
            .map(|at| [0, 1].map(|c| (low[c] + at[c] * step + step / 2).min(high[c] - 1)))
            .collect();
        let ahead: Vec<f64> = pixels
            .iter()
            .map(|&[x, y]| {
                let z = depth[y * width + x];
                let ahead = (relief.depth([x as f64, y as f64]) - z) / radius;
                if has_return(z) { ahead } else { f64::NAN }
            })
            .collect();
        let rope = Image { width: w, height: h, values: pixels.iter().map(|&[x, y]| inside(x, y)).collect() };
        // how far from the mask, radius_px
        let mut away = distances(&rope, false, (BESIDE[1] * radius_px / cell) as usize + 2);
        away.values.iter_mut().for_each(|far| *far *= (cell / radius_px) as f32);
        let limits = Limits::new(&rope.values, &away.values, &ahead)?;
        let mut shown =
            Image { width: w, height: h, values: ahead.iter().map(|&a| limits.shown(a)).collect() };
        let area = cell * cell / (radius_px * radius_px);
        let mut hides = keep_large(&mut shown, &away, |k| ahead[k] > limits.before, LARGE / area);
        if limits.unseen < MOST_UNSEEN {
            hides |= keep_large(&mut shown, &away, |k| ahead[k].is_nan(), LARGE_UNSEEN / area);
        }
        Some(Self { relief, low: low.map(|l| l as f64), cell, shown, hides, radius, limits })
    }

    /// What is shown of a place.
    pub fn at(&self, uv: [f64; 2]) -> Shown {
        let [x, y] = [0, 1].map(|c| ((uv[c] - self.low[c]) / self.cell).floor());
        if x < 0.0 || y < 0.0 || x >= self.shown.width as f64 || y >= self.shown.height as f64 {
            return Shown::Unknown;
        }
        self.shown.at(x as usize, y as usize)
    }

    /// Whether something hides what is at a place, or within a cell of it.
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

    /// Whether depth tells ropes from what is behind them.
    pub fn tells(&self) -> bool {
        self.limits.behind.is_some()
    }

    /// How far a pixel lies before the ropes' surface, radii; none without a return.
    pub fn ahead(&self, uv: [f64; 2], z: f64) -> Option<f64> {
        has_return(z).then(|| (self.relief.depth(uv) - z) / self.radius)
    }

    /// Whether what lies so far before the ropes' surface, radii, is what is behind them.
    pub fn is_behind(&self, ahead: f64) -> bool {
        self.limits.behind.is_some_and(|limit| ahead < limit)
    }

    /// Whether a pixel of this depth lies so far before the ropes that it is none.
    pub fn before(&self, uv: [f64; 2], z: f64) -> bool {
        self.ahead(uv, z).is_some_and(|ahead| ahead > self.limits.before)
    }
}
