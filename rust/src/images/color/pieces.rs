//! Pieces of strips: connected regions of each width, and what decides whether they are rope.

use super::levels::shrunk;
use super::region::{Region, find_region};
use super::strips::Strips;
use super::{Planes, color, difference2, median, size};
use crate::images::distances::measure_distances;
use crate::images::image::{Blobs, Image, find_blobs};
use crate::parallel;

const LOW: f32 = 0.75; // least response of a strip's pixels
const HIGH: f32 = 1.5; // least response somewhere on a strip
const BAND: [f32; 2] = [0.9, 1.6]; // half widths of strips that make one band, of its half width
const FINE: f64 = 4.0; // pixels: half width of the strips of a band, in an image made smaller for it
const NO_CLASS: u8 = 255; // of pixels that belong to no band
const MIN_BAND: usize = 30; // pixels of a band
const MIN_STRIP: f64 = 4.0; // half widths: pixels of a strip's middle
const MIN_AREA: usize = 12; // pixels of a piece
const EVEN: f32 = 0.35; // logarithm of half widths along a piece
const EVEN_PIXELS: f32 = 0.3; // pixels: the same for thin strips, over the half width
const FAR: f64 = 6.0; // half widths around strips whose colours matter
const IN_BACKGROUND: f32 = 0.35; // of the contrast: pixels that differ less from the background belong to it
const SOFT_REACH: usize = 8; // pixels around a piece whose edge is measured
const SOFT_BINS: [i32; 2] = [-6, 4]; // pixels from the edge, inside is positive
const SOFT_STEP: [f32; 2] = [0.2, 0.8]; // of an edge's step of light: places between these are soft

/// Strips of about one half width, in an image made smaller by a whole number.
pub struct Band {
    pub factor: usize,
    /// Half width, pixels of the whole image.
    pub half_width: f64,
    /// The number of each pixel's piece, from 1 on; 0 for none.
    pub labels: Image<i32>,
    pub pieces: Vec<Piece>,
}

/// What a piece of a strip looks like. Lengths are in pixels of the whole image.
#[derive(Debug, Clone, Default)]
pub struct Piece {
    pub half_width: f32,
    pub length: f32,
    /// The diagonal of its bounding box.
    pub extent: f32,
    /// The largest distance from its edge.
    pub widest: f32,
    /// Share of its middle that has about its half width.
    pub even: f32,
    pub color: [f32; 3],
    pub background: [f32; 3],
    pub contrast: f32,
    pub response: f32,
    /// How much both sides differ, over the contrast.
    pub aside: f32,
    /// Standard deviation of its colours.
    pub scatter: f32,
    /// Width of its edge's step of light.
    pub soft: f32,
    /// Share of its inner pixels that differ from the background.
    pub pure: f32,
    /// Rows and columns of its bounding box in the band's image: top, bottom, left, right.
    pub bounds: [usize; 4],
}

/// Finds the pieces of each width. `planes` decide about regions, `lab` gives colours; `plain` says whether both are one.
pub fn find_pieces(planes: &Planes, lab: &Planes, plain: bool, strips: &Strips) -> Vec<Band> {
    let strong = find_strong(&strips.response);
    let mut widths: Vec<f32> = Vec::new();
    let mut wanted: Vec<f32> = Vec::new();
    let mut classes = Image::filled(strong.width, strong.height, NO_CLASS);
    let pixels = strips.half_width.values.iter().zip(&strips.response.values);
    for (k, (&half_width, &response)) in pixels.enumerate().filter(|&(k, _)| strong.values[k]) {
        let class = widths.iter().position(|&other| other == half_width).unwrap_or_else(|| {
            widths.push(half_width);
            widths.len() - 1
        });
        classes.values[k] = class as u8;
        if response > 1.0 && !wanted.contains(&half_width) {
            wanted.push(half_width);
        }
    }
    wanted.sort_by(f32::total_cmp);
    let bands = parallel::map(&wanted, |&half_width| {
        let range = BAND.map(|share| share * half_width);
        let mut member = [false; 256];
        for (own, width) in member.iter_mut().zip(&widths) {
            *own = (range[0]..range[1]).contains(width);
        }
        let values = classes.values.iter().map(|&class| member[usize::from(class)]).collect();
        let band = Image { width: classes.width, height: classes.height, values };
        find_band(planes, lab, plain, strips, band, half_width)
    });
    bands.into_iter().flatten().collect()
}

/// Returns connected pixels of strips, some of which answer strongly.
fn find_strong(response: &Image<f32>) -> Image<bool> {
    let (width, height) = (response.width, response.height);
    let weak = Image { width, height, values: response.values.iter().map(|&r| r > LOW).collect() };
    let found = find_blobs(&weak, true, true);
    let mut strong = vec![false; found.sizes.len()];
    for run in &found.runs {
        strong[run.blob] |= response.values[run.row * width..][run.begin..run.end].iter().any(|&r| r > HIGH);
    }
    select_blobs(&found, width, height, |blob| strong[blob])
}

fn select_blobs(found: &Blobs, width: usize, height: usize, chosen: impl Fn(usize) -> bool) -> Image<bool> {
    let mut image = Image::filled(width, height, false);
    for run in found.runs.iter().filter(|run| chosen(run.blob)) {
        image.values[run.row * width..][run.begin..run.end].fill(true);
    }
    image
}

fn find_band(
    planes: &Planes,
    lab: &Planes,
    plain: bool,
    strips: &Strips,
    band: Image<bool>,
    half_width: f32,
) -> Option<Band> {
    let [width, height] = size(planes);
    if band.values.iter().filter(|&&own| own).count() < MIN_BAND {
        return None;
    }
    let factor = ((f64::from(half_width) / FINE) as usize).max(1);
    let small = [(width / factor).max(1), (height / factor).max(1)];
    let fine = f64::from(half_width) / factor as f64;
    let core = if factor == 1 {
        band
    } else {
        let values = band.values.iter().map(|&own| f32::from(u8::from(own))).collect();
        let shares = shrunk(&Image { width, height, values }, small);
        let values = shares.values.iter().map(|&share| share > 0.5).collect();
        Image { width: small[0], height: small[1], values }
    };
    let found = find_blobs(&core, true, true);
    let least = (MIN_STRIP * fine) as usize;
    let core = select_blobs(&found, small[0], small[1], |blob| found.sizes[blob] >= least);
    if !core.values.iter().any(|&own| own) {
        return None;
    }
    // what lies far from the strips says nothing about them
    let window = find_window(&core, (FAR * fine) as usize + SOFT_REACH + 2);
    let core = cut(&core, window);
    let within = |planes: &Planes| [0, 1, 2].map(|k| shrunk_within(&planes[k], small, window));
    let own = within(planes);
    let mut region = find_region(&own, &core, fine);
    let colors = if plain { own } else { within(lab) };
    if !plain {
        region.background.fill([0.0; 3]);
    }
    let response = shrunk_within(&strips.response, small, window);
    let aside = shrunk_within(&strips.aside, small, window);
    let (near, mut pieces) = describe(&region, &colors, &response, &aside, factor);
    let [top, _, left, _] = window;
    let mut labels = Image::filled(small[0], small[1], 0i32);
    for (y, row) in near.values.chunks_exact(near.width).enumerate() {
        labels.values[(top + y) * small[0] + left..][..near.width].copy_from_slice(row);
    }
    for piece in &mut pieces {
        let [t, b, l, r] = piece.bounds;
        piece.bounds = [t + top, b + top, l + left, r + left];
    }
    Some(Band { factor, half_width: f64::from(half_width), labels, pieces })
}

/// Returns rows and columns (top, bottom, left, right) that hold all pixels of a mask and a margin around them.
fn find_window(mask: &Image<bool>, margin: usize) -> [usize; 4] {
    let (w, h) = (mask.width, mask.height);
    let [mut top, mut bottom, mut left, mut right] = [h, 0, w, 0];
    for (y, row) in mask.values.chunks_exact(w).enumerate() {
        let Some(first) = row.iter().position(|&own| own) else { continue };
        let last = row.iter().rposition(|&own| own).unwrap_or(first);
        top = top.min(y);
        bottom = y + 1;
        left = left.min(first);
        right = right.max(last + 1);
    }
    let (top, left) = (top.saturating_sub(margin), left.saturating_sub(margin));
    [top, (bottom + margin).min(h), left, (right + margin).min(w)]
}

fn cut<T: Copy>(image: &Image<T>, [top, bottom, left, right]: [usize; 4]) -> Image<T> {
    let mut values = Vec::with_capacity((bottom - top) * (right - left));
    for row in image.values[top * image.width..bottom * image.width].chunks_exact(image.width) {
        values.extend_from_slice(&row[left..right]);
    }
    Image { width: right - left, height: bottom - top, values }
}

/// Returns a window of an image made smaller.
fn shrunk_within(image: &Image<f32>, small: [usize; 2], window: [usize; 4]) -> Image<f32> {
    if small == [image.width, image.height] { cut(image, window) } else { cut(&shrunk(image, small), window) }
}

/// Numbers the pieces of a region, and describes each.
fn describe(
    region: &Region,
    colors: &Planes,
    response: &Image<f32>,
    aside: &Image<f32>,
    factor: usize,
) -> (Image<i32>, Vec<Piece>) {
    let (width, height) = (region.mask.width, region.mask.height);
    let depth = measure_distances(&region.mask, true, width + height);
    let found = find_blobs(&region.mask, true, true);
    let mut pixels: Vec<Vec<usize>> = vec![Vec::new(); found.sizes.len()];
    for run in &found.runs {
        pixels[run.blob].extend((run.begin..run.end).map(|x| run.row * width + x));
    }
    pixels.retain(|own| own.len() >= MIN_AREA);
    let mut labels = Image::filled(width, height, 0i32);
    for (number, own) in pixels.iter().enumerate() {
        own.iter().for_each(|&k| labels.values[k] = number as i32 + 1);
    }
    let context = Context { region, colors, response, aside, depth: &depth, labels: &labels };
    let pieces =
        pixels.iter().enumerate().map(|(number, own)| context.describe(own, number, factor)).collect();
    (labels, pieces)
}

struct Context<'a> {
    region: &'a Region,
    colors: &'a Planes,
    response: &'a Image<f32>,
    aside: &'a Image<f32>,
    depth: &'a Image<f32>,
    labels: &'a Image<i32>,
}

impl Context<'_> {
    fn describe(&self, own: &[usize], number: usize, factor: usize) -> Piece {
        let (width, scale) = (self.depth.width, factor as f32);
        let deep = &self.depth.values;
        let mut middles: Vec<f32> =
            own.iter().filter(|&&k| self.is_middle(k)).map(|&k| (deep[k] - 0.5).max(0.5)).collect();
        middles.sort_by(f32::total_cmp);
        let total: f32 = middles.iter().sum();
        let mut sum = 0.0;
        let half_width = middles
            .iter()
            .copied()
            .find(|&half| {
                sum += half;
                sum >= 0.5 * total
            })
            .unwrap_or(0.5);
        let limit = EVEN + EVEN_PIXELS / half_width;
        let even: f32 = middles.iter().filter(|&&half| (half / half_width).ln().abs() < limit).sum();
        let rows = own.iter().map(|k| k / width);
        let columns = own.iter().map(|k| k % width);
        let bounds = [
            rows.clone().min().unwrap_or(0),
            rows.max().unwrap_or(0) + 1,
            columns.clone().min().unwrap_or(0),
            columns.max().unwrap_or(0) + 1,
        ];
        let inner: Vec<usize> = own.iter().copied().filter(|&k| deep[k] >= 0.5 * half_width).collect();
        let color_mean = mean(inner.iter().map(|&k| color(self.colors, k)));
        let background = mean(own.iter().map(|&k| self.region.background[k]));
        let away = |k: &usize| difference2(color(self.colors, *k), self.region.background[*k]).sqrt();
        let mut differences: Vec<f32> = inner.iter().map(away).collect();
        let contrast = median(&mut differences);
        let shown = differences.iter().filter(|&&difference| difference > IN_BACKGROUND * contrast).count();
        let square: f32 = inner.iter().map(|&k| difference2(color(self.colors, k), color_mean)).sum();
        let [down, across] = [bounds[1] - bounds[0] - 1, bounds[3] - bounds[2] - 1].map(|side| side as f32);
        let length = own.len() as f32 / (2.0 * half_width);
        let soft = if length > SOFT_REACH as f32 { self.measure_softness(bounds, number) } else { 0.0 };
        Piece {
            half_width: half_width * scale,
            length: length * scale,
            extent: (down * down + across * across).sqrt() * scale,
            widest: own.iter().map(|&k| deep[k]).fold(0.0, f32::max) * scale,
            even: if total > 0.0 { even / total } else { 0.0 },
            color: color_mean,
            background,
            contrast,
            response: median(&mut own.iter().map(|&k| self.response.values[k]).collect::<Vec<f32>>()),
            aside: median(&mut inner.iter().map(|&k| self.aside.values[k]).collect::<Vec<f32>>()),
            scatter: (square / inner.len().max(1) as f32).sqrt(),
            soft: soft * scale,
            pure: shown as f32 / inner.len().max(1) as f32,
            bounds,
        }
    }

    /// Returns whether a pixel is as far from the edge as all its neighbours.
    fn is_middle(&self, k: usize) -> bool {
        let (w, h) = (self.depth.width, self.depth.height);
        let (x, y) = (k % w, k / w);
        let own = self.depth.values[k];
        (y.saturating_sub(1)..(y + 2).min(h))
            .all(|j| (x.saturating_sub(1)..(x + 2).min(w)).all(|i| self.depth.at(i, j) <= own))
    }

    /// Returns over how many pixels the light changes at a piece's edge.
    fn measure_softness(&self, [top, bottom, left, right]: [usize; 4], number: usize) -> f32 {
        let (w, h) = (self.depth.width, self.depth.height);
        let (top, left) = (top.saturating_sub(SOFT_REACH), left.saturating_sub(SOFT_REACH));
        let (bottom, right) = ((bottom + SOFT_REACH).min(h), (right + SOFT_REACH).min(w));
        let wide = right - left;
        let at = |p: usize| (top + p / wide) * w + left + p % wide;
        let count = wide * (bottom - top);
        let own: Vec<bool> = (0..count).map(|p| self.labels.values[at(p)] == number as i32 + 1).collect();
        let own = Image { width: wide, height: bottom - top, values: own };
        let away = measure_distances(&own, false, SOFT_REACH + 1);
        let bins = (SOFT_BINS[1] - SOFT_BINS[0]) as usize;
        let mut sums = vec![(0.0f32, 0usize); bins];
        for p in 0..count {
            let k = at(p);
            if !own.values[p] && self.region.mask.values[k] {
                continue;
            }
            let inside = if own.values[p] { self.depth.values[k] - 0.5 } else { 0.5 - away.values[p] };
            let bin = inside.round() as i32 - SOFT_BINS[0];
            if (0..bins as i32).contains(&bin) {
                let sum = &mut sums[bin as usize];
                *sum = (sum.0 + self.colors[0].values[k], sum.1 + 1);
            }
        }
        let light: Vec<f32> = sums.iter().filter(|sum| sum.1 > 0).map(|sum| sum.0 / sum.1 as f32).collect();
        let (Some(&first), Some(&last)) = (light.first(), light.last()) else { return 0.0 };
        let share = |value: f32| (value - first) / (last - first + 1e-6);
        light.iter().filter(|&&value| share(value) > SOFT_STEP[0] && share(value) < SOFT_STEP[1]).count()
            as f32
    }
}

fn mean(colors: impl Iterator<Item = [f32; 3]>) -> [f32; 3] {
    let (mut sum, mut count) = ([0.0f64; 3], 0.0f64);
    for own in colors {
        sum = [0, 1, 2].map(|k| sum[k] + f64::from(own[k]));
        count += 1.0;
    }
    sum.map(|value| (value / count.max(1.0)) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::color::strips::{StripOptions, find_strips};

    #[test]
    fn a_straight_strip_is_one_piece_with_its_length_width_and_colors() {
        let strip = |x: usize, y: usize| (20..140).contains(&x) && (48..54).contains(&y);
        let planes = [40.0f32, 0.0, 10.0].map(|step| Image {
            width: 160,
            height: 100,
            values: (0..160 * 100).map(|k| 30.0 + if strip(k % 160, k / 160) { step } else { 0.0 }).collect(),
        });
        let options =
            StripOptions { max_width: 12.0, min_contrast: 7.0, noise: 4.0, aside: 0.3, signed: false };
        let strips = find_strips(&planes, &options);
        let bands = find_pieces(&planes, &planes, true, &strips);
        let best = bands.iter().flat_map(|band| &band.pieces).max_by(|a, b| a.length.total_cmp(&b.length));
        let piece = best.unwrap();
        // the width of an even number of pixels is one too small
        assert!((piece.length - 120.0).abs() < 30.0, "{piece:?}");
        assert!((piece.half_width - 3.0).abs() < 0.6, "{piece:?}");
        assert!(difference2(piece.color, [70.0, 30.0, 40.0]) < 4.0);
        assert!((piece.contrast - 1700.0f32.sqrt()).abs() < 2.0);
        assert!(piece.even > 0.8 && piece.soft < 2.0);
    }
}
