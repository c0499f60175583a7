//! Pieces of ropes joined over gaps in the mask, where something hides them or a segmenter lost them.

use super::links::{BENDING, CHANGE, STEP};
use super::planar::{Place, apart, bending, cleaned, hermite, length, resampled, unit};
use crate::images::silhouette::Silhouette;
use crate::images::surroundings::Shown;

/// Nodes at a piece's end that turn to the mask's corners, and those before them that show its direction.
const CUT: usize = 2;
const HEADING: usize = 6;
/// Speeds at which curves over a gap leave and arrive, over the distance.
const SPEEDS: [f64; 3] = [1.0, 1.4, 1.8];
/// What a gap costs, and each radius of it: where something hides it, where nothing is known of it or a rope may be, where
/// the camera saw through.
const GAP: f64 = 2.0;
const HIDDEN: f64 = 0.1;
const UNKNOWN: f64 = 0.5;
const BARE: f64 = 3.0;
/// Of a gap that a reading without it bridges.
const DEAREST: f64 = 80.0;
/// What a radius of a piece costs that is left out: mask that nothing covers.
const LEFT: f64 = 1.6;
/// Partners of an end that are tried, ways that are kept, and tries.
const PARTNERS: usize = 4;
const TRIED: usize = 3000;

/// Chains with some of their ends joined.
pub struct Joined {
    pub chains: Vec<Vec<Place>>,
    /// What the gaps cost.
    pub cost: f64,
    /// What of it is not for bending.
    pub fixed: f64,
}

/// A curve from an end of a chain to an end of another.
struct Bridge {
    /// The chains, and which of their ends: 0 for the first node, 1 for the last.
    ends: [(usize, usize); 2],
    curve: Vec<Place>,
    cost: f64,
    fixed: f64,
}

/// The cheapest ways to join chains over gaps, or leave some out, until `ropes` are left; as many as worth it if their
/// number is not known, where each costs `each`.
pub fn joined(
    silhouette: &Silhouette,
    chains: &[Vec<Place>],
    ropes: Option<usize>,
    each: f64,
    most: usize,
) -> Vec<Joined> {
    let asked = ropes.map_or(0, |ropes| chains.len().saturating_sub(ropes.max(1)));
    let gain = if ropes.is_some() { 0.0 } else { each };
    if chains.len() < 2 || (ropes.is_some() && asked == 0) {
        return vec![Joined { chains: chains.to_vec(), cost: 0.0, fixed: 0.0 }];
    }
    let bridges = bridges(silhouette, chains, if ropes.is_some() { DEAREST } else { each });
    let left: Vec<f64> = chains.iter().map(|c| 1.0 + LEFT * length(c) / silhouette.radius_px).collect();
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
    found.into_iter().map(|(_, chosen)| assembled(silhouette, chains, &bridges, &left, &chosen)).collect()
}

/// What is done: a bridge, or a chain that is left out.
#[derive(Clone, Copy)]
enum Step {
    Bridge(usize),
    Leave(usize),
}

struct Search<'a> {
    bridges: &'a [Bridge],
    left: &'a [f64],
    /// How many steps there have to be; none if that is open.
    asked: Option<usize>,
    gain: f64,
    most: usize,
    tried: usize,
    /// What each costs, the cheapest first.
    found: Vec<(f64, Vec<Step>)>,
}

impl Search<'_> {
    /// Takes steps from the `next` on; `group`: which chains are one already.
    fn add(&mut self, next: usize, chosen: &mut Vec<Step>, group: Vec<usize>, cost: f64) {
        self.tried += 1;
        if self.tried > TRIED {
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
            let step =
                if k < self.bridges.len() { Step::Bridge(k) } else { Step::Leave(k - self.bridges.len()) };
            let mut joined = group.clone();
            let more = match step {
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
                    let (from, to) = (group[j], group[i]);
                    joined.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
                    self.bridges[b].cost - self.gain
                }
                Step::Leave(chain) => {
                    // all cannot be left out
                    let alone = group.iter().filter(|g| **g == group[chain]).count() == 1;
                    if !alone || self.asked.is_none() {
                        continue;
                    }
                    self.left[chain]
                }
            };
            chosen.push(step);
            self.add(k + 1, chosen, joined, cost + more);
            chosen.pop();
        }
    }
}

/// Bridges between the ends of chains that cost less than `dearest`, the cheapest first.
fn bridges(silhouette: &Silhouette, chains: &[Vec<Place>], dearest: f64) -> Vec<Bridge> {
    let mut found = Vec::new();
    for i in 0..chains.len() {
        for j in i + 1..chains.len() {
            for (e, f) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                found.extend(bridge(silhouette, chains, [(i, e), (j, f)], dearest));
            }
        }
    }
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
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

/// A chain's nodes from an end on, without those that turn to the mask's corners.
fn from_end(chain: &[Place], end: usize) -> Vec<Place> {
    let cut = if chain.len() > CUT + HEADING { CUT } else { 0 };
    let nodes = &chain[cut * usize::from(end == 0)..chain.len() - cut * usize::from(end == 1)];
    if end == 0 { nodes.to_vec() } else { nodes.iter().rev().copied().collect() }
}

/// The cheapest curve between two ends, if it costs less than `dearest`.
fn bridge(
    silhouette: &Silhouette,
    chains: &[Vec<Place>],
    ends: [(usize, usize); 2],
    dearest: f64,
) -> Option<Bridge> {
    let radius_px = silhouette.radius_px;
    let [p, q] = ends.map(|(chain, end)| from_end(&chains[chain], end));
    let heading = |p: &[Place]| {
        let back = p[HEADING.min(p.len() - 1)];
        unit([p[0][0] - back[0], p[0][1] - back[1]])
    };
    let (a, b, out, into) = (p[0], q[0], heading(&p), heading(&q).map(|x| -x));
    let mut best: Option<Bridge> = None;
    for speed in SPEEDS {
        let curve =
            resampled(&hermite(a, out.map(|x| speed * x), b, into.map(|x| speed * x)), STEP * radius_px);
        let long = length(&curve) / radius_px / curve.len() as f64;
        let price = |x: &Place| {
            if silhouette.distance(*x) > 0.0 {
                return 0.0;
            }
            match silhouette.shown(*x) {
                Shown::Before => HIDDEN,
                Shown::Behind => BARE,
                Shown::Level | Shown::Unknown => UNKNOWN,
            }
        };
        let mut dear = 0.0;
        let is_too_dear = |place| {
            dear += price(place);
            GAP + long * dear >= dearest
        };
        // most ends are far apart
        if curve.iter().any(is_too_dear) {
            continue;
        }
        let fixed = GAP + long * dear;
        let whole: Vec<Place> =
            p[1..4.min(p.len())].iter().rev().chain(&curve).chain(&q[1..4.min(q.len())]).copied().collect();
        let (bent, change) = bending(&resampled(&whole, STEP * radius_px), radius_px);
        let cost = fixed + BENDING * bent + CHANGE * change.min(1.0);
        if cost < best.as_ref().map_or(dearest, |b| b.cost) {
            best = Some(Bridge { ends, curve, cost, fixed });
        }
    }
    best.filter(|_| apart(a, b) > 1e-6)
}

/// The chains after some steps.
fn assembled(
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
                cost += bridges[k].cost;
                fixed += bridges[k].fixed;
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
            let cut = |linked: bool| if linked && own.len() > CUT + HEADING { CUT } else { 0 };
            let (first, last) = (cut(over[chain][enter].is_some()), cut(over[chain][leave].is_some()));
            nodes.extend(&own[first..own.len() - last]);
            let Some((k, turned)) = over[chain][leave] else { break };
            let curve = &bridges[k].curve;
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
        // the middle is hidden; another piece ends as near, straight ahead over bare table
        let pieces = [
            line([22.0, 60.0], [79.0, 60.0]),
            line([121.0, 60.0], [178.0, 60.0]),
            line([178.0, 100.0], [178.0, 118.0]),
        ];
        let ways = joined(&silhouette, &pieces, Some(2), 5.0, 3);
        assert_eq!(ways.len(), 3);
        let best = &ways[0];
        let longest = best.chains.iter().map(|c| length(c)).fold(0.0, f64::max);
        assert!(best.chains.len() == 2 && (longest - 156.0).abs() < 2.0, "{longest}");
        assert!(best.cost < 4.0 && ways[1].cost > best.cost + 1.0);
        // their number is not known: the gap is worth a rope, the bare table is not
        let open = joined(&silhouette, &pieces, None, 5.0, 3);
        assert_eq!(open[0].chains.len(), 2);
        // a single piece stays
        assert_eq!(joined(&silhouette, &pieces[..1], Some(1), 5.0, 3)[0].chains, pieces[..1]);
    }

    #[test]
    fn a_short_piece_far_off_is_left_out() {
        let silhouette = behind_a_bar();
        let pieces = [line([122.0, 60.0], [178.0, 60.0]), line([130.0, 10.0], [150.0, 10.0])];
        let ways = joined(&silhouette, &pieces, Some(1), 5.0, 2);
        assert_eq!(ways[0].chains, pieces[..1]);
        assert!(ways[0].fixed == 0.0 && ways[0].cost > 1.0);
    }
}
