//! Ragged masks mended by depth: bits that a segmenter lost and bits of the background that it took.

use crate::geometry::median::upper_median;
use crate::images::image::{Blobs, Image, blobs, distances};
use crate::images::silhouette::Silhouette;
use crate::images::surroundings::Surroundings;

/// Gaps narrower than twice this may be lost bits, and parts narrower than twice this taken ones, radius_px.
const CLOSED: f64 = 1.0;
const OPENED: f64 = 0.6;
/// Blobs on their own of less than this may be taken bits, radius_px²; smaller ones than the other are judged by nothing.
const SPECK: f64 = 12.0;
const LEAST: f64 = 0.15;
/// Pixels around the silhouette's frame that are looked at.
const PAD: usize = 4;

/// The mask with what lies as deep as the ropes, without what lies behind them; none if depth does not tell these apart.
pub fn mended(
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
    // whether blobs lie behind the ropes, where depth tells
    let behind = |found: &Blobs, most: f64| -> Vec<Option<bool>> {
        let mut ahead = vec![Vec::new(); found.sizes.len()];
        for run in &found.runs {
            let size = found.sizes[run.blob] as f64 / (radius_px * radius_px);
            if size < LEAST || size > most {
                continue;
            }
            for x in run.begin..run.end {
                let k = run.row * w + x;
                ahead[run.blob].extend(surroundings.ahead(at(k), depth[pixel(k)]));
            }
        }
        ahead
            .into_iter()
            .map(|mut a| (!a.is_empty()).then(|| surroundings.is_behind(upper_median(&mut a))))
            .collect()
    };
    let turn = |cut: &mut Image<bool>, found: &Blobs, judged: &[Option<bool>], when: bool, value: bool| {
        for run in found.runs.iter().filter(|run| judged[run.blob] == Some(when)) {
            cut.values[run.row * w..][run.begin..run.end].fill(value);
        }
    };
    let specks = blobs(&cut, true, true);
    let judged = behind(&specks, SPECK);
    turn(&mut cut, &specks, &judged, true, false);
    // what is lost between and in parts of the mask
    let lost = with(&cut, &closed(&cut, CLOSED * radius_px), |mask, closed| closed && !mask);
    let found = blobs(&lost, true, false);
    let judged = behind(&found, f64::INFINITY);
    turn(&mut cut, &found, &judged, false, true);
    // what sticks out
    let taken = with(&cut, &opened(&cut, OPENED * radius_px), |mask, opened| mask && !opened);
    let found = blobs(&taken, true, false);
    let judged = behind(&found, f64::INFINITY);
    turn(&mut cut, &found, &judged, true, false);
    let mut made = vec![false; mask.len()];
    for (k, &value) in cut.values.iter().enumerate() {
        made[pixel(k)] = value;
    }
    Some(made)
}

fn with(a: &Image<bool>, b: &Image<bool>, both: impl Fn(bool, bool) -> bool) -> Image<bool> {
    let values = a.values.iter().zip(&b.values).map(|(&a, &b)| both(a, b)).collect();
    Image { width: a.width, height: a.height, values }
}

/// Grown by a distance, then eaten by it.
fn closed(image: &Image<bool>, reach: f64) -> Image<bool> {
    eaten(&grown(image, reach), reach)
}

/// Eaten by a distance, then grown by it.
fn opened(image: &Image<bool>, reach: f64) -> Image<bool> {
    grown(&eaten(image, reach), reach)
}

fn grown(image: &Image<bool>, reach: f64) -> Image<bool> {
    let away = distances(image, false, reach.ceil() as usize + 1);
    with_values(image, &away, |_, d| f64::from(d) <= reach)
}

fn eaten(image: &Image<bool>, reach: f64) -> Image<bool> {
    let inside = distances(image, true, reach.ceil() as usize + 1);
    with_values(image, &inside, |value, d| value && f64::from(d) > reach)
}

fn with_values(image: &Image<bool>, other: &Image<f32>, both: impl Fn(bool, f32) -> bool) -> Image<bool> {
    let values = image.values.iter().zip(&other.values).map(|(&a, &b)| both(a, b)).collect();
    Image { width: image.width, height: image.height, values }
}
