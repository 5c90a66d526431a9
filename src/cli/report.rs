//! `colvis report`.

use std::path::Path;
use std::sync::Arc;

use crate::app::Timings;
use crate::app::scan::check_thick;
use crate::cli::Program;
use crate::cli::args::{Global, ReportArgs, ReportSubject};
use crate::cli::messages::{print, say};
use crate::cli::prepare;
use crate::cli::shared::Use;
use crate::error::{Error, Result};
use crate::host::terminal::Bar;
use crate::output;
use crate::phantom::{self, Phantom};
use crate::progress::Progress;
use crate::render::CameraModel;
use crate::report::render::{Extent, Subject};
use crate::report::{
    Effort, candidates, cleansing, coverage, dynamics, fields, gradients, perforation, render, scenes, unfold,
};
use crate::space::PreparedVolume;
use crate::volume::Volume;

/// The reports, with their names.
const ALL: [(ReportSubject, &str); 10] = [
    (ReportSubject::Render, "render"),
    (ReportSubject::Gradients, "gradients"),
    (ReportSubject::Scenes, "scenes"),
    (ReportSubject::Dynamics, "dynamics"),
    (ReportSubject::Fields, "fields"),
    (ReportSubject::Perforation, "perforation"),
    (ReportSubject::Cleansing, "cleansing"),
    (ReportSubject::Coverage, "coverage"),
    (ReportSubject::Unfold, "unfold"),
    (ReportSubject::Candidates, "candidates"),
];

/// Runs the command. Fails with status 2 for invalid options, 3 for an unusable input, 4 if interrupted, 5 if an output cannot be
/// written.
pub(crate) fn run(program: &Program, args: &ReportArgs, global: &Global, progress: &Arc<Progress>) -> Result<()> {
    prepare::transfer(global)?;
    prepare::fov(global, CameraModel::default())?;
    if let Some(scan) = args.scan.as_deref().filter(|s| !s.exists()) {
        return Err(Error::file(scan, "does not exist", "check the name"));
    }
    if args.truth.is_some() && args.scan.is_none() {
        return Err(Error::usage("--truth", "needs the scan that it describes", "add --scan"));
    }
    output::make_folder(&args.out)?;
    let findings = {
        let _bar = Bar::show(progress);
        let mut findings = Vec::new();
        for (subject, name) in ALL {
            let all = args.subject == ReportSubject::All;
            if all || subject == args.subject {
                let folder = if all { args.out.join(name) } else { args.out.clone() };
                findings.extend(one(program, subject, args, global, &folder, progress)?);
                findings.push(format!("see {}", folder.join("report.html").display()));
            }
        }
        findings
    };
    print(|out| findings.iter().try_for_each(|f| writeln!(out, "{f}")))
}

fn one(
    program: &Program,
    subject: ReportSubject,
    args: &ReportArgs,
    global: &Global,
    folder: &Path,
    progress: &Progress,
) -> Result<Vec<String>> {
    match subject {
        ReportSubject::Render => {
            let extent = Extent::new(Effort::new(args.quick), prepare::fov(global, CameraModel::default())?);
            render::report(&subjects(args, global, progress)?, &extent, folder, progress)
        }
        ReportSubject::Gradients => gradients::report(Effort::new(args.quick), folder, progress),
        ReportSubject::Dynamics => {
            dynamics::report(Effort::new(args.quick), prepared(args, global, progress)?, folder, progress)
        }
        ReportSubject::Perforation => {
            let steps = args.steps.unwrap_or(if args.quick { 20_000 } else { 1_000_000 });
            perforation::report(steps, global.seed.unwrap_or(1), folder, progress)
        }
        ReportSubject::Cleansing => {
            cleansing::report(Effort::new(args.quick), global.seed.unwrap_or(1), folder, progress)
        }
        ReportSubject::Coverage => {
            let (effort, seed) = (Effort::new(args.quick), global.seed.unwrap_or(1));
            coverage::report(effort, seed, prepared(args, global, progress)?, folder, progress)
        }
        ReportSubject::Candidates => {
            let truth = args.truth.as_deref().map(candidates::read_truth).transpose()?;
            let own = match args.scan.as_deref() {
                Some(path) => {
                    // It is cleansed in any case, and not twice.
                    let global = Global { cleanse: false, ..global.clone() };
                    let (title, volume) = scan(path, &global, progress)?;
                    Some(candidates::Own { title, volume, truth })
                }
                None => None,
            };
            let detectors = &program.catalog.detectors;
            let (effort, seed, transfer) =
                (Effort::new(args.quick), global.seed.unwrap_or(1), prepare::transfer(global)?);
            candidates::report(effort, seed, detectors, transfer, own, folder, progress)
        }
        ReportSubject::Unfold => {
            // It is cleansed in any case, and not twice.
            let own = Global { cleanse: false, ..global.clone() };
            let scan = args.scan.as_deref().map(|s| scan(s, &own, progress)).transpose()?;
            unfold::report(Effort::new(args.quick), global.seed.unwrap_or(1), scan, folder, progress)
        }
        ReportSubject::Fields => {
            let scan = args.scan.as_deref().map(|s| scan(s, global, progress)).transpose()?;
            fields::report(Effort::new(args.quick), global.seed.unwrap_or(1), scan, folder, progress)
        }
        _ => {
            let volume = phantom(args.quick, global, progress)?;
            scenes::report(&volume, &program.catalog.plugins, Effort::new(args.quick), folder, progress)
        }
    }
}

/// A scan with its title.
fn scan(path: &Path, global: &Global, progress: &Progress) -> Result<(String, Volume)> {
    let volume = prepare::load(path, global, Use::Change, &mut Timings::default(), progress)?.into_volume();
    check_thick(&volume)?;
    Ok((title(path), volume))
}

/// The scan of the arguments with its title, prepared for rays.
fn prepared(args: &ReportArgs, global: &Global, progress: &Progress) -> Result<Option<(String, PreparedVolume)>> {
    let transfer = prepare::transfer(global)?;
    let scan = args.scan.as_deref().map(|s| scan(s, global, progress)).transpose()?;
    Ok(scan.map(|(title, volume)| (title, PreparedVolume::new(Arc::new(volume), transfer))))
}

/// Only the file's name: a path may identify a patient.
fn title(path: &Path) -> String {
    path.file_name().map_or_else(|| "Scan".to_owned(), |n| n.to_string_lossy().into_owned())
}

/// The phantom, and the scan if given.
fn subjects(args: &ReportArgs, global: &Global, progress: &Progress) -> Result<Vec<Subject>> {
    let size = if args.quick { "small" } else { "standard" };
    let named = format!("Phantom ({size}, seed {})", global.seed.unwrap_or(1));
    let mut subjects =
        vec![Subject { name: "phantom".to_owned(), title: named, volume: phantom(args.quick, global, progress)? }];
    match &args.scan {
        Some(scan) => {
            let volume = prepare::load(scan, global, Use::Change, &mut Timings::default(), progress)?.into_volume();
            check_thick(&volume)?;
            let volume = PreparedVolume::new(Arc::new(volume), prepare::transfer(global)?);
            subjects.push(Subject { name: "scan".to_owned(), title: title(scan), volume });
        }
        None => say("measures the phantom only; --scan F adds a scan"),
    }
    Ok(subjects)
}

fn phantom(small: bool, global: &Global, progress: &Progress) -> Result<PreparedVolume> {
    let size = if small { phantom::Size::Small } else { phantom::Size::Standard };
    let settings =
        phantom::PhantomSettings { size, seed: global.seed.unwrap_or(1), ..phantom::PhantomSettings::default() };
    let phantom = Phantom::new(&settings);
    let volume = phantom.voxelise(&phantom.grid(), progress)?;
    Ok(PreparedVolume::new(Arc::new(volume), prepare::transfer(global)?))
}
