//! Knots against their known polynomials, brute force and invariances.

use std::f64::consts::{PI, TAU};

use super::alexander::{compute_alexander, compute_mark};
use super::closure::spread_directions;
use super::code::{GaussCode, Visit};
use super::identity::{Identity, Kind};
use super::jones::{Laurent, compute_jones};
use super::projection::{Lid, Look, draw_diagram};
use super::reidemeister::{find_twists, reduced};
use super::table::{Chirality, TABLE};
use super::thinning::thin;
use super::*;
use crate::geometry::boxes::{Bounds, BoxTree};

/// For each entry of the table, a braid whose closure is the right-handed knot (KnotInfo, knotinfo.org).
const BRAIDS: [&[i32]; 18] = [
    &[1, -2],
    &[1, 1, 1],
    &[1, -2, 1, -2],
    &[1, 1, 1, 1, 1],
    &[1, 1, 1, 2, -1, 2],
    &[1, 1, 2, -1, -3, 2, -3],
    &[1, 1, 1, -2, 1, -2],
    &[1, 1, -2, 1, -2, -2],
    &[1, 1, 1, 1, 1, 1, 1],
    &[1, 1, 1, 2, -1, 2, 3, -2, 3],
    &[1, 1, 1, 1, 1, 2, -1, 2],
    &[1, 1, 2, -1, 2, 2, 3, -2, 3],
    &[1, 1, 1, 1, 2, -1, 2, 2],
    &[1, 1, -2, 1, 3, -2, 3],
    &[1, -2, 1, -2, 3, -2, 3],
    &[1, 1, 1, 2, 2, 2],
    &[1, 1, 1, -2, -2, -2],
    &[1, 1, 1, 2, -3, 2, -3],
];

/// Pseudo-random numbers from 0 to 1.
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn polygon(&mut self, count: usize) -> Vec<Point> {
        (0..count).map(|_| std::array::from_fn(|_| self.next())).collect()
    }
}

/// A braid closed about the z axis.
fn closed_braid(word: &[i32]) -> Vec<Point> {
    const STEPS: usize = 12;
    let strands = word.iter().map(|letter| letter.unsigned_abs()).max().unwrap() as usize + 1;
    let (mut position, mut nodes) = (0, Vec::new());
    for (k, &letter) in (0..strands).flat_map(|_| word.iter().enumerate()) {
        let low = letter.unsigned_abs() as usize - 1;
        let rise = match position {
            p if p == low => 1,
            p if p == low + 1 => -1,
            _ => 0,
        };
        for step in 0..STEPS {
            let part = step as f64 / STEPS as f64;
            let angle = TAU * (k as f64 + part) / word.len() as f64;
            let radius = 2.0 + position as f64 + f64::from(rise) * (1.0 - (PI * part).cos()) / 2.0;
            let height = f64::from(rise * letter.signum()) * (PI * part).sin().powi(2);
            nodes.push([radius * angle.cos(), radius * angle.sin(), height]);
        }
        position = (position as i32 + rise) as usize;
    }
    nodes
}

fn code_of(polygon: &[Point], towards: Point) -> GaussCode {
    draw_diagram(polygon, Lid::Segment, normalized(towards)).unwrap().code
}

fn first(points: &[Point], closed: bool) -> (Option<&'static str>, Chirality) {
    let found = identify(points, closed).unwrap();
    (found.answers[0].name, found.answers[0].chirality)
}

fn mirrored(points: &[Point]) -> Vec<Point> {
    points.iter().map(|&[x, y, z]| [x, y, -z]).collect()
}

/// The bracket over all states, A in powers from -60 to 60.
fn bracket_by_brute_force(code: &GaussCode) -> Vec<i64> {
    let planar = code.planar_diagram();
    let mut total = vec![0; 121];
    for state in 0..1_usize << planar.len() {
        let mut at: Vec<usize> = (0..2 * planar.len()).collect();
        fn root(at: &[usize], mut k: usize) -> usize {
            while at[k] != k {
                k = at[k];
            }
            k
        }
        let mut circles = at.len();
        for (k, &[a, b, c, d]) in planar.iter().enumerate() {
            for (p, q) in if state >> k & 1 == 0 { [(a, b), (c, d)] } else { [(a, d), (b, c)] } {
                let (p, q) = (root(&at, p as usize), root(&at, q as usize));
                circles -= usize::from(p != q);
                at[p] = q;
            }
        }
        let power = planar.len() as i64 - 2 * i64::from(state.count_ones());
        // (-A^2 - A^-2)^(circles - 1)
        let mut binomial = 1;
        for k in 0..circles as i64 {
            let sign = if circles % 2 == 1 { 1 } else { -1 };
            total[(60 + power + 2 * (circles as i64 - 1) - 4 * k) as usize] += sign * binomial;
            binomial = binomial * (circles as i64 - 1 - k) / (k + 1);
        }
    }
    total
}

fn jones_by_brute_force(code: &GaussCode) -> Laurent {
    let writhe = code.writhe();
    let sign = if writhe % 2 == 0 { 1 } else { -1 };
    let mut terms: Vec<(i64, i64)> = (bracket_by_brute_force(code).into_iter().enumerate())
        .filter(|&(_, x)| x != 0)
        .map(|(k, x)| (-(k as i64 - 60 - 3 * writhe) / 4, sign * x))
        .collect();
    terms.sort_unstable();
    let mut dense = vec![0; (terms[terms.len() - 1].0 - terms[0].0) as usize + 1];
    terms.iter().for_each(|&(power, x)| dense[(power - terms[0].0) as usize] = x);
    (terms[0].0, dense)
}

#[test]
fn every_knot_of_the_table_is_named_with_its_chirality() {
    for (entry, word) in TABLE.iter().zip(BRAIDS) {
        let ring = closed_braid(word);
        let (name, chirality) = first(&ring, true);
        assert_eq!(name, Some(entry.name));
        let amphichiral = matches!(word, [1, -2, ..] if word.len() < 5)
            || entry.name == "6_3"
            || word == [1, 1, 1, -2, -2, -2];
        assert_eq!(chirality, if amphichiral { Chirality::None } else { Chirality::Right }, "{}", entry.name);
        let flipped = if amphichiral { Chirality::None } else { Chirality::Left };
        assert_eq!(first(&mirrored(&ring), true), (name, flipped));
        let back: Vec<Point> = ring.iter().rev().copied().collect();
        assert_eq!(first(&back, true), (name, chirality));
        assert_eq!(identify(&ring, true).unwrap().core, None);
    }
}

#[test]
fn polynomials_and_small_diagrams_agree_with_the_table() {
    for (entry, word) in TABLE.iter().zip(BRAIDS) {
        let found = identify(&closed_braid(word), true).unwrap();
        assert_eq!(found.alexander.as_deref(), Some(entry.alexander));
        let (low, coefficients) = found.jones.unwrap();
        assert_eq!((low, &coefficients[..]), entry.jones);
        // V(1) = 1 and |V(-1)| = |Delta(-1)| of every knot
        assert_eq!(coefficients.iter().sum::<i64>(), 1);
        let alternating = |all: &[i64]| all.iter().rev().fold(0, |sum, x| x - sum).abs();
        assert_eq!(alternating(&coefficients), alternating(entry.alexander));
    }
}

#[test]
fn entries_of_the_table_differ() {
    let mut seen = Vec::new();
    for entry in &TABLE {
        let (low, coefficients) = entry.jones;
        let image = (-(low + coefficients.len() as i64 - 1), coefficients.iter().rev().copied().collect());
        for jones in [(low, coefficients.to_vec()), image] {
            if !seen.contains(&(entry.name, jones.clone())) {
                assert!(seen.iter().all(|(name, other)| *name == entry.name || *other != jones));
                seen.push((entry.name, jones));
            }
        }
    }
}

#[test]
fn polynomials_of_random_diagrams_are_those_of_brute_force_and_do_not_depend_on_the_view() {
    let mut chance = Chance(7);
    let mut compared = 0;
    while compared < 60 {
        let polygon = chance.polygon(8);
        let [one, other] = [[0.3, 0.5, 0.8], [0.9, -0.4, 0.3]].map(|towards| code_of(&polygon, towards));
        if one.crossings() > 11 || other.crossings() > 11 {
            continue;
        }
        compared += 1;
        assert_eq!(compute_jones(&one).unwrap(), jones_by_brute_force(&one));
        assert_eq!(compute_jones(&one), compute_jones(&other));
        assert_eq!(compute_alexander(&one), compute_alexander(&other));
        let less = reduced(&one);
        assert!(less.crossings() <= one.crossings());
        assert_eq!(
            (compute_jones(&less), compute_alexander(&less)),
            (compute_jones(&one), compute_alexander(&one))
        );
        assert_eq!(Identity::of(less).kind, Identity::of(reduced(&other)).kind);
    }
}

#[test]
fn thinning_keeps_the_knot_of_random_polygons() {
    let mut chance = Chance(3);
    let mut knotted = 0;
    for _ in 0..150 {
        let polygon = chance.polygon(16);
        let left = thin(&polygon, true, f64::INFINITY).left();
        let [all, few] = [&polygon, &left].map(|nodes| reduced(&code_of(nodes, [0.35, 0.5, 0.79])));
        assert_eq!(compute_alexander(&all), compute_alexander(&few));
        knotted += usize::from(compute_alexander(&few) != Some(vec![1]));
        if all.crossings() < 24 {
            assert_eq!(compute_jones(&all), compute_jones(&few));
        }
    }
    assert!(knotted > 5, "{knotted}");
}

#[test]
fn crossings_are_those_of_brute_force() {
    let mut chance = Chance(11);
    let flat = |p: Point, q: Point, r: Point| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    for _ in 0..20 {
        let polygon = chance.polygon(40);
        let side = |k: usize| (polygon[k], polygon[(k + 1) % 40]);
        let cross = |i: usize, j: usize| {
            let ((a, b), (c, d)) = (side(i), side(j));
            flat(a, b, c) * flat(a, b, d) < 0.0 && flat(c, d, a) * flat(c, d, b) < 0.0
        };
        let count = (0..40).flat_map(|j| (0..j).map(move |i| (i, j))).filter(|&(i, j)| cross(i, j)).count();
        let found = draw_diagram(&polygon, Lid::Segment, [0.0, 0.0, 1.0]).unwrap();
        assert_eq!(found.code.crossings(), count);
        assert_eq!(found.code.visits.len(), 2 * count);
        let closures = spread_directions(8).map(|towards| code_of(&polygon, towards));
        assert!(closures.into_iter().all(|code| code.visits.len() == 2 * code.crossings()));
    }
}

#[test]
fn a_tree_of_boxes_finds_what_brute_force_does() {
    let mut chance = Chance(5);
    for count in [1, 2, 3, 7, 33] {
        let segments: Vec<[Point; 2]> = (0..count).map(|_| [0, 1].map(|_| chance.polygon(1)[0])).collect();
        let tree = BoxTree::new(segments.iter().copied());
        for first in [0, 1, count / 2] {
            let corners = chance.polygon(2).iter().map(|p| p.map(|x| 0.6 * x)).collect::<Vec<_>>();
            let bounds = Bounds::about(&corners);
            let mut found = Vec::new();
            tree.any(&bounds, first, |k| {
                found.push(k);
                false
            });
            let meets = |k: &usize| {
                let own = Bounds::about(&segments[*k]);
                (0..3).all(|i| own.low[i] <= bounds.high[i] && bounds.low[i] <= own.high[i])
            };
            assert_eq!(found, (first..count).filter(meets).collect::<Vec<_>>());
        }
    }
}

#[test]
fn codes_of_a_trefoil_are_those_of_the_books() {
    let code = identify(&closed_braid(&[1, 1, 1]), true).unwrap().code;
    assert_eq!(code.signs, [1, 1, 1]);
    assert_eq!(code.writhe(), 3);
    let even: Vec<i64> = code.dowker_thistlethwaite().iter().map(|x| x.abs()).collect();
    assert_eq!(even, [4, 6, 2]);
    // each edge leaves one crossing and enters another
    let mut edges: Vec<u32> = code.planar_diagram().concat();
    edges.sort_unstable();
    assert_eq!(edges, [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]);
}

#[test]
fn moves_take_away_what_they_can() {
    let visit = |(crossing, over)| Visit { crossing, over };
    let code = |visits: &[(u32, bool)], signs: &[i8]| GaussCode {
        visits: visits.iter().copied().map(visit).collect(),
        signs: signs.to_vec(),
    };
    let twist = code(&[(0, true), (0, false)], &[1]);
    assert_eq!(reduced(&twist), GaussCode::default());
    let over = [(0, true), (1, true), (1, false), (0, false)];
    assert_eq!(reduced(&code(&over, &[1, -1])), GaussCode::default());
    let trefoil = identify(&closed_braid(&[1, 1, 1]), true).unwrap().code;
    assert_eq!(reduced(&trefoil).crossings(), 3);
    assert_eq!(reduced(&GaussCode::default()), GaussCode::default());
}

/// A trefoil with long ends: Shastri's polynomial knot.
fn overhand() -> Vec<Point> {
    let place = |k: i32| 4.4 * f64::from(k) / 120.0 - 2.2;
    let node = |t: f64| [t.powi(3) - 3.0 * t, t.powi(4) - 4.0 * t * t, 0.3 * (t.powi(5) - 10.0 * t)];
    (0..=120).map(|k| node(place(k))).collect()
}

#[test]
fn an_open_trefoil_has_a_core_within_its_ends() {
    let mut nodes = overhand();
    let (start, stop) = (nodes[0], nodes[120]);
    let ahead = |p: Point, q: Point, k: i32| [0, 1, 2].map(|i| p[i] + f64::from(k) * (p[i] - q[i]));
    let (before, after) = (nodes[1], nodes[119]);
    nodes.splice(0..0, (1..=60).rev().map(|k| ahead(start, before, k)));
    nodes.extend((1..=60).map(|k| ahead(stop, after, k)));
    let found = identify(&nodes, false).unwrap();
    assert_eq!(found.answers[0].name, Some("3_1"));
    assert!(found.answers[0].share > 0.9);
    let [from, to] = found.core.unwrap();
    assert!(from > 30 && to < 211 && to - from > 40, "{from} {to}");
    assert_eq!(first(&nodes[from..=to], false).0, Some("3_1"));
}

#[test]
fn linking_numbers_of_rings() {
    let ring = |center: f64, upright: bool| -> Vec<Point> {
        let place = |k: i32| TAU * f64::from(k) / 40.0;
        (0..40)
            .map(|k| match upright {
                true => [center + place(k).cos(), 0.0, place(k).sin()],
                false => [place(k).cos(), place(k).sin(), 0.0],
            })
            .collect()
    };
    let (flat, linked, apart) = (ring(0.0, false), ring(1.0, true), ring(3.0, true));
    let number = find_linking_number(&flat, &linked, [true; 2]).unwrap();
    // the upright ring goes down through the flat one, which runs anticlockwise
    assert_eq!(number, -1.0);
    assert_eq!(find_linking_number(&linked, &flat, [true; 2]).unwrap(), number);
    assert_eq!(find_linking_number(&flat, &mirrored(&linked), [true; 2]).unwrap(), -number);
    assert_eq!(find_linking_number(&flat, &apart, [true; 2]).unwrap(), 0.0);
    // a long straight line through the ring winds round it once
    let line: Vec<Point> = [[0.0, 0.1, -1e3], [0.1, 0.0, 1e3]].to_vec();
    let through = find_linking_number(&flat, &line, [true, false]).unwrap();
    assert!((through.abs() - 1.0).abs() < 1e-3, "{through}");
}

#[test]
fn uncertain_crossings_carry_over() {
    let ring = closed_braid(&[1, 1, 1]);
    let code = draw(&ring, true, [0.0, 0.0, 1.0]).unwrap();
    assert_eq!(code.crossings(), 3);
    let chance = order::find_order_probability(&code, &[0.9, 0.8, 1.0]);
    // one wrong crossing of three unties the trefoil
    assert!((chance - 0.72).abs() < 1e-12, "{chance}");
    // all three wrong give the other trefoil
    let chance = order::find_order_probability(&code, &[0.5; 3]);
    assert!((chance - 0.125).abs() < 1e-12, "{chance}");
}

#[test]
fn marks_are_those_of_the_alexander_polynomial() {
    let mut chance = Chance(9);
    let mut by_mark = Vec::new();
    for _ in 0..150 {
        let code = reduced(&code_of(&chance.polygon(11), [0.3, 0.5, 0.8]));
        by_mark.push((compute_mark(&code).unwrap(), compute_alexander(&code).unwrap()));
    }
    for (first, polynomial) in &by_mark {
        assert!(by_mark.iter().all(|(other, theirs)| (first == other) == (polynomial == theirs)));
    }
    by_mark.dedup_by_key(|found| found.0);
    assert!(by_mark.len() > 5, "{by_mark:?}");
}

#[test]
fn stretches_are_closed_as_chains_are() {
    let (mut chance, mut knotted) = (Chance(13), 0);
    for _ in 0..60 {
        let nodes = chance.polygon(18);
        let direction = normalized([0.3, -0.5, 0.8]);
        let look = Look::new(&nodes, direction).unwrap();
        for (from, to) in [(0, 17), (0, 12), (4, 16), (8, 17), (3, 5), (3, 4)] {
            let far = |end: usize| [0, 1, 2].map(|k| nodes[end][k] + 9.0 * direction[k]);
            let mut ring = nodes[from..=to].to_vec();
            ring.extend([far(to), far(from)]);
            let code = reduced(&look.stretch(from, to).unwrap());
            let expected = reduced(&code_of(&thin(&ring, true, f64::INFINITY).left(), [0.35, 0.5, 0.79]));
            assert_eq!(compute_mark(&code), compute_mark(&expected));
            knotted += usize::from(compute_mark(&code) != Some(1));
        }
    }
    assert!(knotted > 3, "{knotted}");
}

#[test]
fn twists_do_not_matter_whichever_strand_is_on_top() {
    let visit = |(crossing, over)| Visit { crossing, over };
    // a loop within a loop, and a trefoil behind: over the start one crossing of both
    let visits = [(0, true), (1, true), (2, false), (2, true), (1, false)];
    let trefoil = [(3, true), (4, false), (5, true), (3, false), (4, true), (5, false)];
    let all = visits.into_iter().chain(trefoil).chain([(0, false)]);
    let code = GaussCode { visits: all.map(visit).collect(), signs: vec![1, -1, 1, 1, 1, 1] };
    assert_eq!(find_twists(&code), [true, true, true, false, false, false]);
    let chance = order::find_order_probability(&code, &[0.5, 0.5, 0.5, 0.9, 1.0, 1.0]);
    assert!((chance - 0.9).abs() < 1e-12, "{chance}");
}

#[test]
fn what_is_no_polyline_is_refused() {
    let line = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 1.0]];
    assert_eq!(first(&line[..2], false), (Some("0_1"), Chirality::None));
    let said = |points: &[Point], closed| identify(points, closed).unwrap_err().to_string();
    assert!(said(&line[..1], false).contains("at least two nodes"));
    assert!(said(&line[..2], true).contains("at least three nodes"));
    assert!(said(&[line[0], line[1], line[1]], false).contains("rows 1 and 2"));
    assert!(said(&[line[0], line[1], line[0]], true).contains("first node again"));
    assert!(said(&[line[0], [f64::NAN; 3]], false).contains("finite"));
    let flat: Vec<Point> = closed_braid(&[1, 1, 1]).iter().map(|&[x, y, _]| [x, y, 0.0]).collect();
    assert!(said(&flat, true).contains("meets itself"));
    assert!(said(&flat, false).contains("meets itself"));
}

#[test]
fn what_is_too_tangled_has_an_answer_all_the_same() {
    let found = identify(&Chance(1).polygon(2000), false).unwrap();
    assert_eq!(found.answers[0].name, None);
    assert_eq!(found.alexander, None);
    assert_eq!(Identity::unknown().kind, Kind::Unknown(None));
}
