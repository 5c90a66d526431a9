//! Passes finished pictures to a presenter: the window's framebuffer or a recording.
//!
//! A window's surface must stay on its thread, but a flight is prepared on another one while the window already responds. So
//! presenters are set by the thread that runs frames ([`hand_to`], [`take`]), and those of plug-ins wait for it ([`plug`],
//! [`take_over`]).

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

/// The presenters of each view: any number, each of which gets every picture. A resource of the world that stays on its thread.
#[derive(Default)]
pub struct Presenters(Vec<Presented>);

/// A presenter with the view whose pictures it takes.
struct Presented {
    view: Entity,
    presenter: Box<dyn Presenter>,
    /// True for one of a plug-in.
    is_plugged: bool,
    /// True for one of a guide or a look, which goes with them.
    is_of_scene: bool,
}

impl Presented {
    /// True if it is a `P` for `view`.
    fn is<P: Presenter>(&self, view: Entity) -> bool {
        let any: &dyn Any = &*self.presenter;
        self.view == view && any.is::<P>()
    }
}

impl Presenters {
    /// Returns the place of the `P` of a view. That of the host comes before those of plug-ins.
    fn position<P: Presenter>(&self, view: Entity) -> Option<usize> {
        self.0.iter().position(|p| p.is::<P>(view))
    }

    fn get_mut<P: Presenter>(&mut self, view: Entity) -> Option<&mut P> {
        let at = self.position::<P>(view)?;
        let any: &mut dyn Any = &mut *self.0[at].presenter;
        any.downcast_mut()
    }

    fn take<P: Presenter>(&mut self, view: Entity) -> Option<P> {
        let at = self.position::<P>(view)?;
        let any: Box<dyn Any> = self.0.remove(at).presenter;
        any.downcast().ok().map(|p| *p)
    }

    /// Adds a presenter: presenters are ordered by view, and within a view those of the host come before those of plug-ins.
    fn add(&mut self, added: Presented) {
        self.0.push(added);
        self.0.sort_by_key(|p| (p.view.index_u32(), p.is_plugged));
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

/// Returns the presenter of a view that is a `P`, if there is one.
pub fn presenter<P: Presenter>(app: &mut App, view: Entity) -> Option<Mut<'_, P>> {
    let presenters = app.world.get_non_send_mut::<Presenters>()?;
    presenters.filter_map_unchanged(|p| p.get_mut(view))
}

/// Removes and returns the presenter of a view that is a `P`, if there is one.
pub fn take<P: Presenter>(app: &mut App, view: Entity) -> Option<P> {
    app.world.get_non_send_mut::<Presenters>()?.take(view)
}

/// Passes a view's picture to its presenters again, outside a frame: for a new overlay.
pub fn present_again(app: &mut App, view: Entity) {
    let Some(mut presenters) = app.world.remove_non_send::<Presenters>() else { return };
    if let Some(picture) = app.world.get::<Picture>(view) {
        presenters.0.retain_mut(|p| p.view != view || presents(&mut *p.presenter, picture));
    }
    app.world.insert_non_send(presenters);
}

/// Sets the presenter of a view's pictures that is a `P`, beside all others. A previous one of this type is replaced, unless it is
/// that of a plug-in.
///
/// A presenter stays on the thread that calls this function; plug-ins use [`plug`].
pub fn hand_to<P: Presenter>(app: &mut App, view: Entity, presenter: P) {
    let mut presenters = presenters(app);
    presenters.0.retain(|p| p.is_plugged || !p.is::<P>(view));
    presenters.add(Presented { view, presenter: Box::new(presenter), is_plugged: false, is_of_scene: false });
}

fn presenters(app: &mut App) -> Mut<'_, Presenters> {
    if !app.world.contains_non_send::<Presenters>() {
        app.world.insert_non_send(Presenters::default());
    }
    app.world.non_send_mut::<Presenters>()
}

/// Hands the presenters of a former camera on to the camera that has taken its place.
pub fn hand_on(app: &mut App, former: Entity) {
    let camera = app.camera_id();
    if let Some(mut presenters) = app.world.get_non_send_mut::<Presenters>() {
        presenters.0.iter_mut().filter(|p| p.view == former).for_each(|p| p.view = camera);
    }
    if let Some(mut waiting) = app.world.get_resource_mut::<Waiting>() {
        let waiting = waiting.0.get_mut().unwrap_or_else(PoisonError::into_inner);
        waiting.iter_mut().filter(|w| w.view == former).for_each(|w| w.view = camera);
    }
}

/// Removes the presenters of the guide and the look, before they are plugged in again or others take their place.
#[doc(hidden)]
pub fn forget_scene(app: &mut App) {
    if let Some(mut presenters) = app.world.get_non_send_mut::<Presenters>() {
        presenters.0.retain(|p| !p.is_of_scene);
    }
    if let Some(mut waiting) = app.world.get_resource_mut::<Waiting>() {
        waiting.0.get_mut().unwrap_or_else(PoisonError::into_inner).retain(|w| !w.is_of_scene);
    }
}

/// Presenters of plug-ins that wait for the thread that runs frames to take them over.
#[derive(Resource)]
pub struct Waiting(Mutex<Vec<WaitingPresenter>>);

struct WaitingPresenter {
    view: Entity,
    presenter: Box<dyn Presenter + Send>,
    is_of_scene: bool,
}

/// Adds a presenter to a view from within a plug-in, beside all others: it takes the pictures from none of them.
///
/// The presenter may be created on another thread than the one that runs frames, and moves there with the first frame.
pub fn plug(app: &mut App, view: Entity, presenter: impl Presenter + Send) {
    let is_of_scene = app.is_plugging_scene();
    let mut waiting = app.world.get_resource_or_insert_with(|| Waiting(Mutex::default()));
    let waiting = waiting.0.get_mut().unwrap_or_else(PoisonError::into_inner);
    waiting.push(WaitingPresenter { view, presenter: Box::new(presenter), is_of_scene });
}

/// Takes over the presenters that plug-ins have set. Call it on the thread that runs frames.
pub fn take_over(app: &mut App) {
    let Some(waiting) = app.world.remove_resource::<Waiting>() else { return };
    for waiting in waiting.0.into_inner().unwrap_or_else(PoisonError::into_inner) {
        let WaitingPresenter { view, presenter, is_of_scene } = waiting;
        presenters(app).add(Presented { view, presenter, is_plugged: true, is_of_scene });
    }
}

/// Passes each view's picture to its presenters, in the order of the entities.
pub fn present_pictures(
    presenters: Option<NonSendMut<Presenters>>,
    pictures: Query<&Picture>,
    slices: Query<(Entity, &SliceView)>,
) {
    let Some(mut presenters) = presenters else { return };
    for (entity, slice) in slices.iter().filter(|s| s.1.made) {
        presenters.0.retain_mut(|Presented { presenter, .. }| {
            let taken = panics::catch(|| presenter.beside(entity, &slice.frame));
            taken.inspect_err(|why| report_fault(format!("presenter {}", presenter.name()), why.as_str())).is_ok()
        });
    }
    presenters.0.retain_mut(|p| pictures.get(p.view).map_or(true, |picture| presents(&mut *p.presenter, picture)));
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use bevy_ecs::world::World;

    use super::*;
    use crate::components::slices::Orientation;
    use crate::testing::{Room, TestApp};

    type Shown = Arc<Mutex<Vec<(&'static str, bool, usize)>>>;

    /// Notes whether each picture was traced, and its width. Panics at pictures of width 13.
    struct Notes(&'static str, Shown);

    impl Presenter for Notes {
        fn name(&self) -> &'static str {
            self.0
        }

        fn present(&mut self, picture: &Picture) {
            assert_ne!(picture.frame.width(), 13, "unlucky");
            self.1.lock().unwrap().push((self.0, picture.traced, picture.frame.width()));
        }

        fn beside(&mut self, _: Entity, frame: &Frame) {
            assert_ne!(frame.width(), 13, "unlucky slice");
            self.1.lock().unwrap().push(("slice", true, frame.width()));
        }
    }

    struct Another;

    impl Presenter for Another {
        fn name(&self) -> &'static str {
            "another"
        }

        fn present(&mut self, _: &Picture) {}
    }

    /// A world in which pictures are presented, with the camera's and another one.
    fn test() -> (TestApp, [Entity; 2], Shown) {
        let mut test = TestApp::new(&Room::new([4; 3]));
        plugin(&mut test.app).unwrap();
        assert!(plugin(&mut test.app).is_err(), "pictures are passed on by one system");
        test.app.equip(Picture::new(8, 6));
        let other = test.app.world.spawn(Picture::new(10, 6)).id();
        let views = [test.app.camera_id(), other];
        (test, views, Shown::default())
    }

    fn taken(shown: &Shown) -> Vec<(&'static str, bool, usize)> {
        std::mem::take(&mut *shown.lock().unwrap())
    }

    #[test]
    fn every_presenter_gets_its_own_picture_in_every_frame() {
        let (mut test, [camera, other], shown) = test();
        test.frame().unwrap();
        hand_to(&mut test.app, other, Notes("late", shown.clone()));
        hand_to(&mut test.app, camera, Notes("first", shown.clone()));
        test.get_mut::<Picture>().traced = true;
        test.frame().unwrap();
        assert_eq!(taken(&shown), [("first", true, 8), ("late", false, 10)], "in the order of the entities");
        test.get_mut::<Picture>().traced = false;
        test.frame().unwrap();
        assert_eq!(taken(&shown), [("first", false, 8), ("late", false, 10)], "even if nothing was traced");
        // Another one for the same view takes the place of the first.
        hand_to(&mut test.app, camera, Notes("second", shown.clone()));
        test.frame().unwrap();
        assert_eq!(taken(&shown), [("second", false, 8), ("late", false, 10)]);
        // A view whose entity has no picture for a while is presented again when it has.
        test.app.world.entity_mut(other).remove::<Picture>();
        test.frame().unwrap();
        test.app.world.entity_mut(other).insert(Picture::new(11, 6));
        test.frame().unwrap();
        assert_eq!(taken(&shown), [("second", false, 8), ("second", false, 8), ("late", false, 11)]);
    }

    #[test]
    fn a_picture_is_presented_again_without_a_frame() {
        let (mut test, [camera, other], shown) = test();
        present_again(&mut test.app, camera);
        for view in [camera, other] {
            hand_to(&mut test.app, view, Notes("notes", shown.clone()));
        }
        present_again(&mut test.app, other);
        assert_eq!(taken(&shown), [("notes", false, 10)], "and only that of the view");
        assert!(test.get::<Picture>().due, "nothing was traced");
        test.frame().unwrap();
        assert_eq!(taken(&shown).len(), 2, "all are still there");
    }

    #[test]
    fn one_that_panics_is_named_and_dropped_and_the_others_go_on() {
        let (mut test, [camera, other], shown) = test();
        hand_to(&mut test.app, camera, Notes("poor", shown.clone()));
        hand_to(&mut test.app, other, Notes("fine", shown.clone()));
        test.get_mut::<Picture>().frame.resize(13, 6);
        let e = test.frame().unwrap_err();
        assert!(e.what == "presenter poor" && e.why.contains("unlucky"), "{e}");
        assert_eq!(taken(&shown), [("fine", false, 10)]);
        test.get_mut::<Picture>().frame.resize(8, 6);
        test.frame().unwrap();
        assert_eq!(taken(&shown), [("fine", false, 10)], "it is not asked again");
        // Outside a frame it is the same.
        test.app.world.get_mut::<Picture>(other).unwrap().frame.resize(13, 6);
        present_again(&mut test.app, other);
        assert!(test.app.outcome().unwrap_err().what.contains("presenter fine"));
        present_again(&mut test.app, other);
        test.app.outcome().unwrap();
    }

    #[test]
    fn a_slice_that_was_drawn_goes_to_every_presenter_before_the_pictures() {
        let (mut test, [camera, other], shown) = test();
        hand_to(&mut test.app, camera, Notes("notes", shown.clone()));
        hand_to(&mut test.app, other, Another);
        let slice = test.app.world.spawn(SliceView::new(Orientation::Axial, [5, 5])).id();
        let drawn = |world: &mut World, made: bool, width: usize| {
            let mut s = world.get_mut::<SliceView>(slice).unwrap();
            s.made = made;
            s.frame.resize(width, 5);
        };
        for (made, expected) in
            [(true, vec![("slice", true, 5), ("notes", false, 8)]), (false, vec![("notes", false, 8)])]
        {
            drawn(&mut test.app.world, made, 5);
            test.frame().unwrap();
            assert_eq!(taken(&shown), expected);
        }
        drawn(&mut test.app.world, true, 13);
        let e = test.frame().unwrap_err();
        assert!(e.what == "presenter notes" && e.why.contains("unlucky slice"), "{e}");
        assert!(taken(&shown).is_empty(), "it does not get the picture either");
        assert!(presenter::<Another>(&mut test.app, other).is_some(), "the other one is still there");
    }

    #[test]
    fn presenters_are_found_and_taken_by_their_view_and_type() {
        let (mut test, [camera, other], shown) = test();
        assert!(take::<Notes>(&mut test.app, camera).is_none());
        hand_to(&mut test.app, camera, Notes("notes", shown.clone()));
        hand_to(&mut test.app, other, Another);
        assert_eq!(presenter::<Notes>(&mut test.app, camera).unwrap().0, "notes");
        assert!(
            presenter::<Another>(&mut test.app, camera).is_none() && presenter::<Notes>(&mut test.app, other).is_none()
        );
        assert!(take::<Another>(&mut test.app, camera).is_none(), "it is of another type, and stays");
        assert_eq!(take::<Notes>(&mut test.app, camera).unwrap().0, "notes");
        assert!(take::<Notes>(&mut test.app, camera).is_none() && take::<Another>(&mut test.app, other).is_some());
        // One of a plug-in waits until it is taken over, and takes the pictures from no other, not even from one of its type.
        hand_to(&mut test.app, camera, Notes("host's", shown.clone()));
        plug(&mut test.app, camera, Notes("waits", shown.clone()));
        plug(&mut test.app, camera, Notes("waits, too", shown.clone()));
        test.frame().unwrap();
        assert_eq!(taken(&shown), [("host's", false, 8)]);
        take_over(&mut test.app);
        take_over(&mut test.app);
        hand_to(&mut test.app, camera, Another);
        hand_to(&mut test.app, camera, Notes("host's again", shown.clone()));
        test.frame().unwrap();
        assert_eq!(taken(&shown), [("host's again", false, 8), ("waits", false, 8), ("waits, too", false, 8)]);
        present_again(&mut test.app, camera);
        assert_eq!(taken(&shown).len(), 3);
        assert_eq!(take::<Notes>(&mut test.app, camera).unwrap().0, "host's again");
        assert!(take::<Another>(&mut test.app, camera).is_some());
    }
}
