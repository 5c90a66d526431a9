"""Compiles many faults into one program, each of which a variable of the environment switches on.

A function with faults gets one copy of its body for each, and a copy as it is:

    fn f(x: f64) -> f64 {
        if crate::mutation::is(17) { x * 2.0 } else if crate::mutation::is(18) { x - 2.0 } else { x + 2.0 }
    }

COLVIS_MUTANT=17 selects the first copy. COLVIS_MUTANT=record writes the numbers of the faults whose functions are called to the file
that COLVIS_REACHED names, each once for a process. Faults in constants, in `const` functions and in functions that return an
`impl Trait` cannot be switched.
"""

import re

TOKEN = re.compile(
    r'//[^\n]*|/\*.*?\*/|b?r(#*)".*?"\1|b?"(?:\\.|[^"\\])*"|b?\'(?:\\[^\n]+?|[^\\\'\n])\'|\'\w+|[A-Za-z_]\w*|\s+|->|.', re.S)

MODULE = '''
#[doc(hidden)]
pub mod mutation {
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};

    const UNKNOWN: usize = usize::MAX;
    const RECORD: usize = usize::MAX - 1;
    static CHOSEN: AtomicUsize = AtomicUsize::new(UNKNOWN);
    static REACHED: [AtomicBool; %d] = [const { AtomicBool::new(false) }; %d];

    #[inline]
    pub fn is(number: usize) -> bool {
        match CHOSEN.load(Relaxed) {
            UNKNOWN | RECORD => look(number),
            chosen => chosen == number,
        }
    }

    #[cold]
    #[inline(never)]
    fn look(number: usize) -> bool {
        if CHOSEN.load(Relaxed) == UNKNOWN {
            let chosen = std::env::var("COLVIS_MUTANT").unwrap_or_default();
            CHOSEN.store(if chosen == "record" { RECORD } else { chosen.parse().unwrap_or(0) }, Relaxed);
            return is(number);
        }
        if !REACHED[number].swap(true, Relaxed)
            && let Some(path) = std::env::var_os("COLVIS_REACHED")
            && let Ok(mut file) = std::fs::OpenOptions::new().append(true).create(true).open(path)
        {
            let _ = std::io::Write::write_all(&mut file, format!("{number}\\n").as_bytes());
        }
        false
    }
}
'''
IMPORT = '''
#[doc(hidden)]
pub use colvis_scan::mutation;
'''
ALLOW = "#![allow(warnings, clippy::all, arithmetic_overflow, unconditional_panic, reason = \"these are faults\")]\n"


def offset(starts, place):
    return starts[place["line"] - 1] + place["column"] - 1


def line_starts(text):
    starts = [0]
    starts.extend(m.end() for m in re.finditer("\n", text))
    return starts


def body_of(text, start, end):
    """Returns where the body of the function at `start..end` begins and ends, between its braces; None if it cannot be switched."""
    if text[end - 1] != "}":
        return None
    depth, previous, signature, found = 0, "", [], False
    for m in TOKEN.finditer(text, start, end):
        token = m.group()
        if token.isspace() or token.startswith(("//", "/*")):
            continue
        if not found:
            found = token == "fn"
            if found and previous == "const":
                return None
        elif token in "([":
            depth += 1
        elif token in ")]":
            depth -= 1
        elif token == "{" and depth == 0:
            result = "".join(signature).partition("->")[2]
            return None if re.search(r"\bimpl\b", result) else (m.end(), end - 1)
        if found:
            signature.append(token + " ")
        previous = token
    return None


def place_of(text, mutant):
    """Returns the body that a mutant is in, and its own place; None if it cannot be switched."""
    if not mutant["function"]:
        return None
    starts = line_starts(text)
    span, function = mutant["span"], mutant["function"]["span"]
    body = body_of(text, offset(starts, function["start"]), offset(starts, function["end"]))
    own = offset(starts, span["start"]), offset(starts, span["end"])
    return (body, own) if body and body[0] <= own[0] and own[1] <= body[1] else None


def switched(text, mutants):
    """Returns the text with the mutants of a file, by number, and the lines of each one's body."""
    bodies = {}
    for number, mutant in mutants.items():
        body, own = place_of(text, mutant)
        bodies.setdefault(body, []).append((number, own, mutant["replacement"]))
    # Faults of a function within another belong to the outer one.
    for inner in sorted(bodies, key=lambda b: b[1] - b[0]):
        outer = [b for b in bodies if b != inner and b[0] <= inner[0] and inner[1] <= b[1]]
        if outer:
            bodies[max(outer, key=lambda b: b[1] - b[0])].extend(bodies.pop(inner))
    pieces, lines, line, at = [], {}, 1, 0

    def put(piece):
        nonlocal line
        pieces.append(piece)
        line += piece.count("\n")

    for begin, end in sorted(bodies):
        put(text[at:begin] + "\n")
        for number, (first, last), replacement in bodies[begin, end]:
            put(f"if crate::mutation::is({number}) {{\n")
            before = line
            put(text[begin:first] + replacement + text[last:end] + "\n")
            lines[number] = before, line
            put("} else ")
        put("{\n" + text[begin:end] + "\n}\n")
        at = end
    put(text[at:])
    return "".join(pieces), lines
