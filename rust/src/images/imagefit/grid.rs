//! A grid of places in an image, for searches of near places.

use super::places::Place2;

/// Places sorted into square cells.
#[derive(Debug, Default)]
pub struct Grid {
    origin: Place2,
    inverse: f64,
    size: [usize; 2],
    /// The first place of each cell.
    starts: Vec<u32>,
    /// Numbers and places, cell by cell, in the order of their numbers.
    items: Vec<(u32, Place2)>,
    cells: Vec<u32>,
}

impl Grid {
    /// Sorts places into the cells of a frame, given by its corner and size. Places outside belong to the border's
    /// cells.
    pub fn fill(&mut self, places: &[Place2], frame: (Place2, [usize; 2]), cell: f64) {
        self.origin = frame.0;
        self.inverse = 1.0 / cell;
        self.size = frame.1.map(|n| (n as f64 / cell) as usize + 1);
        self.starts.clear();
        self.starts.resize(self.size[0] * self.size[1] + 1, 0);
        self.cells.clear();
        for &place in places {
            let [x, y] = self.cell(place);
            let cell = y * self.size[0] + x;
            self.starts[cell + 1] += 1;
            self.cells.push(cell as u32);
        }
        for i in 1..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        self.items.clear();
        self.items.resize(places.len(), (0, [0.0; 2]));
        for (i, &place) in places.iter().enumerate().rev() {
            // counted down from the next cell's start
            let end = &mut self.starts[self.cells[i] as usize + 1];
            *end -= 1;
            self.items[*end as usize] = (i as u32, place);
        }
        // the former ends are now starts
        self.starts.remove(0);
        self.starts.push(places.len() as u32);
    }

    #[inline(always)]
    fn cell(&self, at: Place2) -> [usize; 2] {
        std::array::from_fn(|k| {
            (((at[k] - self.origin[k]) * self.inverse).max(0.0) as usize).min(self.size[k] - 1)
        })
    }

    /// Returns the places in the cells within reach of a place, by rows of cells.
    #[inline(always)]
    pub fn around(&self, at: Place2, reach: f64) -> impl Iterator<Item = &[(u32, Place2)]> {
        let [left, top] = self.cell(at.map(|x| x - reach));
        let [right, bottom] = self.cell(at.map(|x| x + reach));
        (top..=bottom).map(move |row| {
            let start = self.starts[row * self.size[0] + left] as usize;
            let end = self.starts[row * self.size[0] + right + 1] as usize;
            &self.items[start..end]
        })
    }

    /// Returns the nearest place within `reach`. A near place and its number, if known, shorten the search.
    #[inline]
    pub fn nearest(&self, at: Place2, reach: f64, near: Option<(usize, Place2)>) -> Option<usize> {
        let mut best = reach * reach;
        let mut found = None;
        if let Some((k, place)) = near {
            let d = (place[0] - at[0]).powi(2) + (place[1] - at[1]).powi(2);
            if d < best {
                (best, found) = (d, Some(k));
            }
        }
        for run in self.around(at, best.sqrt()) {
            for &(i, place) in run {
                let d = (place[0] - at[0]).powi(2) + (place[1] - at[1]).powi(2);
                if d < best {
                    best = d;
                    found = Some(i as usize);
                }
            }
        }
        found
    }

    /// Calls with all pairs i < j of places nearer than `reach`, and their squared distance.
    pub fn pairs(&self, places: &[Place2], reach: f64, mut call: impl FnMut(usize, usize, f64)) {
        for (i, &at) in places.iter().enumerate() {
            for run in self.around(at, reach) {
                for &(j, place) in run {
                    let d = (place[0] - at[0]).powi(2) + (place[1] - at[1]).powi(2);
                    if j as usize > i && d < reach * reach {
                        call(i, j as usize, d);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_and_pairs_are_those_of_a_full_search() {
        let place = |i: usize| {
            let t = i as f64;
            [40.0 * (t * 0.37).sin() + 20.0, 30.0 * (t * 0.61).cos() + 10.0]
        };
        let places: Vec<Place2> = (0..300).map(place).collect();
        let mut grid = Grid::default();
        for _ in 0..2 {
            grid.fill(&places, ([0.0, 0.0], [40, 30]), 4.0);
        }
        let square = |a: Place2, b: Place2| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        for i in 0..50 {
            let at = place(1000 + i);
            let full = (0..300).min_by(|&a, &b| square(places[a], at).total_cmp(&square(places[b], at)));
            let full = full.filter(|&k| square(places[k], at) < 16.0);
            assert_eq!(grid.nearest(at, 4.0, None), full);
            assert_eq!(grid.nearest(at, 4.0, Some((5 * i, places[5 * i]))), full);
        }
        let mut found = Vec::new();
        grid.pairs(&places, 3.5, |i, j, _| found.push([i, j]));
        found.sort_unstable();
        let full: Vec<[usize; 2]> = (0..300)
            .flat_map(|i| (i + 1..300).map(move |j| [i, j]))
            .filter(|&[i, j]| square(places[i], places[j]) < 3.5 * 3.5)
            .collect();
        assert!(full.len() > 100);
        assert_eq!(found, full);
    }
}
