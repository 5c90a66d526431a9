//! `colvis slice`.

use std::io;
use std::path::Path;

use crate::cli::args::{Global, ImageSize, SliceArgs};
use crate::cli::files;
use crate::cli::prepare;
use crate::error::{Error, Result};
use crate::host::record::write_grey_png;
use crate::output;
use crate::progress::Progress;
use crate::render::slice::{Slab, Slice, Windowing};
use crate::volume::Volume;

/// Rows between two checks for an interrupt.
const BAND: usize = 64;

/// Output format of the picture.
#[derive(Clone, Copy)]
enum Format {
    Png,
    Npy,
}

impl Format {
    /// The format of a file's ending.
    fn of(path: &Path) -> Result<Self> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        match ending.as_str() {
            "png" => Ok(Self::Png),
            "npy" => Ok(Self::Npy),
            _ => {
                let why = "its extension is not that of an image or NumPy file";
                Err(Error::usage(path.display().to_string(), why, "end it in .png or .npy"))
            }
        }
    }
}

/// Runs the command. Fails with status 2 for invalid options, 3 if the input cannot be read, 4 if the point is outside the scan or
/// if interrupted, 5 if the picture cannot be written.
pub(crate) fn run(args: &SliceArgs, global: &Global, progress: &Progress) -> Result<()> {
    let format = Format::of(&args.out)?;
    let usage = |option: &'static str, hint: &'static str| move |why: String| Error::usage(option, why, hint);
    let frame =
        args.plane.frame().map_err(usage("--plane", "give axial, coronal, sagittal or a normal such as 1,0,2"))?;
    let middle = Windowing::default();
    let windowing = Windowing::new(args.level.unwrap_or(middle.level()), args.window.unwrap_or(middle.width()))
        .map_err(usage("--window", "give a width in HU such as 400"))?;
    if let Some(s) = args.mm_per_pixel.filter(|s| !(1e-6..=1e6).contains(s)) {
        let why = format!("pixel size {s} mm is out of range");
        return Err(Error::usage("--mm-per-pixel", why, "give a size in mm such as 0.5"));
    }
    files::check_folders(&args.out, None)?;
    let volume = prepare::load_or_phantom(args.input.as_deref(), global, progress)?;
    let size = args.size.unwrap_or(ImageSize { width: 512, height: 512 });
    let slice = Slice {
        centre: args.at.0,
        frame,
        mm_per_pixel: args.mm_per_pixel.unwrap_or(volume.grid().min_spacing()),
        size: [size.width, size.height],
    };
    if !volume.grid().contains(slice.centre) {
        let p = slice.centre;
        let why = format!("{},{},{} is outside the scan", p.x, p.y, p.z);
        return Err(Error::incomplete("--at", why, "give a point inside it; colvis info prints its bounds"));
    }
    progress.stage("cutting", size.height as u64);
    let slab = args.slab.unwrap_or_default();
    match format {
        Format::Png => {
            let mut grey = Vec::with_capacity(size.width * size.height);
            bands(&slice, &volume, slab, progress, |hu| {
                grey.extend(hu.iter().map(|hu| windowing.grey(*hu)));
                Ok(())
            })
            .map_err(|e| output::cannot(&args.out, e))?;
            write_grey_png(&args.out, &grey, slice.size)
        }
        Format::Npy => output::write_whole(&args.out, |w| {
            output::write_npy_head(w, &[size.height, size.width])?;
            bands(&slice, &volume, slab, progress, |hu| output::write_npy_values(w, hu))
        }),
    }
}

/// Passes the picture's HU to `take`, a few rows at a time.
fn bands(
    slice: &Slice,
    volume: &Volume,
    slab: Slab,
    progress: &Progress,
    mut take: impl FnMut(&[f32]) -> io::Result<()>,
) -> io::Result<()> {
    let [width, height] = slice.size;
    let mut hu = vec![0.0; width * height.min(BAND)];
    for first in (0..height).step_by(BAND) {
        let rows = BAND.min(height - first);
        let band = &mut hu[..width * rows];
        slice.fill_rows(volume, slab, first, band);
        take(band)?;
        progress.advance(rows as u64).map_err(io::Error::other)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::render::slice::SlicePlane;
    use crate::volume::Grid;

    #[test]
    fn an_ending_names_the_format() {
        assert!(matches!(Format::of(Path::new("a.PNG")), Ok(Format::Png)));
        assert!(matches!(Format::of(Path::new("a.png.npy")), Ok(Format::Npy)));
        for name in ["a", "a.jpg", ".png", ""] {
            assert!(Format::of(Path::new(name)).is_err(), "{name}");
        }
    }

    #[test]
    fn the_bands_of_a_slice_are_the_whole_of_it_once() {
        let grid = Grid::new([4; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let volume = Volume::new(grid, (0i16..64).map(|n| 10 * n).collect());
        for height in [1, BAND - 1, BAND, BAND + 1, 2 * BAND, 3 * BAND - 7] {
            let slice = Slice {
                centre: DVec3::splat(1.5),
                frame: SlicePlane::Coronal.frame().unwrap(),
                mm_per_pixel: 3.0 / height as f64,
                size: [5, height],
            };
            let (mut whole, mut taken) = (Vec::new(), Vec::new());
            slice.fill(&volume, &mut whole);
            let take = |hu: &[f32]| {
                taken.extend_from_slice(hu);
                Ok(())
            };
            bands(&slice, &volume, Slab::default(), &Progress::new(), take).unwrap();
            assert_eq!(taken.len(), 5 * height);
            assert!(taken == whole, "{height} rows");
        }
    }
}
