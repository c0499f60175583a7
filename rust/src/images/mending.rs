//! Repair of ragged masks by depth: pieces that a segmenter lost, and background that it added.

use crate::geometry::median::upper_median;
use crate::images::distances::measure_distances;
use crate::images::image::{Blobs, Image, find_blobs};
use crate::images::silhouette::Silhouette;
use crate::images::surroundings::Surroundings;

const CLOSED: f64 = 1.0; // gaps up to twice as wide may be lost pieces, image radii
const OPENED: f64 = 0.6; // parts up to twice as wide may be added background, image radii
const MAX_SPECK: f64 = 12.0; // largest separate blobs that may be added background, squared image radii
const MIN_BLOB: f64 = 0.15; // smallest blobs that depth can judge, squared image radii
const PAD: usize = 4; // margin around the silhouette's frame, pixels

/// Adds pixels as deep as the ropes to a mask and removes pixels behind them; None if depth does not separate the two.
pub fn mend(
    depth: &[f64],
    mask: &[bool],
    width: usize,
    silhouette: &Silhouette,
    surroundings: &Surroundings,
) -> Option<Vec<bool>> {
    surroundings.tells().then_some(())?;
    let radius_px = silhouette.radius_px;
    let height = mask.len() / width;
    let reach = (3.0 * CLOSED * radius_px) as usize + PAD;
    let (corner, frame) = silhouette.frame();
    let low = corner.map(|c| (c.max(0.0) as usize).saturating_sub(reach));
    let high = [width, height];
    let high = [0, 1].map(|c| ((corner[c] + frame[c] as f64) as usize + reach).min(high[c]));
    let (w, h) = (high[0] - low[0], high[1] - low[1]);
    let pixel = |k: usize| (low[1] + k / w) * width + low[0] + k % w;
    let mut cut = Image { width: w, height: h, values: (0..w * h).map(|k| mask[pixel(k)]).collect() };
    let at = |k: usize| [(low[0] + k % w) as f64, (low[1] + k / w) as f64];
    // whether blobs lie behind the ropes, where depth shows it
    let behind = |found: &Blobs, most: f64| -> Vec<Option<bool>> {
        let mut ahead = vec![Vec::new(); found.sizes.len()];
        for run in &found.runs {
            let size = found.sizes[run.blob] as f64 / (radius_px * radius_px);
            if size < MIN_BLOB || size > most {
                continue;
            }
            for x in run.begin..run.end {
                let k = run.row * w + x;
                ahead[run.blob].extend(surroundings.ahead(at(k), depth[pixel(k)]));
            }
        }
        ahead
            .into_iter()
            .map(|ahead| upper_median(&ahead).map(|middle| surroundings.is_behind(middle)))
            .collect()
    };
    let turn = |cut: &mut Image<bool>, found: &Blobs, judged: &[Option<bool>], when: bool, value: bool| {
        for run in found.runs.iter().filter(|run| judged[run.blob] == Some(when)) {
            cut.values[run.row * w..][run.begin..run.end].fill(value);
        }
    };
    let specks = find_blobs(&cut, true, true);
    let judged = behind(&specks, MAX_SPECK);
    turn(&mut cut, &specks, &judged, true, false);
    // pieces lost between and in parts of the mask
    let lost = combine(&cut, &closed(&cut, CLOSED * radius_px), |mask, closed| closed && !mask);
    let found = find_blobs(&lost, true, false);
    let judged = behind(&found, f64::INFINITY);
    turn(&mut cut, &found, &judged, false, true);
    // parts that stick out
    let taken = combine(&cut, &opened(&cut, OPENED * radius_px), |mask, opened| mask && !opened);
    let found = find_blobs(&taken, true, false);
    let judged = behind(&found, f64::INFINITY);
    turn(&mut cut, &found, &judged, true, false);
    let mut made = vec![false; mask.len()];
    for (k, &value) in cut.values.iter().enumerate() {
        made[pixel(k)] = value;
    }
    Some(made)
}

fn combine(a: &Image<bool>, b: &Image<bool>, both: impl Fn(bool, bool) -> bool) -> Image<bool> {
    let values = a.values.iter().zip(&b.values).map(|(&a, &b)| both(a, b)).collect();
    Image { width: a.width, height: a.height, values }
}

/// Grows, then shrinks by a distance.
fn closed(image: &Image<bool>, reach: f64) -> Image<bool> {
    shrunk(&grown(image, reach), reach)
}

/// Shrinks, then grows by a distance.
fn opened(image: &Image<bool>, reach: f64) -> Image<bool> {
    grown(&shrunk(image, reach), reach)
}

fn grown(image: &Image<bool>, reach: f64) -> Image<bool> {
    let away = measure_distances(image, false, reach.ceil() as usize + 1);
    combine_values(image, &away, |_, d| f64::from(d) <= reach)
}

fn shrunk(image: &Image<bool>, reach: f64) -> Image<bool> {
    let inside = measure_distances(image, true, reach.ceil() as usize + 1);
    combine_values(image, &inside, |value, d| value && f64::from(d) > reach)
}

fn combine_values(image: &Image<bool>, other: &Image<f32>, both: impl Fn(bool, f32) -> bool) -> Image<bool> {
    let values = image.values.iter().zip(&other.values).map(|(&a, &b)| both(a, b)).collect();
    Image { width: image.width, height: image.height, values }
}
