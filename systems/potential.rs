//! The guide of the paper's section 3.1.1: the wall repels, the target attracts.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{Body, Pose};
use crate::components::clock::Clock;
use crate::components::flight::{Flight, HelpAnswered, HelpCall};
use crate::components::guide::{Field, Gaze, GuideThrust, PotentialField};
use crate::components::scan::{TargetDistances, WallDistances};
use crate::dynamics::potential::ahead;
use crate::dynamics::{self, Potential};
use crate::error::{Error, Result};
use crate::schedule::{App, FlightSystems, Guide, Look, Main, Needs};
use crate::systems::looks::way;

/// Factor on the wall's strength in a trap, until the target's pull has led the body out.
const YIELDING: f64 = 0.02;
/// How often the wall yields in one flight, and for how long, s.
const YIELDS: u32 = 6;
const YIELD_S: f64 = 4.0;

/// The requested potential. In a trap, the field differs from it for a while.
#[derive(Component, Clone, Copy, Debug)]
pub struct YieldingPotential {
    /// `C_t`, `C_s`, `p`.
    potential: Potential,
    /// How often the wall has yielded to lead the body out of a trap.
    yields: u32,
    /// The wall yields until this tick.
    yields_until: u64,
}

impl Guide for Potential {
    const NAME: &'static str = "potential";
    const SUMMARY: &'static str = "the wall repels, the goal attracts";
    const KEY: Option<char> = Some('2');
    const LOOK: Option<Look> = Some(way::LOOK);
    const NEEDS: Needs = Needs { distances: true, fluid_as_gas: true, ..Needs::NOTHING };

    fn check(&self) -> Result<()> {
        Self::check(self)
    }

    fn cruise_mm_s(&self, body: &dynamics::Body) -> f64 {
        self.target_force / (body.mass_g * body.drag_per_s).max(1e-9)
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        let wall = app.scan_get::<WallDistances>().map(|d| Arc::clone(&d.0) as Field);
        let target = app.scan_get::<TargetDistances>().map(|d| Arc::clone(&d.0) as Field);
        let wall =
            wall.ok_or_else(|| Error::fault("potential", "the distances to the wall are missing", "report it"))?;
        app.equip((
            YieldingPotential { potential: *self, yields: 0, yields_until: 0 },
            PotentialField { potential: *self, wall, target },
        ));
        app.add_systems(FlightSystems::Guide, guide_by_potential);
        app.add_systems(FlightSystems::Answer, yield_to_trap);
        Ok(())
    }
}

/// Directs the view towards the target. The potential itself acts in the body's step.
pub fn guide_by_potential(
    clock: Res<Clock>,
    camera: Single<
        (&Pose, &Body, &YieldingPotential, Option<&Gaze>, &mut PotentialField, &mut GuideThrust),
        With<Main>,
    >,
) {
    let (pose, body, settings, gaze, mut field, mut guide) = camera.into_inner();
    field.potential = settings.potential;
    field.potential.target_force *= gaze.map_or(1.0, Gaze::pace);
    if clock.tick < settings.yields_until {
        field.potential.wall_energy *= YIELDING;
    }
    let look_direction = field.target.as_deref().map_or(DVec3::ZERO, |t| ahead(t, pose.position));
    let limit = settings.potential.target_force / body.0.mass_g;
    *guide = GuideThrust { limit, look_direction, ..GuideThrust::default() };
}

/// Weakens the wall for a few seconds before the operator is called.
///
/// D_t has no local minima, so the wall causes any local minimum of V. The step still cannot perforate.
pub fn yield_to_trap(
    clock: Res<Clock>,
    camera: Single<(Entity, &mut YieldingPotential, &mut HelpCall, &mut Flight), With<Main>>,
    mut commands: Commands,
) {
    let (entity, mut settings, mut call, mut flight) = camera.into_inner();
    if call.0.is_none() || settings.yields >= YIELDS {
        return;
    }
    call.0 = None;
    settings.yields += 1;
    settings.yields_until = clock.tick + (YIELD_S * f64::from(clock.hz)) as u64;
    flight.escapes += 1;
    commands.trigger(HelpAnswered { entity });
}

#[cfg(test)]
#[path = "potential_tests.rs"]
mod tests;
