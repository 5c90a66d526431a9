#!/usr/bin/env python3
"""Measures lumen, wall distance and centerline of colvis, and of another program on the same scan in the same run.

usage: python3 tests/bench/fields.py SCAN [--colvis BINARY] [--truth T.json] [--threads 2] [--rounds 3]
                                     [--peer "PYTHON fields.py"] [--json OUT]

Runs `colvis centerline SCAN` and prints the preparation times (seconds, median of the rounds), their sum without reading the
file, the peak memory, and the line's error. The error is measured against the truth from `colvis phantom --truth` (mm: mean,
95 %, worst; in both directions, between the line's ends).

--peer names a command that takes `SCAN --seed X Y Z --threads N [--truth T.json]` and prints one line of JSON with its
seconds and errors. The seed is the line's first point. --json also writes all numbers to a file. Requires only the standard
library.

The program is --colvis, else the environment variable COLVIS, else target/release/colvis.
"""
import argparse, json, math, os, pathlib, shlex, statistics, subprocess, sys, tempfile


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
    """Mean, 95th percentile and largest distance of points from a line, mm."""
    e = sorted(off(p, line) for p in points)
    return {"mean": sum(e) / len(e), "p95": e[int(0.95 * (len(e) - 1))], "worst": e[-1]}


def shown(e):
    return f"mean {e['mean']:.3f}, 95 % {e['p95']:.3f}, worst {e['worst']:.3f}"


ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
ap.add_argument("scan")
ap.add_argument("--colvis", default=os.environ.get("COLVIS"))
ap.add_argument("--truth")
ap.add_argument("--threads", default="2")
ap.add_argument("--rounds", type=int, default=3)
ap.add_argument("--peer")
ap.add_argument("--json", help="also write the numbers to this file")
a = ap.parse_args()
colvis = a.colvis or str(pathlib.Path(__file__).resolve().parents[2] / "target/release/colvis")
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
out = {"scan": os.path.basename(a.scan), "prepare": parts, "sum_s": own, "peak_rss_bytes": peak * 2**20, "length_mm": line["length_mm"]}
if a.truth:
    truth = json.load(open(a.truth))["centerline"]
    nearest = lambda p: min(range(len(truth)), key=lambda n: math.dist(truth[n], p))
    first, last = sorted((nearest(line["points"][0]), nearest(line["points"][-1])))
    out["line_to_truth_mm"] = errors(line["points"], truth)
    out["truth_to_line_mm"] = errors(truth[first : last + 1], line["points"])
    print(f"  line to truth, mm: {shown(out['line_to_truth_mm'])}")
    print(f"  truth to line, mm: {shown(out['truth_to_line_mm'])}")
if a.peer:
    seed = [str(x) for x in line["points"][0]]
    more = ["--truth", os.path.abspath(a.truth)] if a.truth else []
    command = shlex.split(a.peer) + [a.scan, "--seed", *seed, "--threads", a.threads, *more]
    try:
        said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        peer = json.loads(said.strip().splitlines()[-1])
    except (OSError, subprocess.CalledProcessError, ValueError, IndexError) as e:
        # The numbers of colvis stay valid.
        why = f"exit status {e.returncode}" if isinstance(e, subprocess.CalledProcessError) else f"{type(e).__name__}: {e}"
        print(f"the other program failed: {why}", file=sys.stderr)
        out["peer_failed"] = why
    else:
        seconds = sum(v for k, v in peer.items() if k.endswith("_s"))
        print(f"peer: {seconds:.3f} s without loading; {json.dumps(peer)}")
        out["peer"] = {**peer, "sum_s": seconds}
if a.json:
    with open(a.json, "w") as f:
        json.dump(out, f, indent=1)
