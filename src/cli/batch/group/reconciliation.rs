//! The list of cases and the folders: what is missing, what nobody asked for, what is there twice.

use std::collections::{BTreeMap, BTreeSet};

use super::rows::{Found, Row, State};

/// Where the ids of all cases are from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    Manifest,
    /// The list that a run left in the folder of cases.
    List,
    /// There is no list.
    None,
    /// The list in the folder of cases cannot be read.
    Unreadable,
}

/// What differs between the list and the folders.
#[derive(Debug)]
pub(super) struct Reconciliation {
    pub(super) source: Source,
    /// Number of ids in the list.
    pub(super) listed: usize,
    /// Ids of the list without a case.
    pub(super) missing: Vec<String>,
    /// Cases that the list does not have.
    pub(super) extra: Vec<String>,
    /// Cases with the same scan.
    pub(super) twice: Vec<Vec<String>>,
    /// Folders with the record of another case, and that case.
    pub(super) renamed: Vec<(String, String)>,
    /// Cases that are being written, or were when a run was interrupted.
    pub(super) interrupted: Vec<String>,
    /// Folders without a record that the list does not have.
    pub(super) without_record: Vec<String>,
}

/// Compares the list with what was found. Returns the rows of all cases, those that are missing too, by their ids.
pub(super) fn reconcile(found: Found, source: Source, listed: Option<&BTreeSet<String>>) -> (Vec<Row>, Reconciliation) {
    let Found { mut rows, without_record, interrupted } = found;
    let is_listed = |id: &String| listed.is_some_and(|l| l.contains(id));
    let there: BTreeSet<&String> = rows.iter().map(|r| &r.id).collect();
    let missing: Vec<String> = listed.into_iter().flatten().filter(|id| !there.contains(id)).cloned().collect();
    let extra = rows.iter().map(|r| &r.id).filter(|id| listed.is_some() && !is_listed(id)).cloned().collect();
    let mut same: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for row in rows.iter().filter(|r| !r.content.is_empty()) {
        same.entry(&row.content).or_default().push(row.id.clone());
    }
    let mut twice: Vec<Vec<String>> = same.into_values().filter(|ids| ids.len() > 1).collect();
    twice.sort_unstable();
    let renamed = rows.iter().filter_map(|r| Some((r.id.clone(), r.other_id.clone()?))).collect();
    let added = missing.iter().map(|id| {
        let why = match without_record.binary_search(id) {
            Ok(_) => "its folder has no case.json",
            Err(_) if interrupted.contains(id) => "it is being made, or a run was interrupted",
            Err(_) => "it has no folder",
        };
        Row::unknown(id, State::Missing, "missing", why)
    });
    let added: Vec<Row> = added.collect();
    rows.extend(added);
    rows.sort_by(|a, b| a.id.cmp(&b.id));
    let without_record = without_record.into_iter().filter(|id| !is_listed(id)).collect();
    let listed = listed.map_or(0, BTreeSet::len);
    (rows, Reconciliation { source, listed, missing, extra, twice, renamed, interrupted, without_record })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(id: &str, content: &str) -> Row {
        Row { content: content.to_owned(), ..Row::unknown(id, State::Done, "", "") }
    }

    fn found() -> Found {
        let mut copied = row("f", "");
        copied.other_id = Some("a".to_owned());
        Found {
            rows: vec![row("a", "1"), row("b", "2"), row("d", "1"), row("e", ""), copied],
            without_record: vec!["empty".to_owned(), "half".to_owned()],
            interrupted: vec!["late".to_owned()],
        }
    }

    #[test]
    fn missing_extra_and_double_cases_are_told() {
        let listed: BTreeSet<String> = ["a", "b", "c", "e", "f", "half", "late"].map(str::to_owned).into();
        let (rows, told) = reconcile(found(), Source::Manifest, Some(&listed));
        assert_eq!((told.listed, told.missing.join(" "), told.extra.join(" ")), (7, "c half late".into(), "d".into()));
        assert_eq!(told.twice, [["a", "d"]], "cases without a hash are not the same");
        assert_eq!(told.renamed, [("f".to_owned(), "a".to_owned())]);
        assert_eq!((told.without_record.join(" "), told.interrupted.join(" ")), ("empty".into(), "late".into()));
        let ids: Vec<_> = rows.iter().map(|r| r.id.as_str()).collect();
        assert_eq!(ids, ["a", "b", "c", "d", "e", "f", "half", "late"]);
        let why = |n: usize| (rows[n].state, rows[n].failures[0].line.as_str());
        assert_eq!(why(2), (State::Missing, "it has no folder"));
        assert_eq!(why(6), (State::Missing, "its folder has no case.json"));
        assert_eq!(why(7), (State::Missing, "it is being made, or a run was interrupted"));
    }

    #[test]
    fn without_a_list_nothing_is_missing_or_extra() {
        let (rows, told) = reconcile(found(), Source::None, None);
        assert!(told.missing.is_empty() && told.extra.is_empty() && told.twice.len() == 1);
        assert_eq!((rows.len(), told.without_record.len()), (5, 2));
    }
}
