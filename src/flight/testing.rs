//! Worlds for headless tests of single systems.
//!
//! A system is tested in a bare [`App`] that has the components which the system needs, and no others. [`TestApp`] is such a
//! world, with a scan whose distances are known in closed form ([`Room`]), a clock, and operator input at given steps. Tests
//! step it and compare components. `examples/test_one_system.rs` tests a system of its own:
//!
//! ```
//! use bevy_ecs::prelude::*;
//! # use colvis_flight as colvis;
//! use colvis::components::camera::Pose;
//! use colvis::components::scan::Walls;
//! use colvis::schedule::{FlightSystems, Main};
//! use colvis::testing::{Room, TestApp};
//! use glam::DVec3;
//!
//! /// The least clearance so far, mm.
//! #[derive(Component)]
//! struct Narrowest(f64);
//!
//! fn note_narrowest(walls: Single<&Walls, With<Main>>, camera: Single<(&Pose, &mut Narrowest), With<Main>>) {
//!     let (pose, mut narrowest) = camera.into_inner();
//!     narrowest.0 = narrowest.0.min(walls.0.at(pose.position).mm);
//! }
//!
//! let room = Room::new([20, 40, 20]);
//! let mut test = TestApp::new(&room);
//! test.app.equip(Narrowest(f64::INFINITY)).add_systems(FlightSystems::Watch, note_narrowest);
//! for away in [4.0, 7.0, 2.0] {
//!     test.place(room.centre() + DVec3::X * away);
//!     test.steps(1)?;
//! }
//! // 7 mm from the centre of a room 20 mm wide. The clearance finder stays up to 0.05 mm below the exact distance.
//! assert!((2.94..=3.0).contains(&test.get::<Narrowest>().0));
//! # Ok::<(), colvis::error::Error>(())
//! ```

use std::collections::VecDeque;
use std::sync::Arc;

use bevy_ecs::component::Mutable;
use bevy_ecs::prelude::*;
use glam::{DMat3, DVec3};

use crate::components::camera::Pose;
use crate::components::clock::Clock;
use crate::components::flight::Flight;
use crate::components::input::{HandCommand, Inbox};
use crate::components::scan::{Scan, Walls};
use crate::dynamics::Attitude;
use crate::error::Result;
use crate::fields::ClearanceFinder;
use crate::schedule::App;
use crate::space::{PreparedVolume, TransferFunction};
use crate::systems;
use crate::volume::{Grid, Volume};

/// Tissue around a room, voxels of 1 mm. At this distance from the wall nothing can be sensed.
const AROUND: usize = 4;
/// The value of tissue, HU. With gas at −1000 HU the wall at −650 HU lies halfway between the centres of two voxels.
const TISSUE_HU: i16 = -300;
const GAS_HU: i16 = -1000;
/// Reach of the clearance search, mm, as in a flight.
const REACH_MM: f64 = 11.0;

/// A box of gas in tissue. Its walls are planes, so every distance in it is known exactly, up to the rounding of positions.
///
/// One corner is at the world's origin, and the box extends along +x, +y and +z. Close to its edges (within a voxel) the
/// scan rounds the corner off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    size: [usize; 3],
}

impl Room {
    /// Creates a room of a size in mm, each side at least 2.
    pub fn new(size_mm: [usize; 3]) -> Self {
        Self { size: size_mm.map(|s| s.max(2)) }
    }

    /// Returns its size, mm.
    pub fn size_mm(&self) -> DVec3 {
        DVec3::from_array(self.size.map(|s| s as f64))
    }

    /// Returns its centre, world mm.
    pub fn centre(&self) -> DVec3 {
        0.5 * self.size_mm()
    }

    /// Returns the scan of the room: voxels of 1 mm, with the default transfer function.
    pub fn scan(&self) -> PreparedVolume {
        let dims = self.size.map(|s| s + 2 * AROUND);
        // The first voxel of gas lies half a voxel inside the wall.
        let origin = DVec3::splat(0.5 - AROUND as f64);
        let grid = Grid::new(dims, DVec3::ONE, origin, DMat3::IDENTITY).expect("a grid of some voxels");
        let is_gas = |at: [usize; 3]| (0..3).all(|a| (AROUND..AROUND + self.size[a]).contains(&at[a]));
        let data = (0..grid.len()).map(|n| [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])]);
        let data = data.map(|at| if is_gas(at) { GAS_HU } else { TISSUE_HU }).collect();
        PreparedVolume::new(Arc::new(Volume::new(grid, data)), TransferFunction::default())
    }

    /// Returns the distance of a point inside (world mm) to the nearest wall, mm; 0 outside.
    pub fn clearance_mm(&self, at: DVec3) -> f64 {
        at.min(self.size_mm() - at).min_element().max(0.0)
    }

    /// Returns the distance from a point inside (world mm) along a unit direction to the wall, mm; 0 outside.
    pub fn distance_mm(&self, at: DVec3, direction: DVec3) -> f64 {
        if self.clearance_mm(at) == 0.0 {
            return 0.0;
        }
        let size = self.size_mm();
        let along = |a: usize| {
            let wall = if direction[a] > 0.0 { size[a] } else { 0.0 };
            if direction[a] == 0.0 { f64::INFINITY } else { (wall - at[a]) / direction[a] }
        };
        along(0).min(along(1)).min(along(2))
    }
}

/// A world with one scan and one camera, for tests of systems.
///
/// The scan has [`Scan`] and [`Walls`], the camera a [`Pose`] and a [`Flight`], and the world a [`Clock`] that counts the steps.
/// Everything else is up to the test.
pub struct TestApp {
    /// The world and its schedules.
    pub app: App,
    script: VecDeque<(u64, HandCommand)>,
}

impl TestApp {
    /// Creates a world whose camera is in the middle of the room and looks along +y, with +z up.
    pub fn new(room: &Room) -> Self {
        let scan = room.scan();
        let mut app = App::new();
        let walls = ClearanceFinder::new(scan.shared_voxels(), scan.transfer().iso() as f32, REACH_MM);
        app.scan().insert((Scan(scan), Walls(walls)));
        let mut test = Self { app, script: VecDeque::new() };
        test.app.camera().insert(Flight::default());
        test.place(room.centre());
        systems::clock::plugin(&mut test.app).expect("a clock in an empty world");
        test
    }

    /// Puts the camera at a position, world mm, looking along +y with +z up.
    pub fn place(&mut self, position: DVec3) {
        self.app.camera().insert(Pose { position, attitude: Attitude::new(DVec3::Y, DVec3::Z) });
    }

    /// Gives operator input before the step with that number, counted from 0 in the life of this world. Commands take effect
    /// if the [operator's system](systems::operator) is plugged in.
    pub fn script(&mut self, commands: impl IntoIterator<Item = (u64, HandCommand)>) {
        self.script.extend(commands);
        self.script.make_contiguous().sort_by_key(|(tick, _)| *tick);
    }

    /// Runs steps.
    ///
    /// # Errors
    /// Returns status 1 if the systems cannot be ordered, or one has panicked.
    pub fn steps(&mut self, count: u32) -> Result<()> {
        for _ in 0..count {
            if self.app.is_changed() {
                self.app.build()?;
            }
            while self.script.front().is_some_and(|(tick, _)| *tick <= self.tick()) {
                if let (Some((_, command)), Some(mut inbox)) =
                    (self.script.pop_front(), self.app.world.get_resource_mut::<Inbox>())
                {
                    inbox.0.push_back(command);
                }
            }
            self.app.step()?;
        }
        Ok(())
    }

    /// Runs a frame.
    ///
    /// # Errors
    /// Returns the errors of [`TestApp::steps`].
    pub fn frame(&mut self) -> Result<()> {
        if self.app.is_changed() {
            self.app.build()?;
        }
        self.app.frame()
    }

    /// Returns the number of completed steps.
    pub fn tick(&self) -> u64 {
        self.app.world.resource::<Clock>().tick
    }

    /// Returns a component of the camera.
    ///
    /// # Panics
    /// Panics if the camera has none, which fails the test.
    pub fn get<T: Component>(&self) -> &T {
        self.app.camera_get().unwrap_or_else(|| panic!("the camera has no {}", std::any::type_name::<T>()))
    }

    /// Returns a component of the camera for modification.
    ///
    /// # Panics
    /// Panics if the camera has none, which fails the test.
    pub fn get_mut<T: Component<Mutability = Mutable>>(&mut self) -> Mut<'_, T> {
        self.app.camera_get_mut().unwrap_or_else(|| panic!("the camera has no {}", std::any::type_name::<T>()))
    }
}

/// Returns a digest of numbers that depends on every bit of each, to compare runs that must be equal (FNV-1a, 64 bits).
pub fn digest(numbers: impl IntoIterator<Item = f64>) -> u64 {
    let bytes = numbers.into_iter().flat_map(|n| n.to_bits().to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::clearance::TOLERANCE_MM;
    use crate::math::hash;
    use crate::space::first_crossing;

    #[test]
    fn a_room_is_as_large_as_it_says() {
        let room = Room::new([12, 30, 17]);
        let scan = room.scan();
        let walls = ClearanceFinder::new(scan.shared_voxels(), scan.transfer().iso() as f32, REACH_MM);
        for n in 0..200 {
            let u = |k| hash::uniform(n, k);
            let at = DVec3::new(u(0), u(1), u(2)) * (room.size_mm() - 3.0) + 1.5;
            let direction = (DVec3::new(u(3), u(4), u(5)) - 0.5).normalize();
            let end = at + direction * room.distance_mm(at, direction);
            // Away from edges, which the scan rounds off.
            let near = (0..3).filter(|&a| end[a].min(room.size_mm()[a] - end[a]) < 1.0).count();
            if near == 1 {
                let found = first_crossing(&scan, at, direction, f64::INFINITY).unwrap();
                assert!((found - room.distance_mm(at, direction)).abs() < 1e-9, "{at} {direction}: {found}");
            }
            let clearance = walls.at(at).mm;
            let exact = room.clearance_mm(at);
            let below = exact - clearance;
            let is_bound = (-1e-3..=TOLERANCE_MM + 1e-3).contains(&below);
            assert!(exact > REACH_MM - 1.0 || is_bound, "{at}: {clearance}, {exact}");
        }
        assert_eq!(room.clearance_mm(DVec3::splat(-1.0)), 0.0);
        assert_eq!(room.distance_mm(DVec3::splat(-1.0), DVec3::X), 0.0);
        assert_eq!(Room::new([0, 1, 5]).size_mm(), DVec3::new(2.0, 2.0, 5.0));
    }

    #[test]
    fn a_script_is_played_step_by_step() {
        let mut test = TestApp::new(&Room::new([10; 3]));
        test.app.world.init_resource::<Inbox>();
        test.script([(2, HandCommand::Resume), (0, HandCommand::Speed(2.0)), (2, HandCommand::Pause(true))]);
        let inbox = |test: &TestApp| test.app.world.resource::<Inbox>().0.iter().copied().collect::<Vec<_>>();
        test.steps(1).unwrap();
        assert_eq!((test.tick(), inbox(&test)), (1, vec![HandCommand::Speed(2.0)]));
        test.steps(2).unwrap();
        assert_eq!(inbox(&test)[1..], [HandCommand::Resume, HandCommand::Pause(true)], "in the order of the script");
    }

    #[test]
    fn digests_see_every_bit() {
        assert_eq!(digest([1.0, 2.0]), digest([1.0, 2.0]));
        assert_ne!(digest([1.0, 2.0]), digest([2.0, 1.0]));
        assert_ne!(digest([0.0]), digest([-0.0]));
        assert_ne!(digest([1.0]), digest([1.0 + f64::EPSILON]));
    }
}
