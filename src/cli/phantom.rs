//! `colvis phantom`.

use crate::cli::args::{Global, PhantomArgs, PhantomFeature, PhantomSize};
use crate::cli::prepare;
use crate::error::Result;
use crate::output;
use crate::phantom::{Phantom, PhantomSettings, Size};
use crate::progress::Progress;
use crate::volume::io;

/// Runs the command.
///
/// # Errors
/// Returns status 2 for an unknown ending, 4 if cancelled, 5 if an output cannot be written.
pub(crate) fn run(args: &PhantomArgs, global: &Global, progress: &Progress) -> Result<()> {
    prepare::check_files(None, &args.out, args.truth.as_deref())?;
    io::check_ending(&args.out)?;
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
        bridges: has(PhantomFeature::Bridges),
        noise: has(PhantomFeature::Noise),
        seed: global.seed.unwrap_or(1),
    });
    let volume = phantom.voxelise(&phantom.grid(), progress)?;
    let truth = args.truth.as_ref().map(|path| (path, phantom.truth()));
    progress.check()?;
    io::save(&args.out, &volume, progress)?;
    match truth {
        Some((path, truth)) => output::write_json(path, &truth),
        None => Ok(()),
    }
}
