//! One view's mask, prepared: the signed distance from its edge, and the edge with its normals.
//!
//! All of this is lateral evidence: where the rope is in the image, to a fraction of a pixel, independent of depth.

use std::ops::Range;

use crate::images::distances::Columns;
use crate::images::field::{Field, Tiles};
use crate::images::image::{Image, smoothing_kernel};
use crate::images::strokes::{Filled, Strokes, find_scale, measure_shown_radius};
use crate::images::surroundings::{Ropes, Shown, Surroundings};
use crate::parallel;
use crate::simd::kernel;

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

/// Returns the signed distance of a magnified mask's pixels from its edge, positive inside, original pixels, and the same
/// slightly smoothed, for gradients. Distances outside are exact up to `reach` pixels, and known up to `KNOWN` times that.
fn measure_signed(filled: &Filled, reach: usize) -> [Field; 2] {
    let (inside, scale) = (&filled.inside, filled.scale as f32);
    let (w, h) = (inside.width, inside.height);
    let kernel = smoothing_kernel(1.0);
    let rows = Field::list_rows(h, parallel::count_rows(w));
    let halo = kernel.len() - 1;
    let bands: Vec<Range<usize>> =
        rows.iter().map(|rows| rows.start.saturating_sub(halo)..(rows.end + 1 + halo).min(h)).collect();
    let (inner, outer) = parallel::both(
        || Columns::new(inside, true, h, &bands),
        || Columns::new(inside, false, reach, &bands),
    );
    let least = -KNOWN * reach as f32 / scale;
    let numbers: Vec<usize> = (0..rows.len()).collect();
    let tiles = parallel::map(&numbers, |&k| {
        let (rows, band) = (rows[k].clone(), &bands[k]);
        let mut signed = vec![0.0; band.len() * w];
        let mut outside = vec![0.0; band.len() * w];
        inner.measure(k, &mut signed);
        outer.measure(k, &mut outside);
        join_sides(&mut signed, &outside, scale);
        let (first, more) = (rows.start - band.start, (rows.end + 1).min(h) - rows.start);
        let signed = Image { width: w, height: band.len(), values: signed };
        let mut smooth = vec![0.0; more * w];
        signed.convolve_rows(&kernel, first, &mut smooth);
        let signed = &signed.values[first * w..(first + more) * w];
        let chosen = Tiles::choose(signed, w, rows.clone(), least);
        [Tiles::new(signed, w, rows.clone(), chosen.clone()), Tiles::new(&smooth, w, rows, chosen)]
    });
    let (signed, smooth): (Vec<Tiles>, Vec<Tiles>) = tiles.into_iter().map(|[a, b]| (a, b)).unzip();
    [signed, smooth].map(|tiles| Field::new([w, h], tiles, least))
}

kernel! {
    /// Turns the distances of a magnified mask's pixels from others into signed ones, original pixels.
    fn join_sides<S>(_, inside: &mut [f32], outside: &[f32], scale: f32) {
        for (value, outside) in inside.iter_mut().zip(outside) {
            // the edge runs between the pixels
            let inner = (*value - 0.5).max(0.0) / scale;
            *value = if inner > 0.0 { inner } else { (0.5 - outside) / scale };
        }
    }
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
    signed: Field,
    /// The signed distance, slightly smoothed, for gradients.
    smooth: Field,
    /// Raggedness of the mask, 0 to 1.
    pub ragged: f64,
    /// The depth beside it, if known.
    surroundings: Option<Surroundings>,
}

const EXACT: f64 = 5.0; // distances outside the mask are exact up to this and 4 pixels, image radii
const KNOWN: f32 = 4.0; // times as far: farther places outside the mask count as this far
const MAX_SHRUNK: f64 = 0.7; // distance by which masks are too narrow at most, pixels
const MAX_GROWN: f64 = 2.0; // distance by which masks are too wide at most, pixels
const MAX_GROWN_WIDE: f64 = 1.0; // the same for masks that may show two ropes side by side, pixels
const SIDE_BY_SIDE: f64 = 1.6; // masks wider than this may show two ropes side by side, image radii
/// The mask shows something else if it is more than this too narrow, or by the second more than allowed too wide,
/// pixels.
const OTHER: [f64; 2] = [1.5, 0.5];

impl Silhouette {
    /// Prepares the mask of an image of `width` columns; None if it is empty without specks.
    ///
    /// Specks are removed and small holes filled. A mask with many of both is ragged: its edge is smoothed more, and
    /// larger holes are filled.
    pub fn new(mask: &[bool], width: usize, radius_px: f64, scale: usize) -> Option<Self> {
        let filled = Filled::new(mask, width, radius_px, scale)?;
        let [w, h] = [filled.inside.width / scale, filled.inside.height / scale];
        let reach = ((EXACT * radius_px + 4.0) * scale as f64).ceil() as usize;
        let (strokes, [signed, smooth]) =
            parallel::both(|| Strokes::new(&filled), || measure_signed(&filled, reach));
        let mut made = Self {
            radius_px,
            shown_px: radius_px,
            boundary: Vec::new(),
            mask: Image::filled(w, h, false),
            strokes,
            signed,
            smooth,
            ragged: filled.ragged,
            surroundings: None,
        };
        let mut away = Image::filled(w, h, 0.0);
        parallel::rows(&mut away.values, w, |first, part| {
            for (row, y) in part.chunks_exact_mut(w).zip(first..) {
                for (away, x) in row.iter_mut().zip(0..) {
                    *away = made.pixel_distance(x, y);
                }
            }
        });
        made.mask.values = away.values.iter().map(|&away| away > 0.0).collect();
        made.find_boundary(&away);
        Some(made)
    }

    /// Prepares the mask of a rope whose radius in the image is known roughly; None if it is empty without specks.
    ///
    /// The mask corrects the radius. Masks are a little too narrow, or up to two pixels too wide. Wider ones may show
    /// strands side by side.
    pub fn of_rope(mask: &[bool], width: usize, radius_px: f64) -> Option<Self> {
        let mut made = Self::new(mask, width, radius_px, find_scale(radius_px))?;
        let shown = measure_shown_radius(&made.strokes)?;
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

    /// Projects the pixels near the edge, from which they are `away`, onto it: one for each pixel of edge, or for each
    /// third of the radius of a thicker rope.
    fn find_boundary(&mut self, away: &Image<f64>) {
        let step = ((self.radius_px / 3.0).round() as usize).max(1);
        let near = 0.5 * step as f64;
        for y in (0..away.height).step_by(step) {
            for x in (0..away.width).step_by(step) {
                let away = away.at(x, y);
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
        if first == last {
            return at(first, first);
        }
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
        (self.strokes.origin, self.strokes.size.map(|n| n / self.strokes.scale))
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
