//! The files of a frame.

use std::path::Path;

use super::{Source, exr, path};
use crate::dataset::layout::{Content, Layout, Shot};
use crate::dataset::look::{Look, Mucosa, Picture};
use crate::dataset::truth::{Kind, Truth};
use crate::error::Result;
use crate::output::{self, png};
use crate::render::View;

/// A frame that was measured.
pub(super) struct Taken {
    pub n: usize,
    pub seconds: f64,
    pub view: View,
    pub truth: Truth,
    pub picture: Picture,
    /// The files of the picture's light, from [`kept`].
    pub kept: Vec<String>,
}

/// Returns the names of a kind's files of a frame.
pub(super) fn names(kind: Kind, n: usize) -> Vec<String> {
    match kind {
        Kind::Flow => ["flow-before", "flow-after"]
            .into_iter()
            .map(|k| format!("truth/{k}/{n:06}.npy"))
            .chain([format!("truth/unseen/{n:06}.png")])
            .collect(),
        Kind::Labels => vec![format!("truth/labels/{n:06}.png"), format!("truth/parts/{n:06}.png")],
        kind => vec![format!("truth/{}/{n:06}.npy", kind.name())],
    }
}

/// Where the exposures of frames are kept until all are there.
pub(super) const EXPOSURES: &str = "exposure";

/// Returns the name of the file that keeps a frame's exposure.
pub(super) fn exposure(n: usize) -> String {
    format!("{EXPOSURES}/{n:06}.txt")
}

/// Returns the names of the files that a look keeps of a frame beside its picture.
pub(super) fn kept(look: &Look, n: usize) -> Vec<String> {
    let all = [(true, "linear", "exr"), (look.mucosa != Mucosa::Off, "albedo", "png")];
    let all = all.into_iter().filter(|(is_kept, ..)| *is_kept && look.linear);
    all.map(|(_, folder, end)| format!("{folder}/{n:06}.{end}")).collect()
}

/// True if a frame was written. Its picture is its last file.
pub(super) fn is_there(folder: &Path, layout: &dyn Layout, source: &Source<'_>, (n, seconds): (usize, f64)) -> bool {
    let truth = source.kinds.iter().flat_map(|kind| names(*kind, n));
    let look = kept(&source.look, n).into_iter().chain([exposure(n), layout.picture(n, seconds)]);
    truth.chain(look).all(|name| path(folder, &name).is_file())
}

impl Taken {
    /// Writes the frame's files, its picture last.
    pub(super) fn save(&self, folder: &Path, layout: &dyn Layout) -> Result<()> {
        let (truth, size) = (&self.truth, [self.view.width(), self.view.height()]);
        let shape = [size[1], size[0]];
        let floats = |name: &str, values: &[f32], each: usize| {
            let shape = if each == 1 { shape.to_vec() } else { vec![shape[0], shape[1], each] };
            output::write_npy(&whole(folder, name)?, values, &shape)
        };
        let grey = |name: &str, values: &[u8]| {
            let file = whole(folder, name)?;
            output::write_whole(&file, |w| {
                png::encode(w, values, size, png::ColorType::Grayscale, png::Compression::Fast)
            })
        };
        for (kind, each, values) in [
            (Kind::Depth, 1, &truth.depth[..]),
            (Kind::Z, 1, &truth.z[..]),
            (Kind::Normals, 3, truth.normals.as_flattened()),
            (Kind::Shading, 1, &truth.shading[..]),
            (Kind::Along, 3, truth.along.as_flattened()),
        ] {
            if !values.is_empty() {
                floats(&names(kind, self.n)[0], values, each)?;
            }
        }
        if !truth.scene.is_empty() {
            floats(&format!("truth/scene-flow/{:06}.npy", self.n), truth.scene.as_flattened(), 3)?;
        }
        if !truth.flow[0].is_empty() {
            let [before, after, unseen] = &names(Kind::Flow, self.n)[..] else { return Ok(()) };
            floats(before, truth.flow[0].as_flattened(), 2)?;
            floats(after, truth.flow[1].as_flattened(), 2)?;
            let both: Vec<u8> = truth.unseen[0].iter().zip(&truth.unseen[1]).map(|(b, a)| (b << 2) | a).collect();
            grey(unseen, &both)?;
        }
        if !truth.labels.is_empty() {
            for (k, name) in names(Kind::Labels, self.n).iter().enumerate() {
                grey(name, &truth.labels.iter().map(|l| l[k]).collect::<Vec<_>>())?;
            }
        }
        let shot = Shot { n: self.n, seconds: self.seconds, view: &self.view, truth };
        for (name, content) in layout.files(&shot) {
            let file = whole(folder, &name)?;
            match content {
                Content::Grey16(values) => {
                    output::write_whole(&file, |w| png::encode16(w, &values, size, png::ColorType::Grayscale))?;
                }
                Content::Text(text) => output::write_whole(&file, |w| w.write_all(text.as_bytes()))?,
            }
        }
        self.save_light(folder, size)?;
        let file = whole(folder, &layout.picture(self.n, self.seconds))?;
        output::write_whole(&file, |w| {
            png::encode(w, self.picture.shown.as_flattened(), size, png::ColorType::Rgb, png::Compression::Fast)
        })
    }
}

/// What linear light is, in its files.
const LIGHT: &str = "R, G, B: linear light that the wall sends to the lens, 1/mm2, before exposure and noise; gloss: what of each is gloss";

impl Taken {
    /// Writes the picture's exposure, and its linear light and the wall's colour if they are kept.
    fn save_light(&self, folder: &Path, size: [usize; 2]) -> Result<()> {
        let Picture { exposure: factor, linear, gloss, albedo, .. } = &self.picture;
        let text = factor.to_string();
        output::write_whole(&whole(folder, &exposure(self.n))?, |w| w.write_all(text.as_bytes()))?;
        let values = linear.as_flattened();
        for name in &self.kept {
            let file = whole(folder, name)?;
            if name.ends_with(".exr") {
                let channels = [("B", values, 3, 2), ("G", values, 3, 1), ("R", values, 3, 0), ("gloss", gloss, 1, 0)];
                output::write_whole(&file, |w| exr::encode(w, &channels, size, LIGHT))?;
            } else {
                let steps: Vec<u16> =
                    albedo.as_flattened().iter().map(|a| (65_535.0 * a.clamp(0.0, 1.0)).round() as u16).collect();
                output::write_whole(&file, |w| png::encode16(w, &steps, size, png::ColorType::Rgb))?;
            }
        }
        Ok(())
    }
}

/// Returns the path of a file, whose folder is created.
fn whole(folder: &Path, name: &str) -> Result<std::path::PathBuf> {
    let path = path(folder, name);
    path.parent().map_or(Ok(()), output::make_folder)?;
    Ok(path)
}
