//! A mask of ropes whose radius is not known.

use std::sync::{Arc, Mutex, PoisonError};

use super::bits::Bits;
use super::strokes::{Filled, Strokes, find_scale_of_widths, measure_shown_radius};

const NANOSECONDS: usize = 40; // that a pixel of a mask takes; one beside it takes about one

/// A mask, and its strands as they were traced last: radii that fill the same holes have the same strands.
pub struct RopeMask {
    mask: Bits,
    /// How long it takes to measure the ropes' radius, about.
    pub nanoseconds: usize,
    traced: Mutex<Option<(Bits, Arc<Strokes>)>>,
}

impl RopeMask {
    /// Takes the mask of an image of `width` columns.
    pub fn new(mask: &[bool], width: usize) -> Self {
        let mask = Bits::pack(mask, width);
        let own: usize = mask.words.iter().map(|word| word.count_ones() as usize).sum();
        let around = mask.find_bounds().map_or(0, |[columns, rows]| columns.len() * rows.len());
        Self { mask, nanoseconds: NANOSECONDS * own + around, traced: Mutex::new(None) }
    }

    /// Fills the mask for ropes of a radius, pixels, and magnifies it; None if it is empty without specks.
    pub fn fill(&self, radius_px: f64, scale: usize) -> Option<Filled> {
        Filled::new(&self.mask, radius_px, scale)
    }

    /// Traces the strands of the mask, filled.
    pub fn trace(&self, filled: &Filled) -> Arc<Strokes> {
        let mut traced = self.traced.lock().unwrap_or_else(PoisonError::into_inner);
        match &*traced {
            Some((before, strokes)) if strokes.scale == filled.scale && *before == filled.inside => {
                strokes.clone()
            }
            _ => {
                let strokes = Arc::new(Strokes::new(filled));
                *traced = Some((filled.inside.clone(), strokes.clone()));
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
