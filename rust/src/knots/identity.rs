//! The knot of a closed polyline.

use rustc_hash::FxHashMap;

use super::alexander::compute_alexander;
use super::code::GaussCode;
use super::jones::{Laurent, compute_jones};
use super::projection::{Diagram, Lid, NoDiagram, draw_diagram};
use super::reidemeister::reduced;
use super::table::{Chirality, find_named, has_alexander};
use super::thinning::thin;
use crate::geometry::{Point, normalized};

/// Directions from which thinned polylines are viewed: none that a person or a program would choose.
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
const COMPARED: usize = 3; // views that are compared; the others replace views from which a strand lies over a node
const FEW_CROSSINGS: usize = 7; // diagrams with at most this many crossings need no comparison

/// The knot that the polynomials of a diagram give.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A knot of the table.
    Known(usize, Chirality),
    /// Another knot, with its Alexander polynomial; None if the diagram is too large.
    Unknown(Option<Vec<i64>>),
}

/// A closed polyline's knot.
#[derive(Debug, Clone)]
pub struct Identity {
    pub kind: Kind,
    /// A diagram that no move of Reidemeister's first or second kind can reduce.
    pub code: GaussCode,
    pub alexander: Option<Vec<i64>>,
    pub jones: Option<Laurent>,
}

impl Identity {
    pub fn unknown() -> Self {
        Self { kind: Kind::Unknown(None), code: GaussCode::default(), alexander: None, jones: None }
    }

    /// Identifies the knot of a reduced diagram.
    pub fn of(code: GaussCode) -> Self {
        let alexander = compute_alexander(&code);
        let jones =
            alexander.as_ref().filter(|found| has_alexander(found)).and_then(|_| compute_jones(&code));
        let known = alexander.as_ref().zip(jones.as_ref()).and_then(|(a, j)| find_named(a, j));
        let kind = known.map_or_else(|| Kind::Unknown(alexander.clone()), |(k, which)| Kind::Known(k, which));
        Self { kind, code, alexander, jones }
    }
}

/// Knots of diagrams, each identified once.
#[derive(Debug, Default)]
pub struct Known {
    knots: Vec<Identity>,
    /// The number of each diagram's knot.
    numbers: FxHashMap<GaussCode, usize>,
}

impl Known {
    /// Identifies the knot of a closed polyline.
    pub fn identity(&mut self, polygon: &[Point]) -> Result<&Identity, NoDiagram> {
        let left = thin(polygon, true, f64::INFINITY).left();
        // a knot needs at least six segments
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

    /// Returns reduced diagrams of a few views of a closed polyline, up to the first that is small or known.
    fn diagrams(&self, polygon: &[Point]) -> Result<Vec<GaussCode>, NoDiagram> {
        // if a strand lies over a node from everywhere, the strand meets the node
        let (mut seen, mut failure) = (Vec::new(), NoDiagram::Meets);
        for towards in VIEWPOINTS {
            match draw_diagram(polygon, Lid::Segment, normalized(towards)) {
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
