//! A minimal parser of Rust sources: the modules that a file declares and the paths that it uses.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A source file.
pub(crate) struct SourceFile {
    pub path: PathBuf,
    /// The module path from the crate's root.
    pub module: Vec<String>,
    pub text: String,
    /// The text with comments, literals and test items blanked, with every remaining byte at its original position.
    code: String,
}

/// A used path, from the crate's root.
pub(crate) struct Use {
    pub path: Vec<String>,
    pub line: usize,
    /// The name by which a `use` makes it known, `*` for everything in it; `None` for any other path.
    pub name: Option<String>,
}

impl SourceFile {
    /// Reads a module's file.
    pub(crate) fn read(path: &Path, module: Vec<String>) -> Self {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let code = without_tests(&without_literals(&text, b' '));
        Self { path: path.to_owned(), module, text, code }
    }

    /// True if the file defines an item of this name.
    pub(crate) fn defines(&self, name: &str) -> bool {
        const ITEMS: [&str; 9] = ["const", "enum", "fn", "macro_rules", "mod", "static", "struct", "trait", "type"];
        let tokens = tokens(&self.code);
        tokens.windows(3).any(|w| ITEMS.contains(&w[0].1) && (w[1].1 == name || w[1].1 == "!" && w[2].1 == name))
    }

    /// Returns the modules that the file declares in separate files, with those files.
    pub(crate) fn modules(&self) -> Vec<(String, PathBuf)> {
        let tokens = tokens(&self.code);
        let folder = self.path.parent().unwrap();
        let is_folder = ["mod", "lib", "main"].iter().any(|n| self.path.file_stem().unwrap() == *n);
        let below = if is_folder { folder.to_owned() } else { self.path.with_extension("") };
        let mut all = Vec::new();
        for w in tokens.windows(3) {
            if w[0].1 == "mod" && w[2].1 == ";" {
                let name = w[1].1.to_owned();
                let own = self.path_attribute(w[0].0).map(|p| folder.join(p));
                let files = [below.join(format!("{name}.rs")), below.join(&name).join("mod.rs")];
                let file = own.or_else(|| files.into_iter().find(|f| f.exists()));
                all.push((name, file.unwrap_or_else(|| panic!("{}: no file of {}", self.path.display(), w[1].1))));
            }
        }
        all
    }

    /// Returns the file that a `path` attribute of the item at `at` names.
    fn path_attribute(&self, at: usize) -> Option<&str> {
        let begin = self.code[..at].rfind([';', '}']).map_or(0, |n| n + 1);
        // Comments between the attribute and the item may contain anything, so look only at the remaining code.
        let attribute = begin + self.code[begin..at].find("#[path")?;
        self.text[attribute..at].split('"').nth(1)
    }
}

/// Returns the string literals of a source outside tests, each with its line. Escapes stay as they are written, but for a line that goes
/// on in the next one.
pub(crate) fn literals(text: &str) -> Vec<(usize, String)> {
    // Strings are marked by a byte that no source has, so that they can be found once comments and tests are blanked.
    const MARK: u8 = 1;
    let code = without_tests(&without_literals(text, MARK));
    let (code, mut all, mut n) = (code.as_bytes(), Vec::new(), 0);
    while n < code.len() {
        let length = code[n..].iter().take_while(|b| **b == MARK || **b == b'\n').count();
        let is_string = code[n] == MARK;
        if is_string {
            let raw = text[n..n + length].trim_end().trim_start_matches('r').trim_matches('#');
            let lines: Vec<&str> = raw.trim_matches('"').split("\\\n").collect();
            let rest = lines.iter().skip(1).map(|l| l.trim_start());
            all.push((text[..n].lines().count().max(1), lines[..1].iter().copied().chain(rest).collect()));
        }
        n += if is_string { length } else { 1 };
    }
    all
}

/// Blanks comments and character literals, and fills string literals with this byte.
fn without_literals(text: &str, string_mark: u8) -> String {
    let bytes = text.as_bytes();
    let mut out = bytes.to_vec();
    let mut n = 0;
    while n < bytes.len() {
        let rest = &text[n..];
        let word_before = n > 0 && (bytes[n - 1].is_ascii_alphanumeric() || bytes[n - 1] == b'_');
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            block_comment(rest)
        } else if rest.starts_with('"') {
            string(rest)
        } else if rest.starts_with('r') && !word_before && rest[1..].trim_start_matches('#').starts_with('"') {
            let marks = rest[1..].find('"').unwrap();
            let end = format!("\"{}", "#".repeat(marks));
            rest[marks + 2..].find(&end).map_or(rest.len(), |e| marks + 2 + e + end.len())
        } else if rest.starts_with('\'') {
            character(rest)
        } else {
            0
        };
        let mark = if rest.starts_with(['"', 'r']) { string_mark } else { b' ' };
        out[n..n + length].iter_mut().filter(|b| **b != b'\n').for_each(|b| *b = mark);
        n += length.max(rest.chars().next().map_or(1, char::len_utf8));
    }
    String::from_utf8(out).unwrap()
}

/// Returns the length of a block comment, which may contain others.
fn block_comment(rest: &str) -> usize {
    let (mut depth, mut n) = (0, 0);
    while n < rest.len() {
        let two = rest.as_bytes().get(n..n + 2).unwrap_or_default();
        match two {
            b"/*" => depth += 1,
            b"*/" => depth -= 1,
            _ => {
                n += 1;
                continue;
            }
        }
        n += 2;
        if depth == 0 {
            return n;
        }
    }
    rest.len()
}

/// Returns the length of a string literal with its quotes.
fn string(rest: &str) -> usize {
    let bytes = rest.as_bytes();
    let mut n = 1;
    while n < bytes.len() && bytes[n] != b'"' {
        n += if bytes[n] == b'\\' { 2 } else { 1 };
    }
    (n + 1).min(bytes.len())
}

/// Returns the length of a character literal, or 0 for a lifetime.
fn character(rest: &str) -> usize {
    let mut chars = rest.char_indices().skip(1);
    let Some((_, first)) = chars.next() else { return 0 };
    if first == '\\' {
        // The escaped character itself may be a quote.
        return rest.get(3..).and_then(|r| r.find('\'')).map_or(0, |e| e + 4);
    }
    match chars.next() {
        Some((at, '\'')) => at + 1,
        _ => 0,
    }
}

/// Blanks the items that only tests contain: those with the attribute `#[cfg(test)]`.
fn without_tests(code: &str) -> String {
    let mut out = code.to_owned();
    while let Some(at) = out.find("#[cfg(test)]") {
        let mut depth = 0;
        let end = out[at..].char_indices().find(|(_, c)| {
            match c {
                '{' | '(' | '[' => depth += 1,
                '}' | ')' | ']' => depth -= 1,
                _ => {}
            }
            depth == 0 && matches!(c, ';' | '}')
        });
        let end = at + end.map_or(out.len() - at, |(n, _)| n + 1);
        let blank: String = out[at..end].chars().map(|c| if c == '\n' { '\n' } else { ' ' }).collect();
        out.replace_range(at..end, &blank);
    }
    out
}

/// Returns words, `::` and single other characters, with their positions.
fn tokens(code: &str) -> Vec<(usize, &str)> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut all = Vec::new();
    let mut n = 0;
    while n < code.len() {
        let rest = &code[n..];
        let first = rest.chars().next().unwrap();
        let length = if is_word(first) {
            rest.find(|c| !is_word(c)).unwrap_or(rest.len())
        } else if rest.starts_with("::") {
            2
        } else {
            first.len_utf8()
        };
        if !first.is_whitespace() {
            all.push((n, &rest[..length]));
        }
        n += length;
    }
    all
}

/// Returns every path in a file that begins with `crate`, `self` or `super`, from the crate's root.
pub(crate) fn uses(file: &SourceFile) -> Vec<Use> {
    paths(file, &BTreeMap::new())
}

/// Same as [`uses`], with the paths that begin with one of `names` too. Each stands for a module, by its path from the crate's root.
pub(crate) fn paths(file: &SourceFile, names: &BTreeMap<String, Vec<String>>) -> Vec<Use> {
    let tokens = tokens(&file.code);
    // The inline modules of this file, each with its brace depth.
    let (mut module, mut open, mut depth) = (file.module.clone(), Vec::new(), 0);
    let (mut all, mut n) = (Vec::new(), 0);
    while n < tokens.len() {
        match tokens[n].1 {
            "{" => {
                depth += 1;
                if n >= 2 && tokens[n - 2].1 == "mod" {
                    module.push(tokens[n - 1].1.to_owned());
                    open.push(depth);
                }
            }
            "}" => {
                if open.last() == Some(&depth) {
                    open.pop();
                    module.pop();
                }
                depth -= 1;
            }
            word if tokens.get(n + 1).is_some_and(|t| t.1 == "::") && (n == 0 || tokens[n - 1].1 != "::") => {
                let base = match names.get(word) {
                    Some(path) => path[..path.len() - 1].to_vec(),
                    None if ["crate", "self", "super"].contains(&word) => module.clone(),
                    None => {
                        n += 1;
                        continue;
                    }
                };
                let is_use = n > 0 && tokens[n - 1].1 == "use";
                let mut found = Vec::new();
                n = follow(&tokens, n, base, &mut found);
                let line = |at: usize| file.code[..at].lines().count().max(1);
                all.extend(found.into_iter().map(|(at, path, name)| {
                    let name = if name == "self" { path.last().map_or("", |p| p) } else { name };
                    Use { line: line(at + 1), name: is_use.then(|| name.to_owned()), path }
                }));
                continue;
            }
            _ => {}
        }
        n += 1;
    }
    all
}

/// Follows a path, or a tree of paths, from token `n` on. Adds each with the position of its first word below the root and its name,
/// and returns the index of the token after it.
fn follow<'a>(
    tokens: &[(usize, &'a str)],
    mut n: usize,
    mut base: Vec<String>,
    found: &mut Vec<(usize, Vec<String>, &'a str)>,
) -> usize {
    let place = tokens[n].0;
    loop {
        match tokens[n].1 {
            "crate" => base.clear(),
            "super" => {
                base.pop();
            }
            "self" | "*" => {}
            "{" => {
                n += 1;
                while tokens[n].1 != "}" {
                    n = if tokens[n].1 == "," { n + 1 } else { follow(tokens, n, base.clone(), found) };
                }
                return n + 1;
            }
            word => base.push(word.to_owned()),
        }
        n += 1;
        let next = |m: usize| tokens.get(m).map(|t| t.1);
        let goes_on = |t: &str| t == "{" || t == "*" || t.starts_with(|c: char| c.is_alphanumeric() || c == '_');
        if next(n) != Some("::") || !next(n + 1).is_some_and(goes_on) {
            let alias = tokens.get(n + 1).filter(|_| next(n) == Some("as"));
            found.push((place, base, alias.unwrap_or(&tokens[n - 1]).1));
            return if alias.is_some() { n + 2 } else { n };
        }
        n += 1;
    }
}
