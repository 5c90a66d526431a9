//! Blocks of half the side: adds rays through the middles of a block's sides, and judges quarters by the second
//! differences along their sides.

use std::array::from_fn;

use super::sampling::{BLOCK, Block, CONTRAST, Point, Rgb, SLOPE};

/// The largest second difference along a quarter's side, brightness and voxels. The error of linear interpolation is an
/// eighth of it.
const BEND: [f32; 2] = [0.192, 1.2];

/// Positions of the middles of a block's sides, pixels from its top left corner: top, left, right and bottom.
pub(crate) const MIDDLES: [[usize; 2]; 4] = [[BLOCK / 2, 0], [0, BLOCK / 2], [BLOCK, BLOCK / 2], [BLOCK / 2, BLOCK]];

/// A block with additional rays through the middles of its sides.
pub(crate) struct Subdivided {
    /// Corners and centre.
    pub block: Block,
    /// The rays of [`MIDDLES`].
    pub middles: [Point; 4],
}

impl Subdivided {
    /// Returns its rays row by row.
    #[inline(always)]
    pub(crate) fn points(&self) -> [Point; 9] {
        in_rows(self.block.corners, self.block.centre, self.middles)
    }

    /// Returns which of the four quarters (left to right, then top to bottom) may be interpolated between their corners.
    pub(crate) fn smooth(&self) -> [bool; 4] {
        let p = self.points();
        quarters(&p, is_straight, is_even)
    }
}

/// Returns a subdivided block's rays row by row: those of its corners, of its centre and of [`MIDDLES`].
#[inline(always)]
pub(crate) fn in_rows<T>([a, b, c, d]: [T; 4], centre: T, [top, left, right, bottom]: [T; 4]) -> [T; 9] {
    [a, top, b, left, centre, right, c, bottom, d]
}

/// Returns in which of the four quarters each channel of a custom shader's colours may be interpolated, by the conditions
/// for brightness.
pub(crate) fn even_colours(points: &[Rgb; 9]) -> [bool; 4] {
    let of = |channel: usize| {
        let straight = |[a, b, c]: [f32; 3]| (a + c - 2.0 * b).abs() <= BEND[0];
        quarters(&points.map(|p| p[channel]), straight, is_even_light)
    };
    let [red, green, blue] = [of(0), of(1), of(2)];
    from_fn(|n| red[n] && green[n] && blue[n])
}

/// Returns the quarters whose four sides are straight and whose corners are even.
#[inline(always)]
fn quarters<T: Copy>(p: &[T; 9], straight: impl Fn([T; 3]) -> bool, even: impl Fn([T; 4]) -> bool) -> [bool; 4] {
    let line = |first: usize, stride: usize| straight([p[first], p[first + stride], p[first + 2 * stride]]);
    let (rows, columns) = ([0, 3, 6].map(|n| line(n, 1)), [0, 1, 2].map(|n| line(n, 3)));
    from_fn(|n| {
        let (x, y) = (n % 2, n / 2);
        let corners = [0, 1, 3, 4].map(|corner| p[x + 3 * y + corner]);
        rows[y] && rows[y + 1] && columns[x] && columns[x + 1] && even(corners)
    })
}

/// True if the middle one of three rays in a line is close to what the other two predict.
fn is_straight([a, b, c]: [Point; 3]) -> bool {
    let bend = |of: fn(&Point) -> f32| (of(&a) + of(&c) - 2.0 * of(&b)).abs();
    bend(|p| p.bright) <= BEND[0]
        && bend(|p| p.near) <= BEND[1] * b.near * b.near
        && bend(|p| p.front) <= BEND[1] * b.front * b.front
}

/// True if the corners of a quarter belong to one surface.
fn is_even(p: [Point; 4]) -> bool {
    is_even_light(p.map(|p| p.bright)) && is_flat(p.map(|p| p.near)) && is_flat(p.map(|p| p.front))
}

/// True if brightness, or a channel of the colour, may be interpolated between a quarter's corners.
fn is_even_light(corners: [f32; 4]) -> bool {
    twist(corners) <= BEND[0] && span(corners) <= CONTRAST
}

/// True if the inverse depths belong to one surface, or are all zero.
fn is_flat(near: [f32; 4]) -> bool {
    let [least, most] = ends(near);
    twist(near) <= BEND[1] * least * most && most - least <= SLOPE * least * most
}

fn twist([a, b, c, d]: [f32; 4]) -> f32 {
    (a + d - b - c).abs()
}

fn span(values: [f32; 4]) -> f32 {
    let [least, most] = ends(values);
    most - least
}

fn ends([a, b, c, d]: [f32; 4]) -> [f32; 2] {
    [a.min(b).min(c).min(d), a.max(b).max(c).max(d)]
}

/// Weights of a subdivided block's rays ([`Subdivided::points`]) in each of its pixels, row by row: bilinear in each quarter.
pub(crate) static SUBDIVIDED_WEIGHTS: [[f32; BLOCK * BLOCK]; 9] = subdivided_weights();

const fn subdivided_weights() -> [[f32; BLOCK * BLOCK]; 9] {
    let mut all = [[0.0; BLOCK * BLOCK]; 9];
    let half = BLOCK / 2;
    let mut n = 0;
    while n < BLOCK * BLOCK {
        let (x, y) = (n % BLOCK, n / BLOCK);
        let (u, v) = ((x % half) as f32 / half as f32, (y % half) as f32 / half as f32);
        let first = x / half + 3 * (y / half);
        all[first][n] = (1.0 - u) * (1.0 - v);
        all[first + 1][n] = u * (1.0 - v);
        all[first + 3][n] = (1.0 - u) * v;
        all[first + 4][n] = u * v;
        n += 1;
    }
    all
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::sampling::WEIGHTS;
    use super::*;

    /// The nine rays of a subdivided block.
    fn subdivide(of: impl Fn(f32, f32) -> Point) -> Subdivided {
        let at = |[x, y]: [usize; 2]| of(x as f32, y as f32);
        let corners = [[0, 0], [BLOCK, 0], [0, BLOCK], [BLOCK, BLOCK]].map(at);
        Subdivided { block: Block { corners, centre: at([BLOCK / 2; 2]) }, middles: MIDDLES.map(at) }
    }

    #[test]
    fn quarters_with_an_edge_in_one_channel_have_uneven_colours() {
        for channel in 0..3 {
            let with = |n: usize, value: f32| {
                let mut points = [[0.4; 3]; 9];
                points[n][channel] = value;
                even_colours(&points)
            };
            assert_eq!(with(8, 0.4 + 0.9 * BEND[0]), [true; 4]);
            assert_eq!(with(8, 0.4 + 1.1 * BEND[0]), [true, false, false, false], "the sides that end there");
            assert_eq!(with(4, 0.4 + 0.6 * BEND[0]), [false; 4], "all have the centre, on two straight lines");
        }
    }

    #[test]
    fn quarters_are_smooth_apart_from_those_with_an_edge() {
        let bent =
            |c: f32| subdivide(move |x, y| Point { near: 0.05, bright: c * (x * x - y * y), ..Point::default() });
        assert_eq!(bent(0.8 * BEND[0] / 8.0).smooth(), [true; 4]);
        assert_eq!(bent(1.1 * BEND[0] / 8.0).smooth(), [false; 4]);
        // Another surface at a corner affects one of the three rays of two sides. These are sides of three quarters.
        for other in [f32::NAN, 0.0, 0.5] {
            let near = move |x: f32, y: f32| if x + y > 6.0 { other } else { 0.05 };
            let cut = subdivide(move |x, y| Point { near: near(x, y), bright: 0.5, ..Point::default() });
            assert_eq!(cut.smooth(), [true, false, false, false], "{other}");
        }
        // The same for a surface in front, which may also exist at the corner alone.
        for [front, other] in [[0.1, 0.0], [0.1, 0.5], [0.0, 0.1]] {
            let front = move |x: f32, y: f32| if x + y > 6.0 { other } else { front };
            let cut = subdivide(move |x, y| Point { near: 0.05, front: front(x, y), bright: 0.5, ..Point::default() });
            assert_eq!(cut.smooth(), [true, false, false, false], "{other}");
        }
        // What twists is straight along every side.
        let twisted = |c: f32| subdivide(move |x, y| Point { near: 0.05, bright: c * x * y, ..Point::default() });
        assert_eq!(twisted(0.8 * BEND[0] / 4.0).smooth(), [true; 4]);
        assert_eq!(twisted(1.2 * BEND[0] / 4.0).smooth(), [false; 4]);
    }

    proptest! {
        /// Between the rays, pixels follow what is linear between them, and rays keep their own light.
        #[test]
        fn weights_reproduce_what_is_linear(a in -1.0f32..1.0, b in -1.0f32..1.0, c in -1.0f32..1.0) {
            let of = |x: f32, y: f32| Point { near: 0.05, bright: a + b * x + c * y, ..Point::default() };
            let subdivided = subdivide(of);
            for n in 0..BLOCK * BLOCK {
                let expected = of((n % BLOCK) as f32, (n / BLOCK) as f32).bright;
                let whole: f32 = subdivided.block.points().iter().zip(&WEIGHTS).map(|(p, w)| p.bright * w[n]).sum();
                let half: f32 = subdivided.points().iter().zip(&SUBDIVIDED_WEIGHTS).map(|(p, w)| p.bright * w[n]).sum();
                prop_assert!((whole - expected).abs() < 1e-5 && (half - expected).abs() < 1e-5, "{n}: {whole} {half} {expected}");
            }
        }
    }
}
