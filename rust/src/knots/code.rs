//! A knot diagram as a signed Gauss code, and its conversion to the codes of other programs.

/// A passage of the knot through a crossing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Visit {
    pub crossing: u32,
    /// Whether this is the upper strand.
    pub over: bool,
}

/// A diagram of one closed curve: the crossings in the order in which the curve passes them, each twice.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct GaussCode {
    pub visits: Vec<Visit>,
    /// For each crossing, +1 if the lower strand crosses the upper one from right to left, else −1.
    pub signs: Vec<i8>,
}

impl GaussCode {
    pub fn crossings(&self) -> usize {
        self.signs.len()
    }

    pub fn writhe(&self) -> i64 {
        self.signs.iter().map(|&sign| i64::from(sign)).sum()
    }

    /// Returns for each crossing the places of its upper and its lower visit.
    pub fn places(&self) -> Vec<[usize; 2]> {
        let mut places = vec![[0; 2]; self.crossings()];
        for (k, visit) in self.visits.iter().enumerate() {
            places[visit.crossing as usize][usize::from(!visit.over)] = k;
        }
        places
    }

    /// Returns the planar diagram: for each crossing its four edges, anticlockwise from the incoming lower strand.
    ///
    /// Edge k leads to visit k, both counted from 0.
    pub fn planar_diagram(&self) -> Vec<[u32; 4]> {
        let edges = self.visits.len();
        let both = |place: usize| (place as u32, ((place + 1) % edges) as u32);
        let crossing = |([over, under], &sign): ([usize; 2], &i8)| {
            let ((over_in, over_out), (under_in, under_out)) = (both(over), both(under));
            match sign {
                1 => [under_in, over_out, under_out, over_in],
                _ => [under_in, over_in, under_out, over_out],
            }
        };
        self.places().into_iter().zip(&self.signs).map(crossing).collect()
    }

    /// Returns the code of Dowker and Thistlethwaite. Visits are counted from 1, so each crossing has an odd and an
    /// even one. The code lists the even ones in the order of the odd ones, negative if they are over.
    pub fn dowker_thistlethwaite(&self) -> Vec<i64> {
        let places = self.places();
        let even = |visit: &Visit| {
            let [over, under] = places[visit.crossing as usize];
            if visit.over { under as i64 + 1 } else { -(over as i64 + 1) }
        };
        self.visits.iter().step_by(2).map(even).collect()
    }

    /// Exchanges the upper and lower strand at one crossing.
    pub fn switch(&mut self, crossing: usize) {
        self.signs[crossing] = -self.signs[crossing];
        for visit in self.visits.iter_mut().filter(|visit| visit.crossing as usize == crossing) {
            visit.over = !visit.over;
        }
    }
}
