//! The table of the paper's systems in ARCHITECTURE.md: the files, tests, scene keys and commands that it names exist.

use std::path::Path;

/// Returns the texts between backticks.
fn quoted(cell: &str) -> Vec<&str> {
    cell.split('`').skip(1).step_by(2).collect()
}

/// Returns the cells of the rows after this heading whose first cell is a number.
fn rows<'a>(text: &'a str, heading: &str) -> Vec<Vec<&'a str>> {
    let part = text.split(heading).nth(1).unwrap_or_else(|| panic!("ARCHITECTURE.md has no {heading:?}"));
    let part = part.split("\n#").next().unwrap_or(part);
    let cells = part.lines().filter(|l| l.starts_with('|')).map(|l| l.split('|').map(str::trim).collect::<Vec<_>>());
    cells.filter(|c| c.len() > 2 && c[1].parse::<usize>().is_ok()).collect()
}

#[test]
fn the_papers_systems_are_where_the_table_says() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    let rows = rows(&text, "\n## The paper's systems");
    let numbers: Vec<usize> = rows.iter().map(|r| r[1].parse().unwrap()).collect();
    assert_eq!(numbers, (1..=27).collect::<Vec<_>>(), "each system once, in order");
    for row in rows {
        let &[_, number, paper, system, places, reached, tests, _] = row.as_slice() else {
            panic!("a row of {} cells: {row:?}", row.len());
        };
        assert!(!paper.is_empty() && !system.is_empty() && !reached.is_empty(), "{row:?}");
        let built = !reached.starts_with("not built");
        for place in quoted(places) {
            assert!(root.join(place).exists(), "system {number}: there is no {place}");
        }
        let tests = quoted(tests);
        assert!(!built || !quoted(places).is_empty() && tests.len() >= 2, "system {number} has a place and a test");
        for pair in tests.chunks(2) {
            let &[file, test] = pair else { panic!("system {number}: a file without its test: {pair:?}") };
            let source = std::fs::read_to_string(root.join(file)).unwrap_or_default();
            // Property tests are in a macro, where their arguments follow the name.
            assert!(source.contains(&format!("fn {test}(")), "system {number}: {file} has no test {test}");
            assert!(source.contains("#[test]"), "{file}");
        }
    }
}
