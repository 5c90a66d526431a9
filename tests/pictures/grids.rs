//! The default renderer against the reference where rays run along the wall, on grids from cubes to voxels five times
//! as long as wide. `cargo bench -p colvis-bench --bench grids` runs the full comparison, with more poses and sizes.

use std::sync::Arc;

use colvis::phantom::{Phantom, PhantomSettings, Size};
use colvis::progress::Progress;
use colvis::render::{
    Direct, Frame, PreparedVolume, Preset, Quality, Renderer, Reuse, Settings, TransferFunction, View, psnr, renderer,
};
use colvis::volume::Grid;
use glam::DVec3;

use crate::frames::shown;

/// Sides of the pictures, pixels. 330 is neither a power of two nor a whole number of packets.
const SIDES: [usize; 2] = [256, 330];
/// The minimum PSNR of every frame, dB.
const LEAST_DB: f64 = 40.0;

/// A pose: position (mm), forward, up.
type Pose = [[f64; 3]; 3];

/// Seeds of the phantom, voxels (mm) and the poses whose frames were worst. The dark rims of near folds fill much of
/// these pictures.
const CASES: [(u64, [f64; 3], &[Pose]); 4] = [
    (
        1,
        [0.6, 0.6, 3.0],
        &[
            [[41.647, -30.021, 52.492], [-0.7021, -0.5320, -0.4733], [-0.6915, 0.6680, 0.2749]],
            // One millimetre from a thin fold that light shines through.
            [[-64.793, 12.824, 44.815], [-0.4008, -0.1597, -0.9021], [0.6403, 0.6555, -0.4005]],
        ],
    ),
    (2, [0.8, 0.8, 2.0], &[[[67.991, 35.472, 24.243], [0.4909, 0.8325, 0.2569], [-0.5215, 0.5170, -0.6787]]]),
    (
        1,
        [1.0, 1.0, 1.0],
        &[
            [[61.411, 25.500, -40.802], [0.2257, 0.4844, 0.8452], [-0.8902, 0.4549, -0.0230]],
            // Close to the wall, and along it.
            [[72.839, 30.475, 14.977], [0.7309, -0.6148, 0.2963], [-0.3395, 0.0490, 0.9393]],
        ],
    ),
    (1, [0.9, 0.9, 1.25], &[[[56.576, 26.925, -41.862], [0.7607, 0.1129, 0.6392], [-0.5306, 0.6753, 0.5123]]]),
];

/// The small phantom of a seed on voxels of `spacing`.
fn volume(seed: u64, spacing: [f64; 3]) -> PreparedVolume {
    let phantom = Phantom::new(&PhantomSettings { size: Size::Small, seed, ..PhantomSettings::default() });
    let own = phantom.grid();
    let spacing = DVec3::from_array(spacing);
    let reach = DVec3::from_array(own.dims().map(|n| (n - 1) as f64)) * own.spacing();
    let dims = (reach / spacing).floor().to_array().map(|n| n as usize + 1);
    let grid = Grid::new(dims, spacing, own.origin(), own.direction()).unwrap();
    let volume = phantom.voxelise(&grid, &Progress::new()).unwrap();
    PreparedVolume::new(Arc::new(volume), TransferFunction::default())
}

#[test]
#[ignore = "slow: references on every grid"]
fn every_frame_is_good_on_every_grid() {
    for (seed, spacing, poses) in CASES {
        let volume = volume(seed, spacing);
        let mut default = renderer(&volume, Settings::default(), Preset::default(), Reuse::Allowed);
        let mut reference = Direct::new(&volume, Settings::new(Quality::Reference));
        let (mut fast, mut exact) = (Frame::default(), Frame::default());
        for pose in poses {
            let [position, forward, up] = pose.map(DVec3::from_array);
            for side in SIDES {
                let view = View::new(position, forward, up, 90.0, side, side).unwrap();
                default.render(&view, &mut fast);
                reference.render(&view, &mut exact);
                let db = psnr(&fast, &exact);
                let name = format!("grids phantom {seed} {spacing:?} {side}");
                println!("{name}: {db:.1} dB");
                assert!(db >= LEAST_DB, "{name}: {db:.2} dB at {position}; {}", shown(&name, &exact, &fast));
            }
        }
    }
}
