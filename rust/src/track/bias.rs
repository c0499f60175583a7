//! How much depth each camera adds.

use super::camera::Camera;
use super::openings::{Look, Table};
use super::view::Samples;
use crate::geometry::{advance, dot};

const LYING: f64 = 2.5; // radii: heights below this show the bias of depth
const GROUP: usize = 12; // samples in a row whose mean height counts as one
const MIN_GROUP: usize = 6; // of them with depth
const MIN_LYING: usize = 3; // groups that show it
const WHOLE: f64 = 0.6; // share of the width that is seen where depth is read
const LOW: f64 = 0.3; // of the heights lie below a rope that lies
const LEAST: f64 = -0.2; // radii: of a bias
const MOST: f64 = 1.2; // radii: of a bias
const LEAST_SLOPE: f64 = 0.1; // cosine of the angle between ray and the table's normal

/// Takes a share of a new bias of each camera: a rope that lies is not in the table.
///
/// The low heights tell it, because a rope may lie on itself or be in the air. Groups of samples are averaged first: of
/// single samples the low ones are those with much noise.
pub fn learn(cameras: &mut [Camera<'_>], samples: &Samples, looks: &[Look], table: Option<Table>, gain: f64) {
    let Some(table) = table else { return };
    for (camera, (seen, evidence, _)) in cameras.iter_mut().zip(looks) {
        let (mut heights, mut slopes) = (vec![], 0.0f64);
        for start in (0..samples.len()).step_by(GROUP) {
            let group: Vec<usize> = (start..(start + GROUP).min(samples.len()))
                .filter(|&j| evidence.on[j] && evidence.part[j] > WHOLE)
                .collect();
            if group.len() < MIN_GROUP {
                continue;
            }
            let (mut height, mut slope) = (0.0, 0.0);
            for &j in &group {
                let world = camera.pose.apply(advance(seen.places[j], evidence.deep[j], seen.deep[j]));
                let own = dot(camera.turn(seen.rays[j]), table.normal).abs();
                height += (dot(world, table.normal) - table.offset - camera.bias * own) / group.len() as f64;
                slope += own / group.len() as f64;
            }
            if height < LYING * samples.radius[start] {
                heights.push(height);
                slopes += slope;
            }
        }
        if heights.len() >= MIN_LYING {
            let slope = slopes / heights.len() as f64;
            heights.sort_by(f64::total_cmp);
            let r = samples.radius[0];
            let low = heights[(LOW * heights.len() as f64) as usize];
            let want = (r - low).clamp(LEAST * r, MOST * r) / slope.max(LEAST_SLOPE);
            camera.bias += gain * (want - camera.bias);
        }
    }
}
