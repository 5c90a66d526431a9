//! Passes finished pictures to a presenter: the window's framebuffer or a recording.

use std::any::Any;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use bevy_ecs::prelude::*;

use crate::components::output::Picture;
use crate::components::slices::SliceView;
use crate::error::Result;
use crate::panics;
use crate::render::Frame;
use crate::schedule::{App, FlightSystems, Slot, book_time, report_fault};

/// A destination for a view's pictures. It stays on its thread.
pub trait Presenter: Any {
    /// Returns the name used in messages.
    fn name(&self) -> &'static str;

    /// Takes the current picture.
    ///
    /// Called every frame, even when nothing new was traced. `picture.traced` is then false, and it is also false if only
    /// an overlay has changed. A presenter need not show a picture again that it has already shown.
    fn present(&mut self, picture: &Picture);

    /// Takes a slice to show beside the following pictures, whenever it has changed.
    ///
    /// Does nothing by default, for presenters that show no slices.
    fn beside(&mut self, slice: Entity, frame: &Frame) {
        let _ = (slice, frame);
    }
}

/// The presenters, with the entities whose pictures they take. A resource of the world that stays on its thread.
#[derive(Default)]
pub struct Presenters(Vec<(Entity, Box<dyn Presenter>)>);

impl Presenters {
    fn get_mut<P: Presenter>(&mut self, view: Entity) -> Option<&mut P> {
        let (_, presenter) = self.0.iter_mut().find(|(e, _)| *e == view)?;
        let any: &mut dyn Any = &mut **presenter;
        any.downcast_mut()
    }

    fn take<P: Presenter>(&mut self, view: Entity) -> Option<P> {
        self.get_mut::<P>(view)?;
        let at = self.0.iter().position(|(e, _)| *e == view)?;
        let any: Box<dyn Any> = self.0.remove(at).1;
        any.downcast().ok().map(|p| *p)
    }
}

/// Adds the system that passes pictures to presenters.
///
/// # Errors
/// Returns status 2 if another plugin has already added such a system.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Presentation, "presenters")?;
    app.add_systems(FlightSystems::Present, present_pictures);
    Ok(())
}

/// Returns the presenter of a view, if it is a `P`.
pub fn presenter<P: Presenter>(app: &mut App, view: Entity) -> Option<Mut<'_, P>> {
    let presenters = app.world.get_non_send_mut::<Presenters>()?;
    presenters.filter_map_unchanged(|p| p.get_mut(view))
}

/// Removes and returns the presenter of a view, if it is a `P`.
pub fn take<P: Presenter>(app: &mut App, view: Entity) -> Option<P> {
    app.world.get_non_send_mut::<Presenters>()?.take(view)
}

/// Passes a view's picture to its presenter again, outside a frame: for a new overlay.
pub fn present_again(app: &mut App, view: Entity) {
    let Some(mut presenters) = app.world.remove_non_send::<Presenters>() else { return };
    if let Some(picture) = app.world.get::<Picture>(view) {
        presenters.0.retain_mut(|(e, presenter)| *e != view || presents(&mut **presenter, picture));
    }
    app.world.insert_non_send(presenters);
}

/// Sets the presenter of a view's pictures, replacing any previous one.
///
/// A presenter stays on the thread that calls this function; plug-ins use [`plug`].
pub fn hand_to(app: &mut App, view: Entity, presenter: impl Presenter) {
    hand_over(app, view, Box::new(presenter));
}

fn hand_over(app: &mut App, view: Entity, presenter: Box<dyn Presenter>) {
    if !app.world.contains_non_send::<Presenters>() {
        app.world.insert_non_send(Presenters::default());
    }
    let mut presenters = app.world.non_send_mut::<Presenters>();
    presenters.0.retain(|(e, _)| *e != view);
    presenters.0.push((view, presenter));
    presenters.0.sort_by_key(|(e, _)| e.index_u32());
}

/// Presenters of plug-ins that wait for the thread that runs frames to take them over.
#[derive(Resource)]
pub struct Waiting(Mutex<Vec<(Entity, Box<dyn Presenter + Send>)>>);

/// Sets the presenter of a view from within a plug-in.
///
/// The presenter may be created on another thread than the one that runs frames, and moves there with the first frame.
pub fn plug(app: &mut App, view: Entity, presenter: impl Presenter + Send) {
    let mut waiting = app.world.get_resource_or_insert_with(|| Waiting(Mutex::default()));
    waiting.0.get_mut().unwrap_or_else(PoisonError::into_inner).push((view, Box::new(presenter)));
}

/// Takes over the presenters that plug-ins have set. Call it on the thread that runs frames.
pub fn take_over(app: &mut App) {
    let Some(waiting) = app.world.remove_resource::<Waiting>() else { return };
    for (view, presenter) in waiting.0.into_inner().unwrap_or_else(PoisonError::into_inner) {
        hand_over(app, view, presenter);
    }
}

/// Passes each view's picture to its presenter, in the order of the entities.
pub fn present_pictures(
    presenters: Option<NonSendMut<Presenters>>,
    pictures: Query<&Picture>,
    slices: Query<(Entity, &SliceView)>,
) {
    let Some(mut presenters) = presenters else { return };
    for (entity, slice) in slices.iter().filter(|s| s.1.made) {
        presenters.0.retain_mut(|(_, presenter)| {
            let taken = panics::catch(|| presenter.beside(entity, &slice.frame));
            taken.inspect_err(|why| report_fault(format!("presenter {}", presenter.name()), why.as_str())).is_ok()
        });
    }
    presenters.0.retain_mut(|(view, presenter)| pictures.get(*view).map_or(true, |p| presents(&mut **presenter, p)));
}

/// Passes a picture to a presenter. Returns false if the presenter panicked; it is then not called again.
fn presents(presenter: &mut dyn Presenter, picture: &Picture) -> bool {
    let begun = Instant::now();
    let presented = panics::catch(|| presenter.present(picture));
    // The presenters of this crate are measured elsewhere.
    if !["window", "recording"].contains(&presenter.name()) {
        book_time(format!("presenter {}", presenter.name()), begun.elapsed().as_secs_f64() * 1e3);
    }
    presented.inspect_err(|why| report_fault(format!("presenter {}", presenter.name()), why.as_str())).is_ok()
}
