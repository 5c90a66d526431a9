//! The views of a flight: pictures and slices beside the camera's, their presenters, and when each is rendered.

use bevy_ecs::prelude::*;
use glam::DVec3;

use super::FlightApp;
use crate::components::camera::Pose;
use crate::components::output::{Follows, FrameCache, Picture};
use crate::components::slices::SliceView;
use crate::dynamics::Attitude;
use crate::error::{Error, Result};
use crate::panics;
use crate::render::View;
use crate::schedule::{App, at_home, note};
use crate::systems::present::{self, Presenter};

/// The views of a flight, from [`FlightApp::views`].
pub struct Views<'a> {
    pub(super) flight: &'a mut FlightApp,
}

/// Queries of views. They are kept because creating a query allocates.
#[derive(Default)]
pub(super) struct Queries {
    all: Option<QueryState<&'static mut Picture>>,
    /// Components that determine whether a view is finished.
    to_mark: Option<ViewsToMark>,
}

type ViewsToMark =
    QueryState<(Entity, &'static mut Picture, &'static FrameCache, Option<&'static Pose>, Option<&'static Follows>)>;

impl Views<'_> {
    /// Adds a view: an entity with a [`Picture`], a position to look from (its own [`Pose`] or [`Follows`]), and any other
    /// components. It is rendered in every frame from now on. So is a view that is spawned into the world directly, but this
    /// method also prepares the renderer at once.
    ///
    /// ```
    /// # use colvis_app as colvis;
    /// use colvis::app::{Scan, Scene, FlightRequest};
    /// use colvis::components::output::{Follows, Picture};
    ///
    /// let mut flight = Scan::phantom(1)?.flight(Scene::default(), &FlightRequest::default())?;
    /// let rear = flight.views().add((Picture::new(160, 120), Follows::rear()))?;
    /// flight.fly(1.0)?;
    /// flight.frame()?;
    /// let picture = flight.app().world.get::<Picture>(rear).expect("it was just added");
    /// assert!(picture.frame.pixels().iter().any(|p| p[0] > 30));
    /// # Ok::<(), colvis::error::Error>(())
    /// ```
    ///
    /// With the distance to the wall:
    ///
    /// ```
    /// # use colvis_app as colvis;
    /// use colvis::app::{FlightRequest, Scan, Scene};
    /// use colvis::components::output::{Follows, Picture};
    ///
    /// let mut flight = Scan::phantom(1)?.flight(Scene::default(), &FlightRequest::default())?;
    /// let rear = flight.views().add((Picture::with_depth(160, 120), Follows::rear()))?;
    /// flight.frame()?;
    /// let frame = &flight.app().world.get::<Picture>(rear).expect("it was just added").frame;
    /// let mm = frame.depth().expect("it was asked for")[160 * 60 + 80];
    /// assert!(mm > 1.0, "{mm} mm to the wall in the middle of the picture");
    /// # Ok::<(), colvis::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// Returns status 2 for a picture whose preset does not support its settings, or that no camera can render.
    pub fn add(&mut self, view: impl Bundle) -> Result<Entity> {
        let entity = self.flight.app.world.spawn(view).id();
        let ready = self.check(entity).and_then(|()| self.plug_late()).and_then(|()| self.prepare());
        if ready.is_err() {
            self.flight.app.world.despawn(entity);
        }
        ready.map(|()| entity)
    }

    /// Adds a slice: an entity with a [`SliceView`]. It is drawn in each frame that changes it.
    ///
    /// ```
    /// # use colvis_app as colvis;
    /// use colvis::app::{Scan, Scene, FlightRequest};
    /// use colvis::components::slices::{Orientation, SliceView};
    ///
    /// let mut flight = Scan::phantom(1)?.flight(Scene::default(), &FlightRequest::default())?;
    /// let axial = flight.views().add_slice(SliceView::new(Orientation::Axial, [160, 120]))?;
    /// flight.frame()?;
    /// let view = flight.app().world.get::<SliceView>(axial).expect("it was just added");
    /// assert!(view.frame.pixels().iter().any(|p| p[0] > 100), "tissue");
    /// # Ok::<(), colvis::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub fn add_slice(&mut self, slice: SliceView) -> Result<Entity> {
        let entity = self.flight.app.world.spawn(slice).id();
        self.plug_late()?;
        Ok(entity)
    }

    fn check(&self, entity: Entity) -> Result<()> {
        let world = &self.flight.app.world;
        let Some(p) = world.get::<Picture>(entity) else {
            return Err(Error::usage("view", "has no Picture", "spawn it with Picture::new(width, height)"));
        };
        if !world.entity(entity).contains::<Pose>() && !world.entity(entity).contains::<Follows>() {
            return Err(Error::usage("view", "has no viewpoint", "give it a Pose, or Follows"));
        }
        p.preset.supports(&p.settings)?;
        let (width, height) = (p.frame.width(), p.frame.height());
        View::with_model(DVec3::ZERO, DVec3::Y, DVec3::Z, p.camera, p.fov_degrees, width, height).map(drop)
    }

    /// Creates the renderers of views that have none yet, so that the first frame takes no longer than others.
    pub(super) fn prepare(&mut self) -> Result<()> {
        let FlightApp { app, setup, .. } = &mut *self.flight;
        let mut views = app.world.query::<(&Picture, &mut FrameCache)>();
        for (picture, mut cache) in views.iter_mut(&mut app.world) {
            if picture.scan.is_none() {
                panics::ask_plugin(
                    || format!("preset {}", picture.preset.name),
                    || {
                        cache.renderer_for(&setup.volume, picture.settings, picture.preset);
                        Ok(())
                    },
                )?;
            }
        }
        Ok(())
    }

    /// Marks the views other than the camera's whose picture would change or improve if they were rendered now. Returns true if
    /// there is one.
    pub fn mark_unfinished(&mut self) -> bool {
        let camera = self.flight.app.camera_id();
        let here = self.flight.pose();
        let mut any = false;
        let FlightApp { app, queries, .. } = &mut *self.flight;
        let views = queries.to_mark.get_or_insert_with(|| app.world.query());
        for (entity, mut picture, cache, pose, follows) in views.iter_mut(&mut app.world) {
            if entity == camera {
                continue;
            }
            let pose = match follows {
                Some(f) if f.whom.is_none_or(|e| e == camera) => Some(f.pose(&here)),
                // The followed entity may have moved, so the view is rendered.
                Some(_) => None,
                None => pose.copied(),
            };
            let same = pose.zip(picture.view.as_ref()).is_some_and(|(pose, view)| {
                let (width, height) = (picture.frame.width(), picture.frame.height());
                let Attitude { forward, up } = pose.attitude;
                View::with_model(pose.position, forward, up, picture.camera, picture.fov_degrees, width, height)
                    .is_ok_and(|now| now == *view)
            });
            picture.due |= !same || cache.is_unfinished(&picture);
            any |= picture.due;
        }
        any
    }

    /// Sends a view's pictures to a presenter from now on, in addition to all others: see [`Presenter`]. It replaces a presenter of
    /// the same type.
    ///
    /// # Errors
    /// Returns the errors of any change of the schedule.
    pub fn present_to(&mut self, view: Entity, presenter: impl Presenter) -> Result<()> {
        present::hand_to(&mut self.flight.app, view, presenter);
        self.plug_late()
    }

    /// Removes and returns the presenter of the camera's pictures that is a `P`, if there is one.
    pub fn take_presenter<P: Presenter>(&mut self) -> Option<P> {
        let camera = self.flight.app.camera_id();
        present::take(&mut self.flight.app, camera)
    }

    /// Adds the systems needed by views and presenters that were added later.
    fn plug_late(&mut self) -> Result<()> {
        let FlightApp { app, setup, .. } = &mut *self.flight;
        setup.scene.plug_views(app)?;
        if app.is_changed() { app.build() } else { Ok(()) }
    }

    /// Marks all views for rendering.
    pub(super) fn mark_all(&mut self) {
        let FlightApp { app, queries, .. } = &mut *self.flight;
        let pictures = queries.all.get_or_insert_with(|| app.world.query());
        pictures.iter_mut(&mut app.world).for_each(|mut p| p.due = true);
    }

    /// Same as [`FlightApp::frame`], but renders only the views that are due.
    ///
    /// # Errors
    /// Returns the errors of [`FlightApp::frame`].
    pub fn render_due(&mut self) -> Result<()> {
        let _home = at_home();
        self.plug_late()?;
        let FlightApp { app, .. } = &mut *self.flight;
        present::take_over(app);
        let made = app.frame();
        let made = self.flight.restored(made);
        let FlightApp { app, queries, .. } = &mut *self.flight;
        let pictures = queries.all.get_or_insert_with(|| app.world.query());
        let mut resized = false;
        for mut picture in pictures.iter_mut(&mut app.world) {
            resized |= std::mem::take(&mut picture.resized);
        }
        if resized {
            let who = app.inspect().own_systems_that_write::<Picture>().join(" or ");
            note(if who.is_empty() { "a post-process" } else { &who }, "resized an image: it keeps its size");
        }
        made
    }

    /// Presents the camera's last picture again without rendering it. Use it after an overlay has changed.
    pub fn present_again(&mut self) {
        let _home = at_home();
        let camera = self.flight.app.camera_id();
        present::present_again(&mut self.flight.app, camera);
    }
}

/// Returns the views of a flight other than the camera's, in rendering order, with their renderers' caches.
pub(super) fn others(app: &App) -> Vec<(&Picture, &FrameCache)> {
    let camera = app.camera_id();
    let mut views: Vec<_> = entities(app).filter(|&e| e != camera).collect();
    views.sort_unstable_by_key(|e| e.index_u32());
    views.into_iter().filter_map(|e| Some((app.world.get(e)?, app.world.get(e)?))).collect()
}

/// Returns the slices of a flight.
pub(crate) fn slices(app: &App) -> Vec<&SliceView> {
    entities(app).filter_map(|e| app.world.get(e)).collect()
}

/// Returns all entities. A query would need the world for modification.
fn entities(app: &App) -> impl Iterator<Item = Entity> {
    app.world.archetypes().iter().flat_map(|a| a.entities().iter().map(|e| e.id()))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::fields::Lumen;
    use crate::testing::Room;
    use crate::{ImageSettings, Plan, Scene};

    /// A flight through a room, with small pictures.
    fn flight() -> FlightApp {
        let room = Room::new([10, 30, 10]);
        let volume = room.scan();
        let lumen = Arc::new(Lumen::none(volume.voxels().grid()));
        let image = ImageSettings { width: 12, height: 8, ..ImageSettings::default() };
        let scene = Scene { picture: true, image, ..Scene::guided_by("manual") };
        let plan = Plan::between(room.centre(), room.centre() + DVec3::Y * 10.0, 10.0);
        FlightApp::new(volume, lumen, plan, scene).unwrap()
    }

    #[test]
    fn a_frame_traces_every_view_even_if_nothing_has_changed() {
        let mut flight = flight();
        let rear = flight.views().add((Picture::new(8, 8), Follows::rear())).unwrap();
        let traced = |flight: &FlightApp| {
            let rear = flight.app().world.get::<Picture>(rear).unwrap().traced;
            [flight.camera::<Picture>().unwrap().traced, rear]
        };
        for _ in 0..2 {
            flight.frame().unwrap();
            assert_eq!(traced(&flight), [true; 2]);
        }
        flight.views().render_due().unwrap();
        assert_eq!(traced(&flight), [false; 2], "nothing is due");
    }

    #[test]
    fn one_unfinished_view_is_enough_whichever_it_is() {
        let mut flight = flight();
        let views = [(); 3].map(|()| flight.views().add((Picture::new(8, 8), Follows::rear())).unwrap());
        flight.frame().unwrap();
        for view in views {
            assert!(!flight.views().mark_unfinished(), "all are finished");
            flight.app_mut().world.get_mut::<Picture>(view).unwrap().fov_degrees = 60.0;
            assert!(flight.views().mark_unfinished(), "{view:?}");
            flight.views().render_due().unwrap();
        }
    }
}
