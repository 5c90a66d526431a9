//! The guide that steers by tentacles: they keep the camera off the wall and find the path, and mines keep it from
//! turning back.

use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryData;

use crate::components::camera::{Body, Heading, Pose};
use crate::components::flight::{Goal, Watch};
use crate::components::guide::{GuideThrust, MineField, Tentacles};
use crate::components::scan::Scan;
use crate::dynamics;
use crate::dynamics::tentacles::{TentacleSettings, approach, steer};
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Guide, Main};
use crate::space::first_crossing;
use crate::systems::sense;

impl Guide for TentacleSettings {
    const NAME: &'static str = "tentacles";
    const SUMMARY: &'static str = "sensory rays keep off the wall and find the path ahead";
    const KEY: Option<char> = Some('1');

    fn check(&self) -> Result<()> {
        Self::check(self)
    }

    fn cruise_mm_s(&self, _: &dynamics::Body) -> f64 {
        self.cruise_mm_s
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        sense::plug(app, *self)?;
        app.add_systems(FlightSystems::Guide, guide_by_tentacles);
        Ok(())
    }
}

/// The camera that tentacles steer.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct TentacleGuide {
    pose: &'static Pose,
    heading: &'static Heading,
    body: &'static Body,
    tentacles: &'static Tentacles,
    guide: &'static mut GuideThrust,
    mines: Option<&'static MineField>,
    goal: Option<&'static Goal>,
    watch: Option<&'static Watch>,
}

/// Chooses the direction from the tentacle readings.
pub fn guide_by_tentacles(scan: Single<&Scan, With<Main>>, camera: Single<TentacleGuide, With<Main>>) {
    let TentacleGuideItem { pose, heading, body, tentacles, mut guide, mines, goal, watch } = camera.into_inner();
    let mines = mines.map(|m| (&m.mines, &m.settings));
    // While the guide looks for another direction, its whole trail is forbidden ground, not only the last few mines.
    let trail = watch.map_or((&[][..], 0.0), |w| w.rescue.forbidden());
    let settings = watch.map_or(tentacles.settings, |w| w.rescue.temper(&tentacles.settings));
    let s = steer(
        (&tentacles.directions, &tentacles.lengths),
        pose.position,
        heading.0,
        mines,
        trail,
        &settings,
        body.0.drag_per_s,
    );
    *guide = GuideThrust {
        thrust: s.thrust,
        limit: s.limit,
        wall: s.wall,
        look_direction: s.look,
        ..GuideThrust::default()
    };
    // A goal in direct view attracts the camera, as the paper's D_t does; a goal behind a wall does not.
    if let Some(goal) = goal
        && let Some((thrust, direction)) = approach(pose.position, goal.at, &tentacles.settings, body.0.drag_per_s)
        && first_crossing(&scan.0, pose.position, direction, pose.position.distance(goal.at)).is_none()
    {
        guide.thrust = thrust;
        guide.limit = thrust.length();
        guide.look_direction = direction;
    }
}
