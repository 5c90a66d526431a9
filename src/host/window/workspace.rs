//! The workspace: which panels are shown, and where. A layout is a row of tiles with draggable dividers between them.

mod showing;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use egui::{Align, MenuBar, RichText, Ui, UiBuilder, WidgetText};
use egui_tiles::{Behavior, Container, LinearDir, SimplificationOptions, Tile, TileId, Tiles, Tree, UiResponse};
use serde::{Deserialize, Serialize};

use super::action::{MENUS, OWN};
use super::contract::{Context, Panel, PanelEntry, Requests};
use super::intent::Intent;
use super::layouts::{FIRST, LAYOUTS, LayoutEntry, linear};
use super::style::{DISCLAIMER, SOFT, Severity};
use super::toolbar;
use crate::error::{Error, Result};
use crate::host::folders::{self, Folder};
use crate::output;
use crate::panics;
use crate::schedule::note;

/// The current version of the file of layouts.
const VERSION: u32 = 1;
/// Consequence of an invalid file of layouts, for messages.
const HINT: &str = "it is left as it is; the panels are where they are at first";
/// Limits of a tile's share when read from a file, so that every tile has pixels.
const SHARES: [f32; 2] = [0.02, 50.0];
/// Share of panels that are shown beside those of a layout.
const SIDE: f32 = 0.3;

/// The current state of a layout.
struct Arrangement {
    tree: Tree<String>,
    /// Beside the layout's panels: the tile that holds the others as tabs, and these.
    side: (TileId, Vec<TileId>),
}

impl Arrangement {
    fn new(entry: &LayoutEntry, panels: &[Shown]) -> Self {
        let mut tiles = Tiles::default();
        let own = entry.tiles.add(&mut tiles);
        let others: Vec<&str> = panels.iter().map(|p| p.entry.name).filter(|n| !entry.tiles.shows(n)).collect();
        let mut ids = Vec::new();
        ids.extend(others.iter().map(|n| tiles.insert_pane((*n).to_owned())));
        let side = tiles.insert_tab_tile(ids.clone());
        let root = linear(&mut tiles, LinearDir::Horizontal, |_| vec![(1.0 - SIDE, own), (SIDE, side)]);
        let mut made = Self { tree: Tree::new(entry.name, root, tiles), side: (side, ids) };
        for (id, name) in made.side.1.clone().into_iter().zip(&others) {
            // A layout that consists only of slices should not have the flight beside it.
            let shown = panels.iter().any(|p| p.entry.name == *name && p.entry.shown && *name != "flight");
            made.tree.set_visible(id, shown);
        }
        made.settle();
        made
    }

    /// Shows the side if it has a visible panel, otherwise hides it.
    fn settle(&mut self) {
        let any = self.side.1.iter().any(|id| self.tree.is_visible(*id));
        self.tree.set_visible(self.side.0, any);
    }

    fn tile(&self, panel: &str) -> Option<TileId> {
        self.tree.tiles.find_pane(&panel.to_owned())
    }

    fn is_shown(&self, panel: &str) -> bool {
        self.tile(panel).is_some_and(|id| self.tree.is_visible(id))
    }

    /// Shows or hides a panel.
    fn switch(&mut self, panel: &str) {
        if let Some(id) = self.tile(panel) {
            let shown = self.tree.is_visible(id);
            self.tree.set_visible(id, !shown);
            if let Some(Tile::Container(Container::Tabs(tabs))) = self.tree.tiles.get_mut(self.side.0)
                && !shown
                && tabs.children.contains(&id)
            {
                tabs.set_active(id);
            }
            self.settle();
        }
    }

    /// Returns the shares of all divided tiles, from the outermost to the innermost. Their names encode their positions.
    fn shares(&self) -> BTreeMap<String, f32> {
        let mut all = BTreeMap::new();
        self.walk(&mut |place, container, child| {
            all.insert(place, container.shares[child]);
        });
        all
    }

    /// Calls `each` for every divided tile with its position name, its container and its child.
    fn walk(&self, each: &mut impl FnMut(String, &egui_tiles::Linear, TileId)) {
        let mut left: Vec<(String, TileId)> = self.tree.root().map(|r| (String::new(), r)).into_iter().collect();
        while let Some((place, id)) = left.pop() {
            if let Some(Tile::Container(Container::Linear(container))) = self.tree.tiles.get(id) {
                for (n, child) in container.children.iter().enumerate() {
                    let place = format!("{place}{n}");
                    each(place.clone(), container, *child);
                    left.push((place, *child));
                }
            }
        }
    }

    /// Restores stored shares. Those of tiles that no longer exist are ignored.
    fn take(&mut self, kept: &BTreeMap<String, f32>) {
        let mut wanted = Vec::new();
        self.walk(&mut |place, _, child| wanted.extend(kept.get(&place).map(|s| (child, *s))));
        for tile in self.tree.tiles.tiles_mut() {
            if let Tile::Container(Container::Linear(container)) = tile {
                for (child, share) in wanted.iter().filter(|w| w.1.is_finite()) {
                    if container.children.contains(child) {
                        container.shares.set_share(*child, share.clamp(SHARES[0], SHARES[1]));
                    }
                }
            }
        }
    }
}

/// The stored state of the workspace.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    version: u32,
    layout: String,
    /// Positions of the dividers in each layout.
    shares: BTreeMap<String, BTreeMap<String, f32>>,
    /// Visibility of the panels beside those of each layout. Panels that are not named did not exist then.
    beside: BTreeMap<String, BTreeMap<String, bool>>,
}

impl folders::Kept for Kept {
    const VERSION: u32 = VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}

/// A panel of this window.
struct Shown {
    entry: PanelEntry,
    panel: Box<dyn Panel>,
    /// Why it is no longer laid out.
    fault: Option<String>,
}

/// The panels of a window.
pub(crate) struct Workspace {
    panels: Vec<Shown>,
    layout: usize,
    layouts: Vec<Arrangement>,
    /// The file of the workspace; `None` if it is not stored.
    file: Option<PathBuf>,
    /// True if a panel has panicked since the last [`Workspace::take_broken`].
    is_broken: bool,
    /// True while the menus are shown over a layout without them.
    is_at_edge: bool,
    /// Warnings about the scan that are not dismissed.
    warnings: Vec<String>,
}

/// Distance of the pointer from the upper edge at which menus are shown there, and from which on they are not any more, points.
const EDGE: [f32; 2] = [3.0, 30.0];
/// Farthest place that a panel draws at, points.
const ABSURD: f32 = 1e5;

impl Workspace {
    /// Creates a workspace with these panels, in the layout `wanted` or else the last used one. Also returns the error if the
    /// stored state is invalid. In that case everything has its initial position and nothing is stored.
    pub(crate) fn new(entries: &[PanelEntry], wanted: Option<&str>, file: Option<PathBuf>) -> (Self, Option<Error>) {
        // A panel that cannot be made is shown as one that has failed.
        let make = |e: &PanelEntry| {
            let (panel, fault) = match panics::catch(|| (e.make)()) {
                Ok(panel) => (panel, None),
                Err(why) => ((PanelEntry::NONE.make)(), Some(hidden(e, why))),
            };
            Shown { entry: *e, panel, fault }
        };
        let panels: Vec<Shown> = entries.iter().map(make).collect();
        let layouts = LAYOUTS.iter().map(|l| Arrangement::new(l, &panels)).collect();
        let first = LAYOUTS.iter().position(|l| l.name == FIRST).unwrap_or(0);
        let mut made =
            Self { panels, layout: first, layouts, file, is_broken: false, is_at_edge: false, warnings: Vec::new() };
        let error = made.resume().err();
        if error.is_some() {
            made.file = None;
        }
        if let Some(n) = wanted.and_then(|w| LAYOUTS.iter().position(|l| l.name == w)) {
            made.layout = n;
        }
        (made, error)
    }

    fn resume(&mut self) -> Result<()> {
        let Some(path) = &self.file else { return Ok(()) };
        let Some(kept) = folders::read_kept::<Kept>(path, HINT)? else { return Ok(()) };
        for (entry, layout) in LAYOUTS.iter().zip(&mut self.layouts) {
            if let Some(shares) = kept.shares.get(entry.name) {
                layout.take(shares);
            }
            let beside = kept.beside.get(entry.name);
            for panel in self.panels.iter().map(|p| p.entry.name).filter(|p| !entry.tiles.shows(p)) {
                if beside.and_then(|b| b.get(panel)).is_some_and(|shown| *shown != layout.is_shown(panel)) {
                    layout.switch(panel);
                }
            }
        }
        self.layout = LAYOUTS.iter().position(|l| l.name == kept.layout).unwrap_or(0);
        Ok(())
    }

    /// Stores the workspace for the next time.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written.
    pub(crate) fn keep(&self) -> Result<()> {
        let Some(path) = &self.file else { return Ok(()) };
        let all = || LAYOUTS.iter().zip(&self.layouts);
        let beside = |entry: &LayoutEntry, layout: &Arrangement| {
            let names = self.panels.iter().map(|p| p.entry.name);
            names.filter(|p| !entry.tiles.shows(p)).map(|p| (p.to_owned(), layout.is_shown(p))).collect()
        };
        let kept = Kept {
            version: VERSION,
            layout: LAYOUTS[self.layout].name.to_owned(),
            shares: all().map(|(e, l)| (e.name.to_owned(), l.shares())).collect(),
            beside: all().map(|(e, l)| (e.name.to_owned(), beside(e, l))).collect(),
        };
        folders::keep(path, &kept)
    }

    /// Returns the default file of the workspace; `None` on a system that defines no folder for it.
    pub(crate) fn usual_file() -> Option<PathBuf> {
        Folder::State.file(Path::new("layout.json"))
    }

    /// Switches to another layout, by its number.
    pub(crate) fn choose(&mut self, layout: usize) {
        self.layout = layout.min(LAYOUTS.len() - 1);
    }

    /// Shows or hides a panel, by its name.
    pub(crate) fn switch_named(&mut self, name: &str) {
        self.layouts[self.layout].switch(name);
    }

    /// Hides a panel, by its name. Returns false if it is not shown.
    pub(crate) fn hide_named(&mut self, name: &str) -> bool {
        let is_shown = self.layouts[self.layout].is_shown(name);
        self.show_named(name, false);
        is_shown
    }

    /// Shows a panel, or hides it, by its name.
    pub(crate) fn show_named(&mut self, name: &str, shown: bool) {
        let layout = &mut self.layouts[self.layout];
        if layout.is_shown(name) != shown {
            layout.switch(name);
        }
    }

    /// Shows or hides a panel, by its number.
    pub(crate) fn switch(&mut self, panel: usize) {
        if let Some(p) = self.panels.get(panel) {
            self.layouts[self.layout].switch(p.entry.name);
        }
    }

    /// True if a panel is shown, by its name.
    pub(crate) fn shows(&self, name: &str) -> bool {
        self.layouts[self.layout].is_shown(name)
    }

    /// True if a panel other than the flight's is shown. Such panels may show any part of the flight, so they are laid out again
    /// while it moves.
    pub(crate) fn shows_more_than_the_flight(&self) -> bool {
        self.panels.iter().any(|p| p.entry.name != "flight" && self.layouts[self.layout].is_shown(p.entry.name))
    }

    /// Takes whether a panel has panicked since the last call. egui's state may then be damaged, and all panels are made anew, because
    /// their pictures belong to it: what they held is lost. Those that have panicked stay hidden.
    pub(crate) fn take_broken(&mut self) -> bool {
        let is_broken = std::mem::take(&mut self.is_broken);
        if is_broken {
            self.renew();
        }
        is_broken
    }

    /// Makes all panels anew but those that have panicked.
    pub(crate) fn renew(&mut self) {
        for shown in self.panels.iter_mut().filter(|p| p.fault.is_none()) {
            match panics::catch(|| (shown.entry.make)()) {
                Ok(panel) => shown.panel = panel,
                Err(why) => shown.fault = Some(hidden(&shown.entry, why)),
            }
        }
    }

    /// Lays out all panels.
    pub(crate) fn ui(&mut self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        let is_headed = LAYOUTS[self.layout].menus;
        if is_headed {
            egui::Panel::top("menus").show_inside(ui, |ui| self.menus(context, ui, requests));
            egui::Panel::top("tools").show_inside(ui, |ui| toolbar::ui(context, ui, requests));
        }
        if !self.warnings.is_empty() {
            egui::Panel::top("warnings").show_inside(ui, |ui| self.warn_above(ui));
        }
        let area = ui.available_rect_before_wrap();
        let (panels, layout, is_broken) = (&mut self.panels, &mut self.layouts[self.layout], &mut self.is_broken);
        let mut closed = None;
        layout.tree.ui(&mut Tiling { panels, context, requests, is_broken, closed: &mut closed }, ui);
        if let Some(name) = closed {
            layout.switch(&name);
        }
        if !is_headed {
            self.menus_at_edge(context, ui, area, requests);
        }
    }

    /// Shows these warnings about the scan above the panels until they are dismissed. They replace those of another scan.
    pub(crate) fn warn(&mut self, warnings: Vec<String>) {
        self.warnings = warnings;
    }

    /// Shows another warning in place of one that does not hold any more, or none.
    pub(crate) fn warn_instead(&mut self, before: &str, now: Option<&str>) {
        self.warnings.retain(|w| w != before);
        self.warnings.extend(now.map(str::to_owned));
    }

    fn warn_above(&mut self, ui: &mut Ui) {
        let mut dismissed = None;
        for (n, warning) in self.warnings.iter().enumerate() {
            ui.horizontal(|ui| {
                ui.with_layout(egui::Layout::right_to_left(Align::Center), |ui| {
                    if ui.button("Dismiss").clicked() {
                        dismissed = Some(n);
                    }
                    ui.with_layout(egui::Layout::left_to_right(Align::Center), |ui| {
                        let text = RichText::new(format!("{} {warning}", egui_phosphor::regular::WARNING));
                        ui.add(egui::Label::new(text.color(Severity::Notice.colour())).wrap());
                    });
                });
            });
        }
        if let Some(n) = dismissed {
            self.warnings.remove(n);
        }
    }

    /// Shows the menus over a layout without them while the pointer is at the upper edge: who has only a mouse needs them.
    fn menus_at_edge(&mut self, context: &Context<'_>, ui: &Ui, area: egui::Rect, requests: &mut Requests) {
        let edge = area.top() + if self.is_at_edge { EDGE[1] } else { EDGE[0] };
        let is_there = ui.ctx().pointer_hover_pos().is_some_and(|at| at.y < edge);
        self.is_at_edge = is_there || self.is_at_edge && egui::Popup::is_any_open(ui.ctx());
        if self.is_at_edge {
            let shown =
                egui::Area::new(egui::Id::new("menus at the edge")).fixed_pos(area.min).order(egui::Order::Middle);
            shown.show(ui.ctx(), |ui| {
                egui::Frame::NONE.fill(ui.visuals().panel_fill).inner_margin(4.0).show(ui, |ui| {
                    ui.set_width(area.width() - 8.0);
                    self.menus(context, ui, requests);
                });
            });
        }
    }

    /// True if the state is shown above all panels.
    pub(crate) fn is_headed(&self) -> bool {
        LAYOUTS[self.layout].menus
    }

    fn menus(&self, context: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
        MenuBar::new().ui(ui, |ui| {
            for (title, entries) in MENUS {
                ui.menu_button(*title, |ui| {
                    let mut is_apart = false;
                    for (entry, action) in entries.iter().flat_map(|e| context.actions.of_menu(e).map(move |a| (e, a)))
                    {
                        // Those of other crates stand apart.
                        if *entry == OWN && !std::mem::replace(&mut is_apart, true) {
                            ui.separator();
                        }
                        let button = egui::Button::new(action.title()).shortcut_text(action.key_text());
                        let button = button.selected(self.is_on(&action.intent));
                        let why_not = context.why_not(action);
                        let shown = ui.add_enabled(why_not.is_none(), button);
                        if shown.on_disabled_hover_text(why_not.unwrap_or_default()).clicked() {
                            requests.action(&action.id);
                        }
                    }
                });
            }
            ui.with_layout(egui::Layout::right_to_left(Align::Center), |ui| {
                ui.label(RichText::new(DISCLAIMER).color(SOFT));
                let r = context.hud;
                // If the flight is not shown, its messages need another place.
                if let Some(message) = r.message.as_ref().filter(|_| !self.layouts[self.layout].is_shown("flight")) {
                    ui.separator();
                    ui.label(message);
                }
            });
        });
    }

    /// True if the state that an action toggles is on.
    fn is_on(&self, intent: &Intent) -> bool {
        match intent {
            Intent::Layout(n) => *n == self.layout,
            Intent::Panel(n) => self.panels.get(*n).is_some_and(|p| self.layouts[self.layout].is_shown(p.entry.name)),
            _ => false,
        }
    }
}

/// True if a shape has places that are not finite, or is absurdly far away.
fn is_absurd(shape: &egui::Shape) -> bool {
    use egui::Shape;
    // A bounding rectangle leaves out places that are not numbers.
    let is_finite = match shape {
        Shape::Noop => return false,
        // The bounding rectangle of a text without ink is not finite.
        Shape::Text(text) if text.galley.mesh_bounds.is_negative() => return !text.pos.is_finite(),
        Shape::Vec(all) => return all.iter().any(is_absurd),
        Shape::Path(path) => path.points.iter().all(|p| p.is_finite()),
        Shape::LineSegment { points, .. } => points.iter().all(|p| p.is_finite()),
        Shape::Circle(circle) => circle.center.is_finite() && circle.radius.is_finite(),
        Shape::Ellipse(ellipse) => ellipse.center.is_finite() && ellipse.radius.is_finite(),
        Shape::Mesh(mesh) => mesh.vertices.iter().all(|v| v.pos.is_finite()),
        Shape::Text(text) => text.pos.is_finite() && text.angle.is_finite(),
        Shape::QuadraticBezier(curve) => curve.points.iter().all(|p| p.is_finite()),
        Shape::CubicBezier(curve) => curve.points.iter().all(|p| p.is_finite()),
        Shape::Rect(_) | Shape::Callback(_) => true,
    };
    let at = shape.visual_bounding_rect();
    // What encloses nothing ends before it begins.
    let is_seen = at.min.x <= at.max.x && at.min.y <= at.max.y || at.any_nan();
    let far = at.min.to_vec2().length().max(at.max.to_vec2().length());
    !is_finite || is_seen && !(at.is_finite() && far < ABSURD)
}

/// Removes shapes of a layer, from `first` on, that no one can see and that take forever to draw: places that are not finite or absurdly
/// far away. Returns true if there were any.
fn hide_absurd(egui: &egui::Context, layer: egui::LayerId, first: egui::layers::ShapeIdx) -> bool {
    egui.graphics_mut(|graphics| {
        let list = graphics.entry(layer);
        let mut any = false;
        for n in first.0..list.next_idx().0 {
            list.mutate_shape(egui::layers::ShapeIdx(n), |clipped| {
                if is_absurd(&clipped.shape) {
                    (clipped.shape, any) = (egui::Shape::Noop, true);
                }
            });
        }
        any
    })
}

/// Lays out panels in their tiles.
struct Tiling<'a, 'b> {
    panels: &'a mut [Shown],
    context: &'a Context<'b>,
    requests: &'a mut Requests,
    /// Set if a panel panics.
    is_broken: &'a mut bool,
    /// The panel whose tab was closed.
    closed: &'a mut Option<String>,
}

impl Behavior<String> for Tiling<'_, '_> {
    fn pane_ui(&mut self, ui: &mut Ui, _: TileId, name: &mut String) -> UiResponse {
        let Some(shown) = self.panels.iter_mut().find(|p| p.entry.name == *name) else { return UiResponse::None };
        let rect = ui.available_rect_before_wrap();
        if !shown.entry.picture || shown.fault.is_some() {
            ui.painter().rect_filled(rect, 0.0, ui.visuals().panel_fill);
        }
        if let Some(why) = &shown.fault {
            reported(ui, rect, shown.entry.title, why);
            return UiResponse::None;
        }
        // A separate child, so that state left behind by a panicking panel does not affect the others.
        let mut own =
            ui.new_child(UiBuilder::new().max_rect(if shown.entry.picture { rect } else { rect.shrink(8.0) }));
        own.set_clip_rect(rect.intersect(ui.clip_rect()));
        let (context, requests) = (self.context, &mut *self.requests);
        let (layer, begun) = (own.layer_id(), own.painter().add(egui::Shape::Noop));
        let asked = requests.count();
        let laid_out = panics::catch(|| {
            shown.panel.ui(context, &mut own, requests);
        });
        requests.refuse_from(asked, context.actions, &format!("panel {}", shown.entry.name));
        if hide_absurd(own.ctx(), layer, begun) {
            let what = "draws shapes without a reasonable size: they are not shown";
            note(format!("panel {}", shown.entry.name), what);
        }
        if let Err(why) = laid_out {
            reported(ui, rect, shown.entry.title, &why);
            shown.fault = Some(hidden(&shown.entry, why));
            *self.is_broken = true;
        }
        UiResponse::None
    }

    fn tab_title_for_pane(&mut self, name: &String) -> WidgetText {
        let shown = self.panels.iter().find(|p| p.entry.name == *name);
        shown.map_or(name.as_str(), |p| p.entry.title).into()
    }

    fn is_tab_closable(&self, _: &Tiles<String>, _: TileId) -> bool {
        true
    }

    fn on_tab_close(&mut self, tiles: &mut Tiles<String>, tile: TileId) -> bool {
        // It is hidden, and comes back where it was.
        *self.closed = tiles.get(tile).and_then(|t| if let Tile::Pane(name) = t { Some(name.clone()) } else { None });
        false
    }

    fn is_tile_draggable(&self, _: &Tiles<String>, _: TileId) -> bool {
        false
    }

    fn gap_width(&self, _: &egui::Style) -> f32 {
        4.0
    }

    fn min_size(&self) -> f32 {
        80.0
    }

    fn simplification_options(&self) -> SimplificationOptions {
        // Keep the tiles as in the layout, so that dividers are found again.
        SimplificationOptions::OFF
    }
}

/// Tells that a panel has panicked and is not shown from now on. Returns why.
fn hidden(panel: &PanelEntry, why: String) -> String {
    output::to_stderr(format_args!("note: panel {} panicked: {why}; it is hidden", panel.name));
    why
}

/// Shows the error of a panel in its place.
fn reported(ui: &mut Ui, rect: egui::Rect, title: &str, why: &str) {
    let layout = egui::Layout::top_down(Align::Min);
    ui.scope_builder(UiBuilder::new().max_rect(rect.shrink(8.0)).layout(layout), |ui| {
        ui.label(RichText::new(format!("{title}: panicked")).color(Severity::Alert.colour()));
        ui.label(why);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::settings::KeySettings;
    use crate::host::window::action::Actions;
    use crate::host::window::contract::WindowView;
    use crate::host::window::controller::FlightController;
    use crate::host::window::intent::{Intent, SliceInput};
    use crate::host::window::interface::{Interface, WindowSize};
    use crate::render::ImageSize;

    struct Nothing;

    impl Panel for Nothing {
        fn ui(&mut self, _: &Context<'_>, _: &mut Ui, _: &mut Requests) {}
    }

    fn entries() -> Vec<PanelEntry> {
        let own = PanelEntry { name: "own", title: "Own", make: || Box::new(Nothing), ..PanelEntry::NONE };
        crate::host::window::panels::BUILT_IN.iter().copied().chain([own]).collect()
    }

    fn workspace(file: &Path) -> (Workspace, Option<Error>) {
        Workspace::new(&entries(), None, Some(file.to_owned()))
    }

    #[test]
    fn layouts_dividers_and_panels_are_kept() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a").join("layout.json");
        let (mut first, error) = workspace(&path);
        assert!(error.is_none() && !first.layouts[0].is_shown("own"));
        let own = entries().len() - 1;
        first.choose(0);
        first.switch(own);
        assert!(first.layouts[0].is_shown("own") && first.shows_more_than_the_flight());
        first.layouts[0].take(&BTreeMap::from([
            ("0".to_owned(), 0.9),
            ("1".to_owned(), f32::NAN),
            ("77".to_owned(), 1.0),
        ]));
        assert_eq!(first.layouts[0].shares()["0"], 0.9);
        first.choose(LAYOUTS.len() - 1);
        first.keep().unwrap();
        let (second, error) = workspace(&path);
        assert!(error.is_none());
        assert_eq!(second.layout, LAYOUTS.len() - 1);
        assert_eq!((second.layouts[0].shares()["0"], second.layouts[0].shares()["1"]), (0.9, SIDE));
        assert!(second.layouts[0].is_shown("own"));
        // The requested layout takes precedence.
        assert_eq!(Workspace::new(&entries(), Some("flight"), Some(path)).0.layout, 0);
    }

    /// A panel that panics at its third picture.
    struct Fails(u32);

    impl Panel for Fails {
        fn ui(&mut self, _: &Context<'_>, ui: &mut Ui, requests: &mut Requests) {
            self.0 += 1;
            assert!(self.0 < 3, "the third time");
            if ui.button("press").clicked() {
                requests.action("pause");
            }
        }
    }

    /// Lays out a workspace after some events. Returns the requests.
    fn lay_out(
        w: &mut Workspace,
        interface: &mut Interface,
        controller: &FlightController,
        events: Vec<egui::Event>,
    ) -> Requests {
        let actions =
            Actions::new(&controller.flight().setup().scene.guides, &[], &entries(), &KeySettings::new()).unwrap();
        let hud = crate::host::window::overlay::HudState::default();
        let size = WindowSize { pixels: ImageSize::new(1000, 700), scale: 1.0 };
        let input = egui::RawInput { events, ..egui::RawInput::default() };
        let mut requests = Requests::default();
        let laid_out = interface.lay_out(input, size, std::time::Instant::now(), |ui| {
            w.ui(&Context::new(controller, &actions, &[], &hud), ui, &mut requests);
            Vec::new()
        });
        // As the shell does.
        if w.take_broken() || laid_out.is_err() {
            interface.renew();
        }
        requests
    }

    fn press(at: egui::Pos2, pressed: bool) -> Vec<egui::Event> {
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        vec![egui::Event::PointerMoved(at), egui::Event::PointerButton { pos: at, button, pressed, modifiers }]
    }

    #[test]
    fn panels_are_laid_out_and_clicked_without_a_window() {
        let mut controller = crate::host::window::controller::tests::controller("tentacles");
        let (mut w, mut interface) = (Workspace::new(&entries(), Some("reading"), None).0, Interface::new());
        let shown = lay_out(&mut w, &mut interface, &controller, Vec::new());
        let flight = shown.flight_at().unwrap();
        let places: Vec<egui::Rect> = shown.slices_at().iter().map(|s| s.1).chain([flight]).collect();
        assert_eq!(places.len(), 4);
        for (n, a) in places.iter().enumerate() {
            assert!(a.width() > 150.0 && a.height() > 150.0, "{a:?}");
            assert!(places[..n].iter().all(|b| !a.shrink(1.0).intersects(*b)), "they lie side by side");
        }
        // The slices are drawn, and a click in one is a point of the world.
        let size = |r: &egui::Rect| [r.width() as usize, r.height() as usize];
        let slices: Vec<_> = shown.slices_at().iter().map(|(o, r)| (*o, size(r))).collect();
        let due = controller.prepare(ImageSize::new(100, 100), &slices, std::time::Instant::now()).unwrap();
        controller.show(due).unwrap();
        let (orientation, axial) = shown.slices_at()[0];
        lay_out(&mut w, &mut interface, &controller, Vec::new());
        let mut asked = lay_out(&mut w, &mut interface, &controller, press(axial.center(), true));
        let slice = controller.slices().view(controller.flight(), orientation).unwrap().shown().unwrap();
        let [Intent::Slice(SliceInput::Click(place))] = asked.take()[..] else { panic!("a click in the slice") };
        let offset = f64::from(axial.center().x - axial.min.x) - slice.pixel(place).0[0];
        assert!(offset.abs() < 1e-3 && slice.pixel(place).1.abs() < 1e-9);
        // Pressed again, it is a double click.
        lay_out(&mut w, &mut interface, &controller, press(axial.center(), false));
        let asked = lay_out(&mut w, &mut interface, &controller, press(axial.center(), true)).take();
        assert_eq!(asked, [Intent::Slice(SliceInput::SetOut(place))]);
        // A drag in the flight's picture looks around.
        lay_out(&mut w, &mut interface, &controller, press(axial.center(), false));
        let mut events = press(flight.center(), true);
        events.push(egui::Event::PointerMoved(flight.center() + egui::vec2(30.0, 0.0)));
        let asked = lay_out(&mut w, &mut interface, &controller, events).take();
        assert!(asked.contains(&Intent::Look([30.0, 0.0])), "{asked:?}");
    }

    #[test]
    fn a_panel_that_panics_says_so_in_its_place_and_the_others_stay() {
        let controller = crate::host::window::controller::tests::controller("tentacles");
        let fails =
            PanelEntry { name: "fails", title: "Fails", shown: true, make: || Box::new(Fails(0)), ..PanelEntry::NONE };
        let all = [entries(), vec![fails]].concat();
        let (mut w, mut interface) = (Workspace::new(&all, Some("flight"), None).0, Interface::new());
        for n in 0..6 {
            let shown = lay_out(&mut w, &mut interface, &controller, Vec::new());
            assert!(shown.flight_at().is_some(), "{n}");
            assert_eq!(w.panels.last().unwrap().fault.is_some(), n >= 2, "{n}");
        }
        assert!(w.panels.last().unwrap().fault.as_ref().unwrap().contains("the third time"));
    }

    /// Draws with a number that makes no sense.
    struct Odd(usize, f32);

    impl Panel for Odd {
        fn ui(&mut self, _: &Context<'_>, ui: &mut Ui, _: &mut Requests) {
            let (at, n) = (ui.max_rect().center(), self.1);
            let (ink, line) = (egui::Color32::RED, egui::Stroke::new(1.0, egui::Color32::RED));
            match self.0 {
                0 => drop(ui.label(RichText::new("W").size(n))),
                1 => drop(ui.painter().circle_filled(at, n, ink)),
                2 => drop(ui.painter().line_segment([at, at + egui::vec2(n, n)], line)),
                3 => drop(ui.painter().rect_filled(egui::Rect::from_center_size(at, egui::vec2(n, n)), n, ink)),
                4 => drop(ui.painter().circle_stroke(at, 9.0, egui::Stroke::new(n, ink))),
                _ => drop(ui.allocate_space(egui::vec2(n, n))),
            }
        }
    }

    thread_local! {
        static ODD: std::cell::Cell<(usize, f32)> = const { std::cell::Cell::new((0, 0.0)) };
    }

    /// Whatever a panel draws, it may be hidden, but the other panels go on, and nothing hangs.
    #[test]
    fn shapes_are_absurd_where_a_place_is_none_or_far_away() {
        use egui::{Color32, FontId, Shape, pos2};
        let egui = egui::Context::default();
        let mut shapes = Vec::new();
        let text = |ui: &Ui, text: &str, at| {
            let galley = ui.painter().layout_no_wrap(text.to_owned(), FontId::proportional(14.0), Color32::WHITE);
            Shape::galley(at, galley, Color32::WHITE)
        };
        let _ = egui.run_ui(egui::RawInput::default(), |ui| {
            shapes = ["", "  ", "a"].map(|t| text(ui, t, pos2(9.0, 9.0))).into();
            shapes.push(text(ui, "", pos2(f32::NAN, 9.0)));
        });
        let far: Vec<bool> = shapes.iter().map(is_absurd).collect();
        assert_eq!(far, [false, false, false, true]);
        let red = egui::Stroke::new(1.0, Color32::RED);
        let line = |x| Shape::line(vec![pos2(1.0, 1.0), pos2(x, 2.0), pos2(3.0, 3.0)], red);
        assert!(!is_absurd(&line(9.0)) && !is_absurd(&Shape::Noop) && !is_absurd(&Shape::Vec(vec![line(3.0)])));
        for odd in [f32::NAN, f32::INFINITY, 1e9] {
            assert!(is_absurd(&line(odd)) && is_absurd(&Shape::Vec(vec![Shape::Noop, line(odd)])), "{odd}");
            assert!(is_absurd(&Shape::circle_filled(pos2(1.0, odd), 2.0, Color32::RED)), "{odd}");
            assert!(is_absurd(&Shape::circle_filled(pos2(1.0, 2.0), odd, Color32::RED)), "{odd}");
        }
    }

    #[test]
    fn a_panel_that_draws_absurdly_disturbs_no_other() {
        let controller = crate::host::window::controller::tests::controller("tentacles");
        let make = || {
            let (what, n) = ODD.get();
            Box::new(Odd(what, n)) as Box<dyn Panel>
        };
        let odd = PanelEntry { name: "odd", title: "Odd", shown: true, make, ..PanelEntry::NONE };
        let all = [entries(), vec![odd]].concat();
        let mut artist = crate::host::window::painter::Artist::new();
        for what in 0..6 {
            for n in [5000.0, 1e9, f32::INFINITY, f32::NAN, -1.0, 1e-9] {
                // egui rasterises a glyph before anyone can refuse it, in memory of its size squared.
                if what == 0 && n > 1e4 {
                    continue;
                }
                ODD.set((what, n));
                let (mut w, mut interface) = (Workspace::new(&all, Some("flight"), None).0, Interface::new());
                let mut shown = Requests::default();
                for _ in 0..4 {
                    shown = lay_out(&mut w, &mut interface, &controller, Vec::new());
                    if let Some(layout) = interface.layout() {
                        artist.paint(layout, &layout.textures);
                    }
                }
                assert!(shown.flight_at().is_some_and(|at| at.width() > 100.0 && at.is_finite()), "{what} {n}");
                let layout = interface.layout().unwrap();
                assert!(!layout.tessellate().is_empty(), "{what} {n}");
            }
        }
    }

    #[test]
    fn what_is_damaged_is_told_and_left_as_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("layout.json");
        for text in [
            "",
            "{",
            "[]",
            "{\"version\": 1}",
            "{\"version\": 2, \"layout\": \"flight\", \"shares\": {}, \"beside\": {}}",
            "{\"version\": 1, \"layout\": \"flight\", \"shares\": {\"flight\": {\"0\": \"x\"}}, \"beside\": {}}",
        ] {
            std::fs::write(&path, text).unwrap();
            let (made, error) = workspace(&path);
            assert!(error.is_some_and(|e| !e.to_string().contains('\n')), "{text}");
            made.keep().unwrap();
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        }
        // Layouts and panels that no longer exist are not an error.
        let old =
            "{\"version\": 1, \"layout\": \"x\", \"shares\": {\"x\": {}}, \"beside\": {\"flight\": {\"gone\": true}}}";
        std::fs::write(&path, old).unwrap();
        assert!(workspace(&path).1.is_none());
        // A panel that did not exist then is shown if it is shown initially.
        let new = PanelEntry { name: "new", shown: true, ..PanelEntry::NONE };
        let (made, _) = Workspace::new(&[entries(), vec![new]].concat(), None, Some(path));
        assert!(made.layouts[0].is_shown("new") && !made.layouts[0].is_shown("own"));
    }
}
