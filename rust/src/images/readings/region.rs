//! The mask around a zone that its links should cover.

use super::network::{Network, Skeleton};
use super::planar::Place;
use crate::images::bits::{WORD_PIXELS, select};
use crate::images::runs::list_between;
use crate::images::silhouette::Silhouette;

const AROUND: f64 = 5.0; // distance of the border from the zone's pixels, image radii
const FINE: f64 = 5.0; // pixels of a region in an image radius, about
/// Reach of what a strand covers, image radii and pixels.
const COVER: [f64; 2] = [1.2, 0.3];

/// The mask that the links of a zone should cover, a bit for each pixel of a raster.
pub struct Region {
    raster: Raster,
    reach: f64,
    inside: Vec<u64>,
    /// Numbers of the words that have pixels inside.
    filled: Vec<usize>,
}

/// The pixels that a curve covers, in the words that have pixels inside.
pub type Cover = Vec<u64>;

impl Region {
    /// Takes the mask around a zone, without what segments cover.
    pub fn new(silhouette: &Silhouette, skeleton: &Skeleton, network: &Network, zone: &[u32]) -> Self {
        let radius_px = silhouette.radius_px;
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for &i in zone {
            let p = skeleton.place(i);
            for c in 0..2 {
                low[c] = low[c].min(p[c] - AROUND * radius_px);
                high[c] = high[c].max(p[c] + AROUND * radius_px);
            }
        }
        let raster = Raster::new(low, high, (radius_px / FINE).floor().max(1.0));
        let reach = COVER[0] * radius_px + COVER[1];
        let mut inside = raster.clear();
        for &i in zone.iter().step_by(silhouette.strokes.scale) {
            let reach = skeleton.depth(i) + 0.5 * radius_px;
            raster.visit(&[skeleton.place(i); 2], reach, |word, bits| inside[word] |= bits);
        }
        for (word, bits) in inside.iter_mut().enumerate() {
            let mut left = *bits;
            while left != 0 {
                if !silhouette.holds(raster.place(word, left.trailing_zeros())) {
                    *bits &= !(left & left.wrapping_neg());
                }
                left &= left - 1;
            }
        }
        for (segment, _) in network.segments.iter().zip(&network.stubs).filter(|(_, stub)| !**stub) {
            let near = |p: &Place| (0..2).all(|c| p[c] > low[c] && p[c] < high[c]);
            if segment.points.iter().any(near) {
                raster.visit(&segment.points, reach, |word, bits| inside[word] &= !bits);
            }
        }
        let filled = (0..inside.len()).filter(|&word| inside[word] != 0).collect();
        Self { raster, reach, inside, filled }
    }

    /// Returns the pixels that a curve covers.
    pub fn cover(&self, p: &[Place]) -> Cover {
        let mut bits = self.raster.clear();
        self.raster.visit(p, self.reach, |word, more| bits[word] |= more);
        self.filled.iter().map(|&word| bits[word] & self.inside[word]).collect()
    }

    /// Returns the area that no cover covers, squared pixels.
    pub fn find_uncovered(&self, covers: &[&Cover]) -> f64 {
        let bare: u32 = (self.filled.iter().enumerate())
            .map(|(k, &word)| {
                covers.iter().fold(self.inside[word], |bare, cover| bare & !cover[k]).count_ones()
            })
            .sum();
        f64::from(bare) * self.raster.step * self.raster.step
    }
}

/// A grid of pixels over a part of the image, a bit each.
struct Raster {
    origin: Place,
    step: f64,
    width: usize,
    height: usize,
    /// Words of a row.
    stride: usize,
}

impl Raster {
    fn new(low: Place, high: Place, step: f64) -> Self {
        let origin = low.map(f64::floor);
        let [width, height] = [0, 1].map(|c| ((high[c] - origin[c]) / step) as usize + 2);
        Self { origin, step, width, height, stride: width.div_ceil(WORD_PIXELS) }
    }

    /// Returns words without any pixel.
    fn clear(&self) -> Vec<u64> {
        vec![0; self.stride * self.height]
    }

    /// Returns the place of a word's pixel in the image.
    fn place(&self, word: usize, bit: u32) -> Place {
        let (row, column) = (word / self.stride, word % self.stride * WORD_PIXELS + bit as usize);
        [self.origin[0] + self.step * column as f64, self.origin[1] + self.step * row as f64]
    }

    /// Calls with each word that holds pixels within a distance of a segment of a polyline, and with their bits.
    fn visit(&self, p: &[Place], reach: f64, mut call: impl FnMut(usize, u64)) {
        let reach = reach / self.step;
        for pair in p.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|p| [0, 1].map(|c| (p[c] - self.origin[c]) / self.step));
            for row in list_between(a[1].min(b[1]) - reach, a[1].max(b[1]) + reach, self.height) {
                let (low, high) = cut_row(a, b, reach, row as f64);
                let columns = list_between(low, high, self.width);
                if columns.is_empty() {
                    continue;
                }
                for word in columns.start / WORD_PIXELS..columns.end.div_ceil(WORD_PIXELS) {
                    call(row * self.stride + word, select(word, &columns));
                }
            }
        }
    }
}

/// Returns the first and the last place of a row within a distance of a segment; the first is larger if there is none.
fn cut_row(a: Place, b: Place, reach: f64, y: f64) -> (f64, f64) {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for p in [a, b] {
        let square = reach * reach - (y - p[1]).powi(2);
        if square >= 0.0 {
            let half = square.sqrt();
            (low, high) = (low.min(p[0] - half), high.max(p[0] + half));
        }
    }
    // beside the segment: between lines along it and lines across its ends
    let d = [b[0] - a[0], b[1] - a[1]];
    let square = d[0] * d[0] + d[1] * d[1];
    if square > 0.0 {
        let (up, wide) = (y - a[1], reach * square.sqrt());
        let [first, last] = solve_between(d[0], up * d[1], 0.0, square);
        let [left, right] = solve_between(-d[1], up * d[0], -wide, wide);
        let (from, to) = (first.max(left) + a[0], last.min(right) + a[0]);
        if from <= to {
            (low, high) = (low.min(from), high.max(to));
        }
    }
    (low, high)
}

/// Returns the first and the last x with `low` <= slope x + offset <= `high`; the first is larger if there is none.
fn solve_between(slope: f64, offset: f64, low: f64, high: f64) -> [f64; 2] {
    if slope == 0.0 {
        let all = low <= offset && offset <= high;
        return if all { [f64::NEG_INFINITY, f64::INFINITY] } else { [f64::INFINITY, f64::NEG_INFINITY] };
    }
    let (x, y) = ((low - offset) / slope, (high - offset) / slope);
    [x.min(y), x.max(y)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_cut_where_pixels_are_near_a_segment() {
        let segments = [
            ([3.2, 4.1], [9.7, 12.3]),
            ([9.0, 5.0], [2.0, 5.0]),
            ([6.5, 3.0], [6.5, 11.0]),
            ([7.3, 7.7], [7.3, 7.7]),
            ([12.4, 3.3], [4.0, 10.9]),
        ];
        for (a, b) in segments {
            let d = [b[0] - a[0], b[1] - a[1]];
            let square = d[0] * d[0] + d[1] * d[1];
            for (row, column) in (0..16).flat_map(|row| (0..16).map(move |column| (row, column))) {
                let e = [f64::from(column) - a[0], f64::from(row) - a[1]];
                let t =
                    if square > 0.0 { ((e[0] * d[0] + e[1] * d[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
                let away = (e[0] - t * d[0]).hypot(e[1] - t * d[1]);
                let (low, high) = cut_row(a, b, 2.6, f64::from(row));
                assert_eq!((low..=high).contains(&f64::from(column)), away <= 2.6, "{row}, {column}");
            }
        }
    }
}
