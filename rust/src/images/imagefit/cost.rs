//! The misfit of a hypothesis: what the fit leaves unexplained.

use super::camera::{RopeView, Sensor};
use super::curves::Curves;
use super::evidence::Seen;
use super::outcome::Misfit;
use super::places::{Place2, STEP};

/// Mask within this distance of the axis is covered, image radii, and pixels in addition.
const COVERS: (f64, f64) = (1.2, 0.5);
/// Masks fill corners between tubes that no disc of this radius reaches into, image radii.
const CLOSED: f64 = 0.6;
/// Tube within this distance of the axis must lie in the mask, image radii, less pixels.
const FILLS: (f64, f64) = (0.7, 0.3);
/// Tube farther from the axis spills over the mask's edge up to this distance, image radii. Beyond, edges are rough.
const SPILLS: f64 = 0.9;
const SPECK: f64 = 1.0; // distance of a mask's pixels at least from what is left of it without specks, pixels
const NOISE: f64 = 0.5; // noise that divides depth residuals, radii
const LIMIT: f64 = 6.0; // limit of a squared depth residual over the noise

/// Adds the misfit of one view.
pub fn add_view(
    view: &RopeView,
    seen: &Seen,
    curves: &Curves,
    bias: f64,
    radius: f64,
    sensor: &Sensor,
    misfit: &mut Misfit,
) {
    let radius_px = view.silhouette.radius_px;
    let (covers, fills) = (COVERS.0 * radius_px + COVERS.1, FILLS.0 * radius_px - FILLS.1);
    let more = CLOSED * radius_px;
    let distances = Distances::new(view, &seen.image, curves, covers + more);
    let spills = SPILLS * radius_px.min(view.silhouette.shown_px);
    let (mut uncovered, mut outside, mut spilled) = (0, 0, 0);
    for (row, squares) in distances.squares.chunks_exact(distances.width.max(1)).enumerate() {
        for (column, &square) in squares.iter().enumerate() {
            let far = square > (covers * covers) as f32;
            let near = square < (spills * spills) as f32;
            if far || near {
                let pixel = [column as i64 + distances.low[0], row as i64 + distances.low[1]];
                let place = pixel.map(|x| x as f64);
                let inside = view.medians.inside(pixel);
                if far && inside && !distances.closes(column, row, covers + more, more) {
                    uncovered += u32::from(view.silhouette.distance(place) > -SPECK);
                } else if near && !inside && !view.silhouette.hidden(place) {
                    let core = fills > 0.0 && square < (fills * fills) as f32;
                    outside += u32::from(core);
                    // not over gaps, where the axis is outside too
                    let away = -view.silhouette.distance(place);
                    spilled += u32::from(!core && away * away < f64::from(square));
                }
            }
        }
    }
    misfit.uncovered += f64::from(uncovered) / (2.0 * radius_px * radius_px);
    misfit.outside += f64::from(outside) / (2.0 * radius_px * radius_px);
    misfit.spilled += f64::from(spilled) / (2.0 * radius_px * radius_px);
    for i in 0..seen.image.len() {
        let observed = view.medians.at(view.silhouette, seen.image[i]);
        let e = (seen.places[i][2] - observed) / radius - sensor.surface - bias;
        if seen.visible[i] && !seen.mixed[i] && e.is_finite() {
            misfit.depth += STEP / sensor.correlation * (e / NOISE).powi(2).min(LIMIT);
            misfit.depths += STEP / sensor.correlation;
        }
    }
}

/// Squared distances of pixels from the axes.
struct Distances {
    low: [i64; 2],
    width: usize,
    /// Row by row; infinite beyond the reach.
    squares: Vec<f32>,
}

impl Distances {
    /// Measures over the mask's frame and the chains, within the image.
    fn new(view: &RopeView, places: &[Place2], curves: &Curves, reach: f64) -> Self {
        let (origin, size) = view.silhouette.frame();
        let mut low = origin;
        let mut high: Place2 = std::array::from_fn(|k| origin[k] + size[k] as f64);
        for p in places {
            for k in 0..2 {
                low[k] = low[k].min(p[k] - reach);
                high[k] = high[k].max(p[k] + reach);
            }
        }
        let low: [i64; 2] = std::array::from_fn(|k| low[k].max(0.0) as i64);
        let high: [i64; 2] = std::array::from_fn(|k| high[k].min(view.size[k] as f64 - 1.0) as i64);
        let [width, height] = std::array::from_fn(|k| (high[k] - low[k] + 1).max(0) as usize);
        let mut made = Self { low, width, squares: vec![f32::INFINITY; width * height] };
        for chain in &curves.chains {
            for pair in places[chain.clone()].windows(2) {
                made.stamp(pair[0], pair[1], reach, [width, height]);
            }
        }
        made
    }

    /// Whether all pixels within `more` of one are within `reach` of the axes: the tubes' union, closed, covers it.
    fn closes(&self, column: usize, row: usize, reach: f64, more: f64) -> bool {
        let most = (reach * reach) as f32;
        if more <= 0.0 || self.squares[row * self.width + column] > most {
            return false;
        }
        let height = self.squares.len() / self.width;
        let whole = more as usize;
        (row.saturating_sub(whole)..(row + whole + 1).min(height)).all(|y| {
            let half = (more * more - (y as f64 - row as f64).powi(2)).sqrt() as usize;
            let columns = column.saturating_sub(half)..(column + half + 1).min(self.width);
            self.squares[y * self.width..][columns].iter().all(|&square| square <= most)
        })
    }

    fn stamp(&mut self, a: Place2, b: Place2, reach: f64, size: [usize; 2]) {
        let range = |k: usize| {
            let from = (a[k].min(b[k]) - reach).ceil() as i64 - self.low[k];
            let to = (a[k].max(b[k]) + reach).floor() as i64 - self.low[k] + 1;
            from.clamp(0, size[k] as i64) as usize..to.clamp(0, size[k] as i64) as usize
        };
        let (columns, rows) = (range(0), range(1));
        let shift = |p: Place2| -> [f32; 2] { std::array::from_fn(|k| (p[k] - self.low[k] as f64) as f32) };
        let (a, b) = (shift(a), shift(b));
        let d = [b[0] - a[0], b[1] - a[1]];
        let inverse = 1.0 / (d[0] * d[0] + d[1] * d[1]).max(1e-12);
        for y in rows {
            let py = y as f32 - a[1];
            let row = &mut self.squares[y * self.width..][columns.clone()];
            for (square, x) in row.iter_mut().zip(columns.clone()) {
                let px = x as f32 - a[0];
                let t = ((px * d[0] + py * d[1]) * inverse).clamp(0.0, 1.0);
                let (ex, ey) = (px - t * d[0], py - t * d[1]);
                *square = square.min(ex * ex + ey * ey);
            }
        }
    }
}
