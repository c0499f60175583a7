//! Reduction of Gauss codes by Reidemeister's first and second moves.

use std::collections::VecDeque;

use super::code::{GaussCode, Visit};

/// Removes crossings of a strand with itself next to each other (I), and pairs where one strand lies over another and
/// comes back (II), until there are none.
pub fn reduced(code: &GaussCode) -> GaussCode {
    let (count, places) = (code.visits.len(), code.places());
    if count == 0 {
        return code.clone();
    }
    let mut next: Vec<usize> = (1..=count).map(|k| k % count).collect();
    let mut previous: Vec<usize> = (0..count).map(|k| (k + count - 1) % count).collect();
    let mut gone = vec![false; count];
    let other = |k: usize| {
        let visit = code.visits[k];
        places[visit.crossing as usize][usize::from(visit.over)]
    };
    let mut open: Vec<usize> = (0..count).collect();
    while let Some(k) = open.pop() {
        let follower = next[k];
        if gone[k] || follower == k {
            continue;
        }
        let (here, there) = (code.visits[k], code.visits[follower]);
        let (a, b) = (other(k), other(follower));
        let is_twist = here.crossing == there.crossing;
        let opposite = code.signs[here.crossing as usize] != code.signs[there.crossing as usize];
        if !is_twist && (here.over != there.over || !opposite || (next[a] != b && next[b] != a)) {
            continue;
        }
        for &visit in &[k, follower, a, b][..if is_twist { 2 } else { 4 }] {
            gone[visit] = true;
            let (before, after) = (previous[visit], next[visit]);
            next[before] = after;
            previous[after] = before;
            // removing a strand may bring its neighbours together
            open.extend([before, previous[before]]);
        }
    }
    renumbered(code, |k| !gone[k])
}

/// Returns for each crossing whether repeated first moves remove it, whichever strand is on top.
pub fn find_twists(code: &GaussCode) -> Vec<bool> {
    let mut gone = vec![false; code.crossings()];
    let mut left: VecDeque<u32> = VecDeque::new();
    for visit in &code.visits {
        if left.back() == Some(&visit.crossing) {
            left.pop_back();
            gone[visit.crossing as usize] = true;
        } else {
            left.push_back(visit.crossing);
        }
    }
    // the knot is closed: the last visit comes before the first
    while left.len() > 1 && left.front() == left.back() {
        gone[left[0] as usize] = true;
        left.pop_front();
        left.pop_back();
    }
    gone
}

/// Returns the remaining crossings, renumbered in the order of the knot.
fn renumbered(code: &GaussCode, stays: impl Fn(usize) -> bool) -> GaussCode {
    let mut numbers = vec![u32::MAX; code.crossings()];
    let mut left = GaussCode::default();
    for (_, visit) in code.visits.iter().enumerate().filter(|&(k, _)| stays(k)) {
        let number = &mut numbers[visit.crossing as usize];
        if *number == u32::MAX {
            *number = left.signs.len() as u32;
            left.signs.push(code.signs[visit.crossing as usize]);
        }
        left.visits.push(Visit { crossing: *number, over: visit.over });
    }
    left
}
