//! A prepared view: its mask, mended by depth, and its depth, without things that hide the ropes.

use super::camera::RopeView;
use super::medians::Medians;
use crate::clouds::depth::{Pinhole, has_return};
use crate::geometry::RigidMotion;
use crate::geometry::median::upper_median;
use crate::images::image::{Image, find_runs};
use crate::images::mending::mend;
use crate::images::silhouette::Silhouette;
use crate::images::surroundings::Surroundings;
use crate::parallel;

const RAGGED: f64 = 0.25; // more ragged masks are mended by depth, 0 to 1

const MIN_RADIUS: f64 = 0.2; // thinner ropes show no axis, pixels

/// One camera's data, prepared for readings and fits.
pub struct Prepared {
    pub silhouette: Silhouette,
    pub medians: Medians,
    pub pinhole: Pinhole,
    pub pose: RigidMotion,
    pub size: [usize; 2],
    /// Columns and rows of the mask's pixels with depth.
    pub covered: Vec<[f64; 2]>,
    /// Depth of all pixels, metres.
    pub depth: Image<f32>,
}

impl Prepared {
    /// Prepares a view; None if its mask shows no rope with depth. If the mask is wider than the ropes, it is read at a
    /// radius of its own, `mask_px`.
    pub fn new(
        depth: &[f64],
        mask: &[bool],
        size: [usize; 2],
        pinhole: Pinhole,
        pose: RigidMotion,
        radius: f64,
        mask_px: Option<f64>,
    ) -> Option<Self> {
        let (mut seen, mut covered) = (Vec::new(), Vec::new());
        let rows = depth.chunks_exact(size[0].max(1)).zip(mask.chunks_exact(size[0].max(1)));
        for (row, (depth, mask)) in rows.enumerate() {
            for run in find_runs(mask) {
                for column in run.filter(|&k| has_return(depth[k])) {
                    seen.push(depth[column]);
                    covered.push([column as f64, row as f64]);
                }
            }
        }
        let radius_px = pinhole.focal[0] * radius / upper_median(&seen)?;
        // no edge of a rope as wide as two images shows
        if radius_px > size[0].max(size[1]) as f64 {
            return None;
        }
        let silhouette = Silhouette::of_rope(mask, size[0], mask_px.unwrap_or(radius_px))?;
        if silhouette.radius_px < MIN_RADIUS {
            return None;
        }
        // a mask that is too wide shows what is beside the ropes too
        let disc_px =
            |silhouette: &Silhouette| if mask_px.is_some() { radius_px } else { silhouette.radius_px };
        let (around, medians) = parallel::both(
            || Surroundings::new(depth, mask, size[0], &silhouette.ropes(), radius),
            || Medians::new(depth, mask, size[0], &silhouette, disc_px(&silhouette)),
        );
        let ragged = around.as_ref().filter(|_| silhouette.ragged > RAGGED);
        let mended = ragged.and_then(|around| mend(depth, mask, size[0], &silhouette, around));
        let silhouette = match &mended {
            Some(mask) => Silhouette::of_rope(mask, size[0], mask_px.unwrap_or(radius_px))?,
            None => silhouette,
        };
        let rope = mended.as_deref().unwrap_or(mask);
        let medians = match around.as_ref().filter(|around| around.hides()) {
            // things that hide the ropes are no part of them where a mask is too wide
            Some(around) => {
                let at = |k: usize| [(k % size[0]) as f64, (k / size[0]) as f64];
                let own = |k: usize| !(rope[k] && around.before(at(k), depth[k]));
                let seen: Vec<f64> =
                    (0..depth.len()).map(|k| if own(k) { depth[k] } else { f64::NAN }).collect();
                Medians::new(&seen, rope, size[0], &silhouette, disc_px(&silhouette))
            }
            None if mended.is_some() => Medians::new(depth, rope, size[0], &silhouette, disc_px(&silhouette)),
            None => medians,
        };
        let silhouette = silhouette.amid(around);
        let depth =
            Image { width: size[0], height: size[1], values: depth.iter().map(|&z| z as f32).collect() };
        Some(Self { silhouette, medians, pinhole, pose, size, covered, depth })
    }

    /// The view as fits need it.
    pub fn rope_view(&self) -> RopeView<'_> {
        RopeView {
            silhouette: &self.silhouette,
            medians: &self.medians,
            pinhole: self.pinhole,
            pose: self.pose,
            size: self.size,
        }
    }
}
