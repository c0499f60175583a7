//! Which knot a closed polyline is.

use rustc_hash::FxHashMap;

use super::alexander::alexander;
use super::code::GaussCode;
use super::jones::{Laurent, jones};
use super::projection::{Diagram, Lid, NoDiagram, diagram};
use super::reidemeister::reduced;
use super::table::{Chirality, has_alexander, named};
use super::thinning::thin;
use crate::geometry::{Point, normalized};

/// Where thinned polylines are looked at from: no direction that a person or a program would choose.
const VIEWPOINTS: [Point; 9] = [
    [0.2631, 0.4172, 0.8699],
    [0.8114, -0.3527, 0.4661],
    [-0.4913, 0.7757, 0.3961],
    [0.5239, 0.6841, -0.5075],
    [-0.7193, -0.4337, 0.5427],
    [0.1379, -0.8461, 0.5149],
    [0.9173, 0.1931, 0.3482],
    [-0.3347, 0.1427, 0.9315],
    [0.0771, 0.9613, 0.2645],
];
/// So many views are compared; the others stand in for unlucky ones.
const COMPARED: usize = 3;
/// Diagrams with no more crossings need no comparison.
const FEW_CROSSINGS: usize = 7;

/// What the polynomials of a diagram say.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A knot of the table.
    Known(usize, Chirality),
    /// A knot outside of it: with its Alexander polynomial, or none where the diagram is too large to say.
    Unknown(Option<Vec<i64>>),
}

/// A closed polyline's knot.
#[derive(Debug, Clone)]
pub struct Identity {
    pub kind: Kind,
    /// A diagram without moves of Reidemeister's first and second kind that take crossings away.
    pub code: GaussCode,
    pub alexander: Option<Vec<i64>>,
    pub jones: Option<Laurent>,
}

impl Identity {
    /// A knot of which nothing is known.
    pub fn unknown() -> Self {
        Self { kind: Kind::Unknown(None), code: GaussCode::default(), alexander: None, jones: None }
    }

    /// Of a reduced diagram.
    pub fn of(code: GaussCode) -> Self {
        let alexander = alexander(&code);
        let jones = alexander.as_ref().filter(|found| has_alexander(found)).and_then(|_| jones(&code));
        let known = alexander.as_ref().zip(jones.as_ref()).and_then(|(a, j)| named(a, j));
        let kind = known.map_or_else(|| Kind::Unknown(alexander.clone()), |(k, which)| Kind::Known(k, which));
        Self { kind, code, alexander, jones }
    }
}

/// Knots of diagrams, each worked out once.
#[derive(Debug, Default)]
pub struct Known {
    knots: Vec<Identity>,
    /// Whose the diagrams are that were seen.
    numbers: FxHashMap<GaussCode, usize>,
}

impl Known {
    /// The knot of a closed polyline.
    pub fn identity(&mut self, polygon: &[Point]) -> Result<&Identity, NoDiagram> {
        let left = thin(polygon, true, f64::INFINITY).left();
        // it takes six segments to tie a knot
        let seen = if left.len() < 6 { vec![GaussCode::default()] } else { self.diagrams(&left)? };
        let known = seen.iter().find_map(|code| self.numbers.get(code).copied());
        let number = known.unwrap_or_else(|| {
            let smallest = seen.iter().min_by_key(|code| code.crossings()).cloned().unwrap_or_default();
            self.knots.push(Identity::of(smallest));
            self.knots.len() - 1
        });
        self.numbers.extend(seen.into_iter().map(|code| (code, number)));
        Ok(&self.knots[number])
    }

    /// The diagrams that a few views of a closed polyline and the moves give; none after one that is small or known.
    fn diagrams(&self, polygon: &[Point]) -> Result<Vec<GaussCode>, NoDiagram> {
        // what lies over a node from everywhere is where that node is
        let (mut seen, mut failure) = (Vec::new(), NoDiagram::Meets);
        for towards in VIEWPOINTS {
            match diagram(polygon, Lid::Segment, normalized(towards)) {
                Ok(Diagram { code, .. }) => {
                    seen.push(reduced(&code));
                    let last = &seen[seen.len() - 1];
                    let is_enough = last.crossings() <= FEW_CROSSINGS || self.numbers.contains_key(last);
                    if is_enough || seen.len() == COMPARED {
                        break;
                    }
                }
                Err(NoDiagram::Unlucky) => {}
                Err(other) => {
                    failure = other;
                    break;
                }
            }
        }
        if seen.is_empty() { Err(failure) } else { Ok(seen) }
    }
}
