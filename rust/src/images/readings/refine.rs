//! Whole chains fitted together to the mask's edge, including pieces of edge that no chain explains yet.

use std::cell::OnceCell;

use super::links::{EDGE_SD, EDGE_SHARE, FIT_BENDING, Votes};
use super::lookup::{Across, Lookup};
use super::planar::{Place, length, unit};
use super::stiffness::{Equations, Stiffness};
use crate::images::silhouette::Silhouette;

/// Reach of edges that no chain explains yet, by iteration, image radii.
const REACH: [f64; 7] = [4.0, 4.0, 3.5, 3.0, 2.0, 1.3, 0.8];
const NEAR: f64 = 1.2; // reach of edges near chains at least, image radii
/// An edge is explained by a chain within this distance of its vote for the axis, image radii.
const EXPLAINED: f64 = 0.8;
const MAX_ALONG: f64 = 0.45; // cosine between an edge's normal and the rope's direction at most
const END_HOLD: f64 = 100.0; // weight that holds a chain's ends where they started
const DAMPING: f64 = 1e-2; // limits steps of nodes that nothing else holds
const SLACK: f64 = 1e-6; // pixels by which a search reaches farther than a known node, against rounding

/// Fits chains together to the mask.
pub fn refined(silhouette: &Silhouette, votes: &Votes, chains: &[Vec<Place>]) -> Vec<Vec<Place>> {
    let radius_px = silhouette.radius_px;
    let starts: Vec<usize> = chains
        .iter()
        .scan(0, |sum, c| {
            *sum += c.len();
            Some(*sum - c.len())
        })
        .collect();
    let mut nodes: Vec<Place> = chains.concat();
    let chain_of: Vec<usize> = chains.iter().enumerate().flat_map(|(k, c)| vec![k; c.len()]).collect();
    let steps: Vec<f64> = chains.iter().map(|c| length(c) / (c.len() - 1) as f64 / radius_px).collect();
    let stiffen = |(chain, &h): (&Vec<Place>, &f64)| {
        let mut holds = vec![0.0; chain.len()];
        holds[0] = END_HOLD;
        holds[chain.len() - 1] = END_HOLD;
        Stiffness::new(h, FIT_BENDING, holds, DAMPING)
    };
    let stiffness: Vec<Stiffness> = chains.iter().zip(&steps).map(stiffen).collect();
    let is_end = |i: usize| {
        let k = chain_of[i];
        i == starts[k] || i + 1 == starts[k] + chains[k].len()
    };
    // the last nearest node of each edge, near which the next one is
    let mut last: Vec<Option<usize>> = vec![None; silhouette.boundary.len()];
    for reach in REACH {
        let tangents: Vec<Place> = (0..nodes.len())
            .map(|i| {
                let (first, last) =
                    (starts[chain_of[i]], starts[chain_of[i]] + chains[chain_of[i]].len() - 1);
                let (a, b) = (nodes[i.saturating_sub(1).max(first)], nodes[(i + 1).min(last)]);
                unit([b[0] - a[0], b[1] - a[1]])
            })
            .collect();
        let mut systems: Vec<Equations> = (stiffness.iter().zip(chains).zip(&starts))
            .map(|((stiffness, c), &s)| stiffness.equations(&nodes[s..s + c.len()], c, radius_px))
            .collect();
        let across = Across { nodes: &tangents, places: &votes.normals, below: MAX_ALONG };
        let nearest = votes.lookup.find_across(&nodes, NEAR * radius_px, &across);
        let lookup = OnceCell::new();
        let edges = silhouette.boundary.iter().zip(&votes.places);
        for (((edge, &vote), near), last) in edges.zip(nearest).zip(&mut last) {
            let away = |x: Place| [vote[0] - x[0], vote[1] - x[1]];
            let squared = |i: usize| away(nodes[i])[0].powi(2) + away(nodes[i])[1].powi(2);
            let is_across = |i: usize| {
                (tangents[i][0] * edge.normal[0] + tangents[i][1] * edge.normal[1]).abs() < MAX_ALONG
            };
            // most edges have a chain beside them
            *last = near.or_else(|| {
                if reach <= NEAR {
                    return None;
                }
                let lookup = lookup.get_or_init(|| Lookup::new(&nodes, NEAR * radius_px));
                let known = last.filter(|&i| is_across(i)).map(|i| squared(i).sqrt() + SLACK);
                let within = reach * radius_px;
                let (mut least, mut found) = (within.powi(2), None);
                lookup.visit(vote, within.min(known.unwrap_or(within)), |i| {
                    if squared(i) < least && is_across(i) {
                        (least, found) = (squared(i), Some(i));
                    }
                });
                found
            });
            let Some(i) = last.filter(|&i| !is_end(i)) else { continue };
            let d = away(nodes[i]);
            let residual = (d[0] * edge.normal[0] + d[1] * edge.normal[1]) / radius_px;
            let weight = if residual.abs() < EXPLAINED {
                (1.0 - (residual / EXPLAINED).powi(2)).powi(2).max(0.25)
            } else if residual.abs() < reach {
                // an edge beyond the limit pulls as hard as one at the limit
                0.25 * EXPLAINED / residual.abs()
            } else {
                continue;
            };
            let weight = weight * EDGE_SHARE * edge.weight / radius_px / (EDGE_SD * EDGE_SD);
            let k = chain_of[i];
            systems[k].add(i - starts[k], [-edge.normal[0], -edge.normal[1]], residual, weight);
        }
        let mut most = 0.0f64;
        for (k, mut system) in systems.into_iter().enumerate() {
            let own = &mut nodes[starts[k]..starts[k] + chains[k].len()];
            for (i, &x) in own.iter().enumerate() {
                let missing = 0.9 - silhouette.distance(x) / radius_px;
                if missing > 0.0 && !silhouette.hidden(x) {
                    let g = silhouette.gradient(x);
                    system.add(i, [-g[0], -g[1]], missing, 4.0 * steps[k]);
                }
            }
            let Some((step, far)) = system.solve() else { continue };
            most = most.max(far);
            let scale = (0.7 / far.max(1e-9)).min(1.0) * radius_px;
            for (node, step) in own.iter_mut().zip(step) {
                for c in 0..2 {
                    node[c] += scale * step[c];
                }
            }
        }
        if most < 0.02 {
            break;
        }
    }
    chains.iter().zip(&starts).map(|(c, &s)| nodes[s..s + c.len()].to_vec()).collect()
}
