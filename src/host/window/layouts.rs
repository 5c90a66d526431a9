//! The built-in layouts: which panels they show, and where.

use egui_tiles::{LinearDir, TileId, Tiles};

use crate::components::slices::Orientation;

/// The layout of a window that is opened for the first time.
pub(crate) const FIRST: &str = "reading";

/// A built-in layout.
pub(crate) struct LayoutEntry {
    /// Its name, for `--layout` and the settings file.
    pub name: &'static str,
    /// Description for menus.
    pub text: &'static str,
    /// Its key, as in the table of actions.
    pub key: &'static str,
    /// True if there is a menu bar above it.
    pub menus: bool,
    /// Its tiles.
    pub tiles: Split,
}

/// Tiles of a layout.
pub(crate) enum Split {
    /// A panel.
    Panel(&'static str),
    /// Side by side, with their shares.
    Row(&'static [(f32, Split)]),
    /// One above the other, with their shares.
    Column(&'static [(f32, Split)]),
}

/// All layouts, in the order of the menus.
pub(crate) const LAYOUTS: &[LayoutEntry] = &[
    LayoutEntry { name: "flight", text: "flight alone", key: "F2", menus: false, tiles: Split::Panel("flight") },
    LayoutEntry {
        name: "reading",
        text: "flight and three slices",
        key: "F3",
        menus: true,
        tiles: Split::Row(&[
            (0.55, Split::Panel("flight")),
            (
                0.45,
                Split::Column(&[
                    (0.5, Split::Panel("axial")),
                    (0.5, Split::Row(&[(1.0, Split::Panel("coronal")), (1.0, Split::Panel("sagittal"))])),
                ]),
            ),
        ]),
    },
    LayoutEntry {
        name: "slices",
        text: "four slices",
        key: "F4",
        menus: true,
        tiles: Split::Column(&[
            (1.0, Split::Row(&[(1.0, Split::Panel("axial")), (1.0, Split::Panel("coronal"))])),
            (1.0, Split::Row(&[(1.0, Split::Panel("sagittal")), (1.0, Split::Panel("across"))])),
        ]),
    },
    LayoutEntry {
        name: "across",
        text: "flight and the slice across the path",
        key: "F5",
        menus: true,
        tiles: Split::Row(&[(1.0, Split::Panel("flight")), (1.0, Split::Panel("across"))]),
    },
    LayoutEntry {
        name: "both",
        text: "both positions",
        key: "F6",
        menus: true,
        tiles: Split::Row(&[(1.0, Split::Panel("flight")), (1.0, Split::Panel("second"))]),
    },
];

impl Split {
    /// Adds its tiles, and returns the outermost.
    pub(crate) fn add(&self, tiles: &mut Tiles<String>) -> TileId {
        let (dir, children) = match self {
            Self::Panel(name) => return tiles.insert_pane((*name).to_owned()),
            Self::Row(children) => (LinearDir::Horizontal, children),
            Self::Column(children) => (LinearDir::Vertical, children),
        };
        linear(tiles, dir, |tiles| children.iter().map(|(share, split)| (*share, split.add(tiles))).collect())
    }

    /// True if a panel of that name is in it.
    pub(crate) fn shows(&self, panel: &str) -> bool {
        match self {
            Self::Panel(name) => *name == panel,
            Self::Row(children) | Self::Column(children) => children.iter().any(|c| c.1.shows(panel)),
        }
    }
}

/// Returns the slices that a layout shows by default, by its name. Empty if the layout does not exist.
#[doc(hidden)]
pub fn slices_of(layout: &str) -> Vec<Orientation> {
    let Some(entry) = LAYOUTS.iter().find(|l| l.name == layout) else { return Vec::new() };
    let panel = |o: &Orientation| if *o == Orientation::Across { "across" } else { o.name() };
    Orientation::ALL.into_iter().filter(|o| entry.tiles.shows(panel(o))).collect()
}

/// Adds tiles side by side or one above the other, with their shares.
pub(crate) fn linear(
    tiles: &mut Tiles<String>,
    dir: LinearDir,
    children: impl FnOnce(&mut Tiles<String>) -> Vec<(f32, TileId)>,
) -> TileId {
    let children = children(tiles);
    let mut container = egui_tiles::Linear::new(dir, children.iter().map(|c| c.1).collect());
    children.iter().for_each(|(share, id)| container.shares.set_share(*id, *share));
    tiles.insert_container(container)
}
