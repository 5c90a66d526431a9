//! A reader's answers to the candidates of a list, as a file.
//!
//! The gallery of `colvis candidates` saves such a file, and reads it back:
//!
//! ```json
//! {"colvis": "answers", "scan": "scan.nii.gz", "answers": [
//!     {"rank": 1, "position": [12.5, -30.0, 101.25], "answer": "yes", "note": "on a fold"}
//! ]}
//! ```
//!
//! Candidates without an answer are not in it, unless they have a note; their `answer` is null then.

use std::collections::BTreeSet;
use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::output;

/// The first field of the file, so that another list is not mistaken for one.
#[doc(hidden)]
pub const KIND: &str = "answers";
/// That of a file of findings, which holds answers too.
const FINDINGS: &str = "findings";
const HINT: &str = "give the answers that the page of candidates saved";

/// Whether a candidate is a polyp, as a reader sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Answer {
    /// It is one.
    Yes,
    /// It is not a polyp.
    No,
    /// The scan does not show it.
    Unsure,
}

/// What a reader says of one candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answered {
    /// The candidate's rank in its list, from 1.
    pub rank: usize,
    /// The candidate's position, world, mm LPS.
    pub position: DVec3,
    /// The answer; none if there is only a note.
    #[serde(default)]
    pub answer: Option<Answer>,
    /// A note, often empty.
    #[serde(default)]
    pub note: String,
}

/// A reader's answers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answers {
    /// Name of the scan's file or folder, without those that it lies in.
    pub scan: String,
    /// One entry for each candidate with an answer or a note.
    pub answers: Vec<Answered>,
}

/// The file.
#[derive(Serialize, Deserialize)]
struct File {
    colvis: String,
    scan: String,
    answers: Vec<Answered>,
}

impl Answers {
    /// Reads a file of answers.
    ///
    /// # Errors
    /// Returns status 3 if it cannot be read, is another file, or has a rank 0, a rank twice or an invalid position.
    pub fn read(path: &Path) -> Result<Self> {
        let text = output::read_text(path, HINT)?;
        let file: File =
            serde_json::from_str(&text).map_err(|e| Error::file(path, e.to_string(), HINT).caused_by(e))?;
        let wrong = |why: String| Err(Error::file(path, why, HINT));
        if ![KIND, FINDINGS].contains(&file.colvis.as_str()) {
            return wrong(format!("\"colvis\" is \"{}\" and not \"{KIND}\"", file.colvis));
        }
        if let Some(why) = impossible(&file.answers) {
            return wrong(why);
        }
        Ok(Self { scan: file.scan, answers: file.answers })
    }

    /// Writes a file of answers.
    ///
    /// # Errors
    /// Returns status 5 if it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let file = File { colvis: KIND.to_owned(), scan: self.scan.clone(), answers: self.answers.clone() };
        output::write_json(path, &file)
    }
}

/// Returns what of answers is impossible: a rank 0, a rank twice or an invalid position.
#[doc(hidden)]
pub fn impossible(answers: &[Answered]) -> Option<String> {
    let mut ranks = BTreeSet::new();
    answers.iter().find_map(|Answered { rank, position, .. }| match rank {
        0 => Some("an answer has rank 0; ranks start at 1".to_owned()),
        _ if !position.is_finite() => Some(format!("the position of rank {rank} is not finite")),
        _ => (!ranks.insert(*rank)).then(|| format!("rank {rank} is answered twice")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;

    #[test]
    fn answers_that_are_written_are_read_again() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("answers.json");
        let entry = |rank, answer, note: &str| Answered {
            rank,
            position: DVec3::new(0.1, -2.5, 1e3 * rank as f64),
            answer,
            note: note.to_owned(),
        };
        let answers = Answers {
            scan: "a \"scan\" <b>.nii.gz".to_owned(),
            answers: vec![
                entry(1, Some(Answer::Yes), ""),
                entry(7, Some(Answer::No), "a fold\nüber the valve"),
                entry(3, Some(Answer::Unsure), ""),
                entry(9, None, "only a note"),
            ],
        };
        for answers in [answers, Answers::default()] {
            answers.write(&path).unwrap();
            assert_eq!(Answers::read(&path).unwrap(), answers);
        }
        assert_eq!(Answers::default().write(&dir.path().join("no/a.json")).unwrap_err().kind, Kind::Output);
    }

    #[test]
    fn the_file_of_the_page_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("answers.json");
        let text = r#"{"colvis": "answers", "scan": "p.nii.gz", "more": 1, "answers": [
            {"rank": 2, "position": [1, 2.5, -3], "answer": "unsure", "note": ""},
            {"rank": 4, "position": [1, 2.5, -3], "answer": null, "note": "later"},
            {"rank": 5, "position": [1, 2.5, -3], "answer": "no"}]}"#;
        std::fs::write(&path, text).unwrap();
        let read = Answers::read(&path).unwrap();
        assert_eq!(read.scan, "p.nii.gz");
        let got: Vec<_> = read.answers.iter().map(|a| (a.rank, a.answer, a.note.as_str())).collect();
        assert_eq!(got, [(2, Some(Answer::Unsure), ""), (4, None, "later"), (5, Some(Answer::No), "")]);
        assert_eq!(read.answers[0].position, DVec3::new(1.0, 2.5, -3.0));
    }

    #[test]
    fn damaged_files_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("answers.json");
        assert_eq!(Answers::read(&path).unwrap_err().kind, Kind::Input, "there is none");
        let with = |answers: &str| format!("{{\"colvis\": \"answers\", \"scan\": \"s\", \"answers\": {answers}}}");
        let good = r#"[{"rank": 1, "position": [1, 2, 3], "answer": "yes", "note": ""}]"#;
        std::fs::write(&path, with(good)).unwrap();
        assert!(Answers::read(&path).is_ok());
        let whole = with(good);
        for text in [
            String::new(),
            "[]".to_owned(),
            whole[..whole.len() / 2].to_owned(),
            whole.replace("\"answers\",", "\"candidates\","),
            whole.replace("\"colvis\"", "\"program\""),
            whole.replace("\"scan\": \"s\"", "\"scan\": 3"),
            with("{}"),
            with(&good.replace("\"yes\"", "\"maybe\"")),
            with(&good.replace("\"yes\"", "\"Yes\"")),
            with(&good.replace("\"rank\": 1", "\"rank\": 0")),
            with(&good.replace("\"rank\": 1", "\"rank\": -1")),
            with(&good.replace("[1, 2, 3]", "[1, 2]")),
            with(&good.replace("[1, 2, 3]", "[1, 2, 1e999]")),
            with(&good.replace("[1, 2, 3]", "[1, 2, null]")),
            with(&format!("[{0}, {0}]", &good[1..good.len() - 1])),
        ] {
            std::fs::write(&path, &text).unwrap();
            let e = Answers::read(&path).expect_err(&text);
            assert!(e.kind == Kind::Input && e.what.ends_with("answers.json"), "{e}");
        }
        std::fs::write(&path, [0xFF, 0xFE, 0]).unwrap();
        assert_eq!(Answers::read(&path).unwrap_err().kind, Kind::Input);
    }
}
