//! Hands finished pictures to whoever shows or keeps them: the window's framebuffer, a recording.

use bevy_ecs::prelude::*;

use crate::components::output::Picture;
use crate::error::Result;
use crate::schedule::{App, FlightSystems, Slot};

/// Somewhere that pictures go to. It is a resource of the world that stays on its thread.
pub trait Presenter: 'static {
    /// Its name, for messages.
    const NAME: &'static str;

    /// Takes the picture as it is now. It is asked in each frame, also in one in which nothing new was traced
    /// (`picture.traced` tells): what it has shown already it need not show again.
    fn present(&mut self, picture: &Picture);
}

/// Plugs a presenter into its slot. It takes part as soon as it is [in the world](hand_to); without this plugin, or without a
/// presenter, nothing is shown or recorded.
///
/// # Errors
/// Status 2 when there is another one.
pub fn plugin<P: Presenter>(app: &mut App) -> Result<()> {
    app.fill(Slot::Presenter, P::NAME)?;
    app.add_systems(FlightSystems::Present, present_picture::<P>);
    Ok(())
}

/// Gives a world the presenter that its pictures go to from now on.
pub fn hand_to<P: Presenter>(app: &mut App, presenter: P) {
    app.world.insert_non_send(presenter);
}

/// Hands the camera's picture on.
pub fn present_picture<P: Presenter>(presenter: Option<NonSendMut<P>>, picture: Single<&Picture>) {
    if let Some(mut presenter) = presenter {
        presenter.present(&picture);
    }
}
