#!/usr/bin/env python3
"""Flies each automatic guide both ways through phantoms with all features and through scans, and prints a table.

    python3 tests/bench/flights.py [--colvis BINARY] [--seeds 1-10] [--size standard] [--guides tentacles,potential,path]
                                   [--scan SCAN ...] [--json OUT]

Each row covers one guide's two flights through one scan, to the cecum and back: how they ended (arrived, or the program's reason
for stopping), simulated seconds, mean and least clearance (mm), mean distance from the centerline (mm; from the phantom's truth,
or from `colvis centerline` for a scan), 99th percentile of the jerk (mm/s^3, by finite differences over a step), and the share
of the wall seen one way and both ways. Requires only the standard library.
"""

import argparse
import bisect
import json
import math
import os
import subprocess
import sys
import tempfile


def arguments():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--colvis", default=os.environ.get("COLVIS", "target/release/colvis"), help="program to run; default: COLVIS")
    p.add_argument("--seeds", default="1-10", help="phantom seeds: A-B, or none")
    p.add_argument("--size", default="standard", help="phantom size")
    p.add_argument("--with", dest="features", default="folds,polyps,fluid,bridges,noise")
    p.add_argument("--guides", default="tentacles,potential,path")
    p.add_argument("--scan", action="append", default=[])
    p.add_argument("--one-way", action="store_true", help="do not fly back")
    p.add_argument("--keep", metavar="FOLDER", help="keep the phantoms in this folder, and reuse those already there")
    p.add_argument("--json", help="also write the rows to this file")
    return p.parse_args()


class Line:
    """A centerline's points; measures the distance of a position from them."""

    def __init__(self, points):
        self.points = sorted((tuple(p) for p in points), key=lambda p: p[2])
        self.z = [p[2] for p in self.points]

    def distance(self, p):
        best = math.inf
        at = bisect.bisect_left(self.z, p[2])
        for steps in (range(at, len(self.z)), range(at - 1, -1, -1)):
            for n in steps:
                if abs(self.z[n] - p[2]) >= best:
                    break
                best = min(best, math.dist(self.points[n], p))
        return best


def fly(colvis, scan, guide, back, folder):
    log, stats = (os.path.join(folder, n) for n in ("f.jsonl", "f.json"))
    command = [colvis, "fly", scan, "--headless", "--guide", guide, "--log", log, "--stats", stats, "--coverage"]
    said = subprocess.run(command + (["--reverse"] if back else []), stderr=subprocess.PIPE, text=True)
    if said.returncode not in (0, 4):
        sys.exit(said.stderr)
    with open(stats) as f:
        stats = json.load(f)
    with open(log) as f:
        return stats, [json.loads(line) for line in f]


def row(name, guide, flights, line):
    lines = [l for f in flights for l in f[1]]
    clearance = [l["clearance_mm"] for l in lines] or [0.0]
    off = [line.distance(l["position"]) for l in lines[::24]] if line else []
    jerks = []
    for _, log in flights:
        v = [l["velocity"] for l in log]
        for a, b, c in zip(v, v[1:], v[2:]):
            jerks.append(math.sqrt(sum((x - 2 * y + z) ** 2 for x, y, z in zip(a, b, c))) * 120 * 120)
    jerks.sort()
    return {
        "scan": name,
        "guide": guide,
        "end": ", ".join(s["state"] if s["state"] != "operator" else "operator: " + s["reason"] for s, _ in flights),
        "escapes": sum(s.get("escapes", 0) for s, _ in flights),
        "seconds": [log[-1]["t"] if log else 0.0 for _, log in flights],
        "mm": [s["length_mm"] for s, _ in flights],
        "clearance_mean": sum(clearance) / len(clearance),
        "clearance_least": min(clearance),
        "offset": sum(off) / len(off) if off else None,
        "jerk_p99": jerks[int(0.99 * (len(jerks) - 1))] if jerks else 0.0,
        "one_way": [s.get("coverage") for s, _ in flights],
        "both_ways": [s.get("coverage_both_ways") for s, _ in flights],
    }


def shown(r):
    def each(values, form):
        return ", ".join("-" if v is None else form.format(v) for v in values)

    offset = "-" if r["offset"] is None else f"{r['offset']:.1f}"
    return (
        f"| {r['scan']} | {r['guide']} | {r['end']} | {each(r['seconds'], '{:.0f}')} | {r['clearance_mean']:.1f}, "
        f"{r['clearance_least']:.1f} | {offset} | {r['jerk_p99']:.0f} | {each(r['one_way'], '{:.2f}')} "
        f"| {each(r['both_ways'], '{:.2f}')} |"
    )


def main():
    args = arguments()
    with tempfile.TemporaryDirectory() as folder:
        rows = []
        print("| scan | guide | end: out, back | s | clearance mean, least mm | distance from the centerline mm "
              "| jerk p99 mm/s³ | wall seen one way | both ways |\n|---|---|---|---|---|---|---|---|---|", flush=True)
        first, _, last = args.seeds.partition("-")
        seeds = [] if args.seeds == "none" else range(int(first), int(last or first) + 1)
        for what in [*seeds, *args.scan]:
            if isinstance(what, int):
                scan, truth = (os.path.join(args.keep or folder, f"{what}{e}") for e in (".nii", ".json"))
                if not os.path.exists(truth):
                    subprocess.run([args.colvis, "phantom", "--out", scan, "--truth", truth, "--seed", str(what),
                                    "--size", args.size, "--with", args.features], check=True, stderr=subprocess.DEVNULL)
                name, points = f"seed {what}", json.load(open(truth))["centerline"]
            else:
                scan, line = what, os.path.join(folder, "line.json")
                name, points = os.path.basename(what), []
                if subprocess.run([args.colvis, "centerline", scan, "--out", line], stderr=subprocess.DEVNULL).returncode == 0:
                    points = json.load(open(line))["points"]
            line = Line(points) if points else None
            for guide in args.guides.split(","):
                ways = [False] if args.one_way else [False, True]
                rows.append(row(name, guide, [fly(args.colvis, scan, guide, back, folder) for back in ways], line))
                print(shown(rows[-1]), flush=True)
        if args.json:
            with open(args.json, "w") as f:
                json.dump(rows, f, indent=1)


if __name__ == "__main__":
    main()
