//! A mask of ropes whose radius is not known.

use std::sync::{Arc, Mutex, PoisonError};

use super::strokes::{Filled, Strokes, find_scale_of_widths, measure_shown_radius};
use super::thinning::Bits;

/// A mask, and its strands as they were traced last: radii that fill the same holes have the same strands.
pub struct RopeMask {
    /// The part of the mask that holds its pixels.
    values: Vec<bool>,
    width: usize,
    /// Column and row of the part's corner.
    corner: [f64; 2],
    traced: Mutex<Option<(Bits, Arc<Strokes>)>>,
}

impl RopeMask {
    /// Takes the mask of an image of `width` columns.
    pub fn new(mask: &[bool], width: usize) -> Self {
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for (row, values) in mask.chunks_exact(width.max(1)).enumerate() {
            if let Some(first) = values.iter().position(|&value| value) {
                let last = values.iter().rposition(|&value| value).unwrap_or(first);
                low = [low[0].min(first), low[1].min(row)];
                high = [high[0].max(last + 1), row + 1];
            }
        }
        let low = [0, 1].map(|c| low[c].min(high[c]));
        let rows = mask.chunks_exact(width.max(1)).take(high[1]).skip(low[1]);
        let values = rows.flat_map(|values| &values[low[0]..high[0]]).copied().collect();
        Self { values, width: high[0] - low[0], corner: low.map(|c| c as f64), traced: Mutex::new(None) }
    }

    /// Fills the mask for ropes of a radius, pixels, and magnifies it; None if it is empty without specks.
    pub fn fill(&self, radius_px: f64, scale: usize) -> Option<Filled> {
        let mut filled = Filled::new(&self.values, self.width, radius_px, scale)?;
        filled.origin = [0, 1].map(|c| filled.origin[c] + self.corner[c]);
        Some(filled)
    }

    /// Traces the strands of the mask, filled.
    pub fn trace(&self, filled: &Filled) -> Arc<Strokes> {
        let bits = Bits::of(&filled.inside);
        let mut traced = self.traced.lock().unwrap_or_else(PoisonError::into_inner);
        match &*traced {
            Some((before, strokes)) if strokes.scale == filled.scale && *before == bits => strokes.clone(),
            _ => {
                let strokes = Arc::new(Strokes::new(filled));
                *traced = Some((bits, strokes.clone()));
                strokes
            }
        }
    }

    /// Estimates the ropes' radius from the widths of the strands, pixels; None if there are none.
    pub fn estimate_radius(&self) -> Option<f64> {
        let shown =
            |radius_px: f64, scale: usize| measure_shown_radius(&self.trace(&self.fill(radius_px, scale)?));
        let roughly = shown(1.0, 1)?.max(0.5);
        shown(roughly, find_scale_of_widths(roughly).min(2))
    }
}
