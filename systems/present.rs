//! Hands finished pictures to what shows or keeps them: the window's framebuffer, a recording.

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

/// A place that a view's pictures go to. It stays on its thread.
pub trait Presenter: Any {
    /// Its name, for messages.
    fn name(&self) -> &'static str;

    /// Takes the picture as it is now. Called in each frame, also when nothing new was traced (`picture.traced` is false
    /// then, and so it is where something over the picture has changed): what it has shown already it need not show again.
    fn present(&mut self, picture: &Picture);

    /// Takes a slice that is to be shown beside the pictures to come, whenever it has changed. A presenter that shows none does nothing.
    fn beside(&mut self, slice: Entity, frame: &Frame) {
        let _ = (slice, frame);
    }
}

/// The presenters, by the entities whose pictures they take: a resource of the world that stays on its thread.
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

/// Adds the system that hands pictures on.
///
/// # Errors
/// Status 2 when there is another one.
pub fn plugin(app: &mut App) -> Result<()> {
    app.fill(Slot::Presentation, "presenters")?;
    app.add_systems(FlightSystems::Present, present_pictures);
    Ok(())
}

/// The presenter of a view, if it is a `P`.
pub fn presenter<P: Presenter>(app: &mut App, view: Entity) -> Option<Mut<'_, P>> {
    let presenters = app.world.get_non_send_mut::<Presenters>()?;
    presenters.filter_map_unchanged(|p| p.get_mut(view))
}

/// Takes the presenter of a view away, if it is a `P`.
pub fn take<P: Presenter>(app: &mut App, view: Entity) -> Option<P> {
    app.world.get_non_send_mut::<Presenters>()?.take(view)
}

/// Hands a view's picture to its presenter again, outside a frame: for something new that lies over it.
pub fn present_again(app: &mut App, view: Entity) {
    let Some(mut presenters) = app.world.remove_non_send::<Presenters>() else { return };
    if let Some(picture) = app.world.get::<Picture>(view) {
        presenters.0.retain_mut(|(e, presenter)| *e != view || presents(&mut **presenter, picture));
    }
    app.world.insert_non_send(presenters);
}

/// Gives a view the presenter that its pictures go to from now on, in the place of another one.
///
/// A presenter stays on the thread that calls this; a plug-in uses [`plug`].
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

/// Presenters of plug-ins, until the thread that runs frames takes them over.
#[derive(Resource)]
pub struct Waiting(Mutex<Vec<(Entity, Box<dyn Presenter + Send>)>>);

/// Gives a view a presenter from within a plug-in: it may be built on another thread than the one that runs frames, and goes there
/// with the first of them.
pub fn plug(app: &mut App, view: Entity, presenter: impl Presenter + Send) {
    let mut waiting = app.world.get_resource_or_insert_with(|| Waiting(Mutex::default()));
    waiting.0.get_mut().unwrap_or_else(PoisonError::into_inner).push((view, Box::new(presenter)));
}

/// Takes over the presenters that plug-ins have given: on the thread that runs frames.
pub fn take_over(app: &mut App) {
    let Some(waiting) = app.world.remove_resource::<Waiting>() else { return };
    for (view, presenter) in waiting.0.into_inner().unwrap_or_else(PoisonError::into_inner) {
        hand_over(app, view, presenter);
    }
}

/// Hands each view's picture to its presenter, in the order of the entities.
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

/// Hands a picture to a presenter; whether it did not panic. One that has is not asked again.
fn presents(presenter: &mut dyn Presenter, picture: &Picture) -> bool {
    let begun = Instant::now();
    let presented = panics::catch(|| presenter.present(picture));
    // This crate's own are told in other figures.
    if !["window", "recording"].contains(&presenter.name()) {
        book_time(format!("presenter {}", presenter.name()), begun.elapsed().as_secs_f64() * 1e3);
    }
    presented.inspect_err(|why| report_fault(format!("presenter {}", presenter.name()), why.as_str())).is_ok()
}
