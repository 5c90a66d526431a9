//! What systems of other crates take from the scan or from the camera of a flight.
//!
//! The components of this crate stay on these two entities while systems run: none of its own systems removes one. So a look at the
//! archetypes before and after shows whether something is gone, and costs nothing while nothing is.

use bevy_ecs::archetype::ArchetypeId;
use bevy_ecs::prelude::*;

use super::own::is_own;

/// The archetypes of a scan and of a camera; `None` for one that does not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Parts([Option<ArchetypeId>; 2]);

impl Parts {
    pub(super) fn of(world: &World, entities: [Entity; 2]) -> Self {
        Self(entities.map(|e| world.get_entity(e).ok().map(|e| e.archetype().id())))
    }

    /// Returns what has been done to the same entities since, if anything is gone: "despawned the camera", "took Pose from the camera".
    pub(super) fn taken(self, world: &World, entities: [Entity; 2]) -> Option<String> {
        let now = Self::of(world, entities);
        let taken = ["scan", "camera"].into_iter().enumerate().filter_map(|(n, entity)| {
            let (Some(before), Some(now)) = (self.0[n], now.0[n]) else {
                return now.0[n].is_none().then(|| format!("despawned the {entity}"));
            };
            let gone = (now != before).then(|| gone(world, before, now)).filter(|gone| !gone.is_empty())?;
            Some(format!("took {} from the {entity}", gone.join(", ")))
        });
        let taken: Vec<String> = taken.collect();
        (!taken.is_empty()).then(|| taken.join(" and "))
    }
}

/// Returns the names of the components of this crate that one archetype has and another has not.
fn gone(world: &World, before: ArchetypeId, now: ArchetypeId) -> Vec<String> {
    let [Some(before), Some(now)] = [before, now].map(|id| world.archetypes().get(id)) else { return Vec::new() };
    let ids = before.components().iter().filter(|&&id| !now.contains(id));
    let names = ids.filter_map(|&id| world.components().get_name(id)).map(|name| name.to_string());
    names.filter(|n| is_own(n)).map(|n| n.rsplit("::").next().unwrap_or(&n).to_owned()).collect()
}
