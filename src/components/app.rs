//! The world, its two schedules, and the one order of everything that is scheduled.

use bevy_ecs::prelude::*;
use bevy_ecs::schedule::{LogLevel, ScheduleBuildSettings, ScheduleConfigs, ScheduleLabel};
use bevy_ecs::system::ScheduleSystem;

use crate::error::{Error, Result};

/// The order of a flight's systems; the only one there is.
///
/// `Input` to `Log` run in each simulation step, `RayCast` in each frame. Two systems of one set must not
/// touch the same data in a way that depends on their order: such a schedule is refused.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FlightSystems {
    /// The operator's hand: thrust, look, pause.
    Input,
    /// Feeling the surroundings: tentacles.
    Sense,
    /// The guide decides on the way. A socket: exactly one navigation method is plugged in.
    Guide,
    /// Every force that acts besides the guide's; mines are laid before they push.
    Force,
    /// The equation of motion, the step that cannot perforate, and the turn of the view.
    Integrate,
    /// What follows from the new place: arrival, trouble.
    Watch,
    /// Writing down the step.
    Log,
    /// Tracing the image. A socket: one renderer.
    RayCast,
}

impl FlightSystems {
    /// The sets of a simulation step, in order.
    pub const STEP: [Self; 7] =
        [Self::Input, Self::Sense, Self::Guide, Self::Force, Self::Integrate, Self::Watch, Self::Log];
    /// The sets of a frame, in order.
    pub const FRAME: [Self; 1] = [Self::RayCast];
}

/// A place that exactly one plugin may fill.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// Who steers.
    Guide,
    /// Who renders.
    Renderer,
}

/// Something that a scene could have and does not.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct LeftOut {
    /// The part.
    pub part: &'static str,
    /// Why it is not there.
    pub why: String,
}

#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
struct Step;

#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
struct Frame;

/// A world with the systems that run on it. Plugins are functions `fn(&mut App) -> Result<()>`.
pub struct App {
    /// All entities and resources.
    pub world: World,
    step: Schedule,
    frame: Schedule,
    filled: Vec<(Slot, &'static str)>,
    left_out: Vec<LeftOut>,
}

/// A part of a scene: adds components and systems to the application.
pub type Plugin = fn(&mut App) -> Result<()>;

impl Default for App {
    fn default() -> Self {
        Self::new()
    }
}

impl App {
    /// A world without entities and schedules without systems.
    pub fn new() -> Self {
        Self { world: World::new(), step: step(), frame: frame(), filled: Vec::new(), left_out: Vec::new() }
    }

    /// Forgets every system, keeping the world: the next plugins start from an empty schedule.
    pub fn clear_systems(&mut self) {
        self.step = step();
        self.frame = frame();
        self.filled.clear();
        self.left_out.clear();
    }

    /// Adds a plugin.
    ///
    /// # Errors
    /// What the plugin refuses.
    pub fn add(&mut self, plugin: Plugin) -> Result<&mut Self> {
        plugin(self)?;
        Ok(self)
    }

    /// Adds systems to a set of the step or of the frame.
    pub fn add_systems<M>(
        &mut self,
        set: FlightSystems,
        systems: impl IntoScheduleConfigs<ScheduleSystem, M>,
    ) -> &mut Self {
        let systems: ScheduleConfigs<ScheduleSystem> = systems.in_set(set);
        if FlightSystems::FRAME.contains(&set) {
            self.frame.add_systems(systems);
        } else {
            self.step.add_systems(systems);
        }
        self
    }

    /// Takes a slot for the plugin `name`.
    ///
    /// # Errors
    /// Status 2 when another plugin has it.
    pub fn fill(&mut self, slot: Slot, name: &'static str) -> Result<()> {
        if let Some((_, other)) = self.filled.iter().find(|(s, _)| *s == slot) {
            return Err(Error::usage(
                format!("{slot:?}"),
                format!("both {other} and {name} want to be it"),
                "name one of them in the scene",
            ));
        }
        self.filled.push((slot, name));
        Ok(())
    }

    /// Notes that a part is not there, for `explain`.
    pub fn leave_out(&mut self, part: &'static str, why: impl Into<String>) {
        self.left_out.push(LeftOut { part, why: why.into() });
    }

    /// What was left out.
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    /// Builds both schedules.
    ///
    /// # Errors
    /// Status 1 when two systems of one set touch the same data: a fault of the plugins.
    pub fn build(&mut self) -> Result<()> {
        for schedule in [&mut self.step, &mut self.frame] {
            schedule.initialize(&mut self.world).map_err(|e| {
                let text = e.to_string(schedule.graph(), &self.world);
                Error::fault("schedule", text, "give the systems that are named an order by putting them in sets")
            })?;
        }
        Ok(())
    }

    /// One simulation step.
    pub fn step(&mut self) {
        self.step.run(&mut self.world);
    }

    /// One frame.
    pub fn frame(&mut self) {
        self.frame.run(&mut self.world);
    }

    /// Names of the systems that run in a step and in a frame, in order, as the built schedules hold them.
    pub fn systems(&self) -> [Vec<String>; 2] {
        [&self.step, &self.frame].map(|s| {
            s.systems().map_or_else(
                |_| Vec::new(),
                |list| {
                    list.map(|(_, s)| s.name().to_string())
                        .filter(|n| !n.contains("ApplyDeferred"))
                        .map(|n| n.rsplit_once("systems::").map_or(n.clone(), |(_, short)| short.to_owned()))
                        .collect()
                },
            )
        })
    }

    /// Type names of all components on any entity, short and sorted: what is really in memory.
    pub fn components_in_use(&self) -> Vec<String> {
        let mut names: Vec<String> = self
            .world
            .archetypes()
            .iter()
            .filter(|a| !a.is_empty())
            .flat_map(|a| a.components().iter().copied())
            .filter_map(|id| self.world.components().get_name(id))
            .map(|n| n.to_string())
            .filter(|n| n.starts_with("colvis"))
            .map(|n| n.rsplit("::").next().unwrap_or(&n).to_owned())
            .collect();
        names.sort();
        names.dedup();
        names
    }
}

fn step() -> Schedule {
    let mut s = Schedule::new(Step);
    let [a, b, c, d, e, f, g] = FlightSystems::STEP;
    s.set_build_settings(strict()).configure_sets((a, b, c, d, e, f, g).chain());
    s
}

fn frame() -> Schedule {
    let mut s = Schedule::new(Frame);
    let [a] = FlightSystems::FRAME;
    s.set_build_settings(strict()).configure_sets(a);
    s
}

fn strict() -> ScheduleBuildSettings {
    ScheduleBuildSettings {
        ambiguity_detection: LogLevel::Error,
        hierarchy_detection: LogLevel::Error,
        ..Default::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Component, Default)]
    struct Number(i32);

    fn add(mut q: Query<&mut Number>) {
        for mut n in &mut q {
            n.0 += 1;
        }
    }

    fn double(mut q: Query<&mut Number>) {
        for mut n in &mut q {
            n.0 *= 2;
        }
    }

    #[test]
    fn sets_are_the_order() {
        let mut app = App::new();
        app.add_systems(FlightSystems::Log, double).add_systems(FlightSystems::Input, add);
        app.build().unwrap();
        app.world.spawn(Number(1));
        app.step();
        let n = app.world.query::<&Number>().single(&app.world).unwrap().0;
        assert_eq!(n, 4, "added first, doubled then");
        assert_eq!(app.systems()[0].len(), 2);
        assert!(app.components_in_use().contains(&"Number".to_owned()));
    }

    #[test]
    fn an_ambiguity_is_refused() {
        let mut app = App::new();
        app.add_systems(FlightSystems::Log, double).add_systems(FlightSystems::Log, add);
        let e = app.build().unwrap_err();
        assert!(e.to_string().contains("Number"), "{e}");
    }

    #[test]
    fn a_slot_takes_one() {
        let mut app = App::new();
        app.fill(Slot::Guide, "tentacles").unwrap();
        assert!(app.fill(Slot::Guide, "manual").is_err());
    }
}
