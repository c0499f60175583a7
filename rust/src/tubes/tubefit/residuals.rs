//! Distances of points from a tube's surface, eight points at a time.
//!
//! Lengths are in radii. Points are given relative to the axis: `q` is a point's place across the axis.

use crate::simd::{Eight, Simd, Three};

/// Eight foot points.
pub struct FootPoints<V> {
    pub residual: V,
    pub outward: Three<V>,
    pub facing: V,
    pub weight: V,
    pub explained: V,
    pub inlier: V,
}

/// Measures distances from the surface for points at `q` from the axis, at the distance `d`.
#[inline(always)]
pub fn measure_distances<S: Simd>(
    simd: S,
    q: Three<S::Eight>,
    d: S::Eight,
    to_camera: Three<S::Eight>,
    band: S::Eight,
) -> FootPoints<S::Eight> {
    let one = simd.splat8(1.0);
    let outward = q * (one / d);
    let facing = outward.dot(to_camera);
    let residual = d - one;
    let explained = simd.splat8(0.1).below(facing);
    FootPoints {
        residual,
        outward,
        facing,
        weight: explained * weigh_by_tukey(simd, residual, band),
        explained,
        inlier: explained * residual.abs().below(band),
    }
}

/// Measures residuals along the viewing rays, with the tube as a straight cylinder at the foot point.
#[inline(always)]
pub fn measure_along_rays<S: Simd>(
    simd: S,
    q: Three<S::Eight>,
    to_camera: Three<S::Eight>,
    tangent: Three<S::Eight>,
    band: S::Eight,
) -> FootPoints<S::Eight> {
    let (zero, one) = (simd.splat8(0.0), simd.splat8(1.0));
    // in the plane across the axis, the ray is q + λ w, nearest to the axis at λ₀
    let w = to_camera - tangent * to_camera.dot(tangent);
    let square = w.dot(w) + simd.splat8(1e-12);
    let nearest = zero - q.dot(w) / square;
    let miss = q + w * nearest;
    let gap = miss.dot(miss);
    let hit = gap.below(one);
    let missed_by = gap.sqrt() - one;
    let length = nearest + ((one - gap).max(zero) / square).sqrt();
    let outward = (q + w * length).unit(simd) * hit;
    let facing = outward.dot(to_camera);
    let residual = hit.choose(zero - length * facing, missed_by);
    let cosine = facing.max(simd.splat8(0.4));
    let near = length.abs().below(simd.splat8(1.2));
    let weight = weigh_by_tukey(simd, residual, band * cosine.max(simd.splat8(0.5))) / (cosine * cosine);
    let explained = hit.max(missed_by.below(simd.splat8(0.25)));
    FootPoints {
        residual,
        outward,
        facing,
        weight: weight * near * hit,
        explained,
        inlier: explained * residual.abs().below(band),
    }
}

/// Returns Tukey's biweight.
#[inline(always)]
fn weigh_by_tukey<S: Simd>(simd: S, residual: S::Eight, band: S::Eight) -> S::Eight {
    let x = residual / band;
    let share = (simd.splat8(1.0) - x * x).max(simd.splat8(0.0));
    share * share
}
