//! What is left in a colon: deep pools, and the tag of the settings.

use glam::DVec3;

use super::PhantomSettings;
use super::pools::{self, Pool};
use super::shape::Shape;
use super::stream::stream;
use super::tag::{Kinds, Tag};
use super::touching::Touching;

/// Returns pools that are filled from a quarter to nearly the whole height of the lumen, with gravity along `down`.
pub(crate) fn deep_pools(shape: &Shape, down: DVec3, seed: u64) -> Vec<Pool> {
    let mut draw = stream(seed, 32);
    pools::pools(shape, down, || 0.25 + 0.65 * draw.within(0.0, 1.0).powi(2))
}

/// Returns the tag of a colon with these pools, away from where it is collapsed or touches itself. `hu` is that of all tag, if it is
/// given.
pub(crate) fn tag(shape: &Shape, pools: &[Pool], settings: &PhantomSettings, hu: Option<f64>, seed: u64) -> Tag {
    let PhantomSettings { films, stool, inhomogeneous, pseudo, position, .. } = *settings;
    let mut tag = Tag::new(shape, pools, Kinds { films, stool, inhomogeneous, pseudo }, position, seed);
    tag.keep_off(&shape.collapsed.iter().map(|c| [c.from, c.to]).collect::<Vec<_>>());
    tag.keep_off(&shape.touching.iter().flat_map(Touching::stretches).collect::<Vec<_>>());
    if let Some(hu) = hu {
        tag.set_hu(hu);
    }
    tag
}
