//! The guide that leaves the steering to the operator: the body drifts to rest unless it is pushed.

use bevy_ecs::prelude::*;

use crate::components::guide::GuideThrust;
use crate::dynamics::Body;
use crate::dynamics::hand::PUSH_MM_S;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Guide, Main};

/// The settings of the manual guide. It has none.
#[derive(Clone, Copy, Debug, Default, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Manual {}

impl Guide for Manual {
    const NAME: &'static str = "manual";
    const SUMMARY: &'static str = "operator input only";
    const KEY: Option<char> = Some('4');
    const AUTOMATIC: bool = false;

    /// Returns the speed that a full push holds.
    fn cruise_mm_s(&self, _: &Body) -> f64 {
        PUSH_MM_S
    }

    fn plug(&self, app: &mut App) -> Result<()> {
        app.add_systems(FlightSystems::Guide, let_drift);
        Ok(())
    }
}

/// Clears the thrust left by a previous guide.
pub fn let_drift(mut guide: Single<&mut GuideThrust, With<Main>>) {
    **guide = GuideThrust::default();
}
