//! Patterns of texts.

/// True if a text matches a pattern: `*` stands for any characters, `?` for one. Upper and lower case are the same.
pub(super) fn matches(text: &str, pattern: &str) -> bool {
    let lower = |s: &str| s.to_lowercase().chars().collect::<Vec<_>>();
    let (text, pattern) = (lower(text), lower(pattern));
    let (mut t, mut p) = (0, 0);
    // Where the last star stands, and how far the text was when it was met.
    let mut star: Option<(usize, usize)> = None;
    while t < text.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, t));
                p += 1;
            }
            Some(c) if *c == '?' || *c == text[t] => {
                t += 1;
                p += 1;
            }
            _ => {
                let Some((at, met)) = star else { return false };
                star = Some((at, met + 1));
                (p, t) = (at + 1, met + 1);
            }
        }
    }
    pattern[p..].iter().all(|c| *c == '*')
}

/// Returns a pattern: a word without wildcards is looked for anywhere.
pub(super) fn pattern(word: &str) -> String {
    if word.contains(['*', '?']) { word.to_owned() } else { format!("*{word}*") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wildcards_match_as_in_an_archive() {
        for (text, pattern, hit) in [
            ("CT Abdomen", "*abdo*", true),
            ("CT Abdomen", "ct*men", true),
            ("CT Abdomen", "?T*", true),
            ("CT Abdomen", "T*", false),
            ("", "*", true),
            ("", "?", false),
            ("aaaab", "*a*ab", true),
            ("aaaac", "*a*ab", false),
        ] {
            assert_eq!(matches(text, pattern), hit, "{text} {pattern}");
        }
        assert_eq!((pattern("Doe"), pattern("D?e")), ("*Doe*".to_owned(), "D?e".to_owned()));
    }
}
