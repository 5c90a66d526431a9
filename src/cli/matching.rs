//! `colvis match`: which places of two scans of one patient belong together.

use std::path::Path;

use serde_json::json;

use crate::app::Timings;
use crate::cli::args::{Global, MatchArgs};
use crate::cli::colon::Colon;
use crate::cli::messages::say;
use crate::cli::prepare;
use crate::error::{Error, Result};
use crate::fields::matching::{Matching, has_line};
use crate::output;
use crate::progress::Progress;

/// Runs the command. Fails with status 3 if an input cannot be read, 4 if one has no colon or no line through it, or if interrupted, 5 if
/// an output cannot be written.
pub(crate) fn run(args: &MatchArgs, global: &Global, progress: &Progress) -> Result<()> {
    let outputs: Vec<&Path> =
        [Some(&args.out), args.stats.as_ref()].into_iter().flatten().map(|p| p.as_path()).collect();
    output::check_folders(&outputs)?;
    let mut timings = Timings::default();
    let mut colon = |path| Colon::cleansed(path, global, &mut timings, progress).map(|(colon, _)| colon);
    let (a, b) = (colon(&args.a)?, colon(&args.b)?);
    let matched = timings.time("match_s", || Matching::new((&a.lumen, &a.along), (&b.lumen, &b.along), progress))?;
    let Some(matched) = matched else {
        let [first, second] = [&a.lumen, &b.lumen].map(|lumen| lumen.segments.len());
        let which = if has_line(&a.lumen, &a.along) { &args.b } else { &args.a };
        let why = format!("no line leads from the rectum to the cecum: the colons are in {first} and {second} pieces");
        return Err(Error::incomplete(which.display().to_string(), why, "give scans whose colons are better filled"));
    };
    let gaps = matched.gaps();
    for (name, gaps) in ["the first scan", "the second scan"].into_iter().zip(gaps) {
        for [from, to] in gaps {
            say(&format!("from {from:.0} to {to:.0} mm {name} is collapsed: what belongs there is a guess"));
        }
    }
    if matched.is_reversed() {
        say("one of the two lines runs from the cecum to the rectum: distances along the second scan shrink");
    }
    output::write_json(
        &args.out,
        &json!({
            "pairs": matched.pairs(),
            "turn_degrees": matched.turns(),
            "length_mm": matched.lengths_mm(),
            "cleansed": [a.is_cleansed, b.is_cleansed],
            "reversed": matched.is_reversed(),
            "gaps": {"a": gaps[0], "b": gaps[1]},
        }),
    )?;
    if let Some(path) = &args.stats {
        let mut stats = prepare::stats_head(&timings);
        let pairs = matched.pairs();
        let mut uncertain: Vec<f64> = pairs.iter().map(|p| p[2]).collect();
        uncertain.sort_by(f64::total_cmp);
        let share = |share: f64| uncertain.get(((uncertain.len() - 1) as f64 * share) as usize).copied();
        stats.insert("pairs".to_owned(), json!(pairs.len()));
        stats.insert("uncertainty_mm".to_owned(), json!([share(0.5), share(0.95)]));
        output::write_json(path, &stats)?;
    }
    Ok(())
}
