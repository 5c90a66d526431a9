#!/usr/bin/env python3
"""Regenerates RESULTS.md: repeats all measurements of this project on this machine.

    cargo build --release
    python3 tests/bench/results.py [--scan SCAN] [--vtk "COMMAND"] [--fields-peer "COMMAND"] [--display "COMMAND"]
                                   [--parts frames,window,flights,fields,coverage,unfold,candidates,cleansing,perforation,render,gradients,dynamics,
                                   scenes,faults]
                                   [--mutants FOLDER] [--quick] [--check N] [--colvis BINARY] [--keep FOLDER] [--out RESULTS.md]

This script builds nothing. It runs the program (`--colvis`, else the environment variable COLVIS, else target/release/colvis)
and the scripts frames.py, flights.py and fields.py in the same folder. The page begins with what is asked most, then has a section for
each part: its command, its findings, and the tables that a reader compares. All other tables are CSV files of the reports; --keep keeps
them. The page marks what this run did not measure; it never reuses numbers from an earlier run. A full run takes some hours on two cores,
--quick some minutes. Leave the machine otherwise idle during the run.

--scan         measures a CT colonography in addition to the phantoms, which the program generates
--vtk          compares frames with another renderer; the command takes `SCAN POSES --size N --threads N`, see frames.py
--fields-peer  compares lumen, distance and centerline with another program: `SCAN --seed X Y Z --threads N`, see fields.py
--display      provides the window's screen, such as `xvfb-run -a -s "-screen 0 1280x1280x24"`; not needed if DISPLAY is set
--mutants      shows what mutants.py has found in this folder; its run takes hours and is a run of its own
--check        also compares every Nth pose of the frames with brute force (needs NumPy and SimpleITK)
--keep         keeps the phantoms, the reports and the scripts' JSON in a folder

Requires only the standard library. If a part fails, the page is still written and names the part, and the exit status is 1.
"""

import argparse
import csv
import datetime
import json
import math
import os
import pathlib
import platform
import shlex
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]


class Failed(Exception):
    """A command failed."""


class Missing(Exception):
    """This run lacks something that a part needs."""


def arguments():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--scan", type=os.path.abspath)
    p.add_argument("--vtk")
    p.add_argument("--fields-peer")
    p.add_argument("--display")
    p.add_argument("--mutants", metavar="FOLDER", type=os.path.abspath)
    p.add_argument("--parts", default=",".join(PARTS))
    p.add_argument("--quick", action="store_true")
    p.add_argument("--check", type=int, default=0)
    p.add_argument("--threads", default=str(cores()))
    p.add_argument("--colvis", default=os.environ.get("COLVIS") or str(ROOT / "target/release/colvis"))
    p.add_argument("--keep", metavar="FOLDER", type=os.path.abspath)
    p.add_argument("--out", default=str(ROOT / "RESULTS.md"))
    a = p.parse_args()
    a.parts = [part.strip() for part in a.parts.split(",") if part.strip()]
    unknown = [part for part in a.parts if part not in PARTS]
    if unknown:
        p.error(f"unknown part {', '.join(unknown)}; choose from {', '.join(PARTS)}")
    a.colvis = os.path.abspath(a.colvis)
    if not os.access(a.colvis, os.X_OK):
        p.error(f"{a.colvis} is not an executable: run cargo build --release, or name one with --colvis")
    if a.scan and not os.path.exists(a.scan):
        p.error(f"{a.scan} does not exist")
    return a


# Page content --------------------------------------------------------------------------------------------------------


class Text(str):
    """Text that is already formatted and printed unchanged."""


def cell(value):
    """Formats a table cell; numbers get three significant digits."""
    if isinstance(value, Text):
        return value
    if value is None or value == "":
        return "–"
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value).replace("|", "\\|")
    if math.isnan(number):
        return "–"
    if math.isinf(number):
        return "∞" if number > 0 else "−∞"
    if number == 0:
        return "0"
    if number == int(number) and abs(number) < 1e12:
        return str(int(number))
    if 1e-3 <= abs(number) < 1e5:
        digits = max(0, 2 - math.floor(math.log10(abs(number))))
        text, short = f"{number:.{digits}f}", f"{number:g}"
        # Keep a setting such as 0.07 as it was written.
        return short if float(short) == number and len(short) < len(text) else text
    return f"{number:.1e}".replace("e-0", "e-").replace("e+0", "e")


def table(head, rows):
    """A Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(cell(c) for c in row) + " |" for row in rows])


def pick(head, rows, columns):
    """These columns of a table, in this order, as far as it has them."""
    at = [head.index(c) for c in columns if c in head]
    return [head[n] for n in at], [[r[n] for n in at] for r in rows]


def beside(tables, key, columns):
    """One table from those of several subjects: a row for each value of `key`, the columns of each subject beside those of the others."""
    keys = list(dict.fromkeys(r[head.index(key)] for _, (head, rows) in tables for r in rows))
    body = [[k] for k in keys]
    for _, (head, rows) in tables:
        found = {r[head.index(key)]: r for r in rows}
        for line in body:
            line += [found[line[0]][head.index(c)] if line[0] in found else None for c in columns]
    return table([key, *(f"{name}: {c}" for name, _ in tables for c in columns)], body)


def command_block(*commands):
    return "```sh\n" + "\n".join(commands) + "\n```"


def findings(text):
    """A report's findings as a list, one item for each line."""
    lines = [line.strip() for line in text.splitlines()]
    return "\n".join(f"- {line}" for line in lines if line and not line.startswith("see "))


def read_csv(path):
    """Column names and rows of a report's CSV."""
    with open(path, newline="", encoding="utf-8") as f:
        head, *rows = list(csv.reader(f))
    return head, rows


def mib(size):
    return f"{size / 2**20:.0f} MiB"


# Commands ------------------------------------------------------------------------------------------------------------


class Bench:
    """Runs the commands; holds the run's folder and its subjects."""

    def __init__(self, args, folder):
        self.args = args
        self.folder = folder
        self.small = args.quick
        self.scripts = 0
        # What is asked most: the answer for each subject, by question.
        self.answers = {}

    def at(self, name):
        return os.path.join(self.folder, name)

    def run(self, command):
        """Runs a command and returns its standard output."""
        command = [str(c) for c in command]
        print(f"{datetime.datetime.now():%H:%M:%S} {self.shown(command)}", file=sys.stderr, flush=True)
        env = {**os.environ, "COLVIS": self.args.colvis}
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env)
        if done.returncode != 0:
            said = (done.stderr or done.stdout).strip().splitlines()
            raise Failed(f"`{self.shown(command)}` exited with status {done.returncode}: {self.plain(said[-1]) if said else 'no output'}")
        return done.stdout

    def plain(self, text):
        """The text without this machine's paths."""
        for path, name in ((self.folder + os.sep, ""), (str(ROOT) + os.sep, ""), (self.args.scan, "SCAN"), (self.args.colvis, "colvis")):
            text = text.replace(path, name) if path else text
        return text

    def shown(self, command):
        """The command as the page shows it, without this machine's paths."""
        named = {self.args.colvis: "colvis", sys.executable: "python3"}
        for path, name in ((self.args.scan, "SCAN"), (self.args.vtk, '"VTK"'), (self.args.fields_peer, '"PEER"')):
            if path:
                named[path] = name
        display = shlex.split(self.args.display or "")
        if display and list(command[: len(display)]) == display:
            command = command[len(display) :]
        words = []
        for c in command:
            c = self.plain(named.get(c, c))
            words.append(c if c.startswith('"') else shlex.quote(c))
        return " ".join(words)

    def invocation(self):
        """This script's command line, without anything that identifies the machine."""
        a = self.args
        given = [*(["--scan", "SCAN"] if a.scan else []), *(["--vtk", '"VTK"'] if a.vtk else [])]
        given += [*(["--fields-peer", '"PEER"'] if a.fields_peer else []), *(["--display", '"SCREEN"'] if a.display else [])]
        given += ["--parts", ",".join(a.parts)] if a.parts != list(PARTS) else []
        given += [*(["--check", str(a.check)] if a.check else []), *(["--quick"] if a.quick else [])]
        return " ".join(["python3 tests/bench/results.py", *given])

    def script(self, name, *options):
        """Runs a script from this folder. Returns its results and the command."""
        self.scripts += 1
        out = self.at(f"{self.scripts}-{name}.json")
        command = [sys.executable, HERE / f"{name}.py", *options]
        self.run([*command, "--json", out])
        with open(out, encoding="utf-8") as f:
            return json.load(f), self.shown([str(c) for c in command])

    def report(self, subject, *options):
        """Runs a report. Returns a reader for its CSV files, its output and the command."""
        folder = self.at(f"report-{subject}")
        quick = ["--quick"] if self.args.quick else []
        command = [self.args.colvis, "report", subject, "--out", folder, "--threads", self.args.threads, *quick, *options]
        said = self.run(command)
        return (lambda name: read_csv(os.path.join(folder, name + ".csv"))), said, self.shown(command)

    def phantom(self):
        """The phantom and its truth, generated on the first call."""
        scan, truth = self.at("phantom.nii"), self.at("phantom.json")
        if not os.path.exists(truth):
            size = "small" if self.small else "standard"
            self.run([self.args.colvis, "phantom", "--out", scan, "--truth", truth, "--size", size])
        return scan, truth

    def subjects(self):
        """The phantom, and the scan if one was given."""
        scan = [("the scan", self.args.scan)] if self.args.scan else []
        return [("the phantom", self.phantom()[0]), *scan]

    def answer(self, question, subject, text):
        """Notes an answer for the top of the page."""
        self.answers.setdefault(question, {})[subject] = Text(text)


# Parts ---------------------------------------------------------------------------------------------------------------


def frames(b):
    few = ["--poses", "24", "--sizes", "256,512"] if b.args.quick else ["--runs", "3"]
    peer = ["--vtk", b.args.vtk] if b.args.vtk else []
    check = ["--check", str(b.args.check)] if b.args.check else []
    commands, rows, memory, failed = [], [], [], []
    for name, scan in b.subjects():
        found, command = b.script("frames", scan, *few, "--threads", b.args.threads, *check, *peer)
        commands.append(command)
        for s in found["sizes"]:
            other, psnr = s.get("peer", {}), s.get("psnr", {})
            rows.append([name, f"{s['size']}×{s['size']}", s["median_ms"], s["p99_ms"], s["rays_a_pixel"],
                         psnr.get("least_db"), other.get("median_ms"), other.get("ratio")])
            if s.get("peer_failed"):
                failed.append(f"VTK failed on {name} at {s['size']}×{s['size']}: {b.plain(s['peer_failed'])}.")
        last, first = found["sizes"][-1], found["memory"][0]
        size = f"{last['size']}×{last['size']}"
        b.answer(f"a frame of {size}: median, p99", name, f"{cell(last['median_ms'])}, {cell(last['p99_ms'])} ms")
        if "ratio" in last.get("peer", {}):
            b.answer(f"times faster than VTK at {size}", name, cell(last["peer"]["ratio"]))
        b.answer("first image after the scan is in memory", name, f"{cell(first['first_frame_s'])} s")
        b.answer("peak memory of a headless flight with images", name, mib(first["peak_rss_bytes"]))
        for m in found["memory"]:
            memory.append([name, m["preset"], mib(m["peak_rss_bytes"]), m["first_frame_s"]])
        others = [s["peer"] for s in found["sizes"] if "peer" in s]
        if others:
            memory.append([name, "VTK", f"{max(o.get('peak_rss_mib', 0) for o in others)} MiB", others[-1].get("first_frame_s")])
    head = ["", "image", "median / ms", "p99 / ms", "rays a pixel", "PSNR, least / dB", "VTK, median / ms", "ratio"]
    missing = ["another renderer (`--vtk`)"] * (not b.args.vtk) + ["the error of these poses (`--check`; see *Renderers*)"] * (not b.args.check)
    lines = [command_block(*commands), table(head, rows), "The poses are spread over a flight through the whole lumen. PSNR is against brute "
             "force." + (f" This run did not measure {' and '.join(missing)}." if missing else "")]
    return lines + [table(["", "preset", "peak memory, headless flight with images", "scan in memory → first image / s"], memory)] + failed


def window(b):
    if not b.args.display and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise Missing("no screen is available (`--display`)")
    side, seconds = (512, "3") if b.args.quick else (1024, "10")
    rows, commands = [], []
    for name, scan in b.subjects():
        stats = b.at("window.json")
        command = [b.args.colvis, "fly", scan, "--size", f"{side}x{side}", "--seconds", seconds, "--layout", "flight", "--stats", stats]
        b.run([*shlex.split(b.args.display or ""), *command])
        commands.append(b.shown(command))
        with open(stats, encoding="utf-8") as f:
            stats = json.load(f)
        ms = sorted(f["ms"] for f in stats["frames"])
        shown = stats.get("present_ms") or {}
        rows.append([name, len(ms), ms[len(ms) // 2], ms[int(len(ms) * 0.99)], shown.get("median"), shown.get("p99")])
        b.answer(f"a window of {side}×{side}: frames a second, p99 of a frame", name,
                 f"{len(ms) / float(seconds):.0f}, {cell(ms[int(len(ms) * 0.99)])} ms")
    head = ["", "frames", "median / ms", "p99 / ms", "presentation, median / ms", "presentation, p99 / ms"]
    return [command_block(*commands), table(head, rows)]


def flights(b):
    seeds = "1-2" if b.args.quick else "1-10"
    few = ["--size", "small"] if b.args.quick else []
    scan = ["--scan", b.args.scan] if b.args.scan else []
    found, command = b.script("flights", "--seeds", seeds, *few, *scan)
    rows = []

    def span(values, form):
        values = [v for v in values if v is not None]
        if not values:
            return None
        least, most = form.format(min(values)), form.format(max(values))
        return Text(least if least == most else f"{least} to {most}")

    def row(name, group):
        ends = [e.strip() for r in group for e in r["end"].split(", ")] if len(group) > 1 else []
        arrived = sum(e == "arrived" for e in ends)
        end = f"{arrived} of {len(ends)} arrived" if ends else group[0]["end"]
        return [name, group[0]["guide"], end, span(sum((r["seconds"] for r in group), []), "{:.0f}"),
                span([r["clearance_mean"] for r in group], "{:.1f}"), span([r["clearance_least"] for r in group], "{:.1f}"),
                span([r["offset"] for r in group], "{:.1f}"), span([r["jerk_p99"] for r in group], "{:.0f}"),
                span(sum((r["one_way"] for r in group), []), "{:.2f}"), span(sum((r["both_ways"] for r in group), []), "{:.2f}")]

    guides = list(dict.fromkeys(r["guide"] for r in found))
    phantoms = [r for r in found if r["scan"].startswith("seed ")]
    rows += [row(f"phantoms {seeds.replace('-', ' to ')}", [r for r in phantoms if r["guide"] == g]) for g in guides]
    rows += [row("the scan", [r]) for r in found if not r["scan"].startswith("seed ")]
    head = ["", "guide", "end: out, back", "s", "clearance, mean / mm", "clearance, least / mm", "distance from the centerline / mm",
            "jerk, p99 / mm/s³", "wall seen, one way", "wall seen, both ways"]
    words = ("Each guide flies to the cecum and back. The phantoms have folds, polyps, fluid, bridges and noise. `tentacles` flies the "
             "largest segment of gas; `path` and `potential` treat segments joined by tagged fluid as one. *Wall seen*: of the area "
             "of the wall around the gas flown through, the share that was within 100 mm, inside a square image and not hidden.")
    for r in rows:
        name = "the scan" if r[0] == "the scan" else "the phantom"
        b.answer(f"flights by `{r[1]}` to the cecum and back; wall seen one way, both ways", name, f"{r[2]}; {cell(r[8])}, {cell(r[9])}")
    return [command_block(command), words, table(head, rows)]


def fields(b):
    rounds = ["--rounds", "1" if b.args.quick else "5", "--threads", b.args.threads]
    peer = ["--peer", b.args.fields_peer] if b.args.fields_peer else []
    commands, lines, rows = [], [], []
    for name, scan in b.subjects():
        truth = ["--truth", b.phantom()[1]] if name == "the phantom" else []
        found, command = b.script("fields", scan, *truth, *rounds, *peer)
        commands.append(command)
        prepare, off = found["prepare"], found.get("line_to_truth_mm", {})
        parts = [prepare.get(k) for k in ("lumen_s", "distance_s", "centerline_s")]
        rows.append([name, "colvis", *parts, found["sum_s"], mib(found["peak_rss_bytes"]), off.get("mean"), off.get("p95"), off.get("worst")])
        b.answer("lumen, wall distance and centerline together", name, f"{cell(found['sum_s'])} s")
        if off:
            b.answer("mean error of the centerline", name, f"{cell(off.get('mean'))} mm")
        if "peer_failed" in found:
            lines.append(f"The other program failed on {name}: {b.plain(found['peer_failed'])}.")
        if "peer" in found:
            p = found["peer"]
            part = lambda word: next((v for k, v in p.items() if k.startswith(word) and k.endswith("_s")), None)
            rows.append([name, "peer", part("segment"), part("distance"), part("centerline"), p["sum_s"], f"{p.get('peak_rss_mib', '–')} MiB",
                         p.get("centerline_mean_mm"), p.get("centerline_p95_mm"), p.get("centerline_max_mm")])
    head = ["", "program", "lumen / s", "distance / s", "centerline / s", "sum / s", "peak memory",
            "line's error, mean / mm", "line's error, 95 % / mm", "line's error, worst / mm"]
    lines += [table(head, rows)]
    if not b.args.fields_peer:
        lines.append("This run measured no other program (`--fields-peer`).")
    read, said, command = b.report("fields", *(["--scan", b.args.scan] if b.args.scan else []))
    commands.append(command)
    lines += [findings(said), table(*read("distance-methods")), table(*read("centerline-methods"))]
    head, rows = read("slices")
    skips, order, parts, status = (head.index(k) for k in ("skips", "segments in order", "parts in order", "exit status"))
    faults = [r for r in rows if r[status] != "0" or r[skips] != "0" or r[order] != "yes" or r[parts] != "yes"]
    lines.append(f"Thick slices, noise and thin walls: {len(faults)} of {len(rows)} volumes have a fault.")
    return [command_block(*commands), *lines, *([table(head, faults)] if faults else [])]


# The renderers on the page; the report has more.
RENDERERS = ("reference h/8", "brute h", "high h/2", "high h", "low h", "filtered h/2", "preset colvis", "preset lean", "packets h", "default", "marching cubes")


def render(b):
    read, said, command = b.report("render", *(["--scan", b.args.scan] if b.args.scan else []))
    lines = [command_block(command), findings(said)]
    found = {}
    for subject, name in (("phantom", "phantom"), ("scan", "scan")):
        for what in ("methods", "worth", "claims"):
            try:
                found.setdefault(what, []).append((name, read(f"{subject}-{what}")))
            except FileNotFoundError:
                continue
    methods = [(name, (head, [r for r in rows if r[head.index("method")] in RENDERERS])) for name, (head, rows) in found["methods"]]
    for name, (head, rows) in methods:
        default = next((r for r in rows if r[head.index("method")] == "default"), None)
        if default:
            b.answer("worst frame of the default preset against brute force", f"the {name}", f"{cell(default[head.index('PSNR worst / dB')])} dB")
    lines += ["### Renderers", beside(methods, "method", ("frame median / ms", "PSNR worst / dB", "memory / 16-bit volume"))]
    lines += ["### The paper's ideas, each in the paper's preset", beside(found["worth"], "idea", ("times faster",))]
    name, (_, claims) = found["claims"][-1]
    lines += [f"### The paper's claims, on the {name}", "\n".join(f"- *{r[0]}* {r[1]}" for r in claims)]
    columns = ("frame median / ms", "of the first", "largest difference")
    rows = []
    for what, title in (("voxels", ""), ("threads", " threads"), ("simd", "")):
        rows += [[f"{r[0]}{title}", *r[1:]] for r in pick(*read(f"phantom-{what}"), (what, *columns))[1]]
    lines += ["### The default preset by voxels, threads and SIMD level", table(["", *columns], rows)]
    return lines


def gradients(b):
    read, said, command = b.report("gradients")
    lines = [command_block(command), findings(said)]
    _, rows = read("walls-cubic")
    noises = list(dict.fromkeys(r[1] for r in rows))
    methods = list(dict.fromkeys(r[0] for r in rows))
    value = {(r[0], r[1]): r[3] for r in rows}
    time = {r[0]: r[2] for r in rows}
    body = [[m, time[m], *(value.get((m, n)) for n in noises)] for m in methods]
    return [*lines, table(["estimator", "time / ns", *(f"error at noise {n} / °" for n in noises)], body), "Walls, cubic voxels."]


def scenes(b):
    read, said, command = b.report("scenes")
    lines = [command_block(command), findings(said)]
    for name, title in (("scenes", "Scenes"), ("parts", "Savings by part")):
        lines += [f"### {title}", table(*read(name))]
    return lines


def dynamics(b):
    read, said, command = b.report("dynamics", *(["--scan", b.args.scan] if b.args.scan else []))
    lines = [command_block(command), findings(said)]
    head, rows = read("precision")
    step = head.index("step / s or tolerance")
    walls = list(dict.fromkeys(r[0] for r in rows))
    best = {}
    for r in rows:
        # A flight's step, or the nearest one measured; adaptive methods have tolerances in this column.
        off = abs(math.log(float(r[step]) * 120.0))
        if off < 0.1 and off < best.get((r[1], r[0]), (math.inf,))[0]:
            best[(r[1], r[0])] = (off, r)
    methods = list(dict.fromkeys(m for m, _ in best))
    body = []
    for m in methods:
        at = [best.get((m, w), (None, None))[1] for w in walls]
        body.append([m, *(r[3] if r else None for r in at), *(r[5] if r else None for r in at[:1])])
    lines += ["### Error in position after a flight in steps of 1/120 s", table(["method", *(f"{w} / mm" for w in walls), f"time of the flight, {walls[0]} / µs"], body)]
    for name, title in (("tentacles", "Number of tentacles"), ("mines-worth", "Drawings flown with and without mines")):
        lines += [f"### {title}", table(*read(name))]
    return lines


def perforation(b):
    read, said, command = b.report("perforation")
    head, rows = read("methods")
    steps, through = (sum(int(float(r[head.index(k)])) for r in rows) for k in ("steps", "perforations"))
    b.answer("steps through the wall, in difficult places", "the phantom", f"{through} of {steps}")
    return [command_block(command), findings(said), table(*pick(head, rows, ("method", "steps", "perforations", "not finite", "hangs", "least margin / mm")))]


def faults(b):
    if not b.args.mutants:
        raise Missing("a folder written by mutants.py, named by `--mutants`")
    with open(os.path.join(b.args.mutants, "plan.json"), encoding="utf-8") as f:
        plan = json.load(f)
    yield command_block(f"python3 tests/bench/mutants.py --out OUT/ --seed {' '.join(map(str, plan['seeds']))} --count {plan['count']}"
                        + (" --faults tests/bench/faults.jsonl tests/bench/faults2.jsonl" if plan["by_hand"] else "") + ("" if plan["stage"] == "digest" else f" --stage {plan['stage']}"))
    yield (f"Faults were put into the program at drawn places, one at a time (begun {plan['date']}, commit {plan['commit'][:7]}). "
           "A fault is noticed by the first test that fails"
           + (", here of the unit tests alone" if plan["stage"] == "unit" else "") + ". Those that change nothing are listed with a reason in "
           "`tests/bench/equivalent.txt`.")
    done = subprocess.run([sys.executable, str(HERE / "mutants.py"), "--table", b.args.mutants], stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise Failed("mutants.py --table ended with an error")
    yield done.stdout.strip()


def cleansing(b):
    read, said, command = b.report("cleansing")
    head, rows = read("parts")
    method, wall, error = (head.index(k) for k in ("method", "wall", "mean position error / mm"))
    under = [float(r[error]) for r in rows if r[method] == "cleansed" and r[wall] == "under fluid" and r[error]]
    if under:
        b.answer("mean error of the wall under fluid, cleansed", "the phantom", f"{cell(sum(under) / len(under))} mm")
    return [command_block(command), findings(said), table(*read("methods"))]


def coverage(b):
    read, said, command = b.report("coverage", *(["--scan", b.args.scan] if b.args.scan else []))
    columns = ("volume", "guide", "view angle / degrees", "one way / %", "same places, both ways / %", "flown there and back / %",
               "missed patches of 300 mm² or more")
    return [command_block(command), findings(said), table(*pick(*read("flights"), columns))]


def unfold(b):
    read, said, command = b.report("unfold", *(["--scan", b.args.scan] if b.args.scan else []))
    columns = ("wall", "method", "absent / %", "twice / %", "s1/s2, 5 %", "50 %", "95 %", "polyps", "shown once", "size error / mm", "time / s")
    return [command_block(command), findings(said), table(*pick(*read("unfold"), columns))]


def candidates(b):
    read, said, command = b.report("candidates")
    head, rows = read("sensitivity")
    polyps = head.index("polyps")
    # Each detector's first row is of all polyps from 6 mm; the others are of sites, shapes and sizes.
    of_all = [r for r in rows if r[polyps] == rows[0][polyps]]
    columns = ("detector", "polyps", "number", "1 a scan / %", "2 a scan / %", "4 a scan / %", "at any score / %")
    shown = pick(head, of_all, columns)
    b.answer(f"polyps, {rows[0][polyps]}: found at 2 false positives a scan", "the phantom", f"{cell(of_all[0][head.index('2 a scan / %')])} %")
    return [command_block(command), findings(said), table(*shown), "Sensitivity at numbers of false positives a scan."]


# What is asked most comes first.
PARTS = {
    "frames": ("Frames of a flight", frames),
    "window": ("In a window", window),
    "flights": ("Flights by guide", flights),
    "fields": ("Lumen, wall distance, centerline", fields),
    "coverage": ("Coverage: the share of the wall that flights see", coverage),
    "unfold": ("The colon laid flat", unfold),
    "candidates": ("Candidates: polyps found against false positives", candidates),
    "cleansing": ("Cleansing: the wall under tagged fluid", cleansing),
    "perforation": ("Random steps against the wall", perforation),
    "render": ("Renderers: error against time", render),
    "gradients": ("Gradient estimators", gradients),
    "dynamics": ("Dynamics", dynamics),
    "scenes": ("Savings from omitted parts", scenes),
    "faults": ("Faults that the tests notice", faults),
}

BY_TESTS = """## Bounds held by tests

Tests hold these numbers within bounds and print what they measure: `COLVIS_CHECKS=full cargo test --release TESTS -- --include-ignored --nocapture`.

| measurement | TESTS |
|---|---|
| depth against the analytic wall, with folds, polyps and noise; normals at that wall | `--test pictures depth` |
| normals of a tube and a sphere at several noise levels | `--lib gradient` |
| share of the centerline passed, distance from it, least clearance | `--test flights flight` |
| jerk when a guide resumes after operator input | `--test flights guides` |
| traps: noticed, identified, left | `--test flights traps` |
| error of the default preset's images against brute force | `--test pictures packets` |
| flights and images identical to those before a change | `--test flights digests` |
"""


# Page ----------------------------------------------------------------------------------------------------------------


def cores():
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def first_match(path, key):
    try:
        with open(path, encoding="utf-8") as f:
            return next((line.partition(":")[2].strip() for line in f if line.startswith(key)), None)
    except OSError:
        return None


def machine(b):
    """The machine, as rows of a table."""
    memory = first_match("/proc/meminfo", "MemTotal")
    memory = f"{int(memory.split()[0]) / 2**20:.1f} GiB" if memory else "unknown"
    stats = b.at("machine.json")
    b.run([b.args.colvis, "fly", "--headless", "--seconds", "0.05", "--stats", stats])
    with open(stats, encoding="utf-8") as f:
        simd = json.load(f).get("simd", "unknown")
    processor = first_match("/proc/cpuinfo", "model name") or platform.processor() or "unknown processor"
    return [["machine", f"{processor}, {cores()} cores, {memory}, {simd}, {platform.system()} {platform.machine()}"], ["threads used", b.args.threads]]


def git(*words):
    try:
        done = subprocess.run(["git", *words], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def commit():
    name = git("describe", "--tags", "--always") or "unknown"
    full = git("rev-parse", "--short=12", "HEAD")
    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!RESULTS.md")
    named = name if not full or full.startswith(name) or name.startswith(full) else f"{name} ({full})"
    return named + (", with uncommitted changes" if changed else "")


def older_than_sources(binary):
    sources = [p for folder in ("src", "systems") for p in (ROOT / folder).rglob("*.rs")] + [ROOT / "Cargo.toml", ROOT / "Cargo.lock"]
    newest = max((p.stat().st_mtime for p in sources if p.exists()), default=0.0)
    return os.stat(binary).st_mtime < newest


def load():
    return f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"


def part(b, name):
    """A section's text, and True if the part failed."""
    title, measure = PARTS[name]
    if name not in b.args.parts:
        return f"## {title}\n\nNot measured in this run (`--parts`).", False
    try:
        return "\n\n".join([f"## {title}", *(line for line in measure(b) if line)]), False
    except Missing as e:
        return f"## {title}\n\nNot measured in this run: {e}.", False
    except (Failed, OSError, KeyError, IndexError, ValueError, StopIteration) as e:
        why = str(e) if isinstance(e, Failed) else f"{type(e).__name__}: {e}"
        print(f"{name} failed: {why}", file=sys.stderr)
        return f"## {title}\n\nFailed in this run: {why}", True


def page(b):
    begun, busy = datetime.datetime.now(datetime.timezone.utc), load()
    stale = older_than_sources(b.args.colvis)
    if stale:
        print("the program is older than the sources: run cargo build --release", file=sys.stderr)
    about = [["command", Text(f"`{b.invocation()}`")], ["date", f"{begun:%Y-%m-%d %H:%M} UTC"], ["commit", commit() + ("; the program is older than the sources" if stale else "")], *machine(b)]
    about.append(["scan", os.path.basename(b.args.scan) if b.args.scan else "none: phantoms only"])
    sections = [part(b, name) for name in PARTS]
    took = (datetime.datetime.now(datetime.timezone.utc) - begun).total_seconds() / 60
    about.append(["machine load before, after; minutes taken", f"{busy}, {load()}; {took:.0f}"])
    intro = (
        "Measurements of colvis. One command writes this page and reuses no number from an earlier run:\n\n"
        + command_block("cargo build --release", "python3 tests/bench/results.py --scan SCAN --vtk \"VTK\" --fields-peer \"PEER\" --display "
                        "\"xvfb-run -a -s '-screen 0 1280x1280x24'\"")
    )
    names = (
        "Each section begins with its command. `colvis` is `target/release/colvis`, `SCAN` the scan named above. `phantom.nii` is the synthetic "
        "colon of `colvis phantom --out phantom.nii --truth phantom.json" + (" --size small" if b.small else "")
        + "`. *VTK* and *PEER* are other programs, measured in the same run on the same data with the same number of threads. The reports "
        "write more tables than this page shows, as CSV files beside their `report.html`."
    )
    quick = "**Quick run**: smaller phantoms, fewer poses, fewer repetitions. It shows that everything runs, not how fast it is."
    subjects = ["the phantom", *(["the scan"] if b.args.scan else [])]
    asked = [[Text(question), *(by.get(name) for name in subjects)] for question, by in b.answers.items()]
    head = ["# Results", intro, *([quick] if b.args.quick else []), "## Asked most", table(["", *subjects], asked), "## This run",
            table(["", ""], about), names]
    return "\n\n".join([*head, *(text for text, _ in sections), BY_TESTS.strip()]) + "\n", any(failed for _, failed in sections)


def main():
    args = arguments()
    with tempfile.TemporaryDirectory() as folder:
        if args.keep:
            os.makedirs(args.keep, exist_ok=True)
        text, failed = page(Bench(args, args.keep or folder))
    # Replace the file in one step, so that it is never half written.
    new = args.out + ".new"
    with open(new, "w", encoding="utf-8") as f:
        f.write(text)
    os.replace(new, args.out)
    print(f"see {args.out}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
