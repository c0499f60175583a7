//! Masks without specks and holes, and the middles of their strands.

use super::bits::Bits;
use super::distances::measure_depths;
use super::image::{Blobs, Image, Run, find_blobs};
use super::parts::{fill_holes, turn_blobs};
use super::runs::Mask;
use super::thinning::find_skeleton;

const PAD: usize = 6; // margin around the mask, pixels
const MAX_SPECK: f64 = 3.0; // smaller blobs of mask are removed, squared image radii
const MAX_HOLE: f64 = 0.25; // smaller holes are filled, squared image radii
const RAGGED_HOLE: f64 = 1.0; // the same for the most ragged mask, in addition, squared image radii
const SMOOTHING: f64 = 0.6; // standard deviation of the smoothing, pixels
const RAGGED_SMOOTHING: f64 = 0.3; // the same for the most ragged mask, in addition, image radii
const MIN_HOLE: usize = 4; // pixels of a hole in a ragged mask at least
const RAGGED: f64 = 0.04; // share of specks and holes in the most ragged mask

/// The middles of a mask's strands.
#[derive(Debug, Clone)]
pub struct Strokes {
    /// The size of the magnified image.
    pub(crate) size: [usize; 2],
    /// The skeleton of the mask: indices into the magnified image, ascending.
    pub(crate) skeleton: Vec<usize>,
    /// Distances of these pixels inside the mask from its edge, original pixels.
    pub(super) depths: Vec<f32>,
    /// The magnification.
    pub(crate) scale: usize,
    /// Original column and row of the magnified image's corner.
    pub(super) origin: [f64; 2],
}

impl Strokes {
    /// Traces the strands of a mask.
    pub fn new(filled: &Filled) -> Self {
        let Filled { inside, origin, scale, .. } = filled;
        let skeleton = find_skeleton(inside);
        let depths = measure_depths(inside, &skeleton);
        // the edge runs between the pixels
        let depths = depths.into_iter().map(|inner| (inner - 0.5).max(0.0) / *scale as f32).collect();
        Self { size: inside.size(), skeleton, depths, scale: *scale, origin: *origin }
    }

    /// Returns the distance of a pixel of the skeleton from the mask's edge, original pixels.
    pub(crate) fn depth(&self, pixel: usize) -> f64 {
        self.skeleton.binary_search(&pixel).map_or(0.0, |k| f64::from(self.depths[k]))
    }

    /// Returns the original column and row of a pixel of the magnified image.
    #[inline(always)]
    pub(crate) fn original(&self, x: usize, y: usize) -> [f64; 2] {
        let scale = self.scale as f64;
        [(x as f64 + 0.5) / scale - 0.5 + self.origin[0], (y as f64 + 0.5) / scale - 0.5 + self.origin[1]]
    }
}

/// A mask, magnified, without specks and small holes.
#[derive(Debug)]
pub struct Filled {
    /// The mask, magnified.
    pub(crate) inside: Bits,
    /// The magnification.
    pub(crate) scale: usize,
    /// Original column and row of the magnified image's corner.
    pub(super) origin: [f64; 2],
    /// Raggedness of the mask, 0 to 1.
    pub(super) ragged: f64,
}

impl Filled {
    /// Prepares the mask of an image; None if it is empty without specks.
    pub fn new(mask: &Bits, radius_px: f64, scale: usize) -> Option<Self> {
        let (origin, small, ragged) = remove_specks(mask, radius_px * radius_px)?;
        let mut inside =
            small.smoothed(SMOOTHING + ragged * RAGGED_SMOOTHING * radius_px).magnified(scale, 0.5);
        let area = radius_px * radius_px * (scale * scale) as f64;
        let filled = (MAX_HOLE + ragged * RAGGED_HOLE) * area;
        fill_holes(&mut inside, |size| (size as f64) < filled);
        turn_blobs(&mut inside, true, true, |size| (size as f64) < MAX_SPECK * area);
        inside.words.iter().any(|&word| word != 0).then_some(Self { inside, scale, origin, ragged })
    }
}

/// Estimates the rope's radius in the image, pixels: the 30th percentile of the skeleton's distances from the edge.
pub(super) fn measure_shown_radius(strokes: &Strokes) -> Option<f64> {
    let mut widths = strokes.depths.clone();
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

/// Returns the magnification of a mask whose widths alone are asked for.
pub(crate) fn find_scale_of_widths(radius_px: f64) -> usize {
    match radius_px {
        ..4.0 => 3,
        ..8.0 => 2,
        _ => 1,
    }
}

/// Removes specks and cuts the mask to what remains, with a margin. Returns the corner's column and row, the mask, and
/// how ragged it is, 0 to 1.
fn remove_specks(mask: &Bits, square: f64) -> Option<([f64; 2], Image<f32>, f64)> {
    let found = find_blobs(mask, true, true);
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
    let (mut cut, mut made) = (Bits::new(w, h), Image::filled(w, h, 0.0f32));
    for run in found.runs.iter().filter(|run| kept(run)) {
        let (row, columns) = (run.row + PAD - low[1], run.begin + PAD - low[0]..run.end + PAD - low[0]);
        made.values[row * w..][columns.clone()].fill(1.0);
        cut.fill(row, columns, true);
    }
    let holes = find_blobs(&cut, false, false);
    let lost: usize = find_compact(&holes).filter(|&size| (size as f64) < square).sum();
    let ragged = ((counts[0] + lost) as f64 / counts[1] as f64 / RAGGED).min(1.0);
    let origin = [low[0] as f64 - PAD as f64, low[1] as f64 - PAD as f64];
    Some((origin, made, ragged))
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
