//! Points of the wall for layouts that list some, with the frames that see them.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use glam::DVec3;
use rayon::prelude::*;

use super::{Source, path};
use crate::dataset::layout::{Layout, Point};
use crate::error::{Error, Result};
use crate::output::{self, png};
use crate::progress::Progress;
use crate::render::View;
use crate::render::leap::Crossings;

/// A point is looked for in so many frames before and after.
const REACH: usize = 3;

/// Returns points of the wall that several frames see, as many as the layout wants. Their colours are those of the pictures, which are in
/// `folder`.
pub(super) fn find(
    (source, rays): (&Source<'_>, &Crossings),
    layout: &dyn Layout,
    folder: &Path,
    progress: &Progress,
) -> Result<Vec<Point>> {
    let wanted = layout.points();
    // Points of a deformed wall are nowhere for long.
    if wanted == 0 || source.deformation.is_some() {
        return Ok(Vec::new());
    }
    progress.stage("points", source.count as u64);
    let each = |n: usize| {
        progress.advance(1)?;
        of_frame((source, rays), wanted, n)
    };
    let all: Vec<Vec<Point>> = (0..source.count).into_par_iter().map(each).collect::<Result<_>>()?;
    let mut all: Vec<Point> = all.into_iter().flatten().collect();
    progress.stage("colours of points", source.count as u64);
    let colours = (0..source.count).into_par_iter().map(|n| {
        progress.advance(1)?;
        let (view, seconds) = (source.views)(n)?;
        let file = path(folder, &layout.picture(n, seconds));
        let pixels = picture(&file, view.width().max(view.height()))?;
        let first = all.iter().enumerate().filter(|(_, p)| p.seen[0].0 == n);
        let colour = |[u, v]: [f64; 2]| {
            pixels.get(v as usize * view.width() + u as usize).copied().ok_or_else(|| damaged(&file))
        };
        first.map(|(k, p)| Ok((k, colour(p.seen[0].1)?))).collect::<Result<Vec<_>>>()
    });
    for (k, colour) in colours.collect::<Result<Vec<_>>>()?.into_iter().flatten() {
        all[k].colour = colour;
    }
    Ok(all)
}

/// Returns points of a frame on an even lattice of its pixels that other frames see, too.
fn of_frame((source, rays): (&Source<'_>, &Crossings), wanted: usize, n: usize) -> Result<Vec<Point>> {
    let (view, _) = (source.views)(n)?;
    let (width, height) = (view.width(), view.height());
    let step = ((width * height) as f64 / wanted as f64).sqrt().max(1.0);
    let near = n.saturating_sub(REACH)..(n + REACH + 1).min(source.count);
    let others = near.filter(|o| *o != n).map(|o| Ok((o, (source.views)(o)?.0))).collect::<Result<Vec<_>>>()?;
    let mut found = Vec::new();
    for row in 0..(height as f64 / step) as usize {
        for column in 0..(width as f64 / step) as usize {
            let (x, y) = (((column as f64 + 0.5) * step) as usize, ((row as f64 + 0.5) * step) as usize);
            let Some(ray) = view.ray(x, y) else { continue };
            let met = rays.first(ray.origin, ray.direction);
            let Some(mm) = met.filter(|mm| *mm > 0.0) else { continue };
            let place = ray.origin + ray.direction * mm;
            let mut seen = vec![(n, [x as f64 + 0.5, y as f64 + 0.5])];
            seen.extend(others.iter().filter_map(|(o, view)| Some((*o, sees(rays, view, place)?))));
            seen.sort_by_key(|s| s.0);
            if seen.len() > 1 {
                found.push(Point { place, colour: [0; 3], seen });
            }
        }
    }
    Ok(found)
}

/// Returns where a view sees a point of the wall, pixels from the top left corner; `None` if it does not.
fn sees(rays: &Crossings, view: &View, place: DVec3) -> Option<[f64; 2]> {
    let at @ [u, v] = view.project(place)?;
    let inside = (0.0..view.width() as f64).contains(&u) && (0.0..view.height() as f64).contains(&v);
    let way = place - view.position();
    let met = rays.first(view.position(), way.normalize_or_zero());
    (inside && view.ray_at(u, v).is_some() && met.is_none_or(|mm| mm >= way.length() - 0.01)).then_some(at)
}

/// Returns the pixels of a picture, row by row from the top.
fn picture(file: &Path, longest: usize) -> Result<Vec<[u8; 3]>> {
    let bytes = fs::read(file).map_err(|e| output::cannot(file, e))?;
    let pixels = png::Decoder::new(Cursor::new(bytes), longest as u32).and_then(png::Decoder::read);
    Ok(pixels.map_err(|_| damaged(file))?.rgba().map(|[r, g, b, _]| [r, g, b]).collect())
}

/// The error of a picture that was there, and cannot be read.
fn damaged(file: &Path) -> Error {
    Error::file(file, "is no picture of this dataset", "remove it, and run the command again")
}
