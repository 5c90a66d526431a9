//! Side-by-side images of two pictures that should be equal.

use image::{Rgb, RgbImage, imageops};

use super::failed::keep;

/// Factor by which differences are amplified, so that a few grey levels are visible.
const AMPLIFIED: u8 = 16;
/// Pixels between the panels.
const GAP: u32 = 4;

/// Saves a picture of three panels (expected, actual, and the amplified difference) and returns its location.
///
/// The difference is white where only one of the two pictures has a pixel.
pub(crate) fn panels(name: &str, expected: &RgbImage, got: &RgbImage) -> String {
    let path = keep(name, &side_by_side(expected, got));
    format!("expected, got and the difference {AMPLIFIED} times as large: {}", path.display())
}

fn side_by_side(expected: &RgbImage, got: &RgbImage) -> RgbImage {
    let (w, h) = (expected.width().max(got.width()), expected.height().max(got.height()));
    let mut all = RgbImage::from_pixel(3 * w + 2 * GAP, h, Rgb([96, 0, 160]));
    imageops::replace(&mut all, expected, 0, 0);
    imageops::replace(&mut all, got, i64::from(w + GAP), 0);
    let difference = RgbImage::from_fn(w, h, |x, y| {
        let pair = (expected.get_pixel_checked(x, y), got.get_pixel_checked(x, y));
        let (Some(a), Some(b)) = pair else { return Rgb([255; 3]) };
        Rgb([0, 1, 2].map(|c| a[c].abs_diff(b[c]).saturating_mul(AMPLIFIED)))
    });
    imageops::replace(&mut all, &difference, i64::from(2 * (w + GAP)), 0);
    all
}

#[test]
fn panels_show_both_pictures_and_where_they_differ() {
    let expected = RgbImage::from_pixel(5, 3, Rgb([10, 20, 30]));
    let mut got = expected.clone();
    got.put_pixel(4, 2, Rgb([10, 23, 255]));
    let all = side_by_side(&expected, &got);
    assert_eq!(all.dimensions(), (3 * 5 + 2 * GAP, 3));
    let at = |panel: u32, x, y| all.get_pixel(panel * (5 + GAP) + x, y).0;
    assert_eq!([at(0, 4, 2), at(1, 4, 2), at(2, 4, 2)], [[10, 20, 30], [10, 23, 255], [0, 48, 255]]);
    assert_eq!([at(0, 0, 0), at(1, 0, 0), at(2, 0, 0)], [[10, 20, 30], [10, 20, 30], [0; 3]]);
    // A picture of another size is white where there is nothing to compare.
    let wide = side_by_side(&expected, &RgbImage::new(6, 3));
    assert_eq!(wide.get_pixel(2 * (6 + GAP) + 5, 0).0, [255; 3]);
}
