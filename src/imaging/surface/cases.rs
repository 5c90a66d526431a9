//! The cases of marching cubes: the cell edges that the wall crosses, joined to triangles.
//!
//! Corner c of a cell is at (c & 1, c >> 1 & 1, c >> 2). Edge 4a + n runs along axis a from its lower corner; n holds
//! the two other coordinates of that corner, with the next axis (cyclic) in bit 0.
//!
//! On each face of the cell, traversed counter-clockwise as seen from outside, the wall leaves through an edge that goes from solid
//! to gas and enters through one that goes from gas to solid. Every crossed edge is an exit in one of its two faces and an entry in
//! the other. Following the faces therefore gives closed loops, which are then cut into triangles.

use std::sync::LazyLock;

/// Corners of face 2a + s (axis a, side s), counter-clockwise as seen from outside the cell.
const FACES: [[u8; 4]; 6] = {
    let mut faces = [[0; 4]; 6];
    let mut a = 0;
    while a < 3 {
        let (u, v) = (1 << ((a + 1) % 3), 1 << ((a + 2) % 3));
        faces[2 * a] = [0, v, u | v, u];
        let up = 1 << a;
        faces[2 * a + 1] = [up, up | u, up | u | v, up | v];
        a += 1;
    }
    faces
};

/// Returns the edge between two corners that differ in one bit.
fn edge(c: u8, d: u8) -> u8 {
    let a = (c ^ d).trailing_zeros() as u8;
    let bit = |n: u8| (c & d) >> (n % 3) & 1;
    4 * a + (bit(a + 1) | bit(a + 2) << 1)
}

/// Returns the axis of edge `e` and the coordinates of its lower corner.
pub(crate) fn place(e: u8) -> (usize, [usize; 3]) {
    let a = usize::from(e / 4);
    let mut low = [0; 3];
    low[(a + 1) % 3] = usize::from(e & 1);
    low[(a + 2) % 3] = usize::from(e >> 1 & 1);
    (a, low)
}

/// Returns the two faces of the cell that contain an edge.
fn faces_of(e: u8) -> [usize; 2] {
    let (a, low) = place(e);
    [1, 2].map(|n| 2 * ((a + n) % 3) + low[(a + n) % 3])
}

/// Returns true if a cut between the vertices of two edges is not allowed.
///
/// Such a cut would run along a face, and the cell beyond might make the same cut, so that four triangles would share a
/// side. Some loops through several faces cannot avoid it. A cell may therefore join the two edges along axis a + 1 of
/// its face on the low side of axis a, and those along a + 2 on the high side, which its neighbour may never do.
fn clashes(e: u8, f: u8) -> bool {
    let may = |face: usize| e / 4 == f / 4 && usize::from(e / 4) == (face / 2 + 1 + face % 2) % 3;
    faces_of(e).into_iter().any(|face| faces_of(f).contains(&face) && !may(face))
}

/// Returns the ambiguous faces (bit f: face f) of a cell with the given `solid` corners: those whose corners alternate
/// around the face, so that two interpretations are possible.
pub(crate) fn ambiguous_faces(solid: u8) -> u8 {
    let is = |c: u8| solid >> c & 1 == 1;
    let alternates = |f: &[u8; 4]| is(f[0]) == is(f[2]) && is(f[1]) == is(f[3]) && is(f[0]) != is(f[1]);
    FACES.iter().enumerate().fold(0, |set, (n, f)| set | u8::from(alternates(f)) << n)
}

/// Returns true if the solid corners of an ambiguous face are joined across it: the value at the saddle of its bilinear
/// function is solid.
///
/// `above` is the difference between each corner of the cell and the wall.
pub(crate) fn is_joined(face: usize, above: &[f64; 8]) -> bool {
    let [a, b, c, d] = FACES[face].map(|c| above[usize::from(c)]);
    // The saddle's value is (ac − bd) / (a + c − b − d), and the divisor has the sign of a.
    let (mut high, mut low) = (a * c, b * d);
    if a < 0.0 || c < 0.0 {
        std::mem::swap(&mut high, &mut low);
    }
    high >= low
}

/// Returns the loops of the wall through a cell's edges, clockwise as seen from the gas.
fn loops(solid: u8, joined: u8) -> Vec<Vec<u8>> {
    let is = |c: u8| solid >> c & 1 == 1;
    let mut next = [None; 12];
    for (n, f) in FACES.iter().enumerate() {
        for i in 0..4 {
            if !is(f[i]) || is(f[(i + 1) % 4]) {
                continue;
            }
            // Joined solid corners separate the gas corners, so the wall goes around the next corner, otherwise around this one.
            let ahead = joined >> n & 1 == 1 || ambiguous_faces(solid) >> n & 1 == 0;
            let steps = if ahead { [1, 2, 3] } else { [3, 2, 1] };
            let enters = steps.map(|s| (i + s) % 4).into_iter().find(|&k| !is(f[k]) && is(f[(k + 1) % 4]));
            next[usize::from(edge(f[i], f[(i + 1) % 4]))] = enters.map(|k| edge(f[k], f[(k + 1) % 4]));
        }
    }
    let mut found = Vec::new();
    for start in 0..12 {
        let mut polygon = Vec::new();
        let mut at = start;
        while let Some(to) = next[usize::from(at)].take() {
            polygon.push(at);
            at = to;
        }
        if !polygon.is_empty() {
            found.push(polygon);
        }
    }
    found
}

/// Cuts the polygon's part from `i` to `j` into triangles with as few clashing cuts as possible (the tests show that
/// there are none). Returns the number of clashes.
fn cut(polygon: &[u8], i: usize, j: usize, out: &mut Vec<[u8; 3]>) -> usize {
    let is_cut = |a: usize, b: usize| b - a > 1 && (a, b) != (0, polygon.len() - 1);
    let bad = |a: usize, b: usize| usize::from(is_cut(a, b) && clashes(polygon[a], polygon[b]));
    let mut best: Option<(usize, Vec<[u8; 3]>)> = None;
    for k in i + 1..j {
        let mut triangles = vec![[polygon[i], polygon[j], polygon[k]]];
        let cost = bad(i, k) + bad(k, j) + cut(polygon, i, k, &mut triangles) + cut(polygon, k, j, &mut triangles);
        if best.as_ref().is_none_or(|b| cost < b.0) {
            best = Some((cost, triangles));
        }
    }
    best.map_or(0, |(cost, mut triangles)| {
        out.append(&mut triangles);
        cost
    })
}

/// All cases.
struct Cases {
    triangles: Vec<[u8; 3]>,
    /// The first and last of a case's triangles, indexed by 64 · solid + joined.
    ranges: Vec<(u32, u32)>,
}

static CASES: LazyLock<Cases> = LazyLock::new(|| {
    let mut cases = Cases { triangles: Vec::new(), ranges: Vec::with_capacity(256 * 64) };
    for solid in 0..=255u8 {
        let ambiguous = ambiguous_faces(solid);
        for joined in 0..64u8 {
            let first = cases.triangles.len() as u32;
            if joined & !ambiguous == 0 {
                for polygon in loops(solid, joined) {
                    cut(&polygon, 0, polygon.len() - 1, &mut cases.triangles);
                }
            }
            cases.ranges.push((first, cases.triangles.len() as u32));
        }
    }
    cases
});

/// Returns the triangles of a cell with the given `solid` corners (bit c: corner c).
///
/// Each triangle has three edges, counter-clockwise as seen from the gas in right-handed coordinates. `joined` is set
/// for each ambiguous face whose solid corners are joined.
pub(crate) fn triangles(solid: u8, joined: u8) -> &'static [[u8; 3]] {
    let cases = &*CASES;
    let (first, last) = cases.ranges[64 * usize::from(solid) + usize::from(joined & ambiguous_faces(solid))];
    &cases.triangles[first as usize..last as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns every case with every interpretation of its ambiguous faces.
    fn all() -> impl Iterator<Item = (u8, u8)> {
        (0..=255u8).flat_map(|s| (0..64u8).filter(move |j| j & !ambiguous_faces(s) == 0).map(move |j| (s, j)))
    }

    #[test]
    fn every_crossed_edge_is_on_the_rim_of_the_triangles() {
        for (solid, joined) in all() {
            let mut crossed: Vec<u8> = (0..12)
                .filter(|&e| {
                    let (a, low) = place(e);
                    let c = low[0] | low[1] << 1 | low[2] << 2;
                    (solid >> c & 1) != (solid >> (c | 1 << a) & 1)
                })
                .collect();
            let mut used: Vec<u8> = triangles(solid, joined).as_flattened().to_vec();
            used.sort_unstable();
            used.dedup();
            crossed.sort_unstable();
            assert_eq!(used, crossed, "{solid:08b} {joined:06b}");
        }
    }

    #[test]
    fn no_cut_is_one_that_the_neighbour_may_make() {
        for (solid, joined) in all() {
            let t = triangles(solid, joined);
            let sides: Vec<(u8, u8)> = t.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
            for &(a, b) in &sides {
                assert_eq!(sides.iter().filter(|&&s| s == (a, b)).count(), 1, "{solid:08b} {joined:06b}");
                let on_a_face = faces_of(a).iter().any(|f| faces_of(b).contains(f));
                assert!(!(sides.contains(&(b, a)) && clashes(a, b)), "{solid:08b} {joined:06b}: {a} {b}");
                assert!(sides.contains(&(b, a)) || on_a_face, "the rim lies on the faces");
            }
        }
    }

    #[test]
    fn what_one_side_of_a_face_may_cut_the_other_may_not() {
        // The same two edges of a face, numbered by the cell below it and by the one above.
        for (e, f) in (0..12).flat_map(|e| (0..12).map(move |f| (e, f))).filter(|(e, f)| e != f) {
            for axis in 0..3 {
                let high = |e: u8| faces_of(e).contains(&(2 * axis + 1));
                if !(high(e) && high(f)) {
                    continue;
                }
                let lower = |e: u8| {
                    let (a, mut low) = place(e);
                    low[axis] = 0;
                    4 * a as u8 + (low[(a + 1) % 3] | low[(a + 2) % 3] << 1) as u8
                };
                assert!(clashes(e, f) || clashes(lower(e), lower(f)), "{e} {f}");
            }
        }
    }

    #[test]
    fn a_single_corner_is_cut_off_and_seen_from_the_gas() {
        let t = triangles(1, 0);
        assert_eq!(t.len(), 1);
        let p = t[0].map(|e| glam::DVec3::AXES[place(e).0]);
        let normal = (p[1] - p[0]).cross(p[2] - p[0]);
        assert!(normal.min_element() > 0.0, "{normal}");
        assert!(triangles(0, 0).is_empty() && triangles(255, 0).is_empty());
    }

    #[test]
    fn a_saddle_tells_whether_solid_corners_meet() {
        // Face 4 is z = 0: corners 0, 1, 3, 2. Solid: 0 and 3.
        assert_eq!(ambiguous_faces(0b1001), 1 << 4);
        let above = |solid: f64, gas: f64| [solid, gas, gas, solid, -1.0, -1.0, -1.0, -1.0];
        assert!(is_joined(4, &above(3.0, -1.0)) && !is_joined(4, &above(1.0, -3.0)));
        let turned = |solid: f64, gas: f64| [gas, solid, solid, gas, -1.0, -1.0, -1.0, -1.0];
        assert!(is_joined(4, &turned(3.0, -1.0)) && !is_joined(4, &turned(1.0, -3.0)));
        assert_eq!(triangles(0b1001, 0).len(), 2, "two corners on their own");
        assert_eq!(triangles(0b1001, 1 << 4).len(), 4, "a band");
    }
}
