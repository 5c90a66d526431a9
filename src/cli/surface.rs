//! `colvis surface`.

use serde_json::{Value, json};

use crate::app::Timings;
use crate::cli::args::{Global, SurfaceArgs};
use crate::cli::files;
use crate::cli::messages::say;
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::error::{Error, Result};
use crate::fields::lumen::Interior;
use crate::output;
use crate::progress::Progress;
use crate::surface::{LumenMesh, Measures, MeshFormat};
use crate::volume::Volume;

/// Runs the command. Fails with status 2 for an unknown ending or an input beside a mask, 3 if the input cannot be read, 4 if it
/// has no lumen or if interrupted, 5 if an output cannot be written.
pub(crate) fn run(args: &SurfaceArgs, global: &Global, progress: &Progress) -> Result<()> {
    MeshFormat::of(&args.out)?;
    let iso = prepare::transfer(global)?.iso();
    let (input, is_mask) = prepare::scan_or_mask("surface", args.input.as_deref(), args.mask.as_deref())?;
    if is_mask && args.from.is_some() {
        return Err(Error::usage("--from", "a mask contains only the lumen", "leave it out, or give a scan"));
    }
    files::check_folders(&args.out, args.stats.as_deref())?;
    let mut timings = Timings::default();
    let (mesh, scan) = if is_mask {
        let volume = prepare::load_mask(input, global, &mut timings, progress)?;
        if global.wall.is_some() {
            say("--wall is ignored: a mask has no HU");
        }
        (timings.time("surface_s", || of_mask(&volume, progress))?, None)
    } else {
        let input = prepare::load(input, global, Use::Look, &mut timings, progress)?;
        let lumen = input.lumen_from(args.from.map(|p| p.0), &mut timings, progress)?;
        let volume = input.volume;
        if lumen.segments.is_empty() {
            return Err(prepare::no_lumen(
                &volume,
                &lumen,
                "give --from and a point in the colon, or a mask of the lumen",
            ));
        }
        let mesh = timings
            .time("surface_s", || LumenMesh::new(&Interior::of_lumen(&volume, &lumen, iso, progress)?, progress))?;
        let (mesh, islands) = mesh.without_islands();
        (mesh, Some((lumen.segments.len(), islands)))
    };
    if mesh.triangles().is_empty() {
        return Err(Error::incomplete("surface", "there is no lumen to enclose", "check --wall or the mask"));
    }
    mesh.save(&args.out, progress)?;
    if let Some(path) = &args.stats {
        let mut stats = prepare::stats_head(&timings);
        if let Value::Object(measures) = json!(Measures::of(&mesh)) {
            stats.extend(measures);
        }
        if let Some((segments, islands)) = scan {
            stats.insert("segments".to_owned(), json!(segments));
            stats.insert("islands_left_out".to_owned(), json!(islands));
        }
        output::write_json(path, &stats)?;
    }
    Ok(())
}

fn of_mask(mask: &Volume, progress: &Progress) -> Result<LumenMesh> {
    LumenMesh::new(&Interior::of_mask(mask)?, progress)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::{DMat3, DVec3};

    use super::*;
    use crate::cli::Program;
    use crate::cli::args::Command;
    use crate::volume::{Grid, io};

    #[test]
    fn the_surface_of_a_mask_encloses_its_voxels() {
        let grid = Grid::new([14; 3], DVec3::splat(2.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let is_set = |n: usize| [n % 14, n / 14 % 14, n / 196].iter().all(|i| (3..11).contains(i));
        let mask = Volume::new(grid, (0..14 * 14 * 14).map(|n| i16::from(is_set(n))).collect());
        let measures = Measures::of(&of_mask(&mask, &Progress::new()).unwrap());
        // 8³ voxels of 8 mm³ are 4.1 ml, and smoothing takes corners and edges off.
        assert!((3.0..4.3).contains(&measures.volume_ml), "{} ml", measures.volume_ml);
        assert_eq!((measures.components, measures.boundary_edges), (1, 0));
    }

    /// A point chooses gas in a scan. In a mask there is nothing to choose.
    #[test]
    fn a_mask_needs_no_point_and_takes_none() {
        let dir = tempfile::tempdir().unwrap();
        let [mask, out] = ["mask.nii", "mesh.ply"].map(|n| dir.path().join(n).to_string_lossy().into_owned());
        let grid = Grid::new([8; 3], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
        let is_set = |n: usize| [n % 8, n / 8 % 8, n / 64].iter().all(|i| (2..6).contains(i));
        let voxels: Vec<u8> = (0..grid.len()).map(|n| u8::from(is_set(n))).collect();
        io::save_mask(Path::new(&mask), &grid, &voxels, &Progress::new()).unwrap();
        let run_with = |more: &[&str]| {
            let line = [&["colvis", "surface", "--mask", &mask, "--out", &out][..], more].concat();
            let args = Program::default().parse(line).unwrap();
            let Some(Command::Surface(surface)) = args.command else { panic!("{:?}", args.command) };
            run(&surface, &args.global, &Progress::new())
        };
        let refused = run_with(&["--from", "4,4,4"]).unwrap_err();
        assert!(refused.what == "--from" && !Path::new(&out).exists(), "{refused}");
        run_with(&[]).unwrap();
        assert!(Path::new(&out).exists());
    }
}
