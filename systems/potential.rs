//! The guide of the paper's section 3.1.1: the wall repels, the target attracts.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::components::camera::{Body, Pose};
use crate::components::clock::Clock;
use crate::components::guide::{GuideThrust, PotentialField, PotentialSettings};
use crate::components::output::GuideName;
use crate::components::{App, FlightSystems, Slot};
use crate::error::Result;
use crate::fields::Distance;

/// The view is directed at the way this far ahead, mm, found in steps of so much.
const AHEAD_MM: f64 = 24.0;
const STEP_MM: f64 = 3.0;
/// In a trap the wall's strength is this share of itself, until the target's pull has led out of it.
const YIELDING: f64 = 0.02;

/// Plugs the potential into the guide's slot.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Guide, "potential")?;
    app.world.insert_resource(GuideName("potential"));
    app.add_systems(FlightSystems::Guide, guide_by_potential);
    Ok(())
}

/// Tells the view where the target draws it. The potential itself acts within the step of the body.
///
/// A local minimum of V is one of the wall's making, as D_t has none: it is escaped by letting the wall's strength yield
/// for some seconds when the watch tells of a trap. The step still cannot perforate.
pub fn guide_by_potential(
    clock: Res<Clock>,
    camera: Single<(&Pose, &Body, &PotentialSettings, &mut PotentialField, &mut GuideThrust)>,
) {
    let (pose, body, settings, mut field, mut guide) = camera.into_inner();
    field.potential = settings.potential;
    if clock.tick < settings.yields_until {
        field.potential.wall_energy *= YIELDING;
    }
    let way = field.target.as_deref().map_or(DVec3::ZERO, |t| ahead(t, pose.position));
    let limit = settings.potential.target_force / body.0.mass_g;
    *guide = GuideThrust { limit, way, ..GuideThrust::default() };
}

/// Unit direction to the way ahead: the mean direction of the places that the steepest descent of the distance to the
/// target leads over; zero where it is not known.
fn ahead(target: &dyn Distance, from: DVec3) -> DVec3 {
    let mut at = from;
    let mut sum = DVec3::ZERO;
    for _ in 0..(AHEAD_MM / STEP_MM) as usize {
        let Some(s) = target.sample(at) else { break };
        let step = STEP_MM.min(s.mm);
        let down = s.gradient.normalize_or_zero();
        if down == DVec3::ZERO || step < 1e-3 {
            break;
        }
        at -= down * step;
        sum += (at - from).normalize_or_zero();
    }
    sum.normalize_or_zero()
}
