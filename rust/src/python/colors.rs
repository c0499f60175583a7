//! Bindings of ropes in colour images.

use numpy::{PyArray2, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::Array;
use super::arrays::{array, constant};
use super::released::released;
use crate::images::color::Planes;
use crate::images::color::drawing;
use crate::images::color::lab;
use crate::images::color::pieces::{self, Band, Piece};
use crate::images::color::strips::{self, StripOptions};
use crate::images::image::Image;

const COLUMNS: usize = 21; // numbers that describe a piece

/// A band: the factor that its image is smaller by, its half width, the pieces' numbers (h, w), their descriptions.
type BandOfPieces<'py> = (usize, f64, Bound<'py, PyArray2<i32>>, Bound<'py, PyArray2<f64>>);

/// The labels (H, W) of ropes, and the pixels' differences from the background (H, W).
type DrawnRopes<'py> = (Bound<'py, PyArray2<i32>>, Bound<'py, PyArray2<f32>>);

/// Return (3, H, W) Lab of an (H, W, 3) image of bytes in sRGB.
#[pyfunction]
pub(super) fn convert_to_lab<'py>(
    py: Python<'py>,
    colors: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let colors = Array::<u8>::exactly("colors", colors, 3)?;
    let &[height, width, 3] = colors.shape() else {
        return Err(PyValueError::new_err("colors: expected (H, W, 3)"));
    };
    let values = colors.into_values();
    let found = released(py, move || lab::convert_to_lab(&values, width).map(|plane| plane.values).concat())?;
    constant(py, found, [3, height, width])
}

/// Return the pieces of strips of each width, at chosen pixels (H, W).
///
/// `planes` decide about strips and regions, and `lab` gives colours; without it, `planes` do. For each width: the
/// factor that its image is smaller by, the half width, the pieces' numbers (h, w), and 21 numbers for each piece.
#[pyfunction]
#[pyo3(signature = (planes, lab, chosen, *, max_width, min_contrast, noise, aside, signed))]
#[allow(clippy::too_many_arguments)]
pub(super) fn find_color_pieces<'py>(
    py: Python<'py>,
    planes: &Bound<'py, PyAny>,
    lab: Option<&Bound<'py, PyAny>>,
    chosen: Option<&Bound<'py, PyAny>>,
    max_width: f64,
    min_contrast: f32,
    noise: f32,
    aside: f32,
    signed: bool,
) -> PyResult<Vec<BandOfPieces<'py>>> {
    let planes = take_planes("planes", planes)?;
    let lab = lab.map(|lab| take_planes("lab", lab)).transpose()?;
    let chosen = chosen.map(|chosen| Array::mask("chosen", chosen)).transpose()?;
    let (width, height) = (planes[0].width, planes[0].height);
    if lab.as_ref().is_some_and(|lab| [lab[0].width, lab[0].height] != [width, height])
        || chosen.as_ref().is_some_and(|chosen| chosen.shape() != [height, width])
    {
        return Err(PyValueError::new_err("planes, lab, chosen: expected one size"));
    }
    let options = StripOptions { max_width, min_contrast, noise, aside, signed };
    let bands = released(py, move || {
        let mut strips = strips::find_strips(&planes, &options);
        if let Some(chosen) = chosen {
            for (response, &own) in strips.response.values.iter_mut().zip(chosen.slice()) {
                *response = if own { *response } else { 0.0 };
            }
        }
        pieces::find_pieces(&planes, lab.as_ref().unwrap_or(&planes), lab.is_none(), &strips)
    })?;
    bands.into_iter().map(|band| convert_band(py, band)).collect()
}

/// Return (H, W) labels of ropes with colours, and each pixel's difference from the background; 0 far from ropes.
///
/// `rough` is a mask of the ropes, and `away` each pixel's distance from it.
#[pyfunction]
pub(super) fn draw_ropes<'py>(
    py: Python<'py>,
    lab: &Bound<'py, PyAny>,
    rough: &Bound<'py, PyAny>,
    away: &Bound<'py, PyAny>,
    ropes: Vec<(i32, [f32; 3])>,
    half_width: f32,
) -> PyResult<DrawnRopes<'py>> {
    let lab = take_planes("lab", lab)?;
    let rough = Array::mask("rough", rough)?;
    let away = Array::<f32>::exactly("away", away, 2)?;
    let (width, height) = (lab[0].width, lab[0].height);
    if rough.shape() != [height, width] || away.shape() != [height, width] {
        return Err(PyValueError::new_err("lab, rough, away: expected one size"));
    }
    let (labels, from_ground): (Vec<i32>, Vec<f32>) = released(py, move || {
        let drawn = drawing::draw_ropes(&lab, rough.slice(), away.slice(), &ropes, half_width);
        drawn.values.into_iter().map(|one| (one.label, one.from_ground)).unzip()
    })?;
    Ok((array(py, labels, [height, width])?, array(py, from_ground, [height, width])?))
}

fn convert_band(py: Python<'_>, band: Band) -> PyResult<BandOfPieces<'_>> {
    let numbers: Vec<f64> = band.pieces.iter().flat_map(list_numbers).collect();
    let size = [band.labels.height, band.labels.width];
    Ok((
        band.factor,
        band.half_width,
        array(py, band.labels.values, size)?,
        array(py, numbers, [band.pieces.len(), COLUMNS])?,
    ))
}

fn list_numbers(piece: &Piece) -> [f64; COLUMNS] {
    let mut found = [0.0; COLUMNS];
    let (c, b) = (piece.color, piece.background);
    let lengths = [piece.half_width, piece.length, piece.extent, piece.widest, piece.even];
    let looks = [piece.contrast, piece.response, piece.aside, piece.scatter, piece.soft, piece.pure];
    let singles = lengths.into_iter().chain(c).chain(b).chain(looks).map(f64::from);
    let all = singles.chain(piece.bounds.map(|side| side as f64));
    found.iter_mut().zip(all).for_each(|(to, value)| *to = value);
    found
}

/// Takes an array (3, H, W) of finite numbers.
fn take_planes(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Planes> {
    let planes = Array::<f32>::exactly(name, value, 3)?;
    let &[3, height, width] = planes.shape() else {
        return Err(PyValueError::new_err(format!("{name}: expected (3, H, W)")));
    };
    if width == 0 || height == 0 {
        return Err(PyValueError::new_err(format!("{name}: expected at least one pixel")));
    }
    let values = planes.slice();
    let size = width * height;
    Ok([0, 1, 2].map(|k| Image { width, height, values: values[k * size..(k + 1) * size].to_vec() }))
}
