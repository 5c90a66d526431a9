//! Rotation-minimising frames along a curve.

use glam::DVec3;

/// One step of double reflection (Wang, Jüttler, Zheng, Liu, *Computation of rotation minimizing frames*, ACM
/// Transactions on Graphics 27(1), 2008): what a normal `r` at the place `x[0]` of a curve is at its place `x[1]`,
/// whose unit tangents are `t[0]` and `t[1]`.
///
/// The frame `(r, t)` is mirrored at the plane midway between the two places, `r′ = r − (2/c₁)(v₁·r) v₁`, `v₁ = x₁ −
/// x₀`,
/// `c₁ = v₁·v₁`, and then at the one that takes the mirrored tangent to the next one, `v₂ = t₁ − t′`. Global error of
/// order 4 in the distance of the places. Where two places or two tangents coincide the reflection is left out, as
/// nothing turns there. Rounding accumulates: over thousands of places the normal must be made orthogonal again.
pub fn doubly_reflected(r: DVec3, x: [DVec3; 2], t: [DVec3; 2]) -> DVec3 {
    let mirror = |v: DVec3, normal: DVec3| {
        let c = normal.length_squared();
        if c > 1e-18 { v - normal * (2.0 * normal.dot(v) / c) } else { v }
    };
    let v1 = x[1] - x[0];
    let (r1, t1) = (mirror(r, v1), mirror(t[0], v1));
    mirror(r1, t[1] - t1)
}
