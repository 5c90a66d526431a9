//! Rotation-minimising frames along a curve.

use glam::DVec3;

/// Transports a normal along a curve by one step of double reflection (Wang, Jüttler, Zheng, Liu, *Computation of
/// rotation minimizing frames*, ACM Transactions on Graphics 27(1), 2008).
///
/// `r` is the normal at the point `x[0]`; the result is the normal at `x[1]`. `t[0]` and `t[1]` are the unit tangents
/// at the two points.
///
/// The frame `(r, t)` is first reflected in the plane midway between the points: `r′ = r − (2/c₁)(v₁·r) v₁`, `v₁ = x₁ − x₀`, `c₁ =
/// v₁·v₁`. The second reflection maps the reflected tangent to the next tangent, `v₂ = t₁ − t′`. The global error is of order 4 in
/// the distance between the points. If two points or two tangents coincide, that reflection is skipped, because nothing turns
/// there. Rounding errors accumulate: over thousands of points, re-orthogonalise the normal.
pub fn doubly_reflected(r: DVec3, x: [DVec3; 2], t: [DVec3; 2]) -> DVec3 {
    let mirror = |v: DVec3, normal: DVec3| {
        let c = normal.length_squared();
        if c > 1e-18 { v - normal * (2.0 * normal.dot(v) / c) } else { v }
    };
    let v1 = x[1] - x[0];
    let (r1, t1) = (mirror(r, v1), mirror(t[0], v1));
    mirror(r1, t[1] - t1)
}
