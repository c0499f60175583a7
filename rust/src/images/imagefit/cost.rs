//! The misfit of a hypothesis: what the fit leaves unexplained.

use super::camera::{RopeView, Sensor};
use super::curves::Curves;
use super::evidence::Seen;
use super::outcome::Misfit;
use super::places::{Place2, STEP};
use crate::simd::{LANES, kernel};

/// Mask within this distance of the axis is covered, image radii, and pixels in addition.
const COVERS: (f64, f64) = (1.2, 0.5);
/// Masks fill corners between tubes that no disc of this radius reaches into, image radii.
const CLOSED: f64 = 0.6;
/// Tube within this distance of the axis must lie in the mask, image radii, less pixels.
const FILLS: (f64, f64) = (0.7, 0.3);
/// Tube farther from the axis spills over the mask's edge up to this distance, image radii. Beyond, edges are rough.
const SPILLS: f64 = 0.9;
const SPECK: f64 = 1.0; // distance of a mask's pixels at least from what is left of it without specks, pixels
const SLACK: f64 = 0.01; // pixels by which more is measured than is needed, against rounding
const STEEP: f64 = 1e6; // larger numbers count as infinite
const MANY: usize = 64; // pixels that are looked at together
const NOISE: f64 = 0.5; // noise that divides depth residuals, radii
const LIMIT: f64 = 6.0; // limit of a squared depth residual over the noise

/// Measures the misfit of one view, without the curves' bending.
pub fn measure_view(
    view: &RopeView,
    seen: &Seen,
    curves: &Curves,
    bias: f64,
    radius: f64,
    sensor: &Sensor,
) -> Misfit {
    let radius_px = view.silhouette.radius_px;
    let (covers, fills) = (COVERS.0 * radius_px + COVERS.1, FILLS.0 * radius_px - FILLS.1);
    let more = CLOSED * radius_px;
    let distances = Distances::new(view, &seen.image, curves, covers + more);
    let spills = SPILLS * radius_px.min(view.silhouette.shown_px);
    let (mut uncovered, mut outside, mut spilled) = (0, 0, 0);
    let limits = [covers, spills].map(|limit| (limit * limit) as f32);
    let mut inside = vec![false; distances.width];
    let mut found = Vec::new();
    for (row, squares) in distances.squares.chunks_exact(distances.width.max(1)).enumerate() {
        view.medians.fill_inside(distances.low[0], row as i64 + distances.low[1], &mut inside);
        find_unlike(squares, &inside, limits, &mut found);
        for &column in &found {
            let (square, place) = (squares[column], distances.place(column, row));
            if inside[column] {
                if !distances.closes(column, row, covers + more, more) {
                    uncovered += u32::from(view.silhouette.distance(place) > -SPECK);
                }
            } else {
                if view.silhouette.hidden(place) {
                    continue;
                }
                let core = fills > 0.0 && square < (fills * fills) as f32;
                outside += u32::from(core);
                // not over gaps, where the axis is outside too
                let away = -view.silhouette.distance(place);
                spilled += u32::from(!core && away * away < f64::from(square));
            }
        }
    }
    let [uncovered, outside, spilled] =
        [uncovered, outside, spilled].map(|pixels| f64::from(pixels) / (2.0 * radius_px * radius_px));
    let mut misfit = Misfit { uncovered, outside, spilled, ..Misfit::default() };
    for i in 0..seen.image.len() {
        let observed = view.medians.at(view.silhouette, seen.image[i]);
        let e = (seen.places[i][2] - observed) / radius - sensor.surface - bias;
        if seen.visible[i] && !seen.mixed[i] && e.is_finite() {
            misfit.depth += STEP / sensor.correlation * (e / NOISE).powi(2).min(LIMIT);
            misfit.depths += STEP / sensor.correlation;
        }
    }
    misfit
}

/// Squared distances of pixels from the axes.
struct Distances {
    low: [i64; 2],
    width: usize,
    /// Row by row; more than the reach's square, or infinite, beyond the reach.
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
            made.add_chain(&places[chain.clone()], reach, [width, height]);
        }
        made
    }

    /// Takes the distances from a polyline.
    fn add_chain(&mut self, nodes: &[Place2], reach: f64, size: [usize; 2]) {
        // how far beyond each node it may be the nearest place, for pixels within reach
        let beyond: Vec<f64> = (0..nodes.len())
            .map(|i| {
                let around = i.checked_sub(1).map(|k| nodes[k]).zip(nodes.get(i + 1));
                around.map_or(reach, |(before, &after)| reach * halve_turn(before, nodes[i], after))
            })
            .collect();
        stamp_chain(self, nodes, &beyond, reach, size);
    }

    /// Returns the place of a pixel in the image.
    fn place(&self, column: usize, row: usize) -> Place2 {
        [column as i64 + self.low[0], row as i64 + self.low[1]].map(|x| x as f64)
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

    /// Takes the distances from a segment of pixels beside it, and `beyond` its ends.
    #[inline(always)]
    fn stamp(&mut self, [a, b]: [Place2; 2], beyond: [f64; 2], reach: f64, size: [usize; 2]) {
        let range = |k: usize| {
            let from = (a[k].min(b[k]) - reach).ceil() as i64 - self.low[k];
            let to = (a[k].max(b[k]) + reach).floor() as i64 - self.low[k] + 1;
            from.clamp(0, size[k] as i64) as usize..to.clamp(0, size[k] as i64) as usize
        };
        let (columns, rows) = (range(0), range(1));
        let shift = |p: Place2| -> Place2 { std::array::from_fn(|k| p[k] - self.low[k] as f64) };
        let (a, b) = (shift(a), shift(b));
        let along = [b[0] - a[0], b[1] - a[1]];
        let long = along[0].hypot(along[1]);
        let along = along.map(|x| x / long.max(1e-9));
        let [start, d] = [a, [b[0] - a[0], b[1] - a[1]]].map(|p| p.map(|x| x as f32));
        let inverse = 1.0 / (d[0] * d[0] + d[1] * d[1]).max(1e-12);
        let inverses = along.map(|x| 1.0 / x);
        for y in rows {
            // columns beside the segment
            let v = y as f64 - a[1];
            let ends = [-beyond[0] - SLACK, long + beyond[1] + SLACK].map(|x| x - v * along[1]);
            let sides = [-reach - SLACK, reach + SLACK].map(|x| x + v * along[0]);
            let [from, to] = find_between(ends, inverses[0], find_between(sides, inverses[1], [-1e9, 1e9]));
            let first = ((from + a[0]).ceil().max(columns.start as f64) as usize).min(columns.end);
            let last = ((to + a[0]).floor() + 1.0).max(first as f64).min(columns.end as f64) as usize;
            let py = y as f32 - start[1];
            // whole rows of lanes take less time: the pixels after the last one are farther, but measured as well
            let end = (first + last.saturating_sub(first).next_multiple_of(LANES)).min(self.width);
            let (whole, rest) = self.squares[y * self.width..][first..end].as_chunks_mut::<LANES>();
            let mut x = first as i32;
            for lanes in whole {
                lower(lanes, x, start[0], py, d, inverse);
                x += LANES as i32;
            }
            lower(rest, x, start[0], py, d, inverse);
        }
    }
}

/// Lowers squared distances of pixels of a row, from column `x` on, to those from a segment; `d` is the way along it from
/// the column `start`, `py` the row from there, and `inverse` one over the square of its length.
#[inline(always)]
fn lower(squares: &mut [f32], x: i32, start: f32, py: f32, d: [f32; 2], inverse: f32) {
    for (square, x) in squares.iter_mut().zip(x..) {
        let px = x as f32 - start;
        let t = ((px * d[0] + py * d[1]) * inverse).clamp(0.0, 1.0);
        let (ex, ey) = (px - t * d[0], py - t * d[1]);
        let own = ex * ex + ey * ey;
        *square = if own < *square { own } else { *square };
    }
}

kernel! {
    /// Takes the distances from the segments of a polyline, and `beyond` its nodes.
    fn stamp_chain<S>(
        _,
        distances: &mut Distances,
        nodes: &[Place2],
        beyond: &[f64],
        reach: f64,
        size: [usize; 2],
    ) {
        for (pair, beyond) in nodes.windows(2).zip(beyond.windows(2)) {
            distances.stamp([pair[0], pair[1]], [beyond[0], beyond[1]], reach, size);
        }
    }
}

kernel! {
    /// Finds a row's pixels inside the mask whose square is above the first limit, and others below the second.
    fn find_unlike<S>(_, squares: &[f32], inside: &[bool], limits: [f32; 2], found: &mut Vec<usize>) {
        found.clear();
        let is_unlike = |square: f32, inside: bool| {
            (inside & (square > limits[0])) | (!inside & (square < limits[1]))
        };
        for (k, (squares, inside)) in squares.chunks(MANY).zip(inside.chunks(MANY)).enumerate() {
            let pixels = || squares.iter().zip(inside).map(|(&square, &inside)| is_unlike(square, inside));
            // most have none
            if pixels().fold(false, |any, unlike| any | unlike) {
                found.extend(pixels().enumerate().filter(|(_, unlike)| *unlike).map(|(i, _)| k * MANY + i));
            }
        }
    }
}

/// Returns the sine of half of the angle by which a polyline turns at a node.
fn halve_turn(before: Place2, node: Place2, after: Place2) -> f64 {
    let (d, e) = ([node[0] - before[0], node[1] - before[1]], [after[0] - node[0], after[1] - node[1]]);
    let long = d[0].hypot(d[1]) * e[0].hypot(e[1]);
    // places that coincide may turn anyhow
    let cosine = if long > 0.0 { (d[0] * e[0] + d[1] * e[1]) / long } else { -1.0 };
    (0.5 - 0.5 * cosine).max(0.0).sqrt()
}

/// Returns the part of an interval of x in which x over a number is between two others.
#[inline(always)]
fn find_between([low, high]: [f64; 2], inverse: f64, within: [f64; 2]) -> [f64; 2] {
    if inverse.abs() > STEEP {
        // so nearly parallel that all of it is, or none
        return if low <= SLACK && high >= -SLACK { within } else { [1.0, 0.0] };
    }
    let (x, y) = (low * inverse, high * inverse);
    [within[0].max(x.min(y)), within[1].min(x.max(y))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_from_all_segments() {
        let (size, reach) = ([90, 70], 9.0);
        // sharp bends, axes along the grid, places that coincide, a part outside
        let nodes: Vec<Place2> = vec![
            [10.0, 10.0],
            [30.0, 10.0],
            [30.0, 35.0],
            [34.0, 12.0],
            [60.2, 40.7],
            [60.2, 40.7],
            [63.0, 42.0],
            [58.0, 41.5],
            [100.0, 80.0],
        ];
        let squared = |p: Place2, a: Place2, b: Place2| {
            let (d, e) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
            let square = d[0] * d[0] + d[1] * d[1];
            let t = if square > 0.0 { ((d[0] * e[0] + d[1] * e[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
            (e[0] - t * d[0]).powi(2) + (e[1] - t * d[1]).powi(2)
        };
        let mut found =
            Distances { low: [0, 0], width: size[0], squares: vec![f32::INFINITY; size[0] * size[1]] };
        found.add_chain(&nodes, reach, size);
        for (k, &square) in found.squares.iter().enumerate() {
            let p = found.place(k % size[0], k / size[0]);
            let least = nodes.windows(2).map(|w| squared(p, w[0], w[1])).fold(f64::INFINITY, f64::min);
            if least <= reach * reach {
                assert!((f64::from(square) - least).abs() < 1e-3, "{p:?}: {square} for {least}");
            } else {
                assert!(f64::from(square) > reach * reach - 1e-3, "{p:?}: {square} for {least}");
            }
        }
    }
}
