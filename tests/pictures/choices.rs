//! The choices among the paper's ideas that a scene can make: they change what runs and what is kept, but not the
//! picture.

use colvis::phantom::{Phantom, PhantomSettings as Colon, Size};
use colvis::render::{
    Choices, Classification, Direct, Frame, GradientSource, Leaping, LowDetail, MemoryPart, PreparedVolume, Preset,
    Quality, Renderer, Reuse, Settings, View, Work, presets, psnr, renderer,
};

use crate::frames::shown;
use crate::support::checks::cases;
use crate::support::embedded::embedded;

const SIDE: usize = 128;

/// A flight of a few frames, 1 mm apart.
fn views() -> Vec<View> {
    let phantom = Phantom::new(&Colon { size: Size::Small, ..Colon::default() });
    let axis = phantom.axis();
    let at = |n: usize| {
        let frame = axis.frame(axis.length() * 0.4 + n as f64);
        View::new(frame.at, frame.tangent, frame.normal, 90.0, SIDE, SIDE).unwrap()
    };
    (0..5).map(at).collect()
}

struct Flown {
    frames: Vec<Frame>,
    work: Vec<Work>,
    parts: Vec<(MemoryPart, usize)>,
}

impl Flown {
    fn samples(&self) -> f64 {
        let all = self.work.iter().fold(Work::default(), |a, b| a + *b);
        all.samples as f64 / all.rays as f64
    }

    fn part(&self, part: MemoryPart) -> usize {
        self.parts.iter().filter(|p| p.0 == part).map(|p| p.1).sum()
    }

    /// Returns the lowest PSNR between the frames of two flights.
    fn psnr(&self, other: &Self) -> f64 {
        self.frames.iter().zip(&other.frames).map(|(a, b)| psnr(a, b)).fold(f64::INFINITY, f64::min)
    }
}

fn fly(mut renderer: Box<dyn Renderer>) -> Flown {
    let (mut frames, mut work) = (Vec::new(), Vec::new());
    for view in views() {
        let mut frame = Frame::default();
        work.push(renderer.render(&view, &mut frame));
        frames.push(frame);
    }
    Flown { frames, work, parts: renderer.parts() }
}

fn chosen(volume: &PreparedVolume, preset: Preset, settings: Settings, choices: Choices) -> Flown {
    fly(renderer(volume, Settings { choices, ..settings }, preset, Reuse::Allowed))
}

const NOTHING: Choices = Choices { leap: None, gradients: None, key_frames: None, low: None };

#[test]
#[ignore = "slow: flights of pictures by every method of leaping"]
fn leaping_changes_samples_and_memory_and_no_bit_of_a_picture() {
    let volume = embedded();
    let filtered = Settings { classification: Classification::Filtered, ..Settings::default() };
    let low = Settings::new(Quality::Low);
    for (preset, settings) in [
        (presets::colvis::PRESET, Settings::default()),
        (presets::colvis::PRESET, low),
        (presets::standard::PRESET, Settings::default()),
        (presets::standard::PRESET, filtered),
        (presets::standard::PRESET, low),
    ] {
        let by = |leap| chosen(&volume, preset, settings, Choices { leap: Some(leap), ..NOTHING });
        let [none, flag, brick, voxel] = [Leaping::None, Leaping::Flag, Leaping::Brick, Leaping::Voxel].map(by);
        let name = format!("{} {:?} {:?}", preset.name, settings.quality, settings.classification);
        println!(
            "{name}: samples a ray {:.1} {:.1} {:.1} {:.1}",
            none.samples(),
            flag.samples(),
            brick.samples(),
            voxel.samples()
        );
        for other in [&flag, &brick, &voxel] {
            assert!(none.frames == other.frames, "{name}: {}", shown("leaping", &none.frames[4], &other.frames[4]));
        }
        // Data from the previous frame lets rays begin far ahead, whatever their leaping method. Here they begin at the
        // camera.
        let alone = |leap| {
            let choices = Choices { leap: Some(leap), ..NOTHING };
            fly(renderer(&volume, Settings { choices, ..settings }, preset, Reuse::Never)).samples()
        };
        let plain = alone(Leaping::None);
        for leap in [Leaping::Flag, Leaping::Brick, Leaping::Voxel] {
            assert!(alone(leap) < plain, "{name} {leap:?}: {:.1} {plain:.1}", alone(leap));
        }
        assert!(voxel.samples() <= 1.02 * flag.samples().min(brick.samples()), "{name}");
        let voxels = volume.voxels().grid().len();
        assert_eq!([&none, &flag, &brick, &voxel].map(|f| f.part(MemoryPart::VoxelDistances)), [0, 0, 0, voxels]);
        assert!(brick.part(MemoryPart::BrickDistances) > 0 && brick.part(MemoryPart::BrickDistances) < voxels / 300);
    }
}

#[test]
fn gradients_come_from_where_they_are_chosen_to() {
    let volume = embedded();
    for preset in [presets::standard::PRESET, presets::colvis::PRESET].into_iter().take(cases(2, 1)) {
        for &quality in cases(&[Quality::High, Quality::Low][..], &[Quality::High]) {
            let by = |gradients| {
                let choices = Choices { gradients: Some(gradients), low: Some(LowDetail::Nearest), ..NOTHING };
                chosen(&volume, preset, Settings::new(quality), choices)
            };
            let [none, eight, cached, stored] =
                [GradientSource::None, GradientSource::Eight, GradientSource::Cached, GradientSource::Stored].map(by);
            for (name, other, least) in [("eight", &eight, 60.0), ("cached", &cached, 45.0), ("stored", &stored, 50.0)]
            {
                let db = none.psnr(other);
                println!("{} {quality:?} {name}: {db:.1} dB", preset.name);
                assert!(db > least, "{name}: {db} {}", shown(name, &none.frames[0], &other.frames[0]));
            }
            for (of, wanted) in [(&none, [0, 0]), (&eight, [0, 0]), (&cached, [1, 0]), (&stored, [0, 1])] {
                let kept =
                    [MemoryPart::GradientCache, MemoryPart::StoredGradients].map(|p| usize::from(of.part(p) > 0));
                assert_eq!(kept, wanted, "{} {quality:?}", preset.name);
            }
        }
    }
}

#[test]
#[ignore = "slow: flights of pictures"]
fn key_frames_come_as_often_as_they_are_chosen_to() {
    let volume = embedded();
    for preset in [presets::colvis::PRESET, presets::standard::PRESET] {
        let by = |n| chosen(&volume, preset, Settings::default(), Choices { key_frames: Some(n), ..NOTHING });
        let [one, three, never] = [1, 3, 1000].map(by);
        let from_scratch = |f: &Flown| f.work.iter().map(|w| w.reused == 0).collect::<Vec<_>>();
        assert_eq!(from_scratch(&one), [true; 5]);
        assert_eq!(from_scratch(&three), [true, false, false, true, false], "{}", preset.name);
        assert_eq!(from_scratch(&never), [true, false, false, false, false]);
        assert!(one.frames == three.frames && one.frames == never.frames, "reuse is proven");
        assert!(three.part(MemoryPart::FrameCache) > 0);
    }
    // The default preset's own renderer reuses nothing.
    let own = chosen(&volume, presets::standard::PRESET, Settings::default(), NOTHING);
    assert_eq!(own.part(MemoryPart::FrameCache), 0);
}

#[test]
#[ignore = "slow: four flights of pictures with every preset"]
fn low_detail_is_what_it_is_chosen_to_be_in_every_preset() {
    let lean = || {
        let s = embedded();
        PreparedVolume::lean(s.shared_voxels(), s.transfer())
    };
    for (preset, volume, own) in [
        (presets::standard::PRESET, embedded(), LowDetail::Third),
        (presets::colvis::PRESET, embedded(), LowDetail::Nearest),
        (presets::lean::PRESET, lean(), LowDetail::Nearest),
    ] {
        let by = |low| chosen(&volume, preset, Settings::new(Quality::Low), Choices { low, ..NOTHING });
        let [unsaid, nearest, third] = [None, Some(LowDetail::Nearest), Some(LowDetail::Third)].map(by);
        let high = chosen(&volume, preset, Settings::default(), NOTHING);
        assert!(unsaid.frames == if own == LowDetail::Third { &third } else { &nearest }.frames[..], "{}", preset.name);
        assert_eq!(nearest.work[0].rays, (SIDE * SIDE) as u64, "{}", preset.name);
        assert!(third.work[0].rays <= (SIDE.div_ceil(3) * SIDE.div_ceil(3)) as u64 + 200, "{:?}", third.work[0]);
        assert!(third.part(MemoryPart::SmallPicture) > 0 && nearest.part(MemoryPart::SmallPicture) == 0);
        let db = [nearest.psnr(&high), third.psnr(&high)];
        println!("{}: nearest {:.1} dB, third {:.1} dB against high detail", preset.name, db[0], db[1]);
        assert!(db[0] > 14.0 && db[1] > db[0], "{db:?}");
    }
}

/// Compares each choice with brute force using the same classification.
#[test]
#[ignore = "slow: flights of pictures by every choice, and their references"]
fn every_choice_keeps_its_bound_against_the_reference() {
    let volume = embedded();
    let reference = |classification| {
        fly(Box::new(Direct::new(&volume, Settings { classification, ..Settings::new(Quality::Reference) })))
    };
    let (by_value, by_density) = (reference(Classification::Value), reference(Classification::Filtered));
    for leap in [Leaping::None, Leaping::Voxel] {
        for gradients in [GradientSource::None, GradientSource::Cached, GradientSource::Stored] {
            let choices =
                Choices { leap: Some(leap), gradients: Some(gradients), key_frames: Some(2), ..Choices::default() };
            for (preset, truth, least) in
                [(presets::standard::PRESET, &by_value, 38.0), (presets::colvis::PRESET, &by_density, 33.0)]
            {
                let db = chosen(&volume, preset, Settings::default(), choices).psnr(truth);
                println!("{} {choices:?}: {db:.1} dB", preset.name);
                assert!(db > least, "{}: {choices:?}: {db}", preset.name);
            }
        }
    }
}
