#!/usr/bin/env python3
"""Lumen, wall distance and centerline of colvis, and of another program on the same scan in the same run.

usage: python3 tests/bench/fields.py SCAN [--truth T.json] [--threads 2] [--rounds 3] [--peer "PYTHON fields.py"]

Runs `colvis centerline SCAN` and prints a line for each: the parts of the preparation (seconds, the medians of the rounds),
their sum without reading the file, the peak of memory, and the line's error against the truth that `colvis phantom --truth`
wrote (mm: mean, 95 %, worst; both ways between the line's ends). --peer names a command that takes
`SCAN --seed X Y Z --threads N [--truth T.json]`, the seed being the line's first point, and prints a line of JSON with its
seconds and errors. The standard library is enough.
"""
import argparse, json, math, os, pathlib, shlex, statistics, subprocess, tempfile


def off(p, line):
    """Distance of a point from a line, mm."""
    best = math.inf
    for a, b in zip(line, line[1:]):
        d = [y - x for x, y in zip(a, b)]
        w = [y - x for x, y in zip(a, p)]
        n = sum(x * x for x in d)
        t = max(0.0, min(1.0, sum(x * y for x, y in zip(d, w)) / n)) if n else 0.0
        best = min(best, sum((y - t * x) ** 2 for x, y in zip(d, w)))
    return math.sqrt(best)


def errors(points, line):
    e = sorted(off(p, line) for p in points)
    return f"mean {sum(e) / len(e):.3f}, 95 % {e[int(0.95 * (len(e) - 1))]:.3f}, worst {e[-1]:.3f}"


ap = argparse.ArgumentParser()
ap.add_argument("scan")
ap.add_argument("--truth")
ap.add_argument("--threads", default="2")
ap.add_argument("--rounds", type=int, default=3)
ap.add_argument("--peer")
a = ap.parse_args()
colvis = pathlib.Path(__file__).resolve().parents[2] / "target/release/colvis"
with tempfile.TemporaryDirectory() as folder:
    at = lambda name: f"{folder}/{name}"
    rounds = []
    for _ in range(a.rounds):
        command = [colvis, "centerline", a.scan, "--out", at("c.json"), "--stats", at("s.json"), "--threads", a.threads]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        rounds.append(json.load(open(at("s.json"))))
    line = json.load(open(at("c.json")))
parts = {k: statistics.median(r["prepare"][k] for r in rounds) for k in rounds[0]["prepare"]}
own = sum(v for k, v in parts.items() if k != "load_s")
peak = max(r["peak_rss_bytes"] for r in rounds) / 2**20
print(f"colvis: {own:.3f} s without loading ({', '.join(f'{k} {v:.3f}' for k, v in parts.items())}), peak {peak:.0f} MiB")
print(f"  line: {line['length_mm']:.0f} mm, {len(line['points'])} points")
if a.truth:
    truth = json.load(open(a.truth))["centerline"]
    nearest = lambda p: min(range(len(truth)), key=lambda n: math.dist(truth[n], p))
    first, last = sorted((nearest(line["points"][0]), nearest(line["points"][-1])))
    print(f"  line to truth, mm: {errors(line['points'], truth)}")
    print(f"  truth to line, mm: {errors(truth[first : last + 1], line['points'])}")
if a.peer:
    seed = [str(x) for x in line["points"][0]]
    more = ["--truth", os.path.abspath(a.truth)] if a.truth else []
    command = shlex.split(a.peer) + [a.scan, "--seed", *seed, "--threads", a.threads, *more]
    said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    peer = json.loads(said.strip().splitlines()[-1])
    seconds = sum(v for k, v in peer.items() if k.endswith("_s"))
    print(f"peer: {seconds:.3f} s without loading; {json.dumps(peer)}")
