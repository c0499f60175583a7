//! Kernels of lines: curves, queries against tubes, knots.

use super::bytes::{Bytes, largest, require_finite};
use crate::geometry::arclength::ByLength;
use crate::geometry::bridge::{bridge, measure_bending, price_join};
use crate::geometry::overlap::{Along, find_overlaps};
use crate::geometry::plan::find_crossings;
use crate::geometry::polyline::arc_length;
use crate::geometry::spline::Spline;
use crate::geometry::straighten::straighten;
use crate::geometry::{Point, dot};
use crate::knots;
use crate::queries::{Path, Sweep, TubeQueries};

const LARGE: f64 = 1e30; // coordinates above this may overflow where no promise is made

pub fn follow_curves(mut bytes: Bytes<'_>) {
    let (spacing, extension, radius, span) = (bytes.length(), bytes.length(), bytes.length(), bytes.length());
    let (nodes, others) = (bytes.points(40), bytes.points(12));
    if let Ok(curve) = Spline::through(&nodes, spacing, extension) {
        require_finite(&curve.control);
        assert!(curve.control.len() >= 4 && curve.control.len() < 5100);
        let (end, pieces) = (curve.end(), curve.pieces());
        for u in [0.0, 0.3 * end, end, bytes.ordinary()] {
            let place = curve.at(u);
            require_finite(&[place.position, place.first, place.second]);
            require_finite(&[pieces.at(u).position]);
        }
        let length = curve.length();
        assert!(length.is_finite() && length >= 0.0);
        let table = ByLength::new(&curve, 0.0, end);
        let half = table.parameter(0.5 * table.length());
        assert!((0.0..=end).contains(&half), "{half} {end}");
        assert!(table.into_table().is_sorted());
    }
    if let Ok(straight) = straighten(&nodes, radius, span) {
        assert_eq!(straight.len(), nodes.len());
        let size = largest(&nodes).max(radius).max(span);
        // the bend of nodes that are much nearer than the radius exceeds all numbers
        if size < LARGE && span > 1e-6 * size {
            require_finite(&straight);
        }
    }
    if largest(&nodes).max(largest(&others)) < LARGE && span < LARGE {
        let reach = [0.5 + 0.1 * bytes.ordinary(), 1.0];
        if let Ok(inner) = bridge(&nodes, &others, span, spacing, reach) {
            require_finite(&inner);
        }
        assert!(measure_bending(&nodes) >= 0.0);
        if let ([p, ..], [q, ..]) = (&nodes[..], &others[..]) {
            let (leave, arrive) = (bytes.unit(), bytes.unit());
            let cost = price_join(*p, leave, *q, arrive, 0.004);
            assert!(cost >= 0.0, "{cost}");
        }
    }
    follow_plans(&nodes, radius, span);
}

fn follow_plans(nodes: &[Point], distance: f64, apart: f64) {
    if !nodes.as_flattened().iter().all(|x| x.is_finite()) {
        return;
    }
    let arc = arc_length(nodes);
    let places: Vec<Along> = nodes
        .iter()
        .zip(&arc)
        .enumerate()
        .map(|(i, (&position, &arc_length))| Along { curve: i / 8, arc_length, position })
        .collect();
    assert_eq!(find_overlaps(&places, distance, apart).len(), nodes.len());
    let plan: Vec<[f64; 2]> = nodes.iter().map(|p| [p[0], p[1]]).collect();
    let segments: Vec<[usize; 2]> = (1..plan.len()).map(|i| [i - 1, i]).collect();
    let found = find_crossings(&plan, &segments, usize::MAX).unwrap();
    assert!(found.is_sorted_by_key(|one| one.pair));
    for one in found {
        assert!(one.pair[0] + 1 < one.pair[1] && one.turn.abs() == 1);
        assert!(one.shares.iter().all(|share| (0.0..=1.0).contains(share)), "{one:?}");
    }
}

pub fn query_tubes(mut bytes: Bytes<'_>) {
    let chains: Vec<(Vec<Point>, f64)> =
        (0..1 + bytes.below(3)).map(|_| (bytes.points(12), bytes.length())).collect();
    let arcs: Vec<Vec<f64>> = chains.iter().map(|(nodes, _)| arc_length(nodes)).collect();
    let paths: Vec<Path<'_>> = (chains.iter().zip(&arcs))
        .map(|((nodes, radius), arc_length)| Path { nodes, arc_length, radius: *radius })
        .collect();
    let Ok(tubes) = TubeQueries::new(&paths) else { return };
    let is_empty = chains.iter().all(|(nodes, _)| nodes.len() < 2);
    let (starts, mut ends) = (bytes.points(8), bytes.points(8));
    ends.resize(starts.len(), [0.0; 3]);
    let widest = chains.iter().fold(0.0, |most: f64, (_, radius)| most.max(*radius));
    let size = chains
        .iter()
        .fold(widest.max(largest(&starts)).max(largest(&ends)), |most, (nodes, _)| most.max(largest(nodes)));
    let distances = tubes.signed_distances(&starts);
    if let Ok(distances) = &distances {
        assert!(distances.iter().all(|&d| d >= -widest && (d.is_finite() || is_empty)), "{distances:?}");
    }
    if let Ok(near) = tubes.nearest(&starts) {
        for (place, distance) in near.into_iter().flatten() {
            require_finite(&[place.point, [place.s, distance, 0.0]]);
            assert!(place.chain < chains.len() && distance >= 0.0);
        }
    }
    if let Ok(hits) = tubes.ray_hits(&starts, &ends) {
        for hit in hits.into_iter().flatten() {
            require_finite(&[hit.place.point, hit.normal, [hit.place.s, hit.distance, 0.0]]);
            assert!(hit.distance >= 0.0 && (dot(hit.normal, hit.normal) - 1.0).abs() < 1e-9, "{hit:?}");
        }
    }
    let radii: Vec<f64> = starts.iter().map(|_| bytes.length()).collect();
    if let Ok(sweeps) = tubes.swept_spheres(&starts, &ends, &radii) {
        sweeps.iter().flatten().for_each(require_sound);
    }
    let [from, to] =
        [(), ()].map(|()| starts.iter().map(|_| bytes.motion()).collect::<Vec<crate::RigidMotion>>());
    let mut halves: Vec<Point> = starts.iter().map(|_| bytes.point().map(f64::abs)).collect();
    if bytes.flag() {
        halves.fill([0.25; 3]);
    }
    if let Ok(sweeps) = tubes.swept_boxes(&from, &to, &halves) {
        for (i, sweep) in sweeps.iter().enumerate().filter_map(|(i, sweep)| Some((i, sweep.as_ref()?))) {
            require_sound(sweep);
            // the box holds its centre
            let own = [from[i].translation.into(), to[i].translation.into()];
            let rounding = 1e-12 * size.max(largest(&own)).max(largest(&halves)).max(1e-3);
            for distance in tubes.signed_distances(&own).unwrap() {
                let most = distance.max(-widest) + rounding;
                assert!(sweep.clearance <= most, "{} {most}", sweep.clearance);
            }
        }
    }
}

fn require_sound(sweep: &Sweep) {
    assert!((0.0..=1.0).contains(&sweep.time) || sweep.time == f64::INFINITY, "{sweep:?}");
    require_finite(&[sweep.place.point, [sweep.place.s, sweep.clearance, 0.0]]);
}

pub fn name_knots(mut bytes: Bytes<'_>) {
    let (closed, direction, strict) = (bytes.flag(), bytes.unit(), bytes.flag());
    let crossings: Vec<Point> = (0..bytes.below(6)).map(|_| bytes.point().map(f64::abs)).collect();
    let (points, others) = (bytes.points(40), bytes.points(20));
    if let Ok(knot) = knots::identify(&points, closed) {
        let total: f64 = knot.answers.iter().map(|answer| answer.share).sum();
        assert!((total - 1.0).abs() < 1e-9);
        if let Some([first, last]) = knot.core {
            assert!(first <= last && last < points.len());
        }
        if let Some(alexander) = &knot.alexander {
            assert_eq!(alexander.iter().sum::<i64>(), 1, "{alexander:?}");
            assert!(alexander.iter().eq(alexander.iter().rev()), "{alexander:?}");
        }
        require_code(&knot.code);
    }
    if let Ok(code) = knots::draw(&points, closed, direction) {
        require_code(&code);
    }
    if let Ok(probability) = knots::find_order_probability(&points, closed, direction, &crossings, strict) {
        // without a diagram, probabilities are taken as they are
        assert!(!strict || (0.0..=1.0 + 1e-9).contains(&probability), "{probability}");
    }
    if let Ok(number) = knots::find_linking_number(&points, &others, [closed, strict]) {
        assert!(number.is_finite() && (number.fract() == 0.0 || !(closed && strict)), "{number}");
    }
}

/// Panics unless each crossing is passed once above and once below.
fn require_code(code: &knots::GaussCode) {
    let mut passed = vec![[0; 2]; code.crossings()];
    for visit in &code.visits {
        passed[visit.crossing as usize][usize::from(visit.over)] += 1;
    }
    assert!(passed.iter().all(|&both| both == [1, 1]), "{code:?}");
    assert_eq!(code.planar_diagram().len(), code.crossings());
    assert!(code.dowker_thistlethwaite().len() <= code.crossings());
}
