//! `colvis phantom`.

use std::path::PathBuf;

use crate::cli::args::{Global, PhantomArgs, PhantomFeature, PhantomPosition, PhantomSize};
use crate::error::Result;
use crate::output;
use crate::phantom::{Phantom, PhantomSettings, Position, Size};
use crate::progress::Progress;
use crate::volume::io;

/// Runs the command.
///
/// # Errors
/// Returns status 2 for an unknown ending, 4 if cancelled, 5 if an output cannot be written.
pub(crate) fn run(args: &PhantomArgs, global: &Global, progress: &Progress) -> Result<()> {
    let volumes = || std::iter::once(&args.out).chain(&args.twin).map(PathBuf::as_path);
    output::check_targets(
        &[],
        &volumes().chain(args.truth.as_deref()).chain(args.labels.as_deref()).collect::<Vec<_>>(),
    )?;
    volumes().chain(args.labels.as_deref()).try_for_each(io::check_ending)?;
    let has = |feature| args.with.contains(&feature);
    let phantom = Phantom::new(&PhantomSettings {
        size: match args.size {
            PhantomSize::Small => Size::Small,
            PhantomSize::Standard => Size::Standard,
            PhantomSize::Large => Size::Large,
        },
        folds: has(PhantomFeature::Folds),
        polyps: has(PhantomFeature::Polyps),
        fluid: has(PhantomFeature::Fluid),
        pools: has(PhantomFeature::Pools),
        films: has(PhantomFeature::Films),
        stool: has(PhantomFeature::Stool),
        inhomogeneous: has(PhantomFeature::Inhomogeneous),
        pseudo: has(PhantomFeature::Pseudo),
        position: match args.position {
            PhantomPosition::Supine => Position::Supine,
            PhantomPosition::Prone => Position::Prone,
            PhantomPosition::Left => Position::Left,
            PhantomPosition::Right => Position::Right,
        },
        bridges: has(PhantomFeature::Bridges),
        lesions: has(PhantomFeature::Lesions),
        decoys: has(PhantomFeature::Decoys),
        ileum: has(PhantomFeature::Ileum),
        stomach: has(PhantomFeature::Stomach),
        lungs: has(PhantomFeature::Lungs),
        collapsed: has(PhantomFeature::Collapsed),
        pelvis: has(PhantomFeature::Pelvis),
        noise: has(PhantomFeature::Noise),
        seed: global.seed.unwrap_or(1),
    });
    let volume = phantom.voxelise(&phantom.grid(), progress)?;
    let truth = args.truth.as_ref().map(|path| (path, phantom.truth()));
    progress.check()?;
    io::save(&args.out, &volume, progress)?;
    drop(volume);
    if let Some(path) = &args.twin {
        io::save(path, &phantom.twin().voxelise(&phantom.grid(), progress)?, progress)?;
    }
    if let Some(path) = &args.labels {
        let grid = phantom.grid();
        io::save_mask(path, &grid, &phantom.labels(&grid, progress)?, progress)?;
    }
    match truth {
        Some((path, truth)) => output::write_json(path, &truth),
        None => Ok(()),
    }
}
