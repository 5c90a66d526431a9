//! Circles of files: files of a crate that use each other, directly or through others. A reader of one has to read them all.
//!
//! A file uses another if a path in it leads to an item there, through whatever `use` re-exports it. The modules that a file
//! declares are its parts: it does not use them, but they may use it. Tests may use everything.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::rust_source::{SourceFile, Use, paths};

/// A path from the root of a crate.
type Module = Vec<String>;

/// The circles that there are, each with its files. They may only shrink.
const KNOWN: &[&[&str]] = &[];

/// The files of a crate, by their modules.
struct Crate {
    files: BTreeMap<Module, SourceFile>,
    /// What each file imports.
    imports: BTreeMap<Module, Vec<Use>>,
}

/// A use of one file by another.
struct Edge {
    from: PathBuf,
    to: PathBuf,
    /// Line and path.
    text: String,
}

impl Crate {
    /// Reads all files of the crate with this root.
    fn read(root: &Path) -> Self {
        let (mut files, mut imports) = (BTreeMap::new(), BTreeMap::new());
        let mut open = vec![(Module::new(), root.to_owned())];
        while let Some((module, path)) = open.pop() {
            let file = SourceFile::read(&path, module.clone());
            open.extend(file.modules().into_iter().map(|(name, path)| ([&module[..], &[name]].concat(), path)));
            let own = paths(&file, &children(&file)).into_iter().filter(|u| u.name.is_some());
            imports.insert(module.clone(), own.collect());
            files.insert(module, file);
        }
        Self { files, imports }
    }

    /// Returns the module whose file defines what a path leads to; `None` if that is in no file of the crate.
    fn definer(&self, path: &[String], depth: usize) -> Option<Module> {
        let known = (0..=path.len()).rev().find(|n| self.files.contains_key(&path[..*n]))?;
        let (module, rest) = path.split_at(known);
        let Some((word, below)) = rest.split_first().filter(|_| depth < 9) else { return Some(module.to_owned()) };
        if self.files[module].defines(word) {
            return Some(module.to_owned());
        }
        self.imports[module].iter().find_map(|used| match used.name.as_ref()? {
            name if name == word => self.definer(&[&used.path, below].concat(), depth + 1),
            name if name == "*" && used.path != module => self.definer(&[&used.path, rest].concat(), depth + 1),
            _ => None,
        })
    }

    /// Returns the uses of files by other files.
    fn edges(&self) -> Vec<Edge> {
        let mut all = Vec::new();
        for (module, file) in &self.files {
            let mut names = children(file);
            for used in &self.imports[module] {
                let found = self.definer(&used.path, 0).filter(|to| to.last() == used.path.last());
                names.extend(found.map(|to| (used.name.clone().unwrap(), to)));
            }
            for used in paths(file, &names) {
                // A path to its own part, or within itself, is no use.
                if let Some(to) = self.definer(&used.path, 0).filter(|to| !to.starts_with(module)) {
                    let text = format!("{}: {}", used.line, used.path.join("::"));
                    all.push(Edge { from: file.path.clone(), to: self.files[&to].path.clone(), text });
                }
            }
        }
        all
    }
}

/// Returns the modules that a file declares, by their names.
fn children(file: &SourceFile) -> BTreeMap<String, Module> {
    file.modules().into_iter().map(|(name, _)| (name.clone(), [&file.module[..], &[name]].concat())).collect()
}

/// Returns the files that can be reached from a file.
fn reached<'a>(edges: &'a [Edge], from: &Path) -> BTreeSet<&'a Path> {
    let mut next: BTreeMap<&Path, Vec<&'a Path>> = BTreeMap::new();
    edges.iter().for_each(|e| next.entry(&e.from).or_default().push(&e.to));
    let (mut all, mut open) = (BTreeSet::new(), next.get(from).cloned().unwrap_or_default());
    while let Some(at) = open.pop() {
        if all.insert(at) {
            open.extend(next.get(at).into_iter().flatten());
        }
    }
    all
}

/// Returns the circles: the largest sets of files that all reach each other.
fn circles(edges: &[Edge]) -> BTreeSet<BTreeSet<&Path>> {
    let files: BTreeSet<&Path> = edges.iter().map(|e| &*e.from).collect();
    let all: BTreeMap<&Path, BTreeSet<&Path>> = files.iter().map(|f| (*f, reached(edges, f))).collect();
    let circle = |f: &&Path| all[f].iter().copied().filter(|to| all.get(to).is_some_and(|t| t.contains(f))).collect();
    files.iter().filter(|f| all[*f].contains(*f)).map(circle).collect()
}

/// Describes circles: the files of each, and their uses of each other.
fn text(circles: &BTreeSet<BTreeSet<&Path>>, edges: &[Edge]) -> String {
    let mut all = String::new();
    for circle in circles {
        let inside = edges.iter().filter(|e| circle.contains(&*e.from) && circle.contains(&*e.to));
        let used = inside.map(|e| format!("    {}:{} -> {}\n", e.from.display(), e.text, e.to.display()));
        let files = circle.iter().map(|f| format!("        \"{}\",\n", f.display()));
        all += &format!("    &[\n{}    ],\n{}", files.collect::<String>(), used.collect::<String>());
    }
    all
}

/// Returns the uses in the crate and in its members.
fn all_edges() -> Vec<Edge> {
    let beside = std::fs::read_dir("src").unwrap().map(|e| e.unwrap().path().join("lib.rs"));
    let roots = beside.chain(["src/lib.rs".into(), "systems/lib.rs".into()]).filter(|p: &PathBuf| p.is_file());
    let mut edges: Vec<Edge> = roots.flat_map(|root| Crate::read(&root).edges()).collect();
    let plain = |p: &Path| {
        p.components().fold(PathBuf::new(), |mut all, part| {
            if part.as_os_str() == ".." {
                all.pop();
            } else {
                all.push(part);
            }
            all
        })
    };
    edges.iter_mut().for_each(|e| (e.from, e.to) = (plain(&e.from), plain(&e.to)));
    edges
}

#[test]
fn circles_of_files_only_shrink() {
    let edges = all_edges();
    let found = circles(&edges);
    let known: BTreeSet<BTreeSet<&Path>> = KNOWN.iter().map(|c| c.iter().map(Path::new).collect()).collect();
    let grown: BTreeSet<_> = found.iter().filter(|f| !known.iter().any(|k| f.is_subset(k))).cloned().collect();
    assert!(grown.is_empty(), "files use each other that did not before:\n{}", text(&grown, &edges));
    assert!(found == known, "KNOWN lists more than these circles:\n{}", text(&found, &edges));
}

/// Returns the circles in an artificial crate, as names of files.
fn found_in(files: &[(&str, &str)]) -> Vec<Vec<String>> {
    let (_dir, lib) = crate::layers::made_up(files);
    let edges = Crate::read(&lib).edges();
    let name = |p: &Path| p.strip_prefix(lib.parent().unwrap()).unwrap().to_str().unwrap().to_owned();
    circles(&edges).iter().map(|c| c.iter().map(|p| name(p)).collect()).collect()
}

#[test]
fn a_circle_is_found_through_re_exports_aliases_and_globs() {
    let lib = ("lib.rs", "mod a;\nmod b;\nmod c;\nmod d;\nuse a::Deep;\npub struct Root;\n");
    let found = found_in(&[
        lib,
        ("a/mod.rs", "mod deep;\npub use deep::Deep;\npub(crate) use deep::*;\n"),
        ("a/deep.rs", "use crate::b as other;\npub struct Deep(other::B);\npub struct More;\n"),
        ("b.rs", "use crate::a::Deep;\npub struct B;\n"),
        ("c.rs", "pub struct C;\n#[cfg(test)]\nuse crate::a::More;\n// crate::a::Deep\n"),
        ("d.rs", "use crate::{a::More, c::C, nowhere::Gone};\n"),
    ]);
    assert_eq!(found, [["a/deep.rs", "b.rs"]]);
    let found = found_in(&[
        lib,
        ("a/mod.rs", "mod deep;\n"),
        ("a/deep.rs", "pub struct Deep(crate::Root);\n"),
        ("b.rs", "fn f() {\n    super::c::g();\n}\n"),
        ("c.rs", "use crate::d;\nfn g() {\n    d::h();\n}\n"),
        ("d.rs", "fn h() {\n    self::inner::f();\n}\nmod inner {\n    use super::super::b::f;\n}\n"),
    ]);
    assert_eq!(found, [["b.rs", "c.rs", "d.rs"]]);
    assert!(
        found_in(&[("lib.rs", "pub mod a;\npub use a::A;\n"), ("a.rs", "use crate::A as B;\npub struct A;\n")])
            .is_empty()
    );
}
