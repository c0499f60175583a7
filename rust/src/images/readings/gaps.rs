//! Pieces of ropes joined over gaps in the mask, where something hides them or a segmenter lost them.

use std::collections::HashMap;
use std::sync::Arc;

use super::links::{BENDING, CHANGE, STEP};
use super::planar::{Place, bending, cleaned, distance, hermite, length, resampled, unit};
use crate::images::silhouette::Silhouette;
use crate::images::surroundings::Shown;

const CORNER_NODES: usize = 2; // last nodes of a piece that turn to the mask's corners
const HEADING_NODES: usize = 6; // nodes before them that show the piece's direction
const SPEEDS: [f64; 3] = [1.0, 1.4, 1.8]; // speeds at which curves over a gap leave and arrive, lengths of the gap
const GAP: f64 = 2.0; // cost of a gap
const HIDDEN: f64 = 0.1; // cost of each radius of a gap where something hides it
const UNKNOWN: f64 = 0.5; // cost of each radius of a gap without depth, or with a rope's depth
const BARE: f64 = 3.0; // cost of each radius of a gap where the camera saw through
const MAX_COST: f64 = 80.0; // largest cost of a gap, if the number of ropes is known
/// Times the largest cost: a curve that costs more at a few places is not looked at closely.
const CLEARLY: f64 = 1.25;
const DROPPED: f64 = 1.6; // cost of each radius of a dropped piece: mask that nothing covers
const PARTNERS: usize = 4; // partners of an end that are tried
const NEAREST: usize = 12; // nearest ends of other chains that curves from an end are made to
const MAX_TRIED: usize = 3000; // combinations that are tried at most

/// Chains, some of them joined.
pub struct Joined {
    pub chains: Vec<Vec<Place>>,
    /// The cost of the gaps.
    pub cost: f64,
    /// Its part that is not for bending.
    pub fixed: f64,
}

/// A curve from the end of one chain to the end of another.
struct Bridge {
    /// The chains, and their ends: 0 for the first node, 1 for the last.
    ends: [(usize, usize); 2],
    curve: Arc<Curve>,
}

/// A curve over a gap, and its cost.
struct Curve {
    nodes: Vec<Place>,
    cost: f64,
    fixed: f64,
}

/// Curves between ends that were asked for before, for one number of ropes: most ways through a mask have most ends in
/// common.
#[derive(Default)]
pub struct KnownCurves {
    /// The number of each end, by the bits of its nodes.
    numbers: HashMap<Vec<[u64; 2]>, usize>,
    curves: HashMap<[usize; 2], Option<Arc<Curve>>>,
}

impl KnownCurves {
    fn number(&mut self, end: &[Place]) -> usize {
        let next = self.numbers.len();
        *self.numbers.entry(end.iter().map(|x| x.map(f64::to_bits)).collect()).or_insert(next)
    }
}

/// Finds the cheapest ways to join chains over gaps, or drop some, until `ropes` are left.
///
/// If their number is not known, it joins chains while that saves more than `each`, the cost of a rope.
pub fn join_pieces(
    silhouette: &Silhouette,
    chains: &[Vec<Place>],
    ropes: Option<usize>,
    each: f64,
    most: usize,
    known: &mut KnownCurves,
) -> Vec<Joined> {
    let asked = ropes.map_or(0, |ropes| chains.len().saturating_sub(ropes.max(1)));
    let gain = if ropes.is_some() { 0.0 } else { each };
    if chains.len() < 2 || (ropes.is_some() && asked == 0) {
        return vec![Joined { chains: chains.to_vec(), cost: 0.0, fixed: 0.0 }];
    }
    let bridges = find_bridges(silhouette, chains, if ropes.is_some() { MAX_COST } else { each }, known);
    let left: Vec<f64> = chains.iter().map(|c| 1.0 + DROPPED * length(c) / silhouette.radius_px).collect();
    let mut search = Search {
        bridges: &bridges,
        left: &left,
        asked: ropes.map(|_| asked),
        gain,
        most,
        tried: 0,
        found: Vec::new(),
    };
    search.add(0, &mut Vec::new(), (0..chains.len()).collect(), 0.0);
    let found = search.found;
    found.into_iter().map(|(_, chosen)| assemble(silhouette, chains, &bridges, &left, &chosen)).collect()
}

/// A step of a solution: a bridge, or a dropped chain.
#[derive(Clone, Copy)]
enum Step {
    Bridge(usize),
    Leave(usize),
}

struct Search<'a> {
    bridges: &'a [Bridge],
    left: &'a [f64],
    /// The number of steps; None if that is open.
    asked: Option<usize>,
    gain: f64,
    most: usize,
    tried: usize,
    /// Solutions with their costs, the cheapest first.
    found: Vec<(f64, Vec<Step>)>,
}

impl Search<'_> {
    /// Tries steps from number `next` on; `group` numbers the chains that are already joined.
    fn add(&mut self, next: usize, chosen: &mut Vec<Step>, group: Vec<usize>, cost: f64) {
        self.tried += 1;
        if self.tried > MAX_TRIED {
            return;
        }
        if self.found.len() == self.most && cost >= self.found[self.most - 1].0 && self.gain == 0.0 {
            return;
        }
        if self.asked.is_none_or(|asked| asked == chosen.len()) {
            let rank = self.found.partition_point(|(other, _)| *other <= cost);
            if rank < self.most {
                self.found.insert(rank, (cost, chosen.clone()));
                self.found.truncate(self.most);
            }
            if self.asked.is_some() {
                return;
            }
        }
        for k in next..self.bridges.len() + self.left.len() {
            if self.tried > MAX_TRIED {
                return;
            }
            let step =
                if k < self.bridges.len() { Step::Bridge(k) } else { Step::Leave(k - self.bridges.len()) };
            let (more, merged) = match step {
                Step::Bridge(b) => {
                    let [(i, _), (j, _)] = self.bridges[b].ends;
                    let taken = chosen.iter().any(|s| match s {
                        Step::Bridge(o) => {
                            self.bridges[*o].ends.iter().any(|e| self.bridges[b].ends.contains(e))
                        }
                        Step::Leave(_) => false,
                    });
                    if taken || group[i] == group[j] {
                        continue;
                    }
                    (self.bridges[b].curve.cost - self.gain, Some((group[j], group[i])))
                }
                Step::Leave(chain) => {
                    // at least one chain must stay
                    let alone = group.iter().filter(|g| **g == group[chain]).count() == 1;
                    if !alone || self.asked.is_none() {
                        continue;
                    }
                    (self.left[chain], None)
                }
            };
            let mut joined = group.clone();
            if let Some((from, to)) = merged {
                joined.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
            }
            chosen.push(step);
            self.add(k + 1, chosen, joined, cost + more);
            chosen.pop();
        }
    }
}

/// Finds bridges between ends of chains that cost less than `dearest`, the cheapest first.
fn find_bridges(
    silhouette: &Silhouette,
    chains: &[Vec<Place>],
    dearest: f64,
    known: &mut KnownCurves,
) -> Vec<Bridge> {
    let near: Vec<[(Vec<Place>, usize); 2]> = chains
        .iter()
        .map(|chain| {
            [0, 1].map(|end| {
                let nodes = take_from_end(chain, end);
                let number = known.number(&nodes);
                (nodes, number)
            })
        })
        .collect();
    let mut found: Vec<Bridge> = pair_ends(chains)
        .into_iter()
        .filter_map(|ends| {
            let [p, q] = ends.map(|(chain, end)| &near[chain][end]);
            let curve = known.curves.entry([p.1, q.1]).or_insert_with(|| {
                let curve = make_curve(silhouette, &p.0, &q.0, dearest);
                curve.map(Arc::new)
            });
            curve.as_ref().map(|curve| Bridge { ends, curve: curve.clone() })
        })
        .collect();
    found.sort_by(|a, b| a.curve.cost.total_cmp(&b.curve.cost));
    let mut partners = std::collections::HashMap::new();
    found.retain(|bridge| {
        let counts = bridge.ends.map(|end| *partners.get(&end).unwrap_or(&0));
        for end in bridge.ends {
            *partners.entry(end).or_insert(0) += 1;
        }
        counts.iter().any(|&count| count < PARTNERS)
    });
    found
}

/// Lists pairs of ends of different chains of which one is among the nearest to the other, in order.
fn pair_ends(chains: &[Vec<Place>]) -> Vec<[(usize, usize); 2]> {
    let ends: Vec<(usize, usize)> = (0..chains.len()).flat_map(|i| [(i, 0), (i, 1)]).collect();
    let place = |(i, e): (usize, usize)| chains[i][e * (chains[i].len() - 1)];
    let mut pairs = std::collections::BTreeSet::new();
    for &end in &ends {
        let mut others: Vec<(f64, (usize, usize))> = ends
            .iter()
            .filter(|other| other.0 != end.0)
            .map(|&other| (distance(place(end), place(other)), other))
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0));
        pairs.extend(others.iter().take(NEAREST).map(|&(_, other)| [end.min(other), end.max(other)]));
    }
    // by chains first, then by ends
    let mut pairs: Vec<_> = pairs.into_iter().collect();
    pairs.sort_by_key(|&[(i, e), (j, f)]| (i, j, e, f));
    pairs
}

/// Returns a chain's first nodes from an end on, without those that turn to the mask's corners.
fn take_from_end(chain: &[Place], end: usize) -> Vec<Place> {
    let cut = if chain.len() > CORNER_NODES + HEADING_NODES { CORNER_NODES } else { 0 };
    let node = |i: usize| if end == 0 { chain[i] } else { chain[chain.len() - 1 - i] };
    (cut..chain.len()).take(HEADING_NODES + 1).map(node).collect()
}

/// Finds the cheapest curve between two ends, whose nodes are given; None if it costs `dearest` or more.
fn make_curve(silhouette: &Silhouette, p: &[Place], q: &[Place], dearest: f64) -> Option<Curve> {
    let radius_px = silhouette.radius_px;
    let heading = |p: &[Place]| {
        let back = p[HEADING_NODES.min(p.len() - 1)];
        unit([p[0][0] - back[0], p[0][1] - back[1]])
    };
    let (a, b, out, into) = (p[0], q[0], heading(p), heading(q).map(|x| -x));
    let price = |x: &Place| {
        if silhouette.holds(*x) {
            return 0.0;
        }
        match silhouette.shown(*x) {
            Shown::Before => HIDDEN,
            Shown::Behind => BARE,
            Shown::Level | Shown::Unknown => UNKNOWN,
        }
    };
    let mut best: Option<Curve> = None;
    for speed in SPEEDS {
        let rough = hermite(a, out.map(|x| speed * x), b, into.map(|x| speed * x));
        // most ends are far apart, and a curve is at least as long as the gap
        let least = distance(a, b) / radius_px / rough.len() as f64;
        let mut sum = 0.0;
        let mut is_far_too_dear = |x| {
            sum += price(x);
            GAP + least * sum >= CLEARLY * dearest
        };
        if rough.iter().any(&mut is_far_too_dear) {
            continue;
        }
        let curve = resampled(&rough, STEP * radius_px);
        let long = length(&curve) / radius_px / curve.len() as f64;
        let mut dear = 0.0;
        let is_too_dear = |place| {
            dear += price(place);
            GAP + long * dear >= dearest
        };
        if curve.iter().any(is_too_dear) {
            continue;
        }
        let fixed = GAP + long * dear;
        let whole: Vec<Place> =
            p[1..4.min(p.len())].iter().rev().chain(&curve).chain(&q[1..4.min(q.len())]).copied().collect();
        let (bent, change) = bending(&resampled(&whole, STEP * radius_px), radius_px);
        let cost = fixed + BENDING * bent + CHANGE * change.min(1.0);
        if cost < best.as_ref().map_or(dearest, |b| b.cost) {
            best = Some(Curve { nodes: curve, cost, fixed });
        }
    }
    best.filter(|_| distance(a, b) > 1e-6)
}

/// Applies the steps of a solution to chains.
fn assemble(
    silhouette: &Silhouette,
    chains: &[Vec<Place>],
    bridges: &[Bridge],
    left: &[f64],
    chosen: &[Step],
) -> Joined {
    let radius_px = silhouette.radius_px;
    let (mut cost, mut fixed) = (0.0, 0.0);
    let mut over = vec![[None; 2]; chains.len()];
    let mut gone = vec![false; chains.len()];
    for step in chosen {
        match *step {
            Step::Bridge(k) => {
                cost += bridges[k].curve.cost;
                fixed += bridges[k].curve.fixed;
                let [(i, e), (j, f)] = bridges[k].ends;
                over[i][e] = Some((k, false));
                over[j][f] = Some((k, true));
            }
            Step::Leave(k) => {
                cost += left[k];
                gone[k] = true;
            }
        }
    }
    let mut made = Vec::new();
    for start in 0..chains.len() {
        let Some(end) = (0..2).find(|&e| over[start][e].is_none()).filter(|_| !gone[start]) else { continue };
        if over[start] == [None; 2] {
            gone[start] = true;
            made.push(chains[start].clone());
            continue;
        }
        let (mut chain, mut enter) = (start, end);
        let mut nodes: Vec<Place> = Vec::new();
        loop {
            gone[chain] = true;
            let leave = 1 - enter;
            let mut own = chains[chain].clone();
            if enter == 1 {
                own.reverse();
            }
            let cut = |linked: bool| {
                if linked && own.len() > CORNER_NODES + HEADING_NODES { CORNER_NODES } else { 0 }
            };
            let (first, last) = (cut(over[chain][enter].is_some()), cut(over[chain][leave].is_some()));
            nodes.extend(&own[first..own.len() - last]);
            let Some((k, turned)) = over[chain][leave] else { break };
            let curve = &bridges[k].curve.nodes;
            if turned {
                nodes.extend(curve.iter().rev());
            } else {
                nodes.extend(curve);
            }
            (chain, enter) = bridges[k].ends[usize::from(!turned)];
        }
        made.push(cleaned(&nodes, 0.5 * radius_px));
    }
    Joined { chains: made, cost, fixed }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::tests::behind_a_bar;

    fn line(a: Place, b: Place) -> Vec<Place> {
        resampled(&[a, b], 4.0)
    }

    #[test]
    fn pieces_are_joined_behind_what_hides_them_rather_than_where_the_camera_sees_through() {
        let silhouette = behind_a_bar();
        // the middle is hidden; another piece ends at the same distance, straight ahead over bare table
        let pieces = [
            line([22.0, 60.0], [79.0, 60.0]),
            line([121.0, 60.0], [178.0, 60.0]),
            line([178.0, 100.0], [178.0, 118.0]),
        ];
        let ways = join_pieces(&silhouette, &pieces, Some(2), 5.0, 3, &mut KnownCurves::default());
        assert_eq!(ways.len(), 3);
        let best = &ways[0];
        let longest = best.chains.iter().map(|c| length(c)).fold(0.0, f64::max);
        assert!(best.chains.len() == 2 && (longest - 156.0).abs() < 2.0, "{longest}");
        assert!(best.cost < 4.0 && ways[1].cost > best.cost + 1.0);
        // the number of ropes is not known: joining over the hidden gap is worth a rope, over the bare table it is not
        let open = join_pieces(&silhouette, &pieces, None, 5.0, 3, &mut KnownCurves::default());
        assert_eq!(open[0].chains.len(), 2);
        // a single piece stays
        assert_eq!(
            join_pieces(&silhouette, &pieces[..1], Some(1), 5.0, 3, &mut KnownCurves::default())[0].chains,
            pieces[..1]
        );
    }

    #[test]
    fn curves_are_made_between_near_ends_alone_where_there_are_many() {
        let row = |n: usize| -> Vec<Vec<Place>> {
            (0..n).map(|i| line([40.0 * i as f64, 60.0], [40.0 * i as f64 + 20.0, 60.0])).collect()
        };
        // all pairs of a few chains
        assert_eq!(pair_ends(&row(5)).len(), 40);
        let many = pair_ends(&row(100));
        assert!(many.len() <= 200 * NEAREST);
        assert!((0..99).all(|i| many.contains(&[(i, 1), (i + 1, 0)])));
    }

    #[test]
    fn a_short_piece_far_off_is_left_out() {
        let silhouette = behind_a_bar();
        let pieces = [line([122.0, 60.0], [178.0, 60.0]), line([130.0, 10.0], [150.0, 10.0])];
        let ways = join_pieces(&silhouette, &pieces, Some(1), 5.0, 2, &mut KnownCurves::default());
        assert_eq!(ways[0].chains, pieces[..1]);
        assert!(ways[0].fixed == 0.0 && ways[0].cost > 1.0);
    }
}
