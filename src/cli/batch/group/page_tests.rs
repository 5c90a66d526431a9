use std::collections::BTreeSet;

use super::*;
use crate::cli::batch::group::distributions;
use crate::cli::batch::group::reconciliation::reconcile;
use crate::cli::batch::group::rows::{Failure, Found};

fn pages(rows: Vec<Row>, source: Source, listed: Option<&BTreeSet<String>>) -> Vec<String> {
    let dir = tempfile::tempdir().unwrap();
    let (rows, told) = reconcile(Found { rows, ..Found::default() }, source, listed);
    let distributions = distributions::all(&rows);
    let outliers = distributions::outliers(&distributions, &rows);
    let group = Group { rows: &rows, told: &told, distributions: &distributions, outliers: &outliers };
    group.write(dir.path()).unwrap();
    (0..group.pages()).map(|n| std::fs::read_to_string(dir.path().join(name(n))).unwrap()).collect()
}

fn done(id: &str) -> Row {
    Row { failures: Vec::new(), version: "1".to_owned(), ..Row::unknown(id, State::Done, "", "") }
}

#[test]
fn whatever_a_record_has_is_text() {
    let bad = "</script><b onclick=\"x()\" title='y'>&";
    let failure = Failure { class: bad.to_owned(), step: bad.to_owned(), line: bad.to_owned() };
    let rows: Vec<Row> = [format!("{bad}1"), format!("{bad}2"), format!("{bad}3")]
        .iter()
        .map(|id| Row {
            state: State::Failed,
            failures: vec![failure.clone()],
            version: id.clone(),
            content: bad.to_owned(),
            picture: Some("x.png".into()),
            other_id: Some(bad.to_owned()),
            ..done(id)
        })
        .collect();
    let html = &pages(rows, Source::Manifest, Some(&BTreeSet::from([bad.to_owned()])))[0];
    assert_eq!(html.matches("</script>").count(), 1, "only the page's own script ends");
    assert!(!html.contains("<b onclick") && html.contains("&lt;b onclick=&quot;x()&quot; title=&#39;y&#39;&gt;&amp;1"));
}

#[test]
fn the_head_counts_what_the_sections_list() {
    let mut rows: Vec<Row> = (0..12).map(|n| Row { content: n.to_string(), ..done(&format!("c{n:02}")) }).collect();
    let fail = |line: &str| Failure { class: "input".to_owned(), step: "fly".to_owned(), line: line.to_owned() };
    for n in [3, 4] {
        (rows[n].state, rows[n].failures) = (State::Failed, vec![fail("is empty")]);
    }
    (rows[5].content, rows[6].version) = ("2".to_owned(), "2".to_owned());
    let listed: BTreeSet<String> = (1..14).map(|n| format!("c{n:02}")).collect();
    let html = &pages(rows.clone(), Source::Manifest, Some(&listed))[0];
    for text in [
        "<h1>Batch of 14 cases</h1>",
        "<li class=\"good\"><b>10</b>done</li><li class=\"bad\"><b>2</b>failed: 2 input</li><li class=\"bad\"><b>2</b>missing</li>",
        "<b>1</b>not in the list",
        "made by 2 versions of colvis: 1 (11 cases), 2 (1 case)",
        "The manifest has 13 cases. There are folders of 12 cases.",
        "<a href=\"#c2\">c02</a> = <a href=\"#c5\">c05</a>",
        "<td>input</td><td>fly</td><td class=\"line\">is empty</td><td class=\"n\">2</td>",
        "No case has a number.",
        "Nothing was made.",
    ] {
        assert!(html.contains(text), "{text}\n{html}");
    }
    let html = &pages(rows[..3].to_vec(), Source::None, None)[0];
    assert!(html.contains("There is no list of the cases") && html.contains("No case failed."));
    assert!(!html.contains("versions of colvis"));
}

#[test]
fn many_cases_have_several_pages_and_links_lead_to_them() {
    let mut rows: Vec<Row> = (0..2 * TOGETHER + 1).map(|n| done(&format!("c{n:05}"))).collect();
    (rows[2000].content, rows[0].content) = ("x".to_owned(), "x".to_owned());
    let html = pages(rows, Source::None, None);
    assert_eq!(html.len(), 3);
    let shown: Vec<usize> = html.iter().map(|h| h.matches("<li class=\"case ").count()).collect();
    assert_eq!(shown, [TOGETHER, TOGETHER, 1]);
    assert!(html[0].contains("<a href=\"#c0\">c00000</a> = <a href=\"cases-3.html#c2000\">c02000</a>"));
    assert!(html[2].contains("id=\"c2000\"") && html[2].contains("page 3 of 3"));
}
