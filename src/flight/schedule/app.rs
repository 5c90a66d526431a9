//! The world of a flight and its two schedules.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use bevy_ecs::error::FallbackErrorHandler;
use bevy_ecs::observer::IntoObserver;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::SystemWithAccess;
use bevy_ecs::schedule::{
    InternedSystemSet, LogLevel, ScheduleBuildSettings, ScheduleCleanupPolicy, ScheduleConfigs, ScheduleError,
    ScheduleLabel,
};
use bevy_ecs::system::{ScheduleSystem, SystemAccess};

use super::ledger::{self, Fault, Ledger};
use super::parts::Parts;
use super::{FlightSystems, Phase};
use crate::error::{Error, Result};
use crate::{output, panics};

/// A slot that exactly one plugin may fill.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Slot {
    /// The guide.
    Guide,
    /// The renderer.
    Renderer,
    /// The system that draws slices.
    Slices,
    /// The system that passes pictures to their presenters.
    Presentation,
    /// The system that measures coverage.
    Coverage,
    /// The system that paints the wall that was not seen.
    CoveragePaint,
    /// The system that paints coated spots of the wall.
    Coats,
    /// The system that colours the wall by what lies behind it.
    Translucency,
    /// The system that restores the size of pictures after post-processes.
    PictureSize,
}

/// An optional part that a scene does not have.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct LeftOut {
    /// The part.
    pub part: &'static str,
    /// Why it was left out.
    pub why: String,
}

#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
struct Step;

#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
struct Frame;

/// All systems of the scene, which are removed when the scene changes.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct OfScene;

/// The systems of one owner in the ledger.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Account(usize);

/// The post-process with this index, in the order of addition.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct PostProcess(u32);

/// Marks the scan that is flown through and the camera that flies.
///
/// The systems of a simulation step work only on these two, so entities of other crates may carry the same components
/// without disturbing the flight.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Main;

/// A world with a scan entity, a camera entity, and the systems that run on them.
///
/// ```
/// use bevy_ecs::prelude::*;
/// # use colvis_flight as colvis;
/// use colvis::schedule::{App, FlightSystems};
///
/// #[derive(Component)]
/// struct Steps(u32);
///
/// let mut app = App::new();
/// app.equip(Steps(0));
/// app.add_systems(FlightSystems::Log, |mut steps: Single<&mut Steps>| steps.0 += 1);
/// app.build()?;
/// app.step()?;
/// assert_eq!(app.camera_get::<Steps>().map(|s| s.0), Some(1));
/// # Ok::<(), colvis::error::Error>(())
/// ```
pub struct App {
    /// All entities and resources.
    pub world: World,
    scan: Entity,
    camera: Entity,
    pub(super) step: Schedule,
    pub(super) frame: Schedule,
    filled: Vec<Filled>,
    pub(super) left_out: Vec<LeftOut>,
    /// Functions that remove the current scene's equipment from the camera.
    strip: Vec<fn(&mut EntityWorldMut)>,
    /// The current scene's observers.
    observers: Vec<Entity>,
    /// The current owner of newly added systems and components.
    pub(super) owner: Owner,
    /// The account that newly added systems are booked to, if there is one.
    account: Option<usize>,
    /// Records which system runs and for how long; `None` if no account is kept.
    pub(super) ledger: Option<Arc<Ledger>>,
    post_processes: u32,
    pub(super) plugged: Vec<String>,
    /// The owner of each system, by the system's full name.
    owners: BTreeMap<String, usize>,
    /// Time that renderers, overlays and presenters of other crates take per frame, ms.
    pub(super) makers: BTreeMap<String, f64>,
    said: BTreeSet<(String, String)>,
    notes: Vec<String>,
    /// The owners whose systems may change entities: by commands, with the whole world, or from observers.
    changers: BTreeSet<usize>,
    /// The owners of observers.
    observing: BTreeSet<usize>,
    /// The camera before systems of other crates took it, or a part of it or of the scan.
    lost: Option<Entity>,
}

/// The owner of systems and components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Owner {
    /// The scene: they are removed when it changes.
    Scene,
    /// A plug-in, or the code that owns the flight: they stay.
    Plugin,
}

struct Filled {
    slot: Slot,
    name: &'static str,
    owner: Owner,
    /// True if a plug-in of another crate has filled it.
    is_plugged: bool,
}

impl Drop for App {
    /// Drops the world. A panic of what plug-ins have put into it is reported with their names, and goes no further.
    fn drop(&mut self) {
        let world = std::mem::take(&mut self.world);
        if let Err(why) = panics::catch(|| drop(world)) {
            let who =
                if self.plugged.is_empty() { "a component or resource".to_owned() } else { self.plugged.join(" or ") };
            output::to_stderr(format_args!("note: plug-in {who} panicked when it was dropped: {why}"));
        }
    }
}

impl Default for App {
    fn default() -> Self {
        Self::new()
    }
}

impl App {
    /// Creates a world with a bare scan, a bare camera, and schedules without systems.
    pub fn new() -> Self {
        ledger::discard();
        drop(ledger::at_home());
        let mut world = World::new();
        world.insert_resource(FallbackErrorHandler(ledger::system_failed));
        let [scan, camera] = [world.spawn(Main).id(), world.spawn(Main).id()];
        Self {
            world,
            scan,
            camera,
            step: schedule(Step, &FlightSystems::STEP),
            frame: schedule(Frame, &FlightSystems::FRAME),
            filled: Vec::new(),
            left_out: Vec::new(),
            strip: Vec::new(),
            observers: Vec::new(),
            owner: Owner::Plugin,
            account: None,
            ledger: None,
            post_processes: 0,
            plugged: Vec::new(),
            owners: BTreeMap::new(),
            makers: BTreeMap::new(),
            said: BTreeSet::new(),
            notes: Vec::new(),
            changers: BTreeSet::new(),
            observing: BTreeSet::new(),
            lost: None,
        }
    }

    /// Replaces the scene.
    ///
    /// Removes the systems and the [equipment](App::equip) of the previous scene, then calls `plug` to add those of the
    /// next one. Additions of plug-ins stay, with the state of their systems.
    ///
    /// # Errors
    /// Returns the error of `plug`, and status 1 if the schedules were left in a state that cannot be built.
    #[doc(hidden)]
    pub fn set_scene(&mut self, plug: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        for schedule in [&mut self.step, &mut self.frame] {
            remove_scene(schedule, &mut self.world)?;
        }
        self.filled.retain(|f| f.owner == Owner::Plugin);
        self.left_out.clear();
        let strip = std::mem::take(&mut self.strip);
        let mut camera = self.camera();
        strip.into_iter().for_each(|take_off| take_off(&mut camera));
        for observer in self.observers.drain(..) {
            self.world.despawn(observer);
        }
        self.owner = Owner::Scene;
        let plugged = plug(self);
        self.owner = Owner::Plugin;
        plugged
    }

    /// Starts to record the owner and the run time of each system added from now on.
    ///
    /// Use it for flights with plug-ins or guides of other crates. Without it, systems have no run conditions.
    #[doc(hidden)]
    pub fn keep_account(&mut self) {
        self.ledger.get_or_insert_default();
    }

    /// True while a scene is plugged in: its guide and its look.
    pub(crate) fn is_plugging_scene(&self) -> bool {
        self.owner == Owner::Scene
    }

    /// True if the owner of each system is recorded.
    #[doc(hidden)]
    pub fn keeps_account(&self) -> bool {
        self.ledger.is_some()
    }

    /// Books the systems that `add` adds to the account `name`. A panic in `add` becomes an error.
    ///
    /// # Errors
    /// Returns the error of `add`, and status 1 if it panics.
    #[doc(hidden)]
    pub fn on_account<R>(&mut self, name: &str, add: impl FnOnce(&mut Self) -> Result<R>) -> Result<R> {
        let before = std::mem::replace(&mut self.account, self.ledger.as_ref().map(|l| l.open(name)));
        let own = [self.scan, self.camera];
        let parts = Parts::of(&self.world, own);
        let added = panics::catch(|| add(self));
        self.account = before;
        let added = added.unwrap_or_else(|why| {
            Err(Error::fault(format!("plug-in {name}"), format!("panicked: {why}"), "fix it, or fly without it"))
        });
        match parts.taken(&self.world, own) {
            Some(what) => {
                self.spawn_lost();
                added.and(Err(taken(format!("plug-in {name}"), what)))
            }
            None => added,
        }
    }

    /// Takes the messages about plug-ins to show to the user since the last call.
    #[doc(hidden)]
    pub fn take_notes(&mut self) -> Vec<String> {
        self.collect_notes();
        std::mem::take(&mut self.notes)
    }

    fn collect_notes(&mut self) {
        for note in ledger::take_notes() {
            if self.said.insert(note.clone()) {
                self.notes.push(format!("{} {}", note.0, note.1));
            }
        }
    }

    /// Returns the scan entity: the volume and data derived from it. If it has been despawned, a bare one takes its place.
    pub fn scan(&mut self) -> EntityWorldMut<'_> {
        self.spawn_lost();
        self.world.entity_mut(self.scan)
    }

    /// Returns the camera entity: its pose, its motion and its view. If it has been despawned, a bare one takes its place.
    pub fn camera(&mut self) -> EntityWorldMut<'_> {
        self.spawn_lost();
        self.world.entity_mut(self.camera)
    }

    /// Spawns a scan and a camera in place of those that do not exist any more.
    fn spawn_lost(&mut self) {
        let Self { world, scan, camera, lost, .. } = self;
        let former = *camera;
        for entity in [scan, camera] {
            if world.get_entity(*entity).is_err() {
                *entity = world.spawn(Main).id();
                lost.get_or_insert(former);
            }
        }
    }

    /// Returns the camera as it was before systems of other crates took it, or a component of this crate from it or from the scan,
    /// since the last call.
    #[doc(hidden)]
    pub fn take_lost(&mut self) -> Option<Entity> {
        self.spawn_lost();
        self.lost.take()
    }

    /// Returns the ID of the scan entity.
    pub fn scan_id(&self) -> Entity {
        self.scan
    }

    /// Returns the ID of the camera entity.
    pub fn camera_id(&self) -> Entity {
        self.camera
    }

    /// Returns a component of the scan.
    pub fn scan_get<T: Component>(&self) -> Option<&T> {
        self.world.get(self.scan)
    }

    /// Returns a component of the camera.
    pub fn camera_get<T: Component>(&self) -> Option<&T> {
        self.world.get(self.camera)
    }

    /// Returns a mutable component of the camera.
    pub fn camera_get_mut<T: Component<Mutability = bevy_ecs::component::Mutable>>(&mut self) -> Option<Mut<'_, T>> {
        self.world.get_mut(self.camera)
    }

    /// Adds components to the camera.
    ///
    /// Components of a scene, for example those of its guide, are removed when the scene changes. Those of a plug-in stay.
    pub fn equip<B: Bundle>(&mut self, components: B) -> &mut Self {
        if self.owner == Owner::Scene {
            self.strip.push(|camera| {
                camera.remove::<B>();
            });
        }
        self.camera().insert(components);
        self
    }

    /// Adds an observer: a system that runs whenever its event is triggered.
    ///
    /// An event of a step is observed before the next [set](FlightSystems) begins. Observers of a scene are removed when the
    /// scene changes. Those of a plug-in stay.
    pub fn observe<M>(&mut self, observer: impl IntoObserver<M>) -> &mut Self {
        let mut observer = observer.into_observer();
        if let (Some(ledger), Some(owner)) = (&self.ledger, self.account) {
            let ledger = Arc::clone(ledger);
            observer = observer.run_if(move || ledger.begin_observer(owner));
            self.observing.insert(owner);
        }
        let observer = self.world.spawn(observer).id();
        if self.owner == Owner::Scene {
            self.observers.push(observer);
        }
        self
    }

    /// Adds systems to a set of the step or of the frame.
    ///
    /// Two systems in one set may not touch the same data unless one is ordered before the other. In
    /// [`PostProcess`](FlightSystems::PostProcess) they may: systems there run in the order in which they were added.
    pub fn add_systems<M>(
        &mut self,
        set: FlightSystems,
        systems: impl IntoScheduleConfigs<ScheduleSystem, M>,
    ) -> &mut Self {
        let mut systems = systems.into_configs();
        if set == FlightSystems::PostProcess {
            let n = self.post_processes;
            self.post_processes += 1;
            systems = systems.chain().in_set(PostProcess(n));
            for before in 0..n {
                systems = systems.after(PostProcess(before));
            }
        }
        self.add_systems_to(set.phase(), systems.in_set(set))
    }

    /// Adds systems that choose their place in a phase.
    ///
    /// Place them with `in_set`, in a custom set that [`configure_sets`](App::configure_sets) has ordered, or directly
    /// with `before` or `after` a [`FlightSystems`].
    pub fn add_systems_to<M>(
        &mut self,
        phase: Phase,
        systems: impl IntoScheduleConfigs<ScheduleSystem, M>,
    ) -> &mut Self {
        let mut systems: ScheduleConfigs<ScheduleSystem> = systems.into_configs();
        if self.owner == Owner::Scene {
            systems = systems.in_set(OfScene);
        }
        if let Some(ledger) = &self.ledger {
            let (ledger, account) = (Arc::clone(ledger), self.account);
            if let Some(owner) = account {
                systems = systems.in_set(Account(owner));
            }
            systems = systems.distributive_run_if(move || ledger.begin(account));
        }
        self.schedule_mut(phase).add_systems(systems);
        self
    }

    /// Orders custom sets within a phase, relative to each other and to [`FlightSystems`].
    ///
    /// ```
    /// use bevy_ecs::prelude::*;
    /// # use colvis_flight as colvis;
    /// use colvis::schedule::{App, FlightSystems, Phase};
    ///
    /// #[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
    /// struct Wind;
    ///
    /// let mut app = App::new();
    /// app.configure_sets(Phase::Step, Wind.after(FlightSystems::Force).before(FlightSystems::Sum));
    /// app.add_systems_to(Phase::Step, (|| println!("blows")).in_set(Wind));
    /// app.build()?;
    /// # Ok::<(), colvis::error::Error>(())
    /// ```
    pub fn configure_sets<M>(
        &mut self,
        phase: Phase,
        sets: impl IntoScheduleConfigs<InternedSystemSet, M>,
    ) -> &mut Self {
        self.schedule_mut(phase).configure_sets(sets);
        self
    }

    fn schedule_mut(&mut self, phase: Phase) -> &mut Schedule {
        match phase {
            Phase::Step => &mut self.step,
            Phase::Frame => &mut self.frame,
        }
    }

    /// Fills a slot for the plugin `name`.
    ///
    /// # Errors
    /// Returns status 2 if another plugin has filled it.
    pub fn fill(&mut self, slot: Slot, name: &'static str) -> Result<()> {
        if let Some(other) = self.filled.iter().find(|f| f.slot == slot) {
            return Err(Error::usage(
                format!("{slot:?}"),
                format!("both {} and {name} claim it", other.name),
                "name one of them in the scene",
            ));
        }
        self.filled.push(Filled { slot, name, owner: self.owner, is_plugged: self.account.is_some() });
        Ok(())
    }

    /// Returns true if there are post-processes.
    #[doc(hidden)]
    pub fn has_post_processes(&self) -> bool {
        self.post_processes > 0
    }

    /// Returns true if a slot is filled.
    #[doc(hidden)]
    pub fn is_filled(&self, slot: Slot) -> bool {
        self.filled.iter().any(|f| f.slot == slot)
    }

    /// Returns the name that a plug-in has filled a slot with.
    pub(super) fn plugged_fill(&self, slot: Slot) -> Option<&'static str> {
        self.filled.iter().find(|f| f.slot == slot && f.is_plugged).map(|f| f.name)
    }

    /// Records that a part was left out, for `explain`.
    #[doc(hidden)]
    pub fn leave_out(&mut self, part: &'static str, why: impl Into<String>) {
        self.left_out.push(LeftOut { part, why: why.into() });
    }

    /// Removes a part from the record of parts left out.
    #[doc(hidden)]
    pub fn take_in(&mut self, part: &str) {
        self.left_out.retain(|l| l.part != part);
    }

    /// Builds both schedules.
    ///
    /// # Errors
    /// Returns status 1 if two systems in one set touch the same data, or if their order is circular.
    pub fn build(&mut self) -> Result<()> {
        for schedule in [&mut self.step, &mut self.frame] {
            build(schedule, &mut self.world)?;
        }
        self.find_owners();
        Ok(())
    }

    /// Returns true if systems were added or removed since the schedules were [built](App::build).
    #[doc(hidden)]
    pub fn is_changed(&self) -> bool {
        self.step.is_changed() || self.frame.is_changed()
    }

    /// Runs one simulation step.
    ///
    /// # Errors
    /// Returns status 1 if a system has panicked, with the name of its plug-in. All other systems have run, and that
    /// plug-in is switched off.
    pub fn step(&mut self) -> Result<()> {
        self.run(Phase::Step)
    }

    /// Runs one frame.
    ///
    /// # Errors
    /// Returns status 1 as [`App::step`] does.
    pub fn frame(&mut self) -> Result<()> {
        self.run(Phase::Frame)
    }

    fn run(&mut self, phase: Phase) -> Result<()> {
        let Self { step, frame, world, ledger, scan, camera, .. } = self;
        let schedule = if phase == Phase::Step { step } else { frame };
        let own = [*scan, *camera];
        let parts = Parts::of(world, own);
        let _home = ledger::at_home();
        let ran = panics::catch(|| schedule.run(world));
        if let Some(ledger) = ledger {
            ledger.finish(phase);
        }
        if let Err(why) = ran {
            ledger::report_fault("a system", why);
        }
        for (name, ms) in ledger::take_times() {
            let usual = self.makers.entry(name).or_insert(ms);
            *usual += (ms - *usual) * 0.1;
        }
        self.collect_notes();
        let outcome = self.outcome();
        match parts.taken(&self.world, own) {
            Some(what) => outcome.and(Err(self.lost_error(what))),
            None => outcome,
        }
    }

    /// Returns the error that something was taken from the scan or the camera, and switches off the owners that may have done it.
    fn lost_error(&mut self, what: String) -> Error {
        self.lost.get_or_insert(self.camera);
        self.spawn_lost();
        let off = |&owner: &usize| self.ledger.as_ref()?.switch_off(owner).map(|(name, _)| name);
        let owners: Vec<String> = self.changers.union(&self.observing).filter_map(off).collect();
        let who = match &owners[..] {
            [] => "a system".to_owned(),
            [one] => format!("plug-in {one}"),
            some => format!("one of the plug-ins {}", some.join(", ")),
        };
        taken(who, what)
    }

    /// Reports faults since the last call, including those outside a schedule: see [`report_fault`](super::report_fault).
    ///
    /// # Errors
    /// Returns status 1 for the first fault that was caught.
    pub fn outcome(&mut self) -> Result<()> {
        let mut first = Ok(());
        for fault in ledger::take_faults() {
            let owner = self.owner_of(&fault.what);
            let what =
                if owner.is_none() && fault.observer.is_some() { "an observer".to_owned() } else { short(&fault.what) };
            let off = owner.or(fault.observer).and_then(|owner| self.ledger.as_ref()?.switch_off(owner));
            // For an owner already switched off, only run conditions are called, and their faults are known.
            if off.as_ref().is_some_and(|(_, was_on)| !was_on) {
                continue;
            }
            let error = ledger::fault_error(off.map(|o| o.0), &Fault { what, ..fault });
            match first {
                Ok(()) => first = Err(error),
                Err(_) => self.notes.push(format!("{}: {}", error.what, error.why)),
            }
        }
        first
    }

    /// Returns the owner of a system. A command has a separate name and belongs to the owner of the system that it is written in.
    fn owner_of(&self, name: &str) -> Option<usize> {
        let written_in =
            || self.owners.iter().find(|(system, _)| name.contains(system.as_str())).map(|(_, owner)| owner);
        self.owners.get(name).or_else(|| written_in().filter(|_| name.contains("handle_error"))).copied()
    }

    /// Records the owner of each system.
    fn find_owners(&mut self) {
        let Some(ledger) = &self.ledger else { return };
        self.owners.clear();
        self.changers.clear();
        for schedule in [&self.step, &self.frame] {
            let Ok(systems) = schedule.systems() else { continue };
            let named: Vec<_> = systems.map(|(key, system)| (key, system.name().to_string())).collect();
            for owner in 0..ledger.owners() {
                let Ok(own) = schedule.graph().systems_in_set(Account(owner).intern()) else { continue };
                let may_change =
                    |s: &SystemWithAccess| s.system().has_deferred() || matches!(s.access(), SystemAccess::Exclusive);
                let accesses = schedule.systems_with_access();
                if accesses.is_ok_and(|mut all| all.any(|(key, s)| own.contains(&key) && may_change(s))) {
                    self.changers.insert(owner);
                }
                let own = named.iter().filter(|(key, _)| own.contains(key));
                self.owners.extend(own.map(|(_, name)| (name.clone(), owner)));
            }
        }
    }
}

/// The error for `who`, which has taken something that a flight cannot do without.
fn taken(who: String, what: String) -> Error {
    Error::fault(who, what, "let it leave the scan and the camera as they are, or fly without it")
}

/// Creates a schedule whose sets run one after the other.
fn schedule(label: impl ScheduleLabel, sets: &[FlightSystems]) -> Schedule {
    let mut s = Schedule::new(label);
    s.set_build_settings(strict());
    s.configure_sets(OfScene);
    for two in sets.windows(2) {
        s.configure_sets(two[0].before(two[1]));
    }
    s
}

/// Builds a schedule. Fails with status 1 if the schedule is ambiguous or its order is circular.
fn build(schedule: &mut Schedule, world: &mut World) -> Result<()> {
    match schedule.initialize(world) {
        Ok(_) => Ok(()),
        Err(e) => {
            let text = e.to_string(schedule.graph(), world);
            let hint = "move one of the systems named here to another set, or order them: `a.before(b)`, `(a, b).chain()`, or \
                        App::configure_sets for a set of your own";
            Err(Error::fault("schedule", text, hint))
        }
    }
}

/// Removes the scene's systems from a schedule.
fn remove_scene(schedule: &mut Schedule, world: &mut World) -> Result<()> {
    if schedule.is_changed() {
        // The systems of a set are known only once the schedule is built. That includes an ambiguous schedule, left
        // behind by a change of scene that failed.
        schedule.set_build_settings(ScheduleBuildSettings { ambiguity_detection: LogLevel::Ignore, ..strict() });
        let built = build(schedule, world);
        schedule.set_build_settings(strict());
        built?;
    }
    match schedule.remove_systems_in_set(OfScene, world, ScheduleCleanupPolicy::RemoveSystemsOnlyAllowBreakages) {
        Ok(_) | Err(ScheduleError::SetNotFound) => Ok(()),
        Err(e) => Err(Error::fault("schedule", e.to_string(), "report it")),
    }
}

/// Returns the readable name of a system: its file and function, such as `watch::watch_flight`.
///
/// A generic system also has the bare name of its type argument. A system of another crate has its whole path, or the
/// name of the type if it was added as a closure by the type's `build`.
pub(super) fn short(name: &str) -> String {
    let name = &name.replace("::{{closure}}", "");
    if let Some((ty, rest)) = name.strip_prefix('<').and_then(|n| n.split_once('>')) {
        return format!("{}{rest}", ty.split(" as ").next().unwrap_or(ty));
    }
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
        app.step().unwrap();
        let n = app.world.query::<&Number>().single(&app.world).unwrap().0;
        assert_eq!(n, 4, "added first, doubled then");
        assert_eq!(app.inspect().systems()[0].len(), 2);
        assert!(app.inspect().components_in_use().contains(&"Number".to_owned()));
    }

    #[test]
    fn an_ambiguity_is_refused() {
        let mut app = App::new();
        app.add_systems(FlightSystems::Log, double).add_systems(FlightSystems::Log, add);
        let e = app.build().unwrap_err();
        assert!(e.to_string().contains("Number"), "{e}");
    }

    #[test]
    fn what_a_plugin_adds_outlives_the_scene_and_keeps_its_state() {
        let mut app = App::new();
        app.world.spawn(Number(0));
        let counts = |app: &mut App| {
            app.add_systems(FlightSystems::Trail, |mut runs: Local<i32>, mut q: Query<&mut Number>| {
                *runs += 1;
                q.iter_mut().for_each(|mut n| n.0 = *runs);
            });
            app.equip(Number(7));
            Ok(())
        };
        app.plug(&("counts", counts)).unwrap();
        assert!(app.plug(&("counts", counts)).is_err(), "a name is taken once");
        let mut names = Vec::new();
        for set in [FlightSystems::Log, FlightSystems::Input, FlightSystems::Log] {
            app.set_scene(|app| {
                app.add_systems(set, double);
                Ok(())
            })
            .unwrap();
            app.build().unwrap();
            app.step().unwrap();
            names.push(app.inspect().systems()[0].len());
        }
        let runs = app.world.query::<&Number>().iter(&app.world).map(|n| n.0).collect::<Vec<_>>();
        assert_eq!((names, runs), (vec![2, 2, 2], vec![6, 6]), "three runs, doubled after the last");
        assert_eq!(app.inspect().plugged(), ["counts"]);
        // A scene that cannot be built leaves the way back open.
        app.set_scene(|app| {
            app.add_systems(FlightSystems::Trail, double);
            Ok(())
        })
        .unwrap();
        let e = app.build().unwrap_err();
        assert!(e.to_string().contains("`a.before(b)`"), "{e}");
        app.set_scene(|app| {
            app.add_systems(FlightSystems::Log, double);
            Ok(())
        })
        .unwrap();
        app.build().unwrap();
        app.step().unwrap();
        assert_eq!(app.camera_get::<Number>().map(|n| n.0), Some(8));
    }

    #[derive(Event)]
    struct Reset;

    fn reset(_: On<Reset>, mut numbers: Query<&mut Number>) {
        numbers.iter_mut().for_each(|mut n| n.0 = 0);
    }

    #[test]
    fn an_event_is_observed_before_the_next_set_and_by_its_own_scene_only() {
        let mut app = App::new();
        app.world.spawn(Number(5));
        let number = |app: &mut App| app.world.query::<&Number>().single(&app.world).unwrap().0;
        for (observes, expected) in [(true, 1), (false, 3), (true, 1)] {
            app.set_scene(|app| {
                if observes {
                    app.observe(reset);
                }
                app.add_systems(
                    FlightSystems::Input,
                    (double, |mut commands: Commands| commands.trigger(Reset)).chain(),
                );
                app.add_systems(FlightSystems::Sense, add);
                Ok(())
            })
            .unwrap();
            app.build().unwrap();
            app.step().unwrap();
            assert_eq!(number(&mut app), expected, "{observes}");
        }
    }

    #[test]
    fn post_processes_run_in_the_order_they_were_added_in() {
        let mut app = App::new();
        app.add_systems(FlightSystems::PostProcess, add);
        app.add_systems(FlightSystems::PostProcess, (double, add));
        app.add_systems(FlightSystems::PostProcess, double);
        app.build().unwrap();
        app.world.spawn(Number(1));
        app.frame().unwrap();
        assert_eq!(app.world.query::<&Number>().single(&app.world).unwrap().0, 10, "((1 + 1) * 2 + 1) * 2");
    }

    #[test]
    fn a_set_of_ones_own_has_its_place() {
        #[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
        struct Between;
        let mut app = App::new();
        app.configure_sets(Phase::Step, Between.after(FlightSystems::Input).before(FlightSystems::Sense));
        app.add_systems(FlightSystems::Sense, double).add_systems(FlightSystems::Input, add);
        app.add_systems_to(
            Phase::Step,
            (|mut q: Query<&mut Number>| q.iter_mut().for_each(|mut n| n.0 -= 5)).in_set(Between),
        );
        app.build().unwrap();
        app.world.spawn(Number(1));
        app.step().unwrap();
        assert_eq!(app.world.query::<&Number>().single(&app.world).unwrap().0, -6, "(1 + 1 - 5) * 2");
    }

    #[test]
    fn a_slot_takes_one() {
        let mut app = App::new();
        app.fill(Slot::Renderer, "one").unwrap();
        assert!(app.fill(Slot::Renderer, "another").is_err() && app.fill(Slot::Guide, "manual").is_ok());
    }
}
