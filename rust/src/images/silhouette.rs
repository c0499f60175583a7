//! One view's mask, prepared: the signed distance from its edge, and the edge with its normals.
//!
//! All of this is lateral evidence: where the rope is in the image, to a fraction of a pixel, independent of depth.

use crate::images::bits::Bits;
use crate::images::edge_distances::{EdgeDistances, SIDE};
use crate::images::image::Image;
use crate::images::runs::Mask;
use crate::images::strokes::{Filled, Strokes, find_scale, measure_shown_radius};
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

/// A mask with the distances from its edge. Columns and rows are those of the original image.
#[derive(Debug)]
pub struct Silhouette {
    /// The rope's radius in the image, pixels.
    pub radius_px: f64,
    /// The radius that the mask shows, pixels, whatever the rope's is.
    pub shown_px: f64,
    /// Places on the edge, about one each pixel; fewer of thick ropes.
    pub boundary: Vec<Edge>,
    /// The mask, with a margin around it.
    pub(crate) mask: Image<bool>,
    pub(crate) strokes: Strokes,
    distances: EdgeDistances,
    /// Raggedness of the mask, 0 to 1.
    pub ragged: f64,
    /// The depth beside it, if known.
    surroundings: Option<Surroundings>,
}

const FAR: [f64; 2] = [20.0, 16.0]; // farther places outside the mask count as this far: image radii, and pixels more
const STEPS: f64 = 3.0; // places on the edge for each image radius of it, about
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
        let Filled { inside, origin, ragged, .. } = Filled::new(&Bits::pack(mask, width), radius_px, scale)?;
        let [w, h] = inside.size().map(|n| n / scale);
        let most = ((FAR[0] * radius_px + FAR[1]) * scale as f64).ceil() as usize;
        let distances = EdgeDistances::new(inside, scale, most);
        let step = ((radius_px / STEPS).round() as usize).max(1);
        // pixels half a step from the edge, and those at their centres
        let (skeleton, edges) =
            parallel::both(|| find_skeleton(distances.mask()), || distances.find_edges(step * scale));
        let depths =
            skeleton.iter().map(|k| distances.at(k % (w * scale), k / (w * scale)).max(0.0)).collect();
        let strokes = Strokes { size: [w * scale, h * scale], skeleton, depths, scale, origin };
        let mut made = Self {
            radius_px,
            shown_px: radius_px,
            boundary: Vec::new(),
            mask: Image::filled(w, h, false),
            strokes,
            distances,
            ragged,
            surroundings: None,
        };
        made.find_boundary(&edges, step);
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

    /// Finds the mask's pixels, and projects those near the edge onto it: one for each `step` pixels of edge. `edges`
    /// tells which tiles of distances have edges.
    fn find_boundary(&mut self, edges: &[bool], step: usize) {
        let (near, scale, first) = (0.5 * step as f64, self.strokes.scale, (self.strokes.scale - 1) / 2);
        let [w, h] = [self.mask.width, self.mask.height];
        for y in 0..h {
            let mut begin = 0;
            while begin < w {
                // pixels with their centres in one tile
                let centre = [begin * scale + first, y * scale + first];
                let end = ((centre[0] | (SIDE - 1)) + 1 - first).div_ceil(scale).min(w);
                let own = y * w + begin..y * w + end;
                if edges[self.distances.number(centre[0], centre[1])] {
                    for x in begin..end {
                        let away = self.pixel_distance(x, y);
                        self.mask.values[y * w + x] = away > 0.0;
                        if away.abs() <= near && x % step == 0 && y % step == 0 {
                            self.boundary.extend(self.project(x, y, away, step as f64));
                        }
                    }
                } else {
                    self.mask.values[own].fill(self.distances.mask().at(centre[0], centre[1]));
                }
                begin = end;
            }
        }
    }

    /// Projects a pixel, which is `away` from the edge, onto it; None if it is not clear where the edge is.
    fn project(&self, x: usize, y: usize, away: f64, weight: f64) -> Option<Edge> {
        let at = [x as f64 + self.strokes.origin[0], y as f64 + self.strokes.origin[1]];
        let gradient = self.gradient(at);
        let norm = (gradient[0] * gradient[0] + gradient[1] * gradient[1]).sqrt();
        (norm >= 0.2).then(|| {
            let normal = [-gradient[0] / norm, -gradient[1] / norm];
            Edge { at: [at[0] + away * normal[0], at[1] + away * normal[1]], normal, weight }
        })
    }

    /// Returns the signed distance of a place from the edge, pixels, positive inside.
    #[inline]
    pub fn distance(&self, uv: [f64; 2]) -> f64 {
        let [x, y] = self.magnified(uv);
        self.distances.between(x, y)
    }

    /// Returns whether a place is in the mask, where its distance is positive.
    #[inline]
    pub fn holds(&self, uv: [f64; 2]) -> bool {
        let [x, y] = self.magnified(uv);
        self.distances.holds(x, y)
    }

    /// Returns the signed distance of the centre of a pixel of the frame.
    #[inline]
    pub fn pixel_distance(&self, x: usize, y: usize) -> f64 {
        // the first and the last of the magnified pixels at the centre
        let (first, last) = ((self.strokes.scale - 1) / 2, self.strokes.scale / 2);
        let (i, j) = (x * self.strokes.scale, y * self.strokes.scale);
        let at = |x: usize, y: usize| f64::from(self.distances.at(i + x, j + y));
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
            self.distances.between_smooth(x + step, y) - self.distances.between_smooth(x - step, y),
            self.distances.between_smooth(x, y + step) - self.distances.between_smooth(x, y - step),
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
                assert_eq!(found.holds([u, v]), found.distance([u, v]) > 0.0);
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
