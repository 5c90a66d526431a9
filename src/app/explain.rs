//! Explains a flight: what it runs and builds, what it leaves out, and why.

use std::borrow::Cow;

use serde::Serialize;

use crate::components::guide::{MineField, Tentacles};
use crate::components::output::{FrameCache, Picture};
use crate::coverage::LiveCoverage;
use crate::flight::views;
use crate::render::{Leaping, MemoryPart};
use crate::schedule::{LeftOut, PluginTime};
use crate::{FlightApp, Setup};

/// A data structure that a flight keeps in memory.
#[derive(Clone, Debug, Serialize)]
pub struct Built {
    /// Name of the data structure.
    pub part: Cow<'static, str>,
    /// Size in bytes.
    pub bytes: usize,
    /// The part of the flight that needs it.
    pub needed_by: Cow<'static, str>,
}

impl Built {
    fn new<By: Into<Cow<'static, str>>>(part: &'static str, bytes: usize, needed_by: By) -> Self {
        Self { part: part.into(), bytes, needed_by: needed_by.into() }
    }
}

/// What was cleansed in a scan.
#[derive(Clone, Debug, Serialize)]
pub struct Taken {
    /// What was removed, and what remains.
    pub text: String,
    /// How long that took, s, with finding the lumen again; `None` if unknown.
    pub seconds: Option<f64>,
}

/// The explanation of a flight.
#[derive(Clone, Debug, Serialize)]
pub struct Explanation {
    /// Systems of a simulation step, in the order they run.
    pub step: Vec<String>,
    /// Systems of a frame, in the order they run.
    pub frame: Vec<String>,
    /// Plug-ins, in the order in which they were built.
    pub plugins: Vec<String>,
    /// Run times of plug-ins and of guides of other crates, up to the current state of the flight.
    pub plugin_times: Vec<PluginTime>,
    /// Components of the entities. Those of other crates have the crate's name.
    pub components: Vec<String>,
    /// What was cleansed in the scan that is flown; `None` if it is flown as scanned.
    pub cleansed: Option<Taken>,
    /// Data structures in memory.
    pub built: Vec<Built>,
    /// Parts that are left out, and why.
    pub left_out: Vec<LeftOut>,
}

/// Explains a flight in its current state.
///
/// ```
/// # use colvis_app as colvis;
/// use colvis::app::explain::explain;
/// use colvis::app::{Scan, Scene, FlightRequest};
///
/// let flight = Scan::phantom(1)?.flight(Scene::guided_by("manual"), &FlightRequest::default())?;
/// let told = explain(&flight);
/// assert!(told.step.iter().any(|system| system == "motion::move_body"));
/// assert!(told.left_out.iter().any(|part| part.part == "tentacles"), "no guide uses sensory rays");
/// # Ok::<(), colvis::error::Error>(())
/// ```
pub fn explain(flight: &FlightApp) -> Explanation {
    let [step, frame] = flight.app().inspect().systems();
    let Setup { volume, lumen, scene, fields, cleansed, .. } = flight.setup();
    let cleansed = cleansed.as_ref().filter(|c| !c.changes.is_empty());
    let part = Built::new::<&'static str>;
    let mut built = vec![
        part("volume (16 bit)", volume.voxels().bytes(), "everything"),
        part("lumen (runs)", lumen.bytes(), "start and end of the flight"),
        part("homogeneous-region flags", volume.bytes(), "rays: the first heading, tentacles, images"),
    ];
    if let Some(c) = cleansed {
        built.push(part(
            "values before cleansing",
            c.changes.bytes(),
            "the flight through fluid; a window shows the scan as scanned",
        ));
    }
    if let Some(t) = flight.camera::<Tentacles>() {
        built.push(part("tentacles", t.bytes(), "the guide"));
    }
    if let Some(m) = flight.camera::<MineField>() {
        built.push(part("mines", m.settings.kept * size_of::<glam::DVec3>(), "the guide"));
    }
    if let Some(c) = flight.camera::<LiveCoverage>() {
        built.push(part("wall, and which of it was seen", c.bytes(), "coverage"));
    }
    if let Some(w) = fields.walls() {
        built.push(part("wall distance field", w.bytes(), "the guide: D_s, and D_t lies on it"));
    }
    if let Some(t) = fields.target() {
        built.push(part("target distance field", t.bytes(), "the guide: D_t"));
    }
    if let Some(r) = fields.route() {
        built.push(Built::new(
            "centerline",
            r.bytes(),
            format!("the guide: its plan (planner {})", scene.needs().planner.name()),
        ));
    }
    let pixels = |p: &Picture| p.frame.width() * p.frame.height() * size_of::<[u8; 3]>();
    if let Some(p) = flight.camera::<Picture>() {
        built.push(part("picture", pixels(p), "a window or a recording"));
    }
    for (n, (view, cache)) in flight.other_views().into_iter().enumerate() {
        let bytes = pixels(view) + cache.renderer().map_or(0, |r| r.bytes().saturating_sub(volume.bytes()));
        built.push(Built { part: format!("view {}", n + 2).into(), bytes, needed_by: "a plug-in".into() });
    }
    let slices: usize = views::slices(flight.app()).iter().map(|s| s.bytes()).sum();
    if slices > 0 {
        built.push(part("slices", slices, "the panels that show them"));
    }
    let mut left_out = flight.app().inspect().left_out().to_vec();
    if let (Some(picture), Some(renderer)) =
        (flight.camera::<Picture>(), flight.camera::<FrameCache>().and_then(FrameCache::renderer))
    {
        // The flags are listed above, as everything that casts rays needs them.
        let own = renderer.parts().into_iter().filter(|p| !built.iter().any(|b| b.part == p.0.name()));
        let choices = picture.settings.choices;
        let needed_by = |part| match part {
            MemoryPart::VoxelDistances => "the scene: [render] leap = \"voxel\"",
            MemoryPart::BrickDistances if choices.leap == Some(Leaping::Brick) => {
                "the scene: [render] leap = \"brick\""
            }
            MemoryPart::StoredGradients => "the scene: [render] gradients = \"stored\"",
            MemoryPart::GradientCache if choices.gradients.is_some() => "the scene: [render] gradients = \"cached\"",
            MemoryPart::FrameCache if choices.key_frames.is_some() => "the scene: [render] key_frames",
            _ => "the picture's preset",
        };
        let reported = |(part, bytes): (MemoryPart, usize)| Built::new(part.name(), bytes, needed_by(part));
        built.extend(own.map(reported).collect::<Vec<_>>());
    }
    let pictures = flight.camera::<Picture>().is_some() && scene.picture;
    let other = |why| if pictures { why } else { "there is no picture" };
    for (part, why) in [
        ("frame cache", other("only the preset colvis or [render] key_frames keeps bounds from frame to frame")),
        ("volume (7 + 1 bit)", other("only the preset colvis samples it")),
        ("gradient cache", other("nothing in the scene keeps gradients of voxels or cells")),
        ("wall distance per voxel", other("no preset asks for it, and no [render] leap = \"voxel\"")),
        ("precomputed gradients", other("no preset asks for it, and no [render] gradients = \"stored\"")),
    ] {
        if !built.iter().any(|b| b.part == part) {
            left_out.push(LeftOut { part, why: why.to_owned() });
        }
    }
    if cleansed.is_none() {
        let why = match (&flight.setup().cleansed, scene.play()) {
            (Some(_), _) => "the colon contains no tagged fluid or stool",
            (None, Some(_)) => "a log is replayed",
            (None, None) if scene.needs().fluid_as_gas => "the flight was made from a volume",
            (None, None) if scene.operator && scene.picture => {
                "the guide does not fly through fluid; the window cleanses the scan after its first image"
            }
            (None, None) => "the guide does not fly through fluid; --cleanse cleanses the scan anyway",
        };
        left_out.push(LeftOut { part: "cleansing", why: why.to_owned() });
    }
    if !volume.flags().has_bits() {
        let why = "the preset lean does not use it: rays leap from brick to brick".to_owned();
        left_out.push(LeftOut { part: "a flag for each voxel", why });
    }
    let plugins = flight.app().inspect().plugged().to_vec();
    let plugin_times = flight.app().inspect().plugin_times();
    Explanation {
        step,
        frame,
        plugins,
        plugin_times,
        components: flight.app().inspect().components_in_use(),
        cleansed: cleansed.map(|c| Taken { text: c.to_string(), seconds: None }),
        built,
        left_out,
    }
}

impl Explanation {
    /// Formats the explanation for a person.
    pub fn text(&self) -> String {
        let mut s = String::from("runs in each simulation step:\n");
        let list = |s: &mut String, names: &[String]| {
            for (n, name) in names.iter().enumerate() {
                s.push_str(&format!("  {}. {name}\n", n + 1));
            }
            if names.is_empty() {
                s.push_str("  nothing\n");
            }
        };
        list(&mut s, &self.step);
        s.push_str("runs in each frame:\n");
        list(&mut s, &self.frame);
        if !self.plugins.is_empty() {
            s.push_str("plugged in:\n");
            list(&mut s, &self.plugins);
        }
        for time in &self.plugin_times {
            let slow = if time.is_slow() { ": slow" } else { "" };
            s.push_str(&format!("  {}{slow}\n", time.text()));
        }
        s.push_str("on entities:\n");
        let crate_of = |name: &str| name.split_once("::").map_or("colvis", |(krate, _)| krate).to_owned();
        for of_crate in self.components.chunk_by(|a, b| crate_of(a) == crate_of(b)) {
            let names: Vec<&str> = of_crate.iter().map(|n| n.rsplit("::").next().unwrap_or(n)).collect();
            s.push_str(&format!("  {}: {}\n", crate_of(&of_crate[0]), names.join(", ")));
        }
        if let Some(Taken { text, seconds }) = &self.cleansed {
            let in_s = seconds.map_or_else(String::new, |s| format!(", in {s:.2} s"));
            s.push_str(&format!("cleansed:\n  {text}{in_s}\n"));
        }
        let width = |parts: &mut dyn Iterator<Item = &str>| parts.map(str::len).max().unwrap_or(0);
        s.push_str("in memory:\n");
        let wide = width(&mut self.built.iter().map(|b| &*b.part));
        for b in &self.built {
            s.push_str(&format!("  {:wide$} {:>12} bytes  {}\n", b.part, b.bytes, b.needed_by));
        }
        s.push_str("left out:\n");
        let wide = width(&mut self.left_out.iter().map(|l| l.part));
        for l in &self.left_out {
            s.push_str(&format!("  {:wide$}  {}\n", l.part, l.why));
        }
        s
    }
}
