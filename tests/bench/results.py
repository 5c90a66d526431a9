#!/usr/bin/env python3
"""Regenerates RESULTS.md: repeats all measurements of this project on this machine.

    cargo build --release
    python3 tests/bench/results.py [--scan SCAN] [--vtk "COMMAND"] [--fields-peer "COMMAND"] [--display "COMMAND"]
                                   [--parts frames,window,flights,fields,render,gradients,scenes,dynamics,perforation,cleansing,coverage,candidates,
                                   faults]
                                   [--mutants FOLDER] [--quick] [--check N] [--colvis BINARY] [--keep FOLDER] [--out RESULTS.md]

This script builds nothing. It runs the program (`--colvis`, else the environment variable COLVIS, else target/release/colvis)
and the scripts frames.py, flights.py and fields.py in the same folder. Each table on the page follows the command that made it.
The page marks what this run did not measure; it never reuses numbers from an earlier run. A full run takes some hours on two
cores, --quick some minutes. Leave the machine otherwise idle during the run.

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

# Tables with more rows than this are collapsed.
LONG = 30

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
    lines += ["| " + " | ".join(cell(c) for c in row) + " |" for row in rows]
    text = "\n".join(lines)
    return text if len(rows) <= LONG else f"<details><summary>{len(rows)} rows</summary>\n\n{text}\n\n</details>"


def command_block(text):
    return f"```sh\n{text}\n```"


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

    def without_scan(self):
        return [] if self.args.scan else ["This run measured no patient scan (`--scan`)."]


# Parts ---------------------------------------------------------------------------------------------------------------


def frames(b):
    few = ["--poses", "24", "--sizes", "256,512"] if b.args.quick else ["--runs", "3"]
    peer = ["--vtk", b.args.vtk] if b.args.vtk else []
    check = ["--check", str(b.args.check)] if b.args.check else []
    lines, rows, memory, failed = [], [], [], []
    for name, scan in b.subjects():
        found, command = b.script("frames", scan, *few, "--threads", b.args.threads, *check, *peer)
        lines.append(command_block(command))
        for s in found["sizes"]:
            other, least, psnr = s.get("peer", {}), s.get("least", {}), s.get("psnr", {})
            of_least = least["p99_ms"] / least["median_ms"] if least else None
            rows.append([name, f"{s['size']}×{s['size']}", s["median_ms"], s["p99_ms"], of_least, s["rays_a_pixel"],
                         psnr.get("least_db"), psnr.get("mean_db"), other.get("median_ms"), other.get("ratio")])
            if s.get("peer_failed"):
                failed.append(f"VTK failed on {name} at {s['size']}×{s['size']}: {b.plain(s['peer_failed'])}.")
        for m in found["memory"]:
            memory.append([name, m["preset"], mib(m["peak_rss_bytes"]), m["first_frame_s"]])
        others = [s["peer"] for s in found["sizes"] if "peer" in s]
        if others:
            first, peak = others[-1].get("first_frame_s"), max(o.get("peak_rss_mib", 0) for o in others)
            memory.append([name, "VTK", f"{peak} MiB", first])
    head = ["", "image", "median / ms", "p99 / ms", "p99 / median, by pose", "rays a pixel",
            "PSNR, least / dB", "PSNR, mean / dB", "VTK, median / ms", "ratio"]
    lines += [table(head, rows), "The poses are spread over a flight through the whole lumen. *p99 / median, by pose* uses each pose's "
              "shortest time of several runs, which excludes other load on the machine. PSNR is against brute force. "
              "The VTK command decides how many of the poses VTK renders."]
    if not b.args.vtk:
        lines.append("This run measured no other renderer (`--vtk`).")
    if not b.args.check:
        lines.append("This run compared no pose with brute force (`--check`). The section *Renderers* lists errors.")
    lines += [table(["", "preset", "peak memory, headless flight with images", "scan in memory → first image / s"], memory)]
    return lines + failed + b.without_scan()


def window(b):
    if not b.args.display and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise Missing("no screen is available (`--display`)")
    side, seconds = (512, "3") if b.args.quick else (1024, "10")
    rows, lines = [], []
    for name, scan in b.subjects():
        stats = b.at("window.json")
        command = [b.args.colvis, "fly", scan, "--size", f"{side}x{side}", "--seconds", seconds, "--layout", "flight", "--stats", stats]
        b.run([*shlex.split(b.args.display or ""), *command])
        lines.append(command_block(b.shown(command)))
        with open(stats, encoding="utf-8") as f:
            stats = json.load(f)
        ms = sorted(f["ms"] for f in stats["frames"])
        shown = stats.get("present_ms") or {}
        rows.append([name, len(ms), ms[len(ms) // 2], ms[int(len(ms) * 0.99)], shown.get("median"), shown.get("p99")])
    head = ["", "frames", "median / ms", "p99 / ms", "presentation, median / ms", "presentation, p99 / ms"]
    return [*lines, table(head, rows), *b.without_scan()]


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
    return [command_block(command), words, table(head, rows), *b.without_scan()]


def fields(b):
    rounds = ["--rounds", "1" if b.args.quick else "5", "--threads", b.args.threads]
    peer = ["--peer", b.args.fields_peer] if b.args.fields_peer else []
    lines, rows = [], []
    for name, scan in b.subjects():
        truth = ["--truth", b.phantom()[1]] if name == "the phantom" else []
        found, command = b.script("fields", scan, *truth, *rounds, *peer)
        lines.append(command_block(command))
        prepare, off = found["prepare"], found.get("line_to_truth_mm", {})
        parts = [prepare.get(k) for k in ("lumen_s", "distance_s", "centerline_s")]
        rows.append([name, "colvis", *parts, found["sum_s"], mib(found["peak_rss_bytes"]), off.get("mean"), off.get("p95"), off.get("worst")])
        if "peer_failed" in found:
            lines.append(f"The other program failed on {name}: {b.plain(found['peer_failed'])}.")
        if "peer" in found:
            p = found["peer"]
            part = lambda word: next((v for k, v in p.items() if k.startswith(word) and k.endswith("_s")), None)
            rows.append([name, "peer", part("segment"), part("distance"), part("centerline"), p["sum_s"], f"{p.get('peak_rss_mib', '–')} MiB",
                         p.get("centerline_mean_mm"), p.get("centerline_p95_mm"), p.get("centerline_max_mm")])
    head = ["", "program", "lumen / s", "distance / s", "centerline / s", "sum / s", "peak memory",
            "line's error, mean / mm", "line's error, 95 % / mm", "line's error, worst / mm"]
    lines += [table(head, rows), *b.without_scan()]
    if not b.args.fields_peer:
        lines.append("This run measured no other program (`--fields-peer`).")
    read, said, command = b.report("fields", *(["--scan", b.args.scan] if b.args.scan else []))
    lines += [command_block(command), findings(said)]
    lines += [table(*read(name)) for name in ("distance-methods", "centerline-methods", "preparation")]
    head, rows = read("slices")
    skips, order, parts, status = (head.index(k) for k in ("skips", "segments in order", "parts in order", "exit status"))
    faults = [r for r in rows if r[status] != "0" or r[skips] != "0" or r[order] != "yes" or r[parts] != "yes"]
    lines.append(f"### Thick slices, noise and thin walls: {len(faults)} of {len(rows)} volumes with a fault")
    return lines + ([table(head, faults)] if faults else [])


def render(b):
    read, said, command = b.report("render", *(["--scan", b.args.scan] if b.args.scan else []))
    lines = [command_block(command), findings(said)]
    kept = ("method", "PSNR mean / dB", "PSNR worst / dB", "SSIM worst", "frame median / ms", "frame p99 / ms", "samples a ray",
            "memory / 16-bit volume", "made ready in / s")
    for subject, name in (("phantom", "The phantom"), ("scan", "The scan")):
        try:
            head, rows = read(f"{subject}-methods")
        except FileNotFoundError:
            continue
        columns = [head.index(k) for k in kept if k in head]
        lines += [f"### {name}: renderers", table([head[n] for n in columns], [[r[n] for n in columns] for r in rows])]
        lines += [f"### {name}: the paper's claims", table(*read(f"{subject}-claims"))]
        lines += [f"### {name}: value of each of the paper's ideas in its preset", table(*read(f"{subject}-worth"))]
    for what, title in (("voxels", "Voxels"), ("threads", "Threads"), ("simd", "SIMD levels")):
        lines += [f"### {title}, default preset", table(*read(f"phantom-{what}"))]
    return lines + b.without_scan()


def gradients(b):
    read, said, command = b.report("gradients")
    lines = [command_block(command), findings(said)]
    for file, title in (("walls-cubic", "Walls, cubic voxels"), ("walls-1-1-3", "Walls, voxels 1:1:3"),
                        ("marschner-lobb-cubic", "Marschner–Lobb signal, cubic voxels")):
        _, rows = read(file)
        noises = list(dict.fromkeys(r[1] for r in rows))
        methods = list(dict.fromkeys(r[0] for r in rows))
        value = {(r[0], r[1]): r[3] for r in rows}
        time = {r[0]: r[2] for r in rows}
        body = [[m, time[m], *(value.get((m, n)) for n in noises)] for m in methods]
        lines += [f"### {title}", table(["estimator", "time / ns", *(f"error at noise {n} / °" for n in noises)], body)]
    return lines


def scenes(b):
    read, said, command = b.report("scenes")
    lines = [command_block(command), findings(said)]
    for name, title in (("scenes", "Scenes"), ("lights", "Cost of the camera light"), ("parts", "Savings by part"), ("built", "Built before the first step"),
                        ("tentacles", "Cost of tentacles relative to an image")):
        lines += [f"### {title}", table(*read(name))]
    return lines


def dynamics(b):
    read, said, command = b.report("dynamics", *(["--scan", b.args.scan] if b.args.scan else []))
    lines = [command_block(command), findings(said)]
    lines += ["### Order of convergence", table(*read("orders"))]
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
    tables = (("stable-step-by-wall-table", "Largest stable step, by the wall's constant / s"),
              ("stable-step-by-clearance-table", "Largest stable step, by clearance / s"),
              ("lateral-jerk", "Steady flight"), ("clamp", "Cost of the clamp"), ("free-motion", "Conservation in free motion"),
              ("tentacles", "Number of tentacles"), ("mines", "Mines"), ("mines-worth", "Mines: drawings flown with and without them"),
              ("repulsion", "Flights by repulsion alone"))
    return lines + [t for name, title in tables for t in (f"### {title}", table(*read(name)))] + b.without_scan()


def perforation(b):
    read, said, command = b.report("perforation")
    lines = [command_block(command), findings(said)]
    return lines + ["### By method", table(*read("methods")), "### By place", table(*read("places"))]


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
    return [command_block(command), findings(said), "### By method", table(*read("methods")), "### By part of the wall", table(*read("parts"))]


def coverage(b):
    read, said, command = b.report("coverage", *(["--scan", b.args.scan] if b.args.scan else []))
    parts = [command_block(command), findings(said)]
    for title, name in [("Flights", "flights"), ("What can be seen at all", "visible"), ("Where the rest lies", "reasons"),
                        ("By part of the wall", "parts"), ("Time and memory", "cost")]:
        parts += [f"### {title}", table(*read(name))]
    return parts


def candidates(b):
    read, said, command = b.report("candidates")
    parts = [command_block(command), findings(said)]
    for title, name in [("Sensitivity", "sensitivity"), ("Measures", "measures"), ("Decoys", "decoys")]:
        parts += [f"### {title}", table(*read(name))]
    return parts


PARTS = {
    "frames": ("Frames of a flight", frames),
    "window": ("In a window", window),
    "flights": ("Flights by guide", flights),
    "fields": ("Lumen, wall distance, centerline", fields),
    "render": ("Renderers: error against time", render),
    "gradients": ("Gradient estimators", gradients),
    "scenes": ("Savings from omitted parts", scenes),
    "dynamics": ("Dynamics", dynamics),
    "perforation": ("Random steps against the wall", perforation),
    "cleansing": ("The wall under tag", cleansing),
    "coverage": ("Coverage: the share of the wall that flights see", coverage),
    "candidates": ("Candidates: polyps found against false positives", candidates),
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
    """The machine, one property for each row."""
    memory = first_match("/proc/meminfo", "MemTotal")
    memory = f"{int(memory.split()[0]) / 2**20:.1f} GiB" if memory else "unknown"
    stats = b.at("machine.json")
    b.run([b.args.colvis, "fly", "--headless", "--seconds", "0.05", "--stats", stats])
    with open(stats, encoding="utf-8") as f:
        simd = json.load(f).get("simd", "unknown")
    return [["processor", first_match("/proc/cpuinfo", "model name") or platform.processor() or "unknown"], ["cores", cores()],
            ["threads used", b.args.threads], ["memory", memory], ["SIMD level", simd], ["system", f"{platform.system()} {platform.machine()}"]]


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
        "Measurements of this project. One command regenerates this page and reuses no number from an earlier run; `--help` "
        "lists its options:\n\n```sh\ncargo build --release\npython3 tests/bench/results.py --scan SCAN "
        '--vtk "VTK" --fields-peer "PEER" --display "xvfb-run -a -s \'-screen 0 1280x1280x24\'"\n```\n\n'
        "The command below each heading made the tables of that section. `colvis` is `target/release/colvis`. `SCAN` is the scan "
        "named below. `phantom.nii` is the synthetic colon of `colvis phantom --out phantom.nii --truth phantom.json"
        + (" --size small" if b.small else "")
        + "`. *VTK* and *PEER* are other programs, measured in the same run on the same data with the same number of threads."
    )
    quick = "**Quick run**: smaller phantoms, fewer poses, fewer repetitions. It shows that everything runs, not how fast it is."
    head = ["# Results", intro, *([quick] if b.args.quick else []), table(["this run", ""], about)]
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
