//! The world of a flight and its two schedules.

use bevy_ecs::prelude::*;
use bevy_ecs::schedule::{LogLevel, ScheduleBuildSettings, ScheduleConfigs, ScheduleLabel};
use bevy_ecs::system::{ScheduleSystem, SystemAccess};

use super::FlightSystems;
use crate::error::{Error, Result};

/// A place that exactly one plugin may fill.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// Who steers.
    Guide,
    /// Who renders.
    Renderer,
    /// Who shows or records what was rendered.
    Presenter,
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

/// A world with a scan entity, a camera entity, and the systems that run on them.
///
/// ```
/// use bevy_ecs::prelude::*;
/// use colvis::schedule::{App, FlightSystems};
///
/// #[derive(Component)]
/// struct Steps(u32);
///
/// let mut app = App::new();
/// app.equip(Steps(0));
/// app.add_systems(FlightSystems::Log, |mut steps: Single<&mut Steps>| steps.0 += 1);
/// app.build()?;
/// app.step();
/// assert_eq!(app.camera_get::<Steps>().map(|s| s.0), Some(1));
/// # Ok::<(), colvis::error::Error>(())
/// ```
pub struct App {
    /// All entities and resources.
    pub world: World,
    scan: Entity,
    camera: Entity,
    step: Schedule,
    frame: Schedule,
    filled: Vec<(Slot, &'static str)>,
    left_out: Vec<LeftOut>,
    /// What takes the present scene's equipment off the camera again.
    strip: Vec<fn(&mut EntityWorldMut)>,
}

/// A part of a scene without settings: adds components and systems to the application.
pub type Plugin = fn(&mut App) -> Result<()>;

impl Default for App {
    fn default() -> Self {
        Self::new()
    }
}

impl App {
    /// A world with a bare scan and a bare camera, and schedules without systems.
    pub fn new() -> Self {
        let mut world = World::new();
        let [scan, camera] = [world.spawn_empty().id(), world.spawn_empty().id()];
        Self {
            world,
            scan,
            camera,
            step: step(),
            frame: frame(),
            filled: Vec::new(),
            left_out: Vec::new(),
            strip: Vec::new(),
        }
    }

    /// Forgets every system and takes [equipment](App::equip) off the camera; what else the world holds stays. The next
    /// plugins start from empty schedules.
    pub fn clear(&mut self) {
        self.step = step();
        self.frame = frame();
        self.filled.clear();
        self.left_out.clear();
        let strip = std::mem::take(&mut self.strip);
        let mut camera = self.camera();
        strip.into_iter().for_each(|take_off| take_off(&mut camera));
    }

    /// The scan entity: the volume and what was derived from it.
    pub fn scan(&mut self) -> EntityWorldMut<'_> {
        self.world.entity_mut(self.scan)
    }

    /// The camera entity: where it is, what moves it, what it sees.
    pub fn camera(&mut self) -> EntityWorldMut<'_> {
        self.world.entity_mut(self.camera)
    }

    /// A component of the scan.
    pub fn scan_get<T: Component>(&self) -> Option<&T> {
        self.world.get(self.scan)
    }

    /// A component of the camera.
    pub fn camera_get<T: Component>(&self) -> Option<&T> {
        self.world.get(self.camera)
    }

    /// A component of the camera, to change it.
    pub fn camera_get_mut<T: Component<Mutability = bevy_ecs::component::Mutable>>(&mut self) -> Option<Mut<'_, T>> {
        self.world.get_mut(self.camera)
    }

    /// Gives the camera components for as long as the scene stays as it is: a change of the guide takes them off again.
    pub fn equip<B: Bundle>(&mut self, components: B) -> &mut Self {
        self.strip.push(|camera| {
            camera.remove::<B>();
        });
        self.camera().insert(components);
        self
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
                        .map(|n| short(&n))
                        .collect()
                },
            )
        })
    }

    /// Names of the systems, as [`App::systems`] has them, that read or write the component `T`.
    pub fn systems_that_query<T: Component>(&self) -> Vec<String> {
        let Some(id) = self.world.component_id::<T>() else { return Vec::new() };
        let of = |s: &Schedule| -> Vec<String> {
            let queries = |a: &SystemAccess| match a {
                SystemAccess::Shared(set) => set.combined_access().has_read(id),
                SystemAccess::Exclusive => true,
                SystemAccess::None => false,
            };
            s.systems_with_access().map_or_else(
                |_| Vec::new(),
                |list| {
                    let list = list.filter(|(_, s)| queries(s.access()));
                    list.map(|(_, s)| short(&s.system().name().to_string())).collect()
                },
            )
        };
        [of(&self.step), of(&self.frame)].concat()
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
    s.set_build_settings(strict());
    chain(&mut s, &FlightSystems::STEP);
    s
}

fn frame() -> Schedule {
    let mut s = Schedule::new(Frame);
    s.set_build_settings(strict());
    chain(&mut s, &FlightSystems::FRAME);
    s
}

/// Each set before the next.
fn chain(schedule: &mut Schedule, sets: &[FlightSystems]) {
    for two in sets.windows(2) {
        schedule.configure_sets(two[0].before(two[1]));
    }
}

/// A system's name as a person reads it: its file and function, `watch::watch_flight`; of a generic one also the bare name of
/// what it is for.
fn short(name: &str) -> String {
    let (path, of) = name.split_once('<').unwrap_or((name, ""));
    let path = path.rsplit_once("systems::").map_or(path, |(_, short)| short);
    match of.trim_end_matches('>').rsplit("::").next() {
        None | Some("") => path.to_owned(),
        Some(of) => format!("{path}<{of}>"),
    }
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
        app.fill(Slot::Renderer, "one").unwrap();
        assert!(app.fill(Slot::Renderer, "another").is_err() && app.fill(Slot::Guide, "manual").is_ok());
    }
}
