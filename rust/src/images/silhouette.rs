//! One view's mask, prepared: the signed distance from its edge, and the edge with its normals.
//!
//! All of this is lateral evidence: where the rope is in the image, to a fraction of a pixel, independent of depth.

use crate::images::image::{Blobs, Image, Run, find_blobs, measure_distances};
use crate::images::surroundings::{Ropes, Shown, Surroundings};
use crate::images::thinning::find_skeleton;
use crate::parallel;

/// A place on the edge of a mask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Column and row, pixels.
    pub at: [f64; 2],
    /// Unit normal, away from the mask.
    pub normal: [f64; 2],
    /// The length of edge that it stands for, pixels.
    pub weight: f64,
}

/// A mask, magnified, without specks and small holes, and the middles of its strands.
#[derive(Debug, Clone)]
pub struct Strokes {
    /// The mask, magnified.
    pub(crate) inside: Image<bool>,
    /// Its skeleton: indices into the magnified image.
    pub(crate) skeleton: Vec<usize>,
    /// Distance inside the magnified mask from its edge, original pixels; 0 outside.
    pub(crate) depth: Image<f32>,
    /// The magnification.
    pub(crate) scale: usize,
    /// Original column and row of the magnified image's corner.
    origin: [f64; 2],
}

impl Strokes {
    /// Prepares the mask of an image of `width` columns; None if it is empty without specks.
    pub fn new(mask: &[bool], width: usize, radius_px: f64, scale: usize) -> Option<Self> {
        let Filled { inside, origin, .. } = Filled::new(mask, width, radius_px, scale)?;
        let (skeleton, depth) = trace_strands(&inside, scale);
        Some(Self { inside, skeleton, depth, scale, origin })
    }

    /// Returns the original column and row of a pixel of the magnified image.
    #[inline(always)]
    pub(crate) fn original(&self, x: usize, y: usize) -> [f64; 2] {
        let scale = self.scale as f64;
        [(x as f64 + 0.5) / scale - 0.5 + self.origin[0], (y as f64 + 0.5) / scale - 0.5 + self.origin[1]]
    }
}

/// A mask, magnified, without specks and small holes.
struct Filled {
    inside: Image<bool>,
    origin: [f64; 2],
    ragged: f64,
}

impl Filled {
    fn new(mask: &[bool], width: usize, radius_px: f64, scale: usize) -> Option<Self> {
        let (origin, small, ragged) = remove_specks(mask, width, radius_px * radius_px)?;
        let mut inside =
            small.smoothed(SMOOTHING + ragged * RAGGED_SMOOTHING * radius_px).magnified(scale, 0.5);
        let area = radius_px * radius_px * (scale * scale) as f64;
        let filled = (MAX_HOLE + ragged * RAGGED_HOLE) * area;
        inside.fill_holes(|size| (size as f64) < filled);
        inside.turn_blobs(true, true, |size| (size as f64) < MAX_SPECK * area);
        inside.values.contains(&true).then_some(Self { inside, origin, ragged })
    }
}

/// Returns the skeleton of a magnified mask, and the distance of its pixels from the edge, original pixels.
fn trace_strands(inside: &Image<bool>, scale: usize) -> (Vec<usize>, Image<f32>) {
    let (skeleton, mut depth) =
        parallel::both(|| find_skeleton(inside), || measure_distances(inside, true, inside.height));
    for inner in &mut depth.values {
        // the edge runs between the pixels
        *inner = (*inner - 0.5).max(0.0) / scale as f32;
    }
    (skeleton, depth)
}

/// A mask with the distances from its edge. Columns and rows are those of the original image.
#[derive(Debug, Clone)]
pub struct Silhouette {
    /// The rope's radius in the image, pixels.
    pub radius_px: f64,
    /// The radius that the mask shows, pixels, whatever the rope's is.
    pub shown_px: f64,
    /// Places on the edge, about one each pixel.
    pub boundary: Vec<Edge>,
    /// The mask, with a margin around it.
    pub(crate) mask: Image<bool>,
    pub(crate) strokes: Strokes,
    /// Signed distance, positive inside, original pixels.
    signed: Image<f32>,
    /// The signed distance, slightly smoothed, for gradients.
    smooth: Image<f32>,
    /// Raggedness of the mask, 0 to 1.
    pub ragged: f64,
    /// The depth beside it, if known.
    surroundings: Option<Surroundings>,
}

const EXACT: f64 = 5.0; // distances outside the mask are exact up to this and 4 pixels, image radii
const PAD: usize = 6; // margin around the mask, pixels
const MAX_SPECK: f64 = 3.0; // smaller blobs of mask are removed, squared image radii
const MAX_HOLE: f64 = 0.25; // smaller holes are filled, squared image radii
const RAGGED_HOLE: f64 = 1.0; // the same for the most ragged mask, in addition, squared image radii
const SMOOTHING: f64 = 0.6; // standard deviation of the smoothing, pixels
const RAGGED_SMOOTHING: f64 = 0.3; // the same for the most ragged mask, in addition, image radii
const MIN_HOLE: usize = 4; // pixels of a hole in a ragged mask at least
const MAX_SHRUNK: f64 = 0.7; // distance by which masks are too narrow at most, pixels
const MAX_GROWN: f64 = 2.0; // distance by which masks are too wide at most, pixels
const MAX_GROWN_WIDE: f64 = 1.0; // the same for masks that may show two ropes side by side, pixels
const SIDE_BY_SIDE: f64 = 1.6; // masks wider than this may show two ropes side by side, image radii
/// The mask shows something else if it is more than this too narrow, or by the second more than allowed too wide,
/// pixels.
const OTHER: [f64; 2] = [1.5, 0.5];
const RAGGED: f64 = 0.04; // share of specks and holes in the most ragged mask

impl Silhouette {
    /// Prepares the mask of an image of `width` columns; None if it is empty without specks.
    ///
    /// Specks are removed and small holes filled. A mask with many of both is ragged: its edge is smoothed more, and
    /// larger holes are filled.
    pub fn new(mask: &[bool], width: usize, radius_px: f64, scale: usize) -> Option<Self> {
        let Filled { inside, origin, ragged } = Filled::new(mask, width, radius_px, scale)?;
        let (w, h) = (inside.width / scale, inside.height / scale);
        let reach = ((EXACT * radius_px + 4.0) * scale as f64).ceil() as usize;
        let ((skeleton, depth), mut signed) =
            parallel::both(|| trace_strands(&inside, scale), || measure_distances(&inside, false, reach));
        for (outer, &inner) in signed.values.iter_mut().zip(&depth.values) {
            *outer = if inner > 0.0 { inner } else { (0.5 - *outer) / scale as f32 };
        }
        let smooth = signed.smoothed(1.0);
        let (boundary, mask) = (Vec::new(), Image::filled(w, h, false));
        let mut made = Self {
            radius_px,
            shown_px: radius_px,
            boundary,
            mask,
            strokes: Strokes { inside, skeleton, depth, scale, origin },
            signed,
            smooth,
            ragged,
            surroundings: None,
        };
        made.mask.values = (0..w * h).map(|k| made.pixel_distance(k % w, k / w) > 0.0).collect();
        made.find_boundary(w, h);
        Some(made)
    }

    /// Prepares the mask of a rope whose radius in the image is known roughly; None if it is empty without specks.
    ///
    /// The mask corrects the radius. Masks are a little too narrow, or up to two pixels too wide. Wider ones may show
    /// strands side by side.
    pub fn of_rope(mask: &[bool], width: usize, radius_px: f64) -> Option<Self> {
        let mut made = Self::new(mask, width, radius_px, find_scale(radius_px))?;
        let shown = shown_radius(&made.strokes)?;
        let more = shown - radius_px;
        let grown = if shown < SIDE_BY_SIDE * radius_px { MAX_GROWN } else { MAX_GROWN_WIDE };
        if more > -OTHER[0] && more < grown + OTHER[1] {
            made.radius_px = shown.clamp(radius_px - MAX_SHRUNK, radius_px + grown);
        }
        made.shown_px = shown;
        Some(made)
    }

    /// Adds what depth shows beside the ropes.
    pub fn amid(mut self, surroundings: Option<Surroundings>) -> Self {
        self.surroundings = surroundings;
        self
    }

    /// Returns whether something in front of the ropes hides a place.
    #[inline]
    pub fn hidden(&self, uv: [f64; 2]) -> bool {
        self.surroundings.as_ref().is_some_and(|s| s.hidden(uv))
    }

    /// Returns what depth shows at a place.
    pub fn shown(&self, uv: [f64; 2]) -> Shown {
        match &self.surroundings {
            Some(surroundings) if surroundings.hidden(uv) => Shown::Before,
            Some(surroundings) => surroundings.at(uv),
            None => Shown::Unknown,
        }
    }

    /// Estimates the rope's radius in the image from the mask alone, pixels.
    pub fn shown_radius(mask: &[bool], width: usize) -> Option<f64> {
        let rough = shown_radius(&Strokes::new(mask, width, 1.0, 1)?)?.max(0.5);
        shown_radius(&Strokes::new(mask, width, rough, 2)?)
    }

    /// Projects the pixels near the edge onto it: one for each pixel of edge, or for each third of the radius of a
    /// thicker rope.
    fn find_boundary(&mut self, w: usize, h: usize) {
        let step = ((self.radius_px / 3.0).round() as usize).max(1);
        let near = 0.5 * step as f64;
        for y in (0..h).step_by(step) {
            for x in (0..w).step_by(step) {
                let away = self.pixel_distance(x, y);
                if away.abs() > near {
                    continue;
                }
                let at = [x as f64 + self.strokes.origin[0], y as f64 + self.strokes.origin[1]];
                let gradient = self.gradient(at);
                let norm = (gradient[0] * gradient[0] + gradient[1] * gradient[1]).sqrt();
                if norm < 0.2 {
                    continue;
                }
                let normal = [-gradient[0] / norm, -gradient[1] / norm];
                let edge = [at[0] + away * normal[0], at[1] + away * normal[1]];
                self.boundary.push(Edge { at: edge, normal, weight: step as f64 });
            }
        }
    }

    /// Returns the signed distance of a place from the edge, pixels, positive inside.
    #[inline]
    pub fn distance(&self, uv: [f64; 2]) -> f64 {
        let [x, y] = self.magnified(uv);
        self.signed.between(x, y)
    }

    /// Returns the signed distance of the centre of a pixel of the frame.
    #[inline]
    pub fn pixel_distance(&self, x: usize, y: usize) -> f64 {
        // the first and the last of the magnified pixels at the centre
        let (first, last) = ((self.strokes.scale - 1) / 2, self.strokes.scale / 2);
        let (i, j) = (x * self.strokes.scale, y * self.strokes.scale);
        let at = |x: usize, y: usize| f64::from(self.signed.at(i + x, j + y));
        0.25 * (at(first, first) + at(last, first) + at(first, last) + at(last, last))
    }

    /// The ropes' pixels, for [`Surroundings`].
    pub fn ropes(&self) -> Ropes<'_> {
        Ropes { mask: &self.mask, corner: self.strokes.origin, radius_px: self.radius_px }
    }

    /// Returns how the distance grows along columns and rows.
    #[inline]
    pub fn gradient(&self, uv: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.magnified(uv);
        let step = 0.5 * self.strokes.scale as f64;
        [
            self.smooth.between(x + step, y) - self.smooth.between(x - step, y),
            self.smooth.between(x, y + step) - self.smooth.between(x, y - step),
        ]
    }

    /// Original column and row of the first pixel of the frame, and its size.
    pub fn frame(&self) -> ([f64; 2], [usize; 2]) {
        (
            self.strokes.origin,
            [self.strokes.inside.width / self.strokes.scale, self.strokes.inside.height / self.strokes.scale],
        )
    }

    /// Returns a place in the magnified image.
    #[inline(always)]
    pub(crate) fn magnified(&self, uv: [f64; 2]) -> [f64; 2] {
        let scale = self.strokes.scale as f64;
        [
            (uv[0] - self.strokes.origin[0] + 0.5) * scale - 0.5,
            (uv[1] - self.strokes.origin[1] + 0.5) * scale - 0.5,
        ]
    }
}

/// Estimates the rope's radius in the image, pixels: the 30th percentile of the skeleton's distances from the edge.
fn shown_radius(strokes: &Strokes) -> Option<f64> {
    let mut widths: Vec<f32> = strokes.skeleton.iter().map(|&k| strokes.depth.values[k]).collect();
    if widths.is_empty() {
        return None;
    }
    let rank = (widths.len() - 1) * 3 / 10;
    let (_, found, _) = widths.select_nth_unstable_by(rank, f32::total_cmp);
    Some(f64::from(*found))
}

/// Returns the magnification of a mask of ropes of a radius, pixels.
pub(crate) fn find_scale(radius_px: f64) -> usize {
    match radius_px {
        ..6.0 => 3,
        ..10.0 => 2,
        _ => 1,
    }
}

/// Removes specks and cuts the mask to what remains, with a margin. Returns the corner's column and row, the mask, and
/// how ragged it is, 0 to 1.
fn remove_specks(mask: &[bool], width: usize, square: f64) -> Option<([f64; 2], Image<f32>, f64)> {
    if width == 0 || mask.len() < width {
        return None;
    }
    let whole = Image { width, height: mask.len() / width, values: mask.to_vec() };
    let found = find_blobs(&whole, true, true);
    let kept = |run: &Run| found.sizes[run.blob] as f64 >= MAX_SPECK * square;
    let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
    let mut counts = [0usize; 2];
    for run in &found.runs {
        counts[usize::from(kept(run))] += run.end - run.begin;
        if kept(run) {
            low = [low[0].min(run.begin), low[1].min(run.row)];
            high = [high[0].max(run.end - 1), high[1].max(run.row)];
        }
    }
    if low[0] == usize::MAX {
        return None;
    }
    let (w, h) = (high[0] - low[0] + 1 + 2 * PAD, high[1] - low[1] + 1 + 2 * PAD);
    let mut cut = Image::filled(w, h, false);
    for run in found.runs.iter().filter(|run| kept(run)) {
        let start = (run.row - low[1] + PAD) * w + PAD - low[0];
        cut.values[start + run.begin..start + run.end].fill(true);
    }
    let holes = find_blobs(&cut, false, false);
    let lost: usize = find_compact(&holes).filter(|&size| (size as f64) < square).sum();
    let ragged = ((counts[0] + lost) as f64 / counts[1] as f64 / RAGGED).min(1.0);
    let values = cut.values.iter().map(|&m| f32::from(u8::from(m))).collect();
    let origin = [low[0] as f64 - PAD as f64, low[1] as f64 - PAD as f64];
    Some((origin, Image { width: w, height: h, values }, ragged))
}

/// Returns the sizes of blobs that are about as wide as long. Narrow ones are gaps between strands, not holes that a
/// segmenter left.
fn find_compact(found: &Blobs) -> impl Iterator<Item = usize> {
    let mut boxes = vec![[usize::MAX, 0, usize::MAX, 0]; found.sizes.len()];
    for run in &found.runs {
        let [left, right, top, bottom] = boxes[run.blob];
        boxes[run.blob] =
            [left.min(run.begin), right.max(run.end), top.min(run.row), bottom.max(run.row + 1)];
    }
    boxes.into_iter().zip(&found.sizes).filter_map(|([left, right, top, bottom], &size)| {
        let long = (right - left).max(bottom - top);
        (size >= MIN_HOLE && 2 * long * long <= 5 * size).then_some(size)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 120;
    const HEIGHT: usize = 90;

    fn mask(inside: impl Fn(f64, f64) -> bool) -> Vec<bool> {
        (0..WIDTH * HEIGHT).map(|k| inside((k % WIDTH) as f64, (k / WIDTH) as f64)).collect()
    }

    #[test]
    fn the_distance_from_the_edge_of_a_disc_is_known_to_half_a_pixel() {
        let (x, y, radius) = (57.3, 44.8, 25.0);
        let disc = mask(|u, v| (u - x).hypot(v - y) < radius);
        for scale in 1..4 {
            let found = Silhouette::new(&disc, WIDTH, 8.0, scale).unwrap();
            for k in 0..WIDTH * HEIGHT {
                let (u, v) = ((k % WIDTH) as f64, (k / WIDTH) as f64);
                let expected = radius - (u - x).hypot(v - y);
                if expected.abs() < 8.0 && (u - x).abs().max((v - y).abs()) < radius + 4.0 {
                    assert!((found.distance([u, v]) - expected).abs() < 0.5, "{scale}: {u}, {v}");
                }
            }
            assert!(found.boundary.len() > 50);
            for edge in &found.boundary {
                let out = [edge.at[0] - x, edge.at[1] - y];
                let away = out[0].hypot(out[1]);
                assert!((away - radius).abs() < 0.5);
                let cos = (out[0] * edge.normal[0] + out[1] * edge.normal[1]) / away;
                assert!(cos > 0.88, "{scale}: {cos}");
            }
        }
    }

    #[test]
    fn a_strip_has_its_width_and_the_length_of_its_edges() {
        // 12 pixels wide, oblique
        let (cos, sin) = (0.8, 0.6);
        let strip = mask(|u, v| {
            let (along, across) = (cos * (u - 60.0) + sin * (v - 45.0), cos * (v - 45.0) - sin * (u - 60.0));
            along.abs() < 40.0 && across.abs() < 6.0
        });
        let found = Silhouette::of_rope(&strip, WIDTH, 5.5).unwrap();
        assert!((found.radius_px - 6.0).abs() < 0.8, "{}", found.radius_px);
        let sides: f64 = found
            .boundary
            .iter()
            .filter(|e| (cos * (e.at[0] - 60.0) + sin * (e.at[1] - 45.0)).abs() < 30.0)
            .inspect(|e| {
                let across = cos * (e.at[1] - 45.0) - sin * (e.at[0] - 60.0);
                assert!((across.abs() - 6.0).abs() < 0.5);
                assert!((cos * e.normal[1] - sin * e.normal[0]) * across.signum() > 0.88);
            })
            .map(|e| e.weight)
            .sum();
        // at least one place for each pixel column that an edge crosses
        assert!(sides > 0.7 * 120.0 && sides < 1.8 * 120.0, "{sides}");
        let inside = strip
            .iter()
            .enumerate()
            .filter(|&(k, _)| found.distance([(k % WIDTH) as f64, (k / WIDTH) as f64]) > 0.0)
            .count() as f64;
        assert!((inside / strip.iter().filter(|&&m| m).count() as f64 - 1.0).abs() < 0.1);
    }

    #[test]
    fn specks_are_left_out_and_small_holes_filled() {
        let with_both = mask(|u, v| {
            let strip = (v - 45.0).abs() < 8.0 && u > 10.0 && u < 110.0;
            let hole = (u - 60.0).abs() < 1.5 && (v - 45.0).abs() < 1.5;
            let speck = (u - 30.0).abs() < 4.0 && (v - 80.0).abs() < 4.0;
            (strip && !hole) || speck
        });
        let found = Silhouette::new(&with_both, WIDTH, 8.0, 2).unwrap();
        assert!(found.distance([60.0, 45.0]) > 6.0);
        assert!(found.distance([30.0, 80.0]) < 0.0);
        assert!(Silhouette::new(&mask(|_, _| false), WIDTH, 8.0, 2).is_none());
        assert!(Silhouette::new(&mask(|u, v| u + v < 3.0), WIDTH, 8.0, 2).is_none());
        assert!(Silhouette::new(&[], 0, 8.0, 2).is_none());
    }
}
