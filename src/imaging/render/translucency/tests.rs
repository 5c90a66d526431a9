use std::sync::Arc;

use fearless_simd::{f32x16, prelude::*};
use glam::{DMat3, DVec3, Vec3};

use super::*;
use crate::render::packets::levels;
use crate::render::{
    Options, PreparedVolume, Preset, Renderer, Reuse, Settings, TransferFunction, View, presets, renderer,
};
use crate::volume::{Grid, Volume};

/// A volume whose value depends on z alone, mm.
fn layers(spacing: DVec3, dims: [usize; 3], value: impl Fn(f64) -> f64) -> PreparedVolume {
    let grid = Grid::new(dims, spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let z = |n: usize| (n / (dims[0] * dims[1])) as f64 * spacing.z;
    let data = (0..grid.len()).map(|n| value(z(n)).round() as i16).collect();
    PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
}

/// Returns the colour and the weight behind the wall near `place` (world, mm), along z, on every SIMD level.
fn behind(
    volume: &PreparedVolume,
    scanned: Option<&Volume>,
    settings: &TranslucencySettings,
    place: DVec3,
) -> [f32; 4] {
    let behind = Behind::new(volume, scanned, settings, Level::new()).unwrap();
    let grid = volume.voxels().grid();
    let q = (grid.voxel(place) + 1.0).as_vec3();
    let mut all = levels().into_iter().map(|(_, level)| {
        fearless_simd::dispatch!(level, simd => {
            let splat = |v: Vec3| [v.x, v.y, v.z].map(|c| f32x16::splat(simd, c));
            let one = f32x16::splat(simd, 1.0);
            behind.colours(simd, splat(q), one.simd_gt(0.0)).map(|c| c.to_array()[7])
        })
    });
    let first = all.next().unwrap();
    assert!(all.all(|other| other == first), "SIMD levels differ");
    assert!(first.iter().all(|c| c.is_finite()), "{first:?}");
    first
}

/// A table that is linear in HU and stops hardly any light: its red is the mean value.
fn mean() -> TranslucencySettings {
    let range = |hu, colour| TissueRange { name: "x".to_owned(), hu, colour, opacity: 1e-4 };
    let ranges = vec![range([-2000.0, -1000.0], [0, 0, 0]), range([1000.0, 2000.0], [200, 0, 0])];
    TranslucencySettings { ranges, ..TranslucencySettings::default() }
}

#[test]
fn each_tissue_of_the_table_has_its_colour() {
    let settings = TranslucencySettings::default();
    for (value, n) in [(-90.0, 1), (40.0, 2), (600.0, 3), (1500.0, 3)] {
        let volume = layers(DVec3::splat(0.7), [12, 12, 40], |z| if z < 10.0 { -1000.0 } else { value });
        let [r, g, b, weight] = behind(&volume, None, &settings, DVec3::new(4.0, 4.0, 9.9));
        let expected = settings.ranges[n].colour.map(f32::from);
        let off = [r - expected[0], g - expected[1], b - expected[2]].map(f32::abs);
        // The edge of a voxel is a ramp through all values below.
        assert!(off.iter().all(|&c| c < 25.0), "{value} HU: {r} {g} {b} instead of {expected:?}");
        assert!(weight > 0.25, "{value} HU: {weight}");
    }
    // A thin wall before gas: some of both.
    let volume = layers(DVec3::splat(0.7), [12, 12, 40], |z| if (10.0..12.0).contains(&z) { 40.0 } else { -1000.0 });
    let [r, _, b, _] = behind(&volume, None, &settings, DVec3::new(4.0, 4.0, 9.9));
    assert!(b > 130.0 && r > 90.0, "{r} {b}");
}

/// The midpoint rule is exact where values change linearly, whatever the spacing, and on grids five times as coarse along z.
#[test]
fn the_mean_of_a_linear_volume_is_exact() {
    for spacing in [DVec3::splat(0.5), DVec3::splat(1.0), DVec3::new(0.5, 0.5, 2.5)] {
        // -650 HU is at 10 mm.
        let slope = 100.0;
        let volume = layers(spacing, [12, 12, 40], |z| -650.0 + slope * (z - 10.0));
        let settings = mean();
        let place = DVec3::new(2.9, 2.7, 9.4);
        let red = behind(&volume, None, &settings, place)[0];
        let (mut sum, mut weight) = (0.0, 0.0);
        for n in 0..10 {
            let mm = 0.5 * (f64::from(n) + 0.5);
            let skin = mm.min(1.0);
            sum += skin * (-650.0 + slope * mm);
            weight += skin;
        }
        let hu = f64::from(red) / 200.0 * 2000.0 - 1000.0;
        assert!((hu - sum / weight).abs() < 0.5, "{spacing}: {hu} instead of {}", sum / weight);
        // The integral itself: ∫ skin·v over ∫ skin, with v linear.
        let exact = -650.0 + slope * (1.0 / 3.0 + 12.0) / 4.5;
        assert!((hu - exact).abs() < 0.01 * slope * 5.0, "{hu} {exact}");
    }
}

/// A coat on soft tissue, against the integral in closed form.
#[test]
fn a_layer_counts_by_its_thickness() {
    let settings = TranslucencySettings::default();
    let mut before = 0.0;
    for mm in [0.0, 1.0, 1.5, 2.0, 3.0, 5.0] {
        let value = |z: f64| match z - 10.0 {
            z if z < 0.0 => -1000.0,
            z if z < mm => 500.0,
            _ => 40.0,
        };
        let volume = layers(DVec3::splat(0.1), [6, 6, 200], value);
        let [_, green, ..] = behind(&volume, None, &settings, DVec3::new(0.3, 0.3, 9.96));
        // T falls as 0.3^∫skin in the coat and 0.75^∫skin behind it.
        let skin = |mm: f64| if mm < 1.0 { 0.5 * mm * mm } else { mm - 0.5 };
        let coat = 1.0 - 0.3f64.powf(skin(mm));
        let tissue = (1.0 - coat) * (1.0 - 0.75f64.powf(skin(5.0) - skin(mm)));
        let exact = (255.0 * coat + 92.0 * tissue) / (coat + tissue);
        // Half a step of the path.
        assert!((f64::from(green) - exact).abs() < 14.0, "{mm} mm: {green} instead of {exact}");
        assert!(f64::from(green) > before - 1.0, "{mm} mm");
        before = f64::from(green);
    }
}

/// Where cleansing took out a thin layer, it is a part of the path; a pool is not.
#[test]
fn a_coat_that_was_cleansed_is_seen_and_a_pool_is_not() {
    let settings = TranslucencySettings::default();
    let dims = [12, 12, 80];
    let scan = |coat: f64| {
        layers(DVec3::splat(0.5), dims, move |z| match z {
            z if z < 20.0 - coat => -1000.0,
            z if z < 20.0 => 500.0,
            _ => 40.0,
        })
    };
    let cleansed = scan(0.0);
    let place = DVec3::new(3.0, 3.0, 19.7);
    let of = |coat: f64| behind(&cleansed, Some(scan(coat).voxels()), &settings, place);
    let [bare, coated, pool] = [0.0, 1.5, 10.0].map(of);
    assert_eq!(bare, behind(&cleansed, None, &settings, place));
    assert!(coated[1] > bare[1] + 60.0, "{coated:?} {bare:?}");
    assert!(pool[1] < bare[1] + 40.0, "only its blur: {pool:?} {bare:?}");
    // A part of the scan, on the same lattice.
    let (volume, low) = (scan(1.5), [2, 3, 10]);
    let (grid, size) = (volume.voxels().grid(), [8, 8, 60]);
    let origin = grid.world(DVec3::from_array(low.map(|c| c as f64)));
    let part = Grid::new(size, grid.spacing(), origin, DMat3::IDENTITY).unwrap();
    let data = (0..part.len()).map(|n| {
        let [x, y, z] = [n % 8, n / 8 % 8, n / 64];
        volume.voxels().data()[grid.index(x + low[0], y + low[1], z + low[2])]
    });
    let part = Volume::new(part, data.collect());
    assert_eq!(behind(&cleansed, Some(&part), &settings, place), coated);
}

#[test]
fn the_ends_of_a_volume_and_of_numbers_break_nothing() {
    let settings = TranslucencySettings::default();
    // A wall in the last voxels: beyond them is what they hold.
    let volume = layers(DVec3::splat(1.0), [8, 8, 12], |z| if z < 10.0 { -1000.0 } else { 40.0 });
    let [r, g, b, weight] = behind(&volume, None, &settings, DVec3::new(3.0, 3.0, 9.4));
    assert!(r > 190.0 && g < 130.0 && b < 150.0 && weight > 0.5, "{r} {g} {b} {weight}");
    for place in [DVec3::splat(-50.0), DVec3::splat(500.0), DVec3::new(3.0, 3.0, 5.0)] {
        assert!(behind(&volume, None, &settings, place)[3] >= 0.0);
    }
    for value in [i16::MIN, i16::MAX] {
        let volume = layers(DVec3::splat(1.0), [8, 8, 12], |z| if z < 6.0 { f64::from(value) } else { 40.0 });
        behind(&volume, None, &settings, DVec3::new(3.0, 3.0, 5.4));
    }
    let thin = layers(DVec3::ONE, [8, 8, 1], |_| 0.0);
    assert!(Behind::new(&thin, None, &settings, Level::new()).is_none());
    let view = View::new(DVec3::splat(3.0), DVec3::Z, DVec3::Y, 90.0, 20, 12).unwrap();
    let of = Pictured { volume: &thin, scanned: None, view: &view, distances: None };
    let mut frame = Frame::new(20, 12);
    Translucency::new(settings).paint(of, PaintedArea::Whole, &mut frame);
    assert_eq!(frame, Frame::new(20, 12));
}

/// A room of gas in fat with a half of tag.
fn room() -> (PreparedVolume, View) {
    let grid = Grid::new([60, 50, 40], DVec3::new(0.7, 0.8, 1.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let value = |n: usize| {
        let at = grid.world(DVec3::new((n % 60) as f64, (n / 60 % 50) as f64, (n / 3000) as f64));
        match (at - DVec3::new(20.0, 20.0, 20.0)).length() {
            mm if mm < 12.0 => -1000,
            _ if at.x > 20.0 => 500,
            _ => -90,
        }
    };
    let volume = Volume::new(grid.clone(), (0..grid.len()).map(value).collect());
    let volume = PreparedVolume::new(Arc::new(volume), TransferFunction::default());
    (volume, View::new(DVec3::splat(20.0), DVec3::Y, DVec3::Z, 90.0, 203, 150).unwrap())
}

fn painted(renderer: &mut dyn Renderer, room: &(PreparedVolume, View), area: PaintedArea) -> [Frame; 2] {
    let (volume, view) = room;
    let mut frame = Frame::default();
    renderer.render(view, &mut frame);
    let plain = frame.clone();
    let of = Pictured { volume, scanned: None, view, distances: renderer.distances() };
    Translucency::new(TranslucencySettings::default()).paint(of, area, &mut frame);
    [plain, frame]
}

#[test]
fn a_picture_has_the_colours_of_the_table_whatever_its_renderer() {
    let room = room();
    let mut first: Option<Frame> = None;
    for preset in presets::BUILT_IN {
        let mut renderer = renderer(&room.0, Settings::default(), preset, Reuse::Never);
        let [plain, frame] = painted(&mut *renderer, &room, PaintedArea::Whole);
        // Looking to posterior with superior on top, the patient's left is on the right.
        for (x, colour) in [(30, [255, 205, 0]), (170, [255, 255, 255])] {
            let at = 75 * 203 + x;
            let light = f32::from(*plain.pixels()[at].iter().max().unwrap()) / 255.0;
            let all = colour.iter().zip(plain.pixels()[at]).zip(frame.pixels()[at]);
            for ((&colour, plain), got) in all {
                let expected = light * (0.9 * colour as f32) + 0.1 * f32::from(plain);
                let off = f32::from(got) - expected;
                assert!(off.abs() < 24.0, "{} at {x}: {got} instead of {expected}", preset.name);
            }
        }
        let db = first.as_ref().map_or(f64::INFINITY, |f| crate::render::psnr(f, &frame));
        assert!(db > 20.0 || preset.name == "colvis", "{}: {db} dB", preset.name);
        first.get_or_insert(frame);
    }
}

#[test]
fn a_lens_colours_the_circle_and_nothing_else() {
    let room = room();
    let mut renderer = renderer(&room.0, Settings::default(), Preset::default(), Reuse::Never);
    let [plain, whole] = painted(&mut *renderer, &room, PaintedArea::Whole);
    for (centre, radius) in [([100.0, 70.0], 40.0), ([2.0, 148.0], 31.5), ([100.5, 75.5], 500.0), ([40.0, 40.0], 0.3)] {
        let [_, lens] = painted(&mut *renderer, &room, PaintedArea::Lens { centre, radius });
        for (n, pixel) in lens.pixels().iter().enumerate() {
            let [x, y] = [n % 203, n / 203].map(|c| c as f32 + 0.5);
            let off = (x - centre[0]).hypot(y - centre[1]) - radius;
            if off.abs() > 0.01 {
                let expected = if off < 0.0 { whole.pixels()[n] } else { plain.pixels()[n] };
                assert_eq!(*pixel, expected, "{x} {y} in {centre:?} {radius}");
            }
        }
    }
    for (centre, radius) in
        [([f32::NAN, 3.0], 9.0), ([-50.0, 20.0], 9.0), ([9.0, 9.0], f32::NAN), ([9.0, 9.0], -3.0), ([400.0, 9.0], 50.0)]
    {
        let [plain, lens] = painted(&mut *renderer, &room, PaintedArea::Lens { centre, radius });
        assert!(plain == lens, "{centre:?} {radius}");
    }
}

#[test]
fn bytes_do_not_depend_on_threads_or_on_what_was_painted_before() {
    let room = room();
    let of_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut renderer = renderer(&room.0, Settings::default(), Preset::default(), Reuse::Never);
            painted(&mut *renderer, &room, PaintedArea::Whole)
        })
    };
    let one = of_threads(1);
    assert!(one[0] != one[1] && [2, 8].into_iter().all(|n| of_threads(n) == one));
    // The same view, another, and the first again, larger and smaller.
    let (volume, view) = &room;
    let mut used = Translucency::new(TranslucencySettings::default());
    let other = View::new(DVec3::splat(19.0), DVec3::X, DVec3::Z, 90.0, 90, 95).unwrap();
    let mut renderer = renderer(volume, Settings::default(), Preset::default(), Reuse::Never);
    for view in [view, view, &other, view] {
        let paint = |renderer: &mut dyn Renderer, translucency: &mut Translucency| {
            let mut frame = Frame::default();
            renderer.render(view, &mut frame);
            let of = Pictured { volume, scanned: None, view, distances: renderer.distances() };
            translucency.paint(of, PaintedArea::Whole, &mut frame);
            frame
        };
        let anew = paint(&mut *renderer, &mut Translucency::new(TranslucencySettings::default()));
        assert!(paint(&mut *renderer, &mut used) == anew);
    }
}

#[test]
fn a_table_that_cannot_be_is_refused_with_its_reason() {
    let read = |text: &str| TranslucencySettings::read(Options::new(text.parse().unwrap()));
    assert_eq!(read("").unwrap(), TranslucencySettings::default());
    assert_eq!(read("depth_mm = 3").unwrap().depth_mm, 3.0);
    let range = |hu: &str, more: &str| format!("[[ranges]]\nname = \"x\"\nhu = {hu}\ncolour = [1, 2, 3]\n{more}\n");
    let one = range("[-100, 5.5]", "opacity = 1");
    assert_eq!(read(&one).unwrap().ranges[0].hu, [-100.0, 5.5]);
    assert!(read(&format!("{one}{}", range("[5.5, 9]", "opacity = 0.1"))).is_ok(), "they may touch");
    for (text, word) in [
        ("depth_mm = 0", "depth_mm"),
        ("depth_mm = -1.0", "above 0 and up to 30"),
        ("depth_mm = nan", "is NaN"),
        ("depth_mm = inf", "is inf"),
        ("depth_mm = 31", "31"),
        ("lens = 0", "lens"),
        ("lens = 1.5", "1.5"),
        ("deep = 3", "deep"),
        ("ranges = []", "has 0 ranges"),
        (&one.repeat(9), "has 9 ranges"),
        (&one.repeat(2), "x begins at -100, before x ends at 5.5"),
        (&range("[5, -5]", "opacity = 1"), "ranges[0].hu: is [5, -5]"),
        (&range("[nan, 5]", "opacity = 1"), "is [NaN, 5]"),
        (&range("[0, inf]", "opacity = 1"), "both finite"),
        (&range("[0, 5]", "opacity = 0"), "opacity"),
        (&range("[0, 5]", "opacity = 1.01"), "opacity"),
        (&range("[0, 5]", ""), "opacity"),
        (&range("[0, 5]", "opacity = 1\nhue = 3"), "hue"),
        (&one.replace("[1, 2, 3]", "[1, 2, 300]"), "300"),
        (&one.replace("\"x\"", "\"\""), "name"),
    ] {
        let e = read(text).unwrap_err().to_string();
        assert!(e.contains(word) && !e.contains('\n'), "{text}: {e}");
    }
}

/// Readers who lack one of three cones tell the colours apart at any brightness (Viénot, Brettel and Mollon, *Digital video colourmaps
/// for checking the legibility of displays by dichromats*, 1999).
#[test]
fn colours_stay_apart_for_every_reader() {
    let settings = TranslucencySettings::default();
    let linear = |c: u8| (f64::from(c) / 255.0).powf(2.2);
    let colours: Vec<DVec3> = settings.ranges.iter().map(|r| DVec3::from_array(r.colour.map(linear))).collect();
    let rows = |m: [[f64; 3]; 3]| DMat3::from_cols_array_2d(&m).transpose();
    let protan = rows([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]);
    let deutan = rows([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]);
    for (reader, see) in [("all cones", DMat3::IDENTITY), ("protan", protan), ("deutan", deutan)] {
        // The share of each channel does not change with brightness.
        let shares: Vec<DVec3> = colours.iter().map(|&c| (see * c) / (see * c).element_sum()).collect();
        for (n, a) in shares.iter().enumerate() {
            for (m, b) in shares.iter().enumerate().skip(n + 1) {
                let names = [&settings.ranges[n].name, &settings.ranges[m].name];
                assert!(a.distance(*b) > 0.12, "{reader}, {names:?}: {a} {b}");
            }
        }
    }
}
