use std::time::Instant;

use super::*;
use crate::space::TransferFunction;

/// Times of the truth's parts: `cargo test --release -p colvis-dataset --lib speed -- --ignored --nocapture`.
#[test]
#[ignore = "tells times"]
fn speed() {
    let volume = colvis_phantom::Phantom::embedded(&Progress::new()).unwrap();
    let phantom = colvis_phantom::Phantom::new(&colvis_phantom::PhantomSettings::embedded(1));
    let volume = PreparedVolume::new(volume.into(), TransferFunction::default());
    let rays = Crossings::new(&volume, &Progress::new()).unwrap();
    let line = phantom.truth().centerline;
    let views: Vec<View> = (40..60)
        .map(|n| {
            let (at, ahead) = (line[n], line[n + 8] - line[n]);
            View::new(at, ahead, DVec3::Z, 90.0, 512, 512).unwrap()
        })
        .collect();
    let (mut all, mut count) = (Times::default(), 0);
    let begun = Instant::now();
    for three in views.windows(3) {
        let near = |view| Some(Neighbour { rays: &rays, view, moved: None });
        let neighbours = [near(&three[0]), near(&three[2])];
        let subject = Subject {
            volume: &volume,
            rays: &rays,
            view: &three[1],
            tissue: None,
            neighbours,
            rings: None,
            labels: None,
        };
        let mut truth = Truth::default();
        truth.measure(subject, &Kind::ALL, &Progress::new()).unwrap();
        all = Times { crossings: all.crossings + truth.times.crossings, flow: all.flow + truth.times.flow, ..all };
        count += 1;
    }
    println!("{:?} a frame, {:?}", begun.elapsed() / count, (all.crossings / count, all.flow / count));
}
