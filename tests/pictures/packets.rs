//! The default renderer, packets of rays with pixels between them, against the brute-force reference, through the
//! embedded phantom. Each picture is good on its own, whatever came before, and identical at every SIMD level.

use colvis::phantom::{Phantom, PhantomSettings as Colon, Size};
use colvis::render::internals::{PacketRenderer, Pixels};
use colvis::render::{Direct, Frame, Preset, Quality, Renderer, Reuse, Settings, View, psnr, renderer};
use fearless_simd::Level;

use crate::frames::shown;
use crate::support::checks::cases;
use crate::support::embedded::embedded;

const SIDE: usize = 256;

/// Views along the axis, then in an order that jumps from end to end, looking back at each.
fn views() -> Vec<View> {
    let phantom = Phantom::new(&Colon { size: Size::Small, ..Colon::default() });
    let axis = phantom.axis();
    let at = |n: usize| {
        let frame = axis.frame(axis.length() * (n as f64 + 0.5) / 8.0);
        let forward = if n.is_multiple_of(2) { frame.tangent } else { -frame.tangent };
        View::new(frame.at, forward, frame.normal, 90.0, SIDE, SIDE).unwrap()
    };
    [0, 1, 2, 7, 3, 6, 0, 4].map(at).to_vec()
}

#[test]
fn every_picture_is_as_good_as_the_reference_whatever_came_before() {
    let volume = embedded();
    let mut default = renderer(&volume, Settings::default(), Preset::default(), Reuse::Allowed);
    let mut reference = Direct::new(&volume, Settings::new(Quality::Reference));
    let (mut fast, mut alone, mut exact) = (Frame::default(), Frame::default(), Frame::default());
    for (n, view) in views().iter().enumerate().take(cases(usize::MAX, 3)) {
        let work = default.render(view, &mut fast);
        renderer(&volume, Settings::default(), Preset::default(), Reuse::Never).render(view, &mut alone);
        assert!(
            fast == alone,
            "picture {n} depends on those before; {}",
            shown(&format!("packets {n} alone"), &alone, &fast)
        );
        reference.render(view, &mut exact);
        let db = psnr(&fast, &exact);
        let share = work.rays as f64 / (SIDE * SIDE) as f64;
        println!(
            "picture {n}: {db:.1} dB, {share:.2} rays a pixel, {:.1} samples a ray",
            work.samples as f64 / work.rays as f64
        );
        assert!(db >= 40.0, "picture {n}: {db}; {}", shown(&format!("packets {n}"), &exact, &fast));
    }
}

#[test]
fn every_level_makes_the_same_bytes() {
    let volume = embedded();
    let levels = [Level::new(), Level::new().as_avx2().map_or(Level::baseline(), Level::Avx2), Level::baseline()];
    for pixels in [Pixels::Needed, Pixels::All] {
        let mut all = levels.map(|l| PacketRenderer::with_level(&volume, Settings::default(), pixels, l));
        for view in views().iter().take(4) {
            let [a, b, c] = all.each_mut().map(|r| {
                let mut frame = Frame::default();
                r.render(view, &mut frame);
                frame
            });
            for (level, frame) in [("the second", &b), ("the third", &c)] {
                assert!(a == *frame, "{level} level; {}", shown(&format!("packets {level} level"), &a, frame));
            }
        }
    }
}

/// Blocks, bands and packets extend beyond a picture's edges at some sizes.
#[test]
fn pictures_of_any_size_are_filled_to_the_edge() {
    let volume = embedded();
    let view = &views()[0];
    let mut default = PacketRenderer::new(&volume, Settings::default(), Pixels::Needed);
    let mut reference = Direct::new(&volume, Settings::new(Quality::Reference));
    let (mut fast, mut exact) = (Frame::default(), Frame::default());
    for [width, height] in [[1, 1], [3, 5], [9, 17], [37, 23], [130, 66], [2, 200], [200, 3]] {
        let view = View::new(view.position(), view.forward(), view.up(), 60.0, width, height).unwrap();
        // The previous content must not resemble the picture.
        fast.resize(width, height);
        fast.buffers().0.fill([0, 255, 0]);
        let work = default.render(&view, &mut fast);
        reference.render(&view, &mut exact);
        let db = psnr(&fast, &exact);
        let greenest = fast.pixels().iter().map(|p| i32::from(p[1]) - i32::from(p[0])).max().unwrap();
        let good = db >= 40.0 && greenest <= 0;
        let name = format!("packets {width} x {height}");
        assert!(good, "{name}: {db} dB, {greenest}; {}", shown(&name, &exact, &fast));
        assert!(work.rays > 0);
    }
}

/// Where the wall is near and smooth there are fewer rays than pixels, and fewer samples than in the plain ray caster.
#[test]
#[ignore = "slow: flights of pictures with every pixel"]
fn most_pixels_need_no_ray() {
    let volume = embedded();
    let mut frame = Frame::default();
    let [mut needed, mut plain] = [0, 0];
    for view in views() {
        needed += PacketRenderer::new(&volume, Settings::default(), Pixels::Needed).render(&view, &mut frame).rays;
        plain += Direct::new(&volume, Settings::default()).render(&view, &mut frame).rays;
    }
    println!("{:.3} rays a pixel", needed as f64 / plain as f64);
    assert!(needed * 2 < plain);
}
