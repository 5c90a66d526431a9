//! What the schedules of a world contain and what they have done.

use bevy_ecs::component::ComponentId;
use bevy_ecs::prelude::*;
use bevy_ecs::query::Access;
use bevy_ecs::system::SystemAccess;

use super::app::{App, LeftOut, Slot, short};
use super::ledger::PluginTime;
use super::own::is_own;

/// The systems, components and plug-ins of an [`App`], for explanations and messages.
#[derive(Clone, Copy)]
pub struct Inspector<'a>(pub(super) &'a App);

impl App {
    /// Returns what the schedules contain and what they have done, for explanations.
    pub fn inspect(&self) -> Inspector<'_> {
        Inspector(self)
    }
}

impl<'a> Inspector<'a> {
    /// Returns the names of the systems that run in a step and in a frame, in the order of the built schedules.
    pub fn systems(&self) -> [Vec<String>; 2] {
        [&self.0.step, &self.0.frame].map(|s| {
            s.systems().map_or_else(
                |_| Vec::new(),
                |list| {
                    list.map(|(_, s)| s.name().to_string()).filter(|n| !is_sync_point(n)).map(|n| short(&n)).collect()
                },
            )
        })
    }

    /// Returns the names, as in [`Inspector::systems`], of the systems that read or write the component `T`.
    pub fn systems_that_query<T: Component>(&self) -> Vec<String> {
        let names = self.systems_by(|access, id| access.has_read(id), self.0.world.component_id::<T>());
        names.iter().map(|n| short(n)).collect()
    }

    /// Returns the names of the systems of other crates that write the component `T`.
    pub fn own_systems_that_write<T: Component>(&self) -> Vec<String> {
        let names = self.systems_by(|access, id| access.has_write(id), self.0.world.component_id::<T>());
        let own = names.iter().filter(|n| !is_own(n.trim_start_matches('<')) && !is_sync_point(n));
        own.map(|n| short(n)).collect()
    }

    /// Returns the full names of the systems with a given access to a component. Exclusive systems have every access.
    fn systems_by(&self, has: fn(&Access, ComponentId) -> bool, id: Option<ComponentId>) -> Vec<String> {
        let Some(id) = id else { return Vec::new() };
        let of = |s: &Schedule| -> Vec<String> {
            let has = |a: &SystemAccess| match a {
                SystemAccess::Shared(set) => has(set.combined_access(), id),
                SystemAccess::Exclusive => true,
                SystemAccess::None => false,
            };
            let Ok(list) = s.systems_with_access() else { return Vec::new() };
            list.filter(|(_, s)| has(s.access())).map(|(_, s)| s.system().name().to_string()).collect()
        };
        [of(&self.0.step), of(&self.0.frame)].concat()
    }

    /// Returns the names of all components on any entity, sorted: those that are really in memory.
    ///
    /// A component of this crate has its short name. A component of another crate is prefixed with the crate's name:
    /// `own_view::Rear`.
    pub fn components_in_use(&self) -> Vec<String> {
        let mut names: Vec<String> = self
            .0
            .world
            .archetypes()
            .iter()
            .filter(|a| !a.is_empty())
            .flat_map(|a| a.components().iter().copied())
            .filter_map(|id| self.0.world.components().get_name(id))
            .map(|n| component_name(&n.to_string()))
            // Drop the bookkeeping of every world.
            .filter(|n| {
                !["IsResource", "Schedules", "DefaultQueryFilters", "FallbackErrorHandler", "Observer", "ObservedBy"]
                    .map(|k| format!("bevy_ecs::{k}"))
                    .contains(n)
            })
            .collect();
        // This crate's components come first, then those of each other crate together.
        names.sort_by_key(|n| (n.contains("::"), n.clone()));
        names.dedup();
        names
    }

    /// Returns true if the systems of `name` were switched off after a panic.
    pub fn is_off(&self, name: &str) -> bool {
        self.0.ledger.as_ref().is_some_and(|l| l.is_off(name))
    }

    /// Returns the run times of plug-ins, and of guides, renderers, overlays and presenters of other crates.
    pub fn plugin_times(&self) -> Vec<PluginTime> {
        let mut times = self.0.ledger.as_ref().map_or_else(Vec::new, |l| l.times());
        let makers = self.0.makers.iter();
        times.extend(makers.map(|(name, ms)| PluginTime { name: name.clone(), step_ms: 0.0, frame_ms: *ms }));
        times
    }

    /// Returns the names of the plug-ins, in the order in which they were built.
    pub fn plugged(&self) -> &'a [String] {
        &self.0.plugged
    }

    /// Returns the name of the plug-in that has filled a slot, if it is of another crate.
    #[doc(hidden)]
    pub fn own_fill(&self, slot: Slot) -> Option<&'static str> {
        self.0.plugged_fill(slot)
    }

    /// Returns the parts that were left out.
    pub fn left_out(&self) -> &'a [LeftOut] {
        &self.0.left_out
    }
}

/// True for the system that carries out the commands of systems before it.
fn is_sync_point(name: &str) -> bool {
    name.ends_with("apply_deferred")
}

/// Returns the short name of a component, prefixed with its crate if that is another one.
fn component_name(name: &str) -> String {
    let path = name.split('<').next().unwrap_or(name);
    let krate = path.split("::").next().unwrap_or(path);
    let last = path.rsplit("::").next().unwrap_or(path);
    if is_own(path) { last.to_owned() } else { format!("{krate}::{last}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_of_other_crates_are_listed_with_the_crate() {
        assert_eq!(component_name("colvis_flight::components::camera::Pose"), "Pose");
        assert_eq!(component_name("colvis_view::rear::Rear"), "colvis_view::Rear");
        assert_eq!(component_name("own_view::rear::Rear<colvis::x::Y>"), "own_view::Rear");
    }
}
