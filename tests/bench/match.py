#!/usr/bin/env python3
"""How well `colvis match` pairs the two positions of phantoms, beside plain distance along the line.

    COLVIS=target/release/colvis target/peers/bin/python tests/bench/match.py --seeds 1-10 [--size standard] [--with …] [--folder DIR]

Truth: `phantom --second` maps points of the wall both ways. A point of the first wall is told along the first line by its nearest point of
the line; the pair proposes a place along the second line and a direction from it. Errors are along the second line (from that place to the
nearest point of the line to the true point), and about it (between the proposed direction and that to the true point, across the line).
A polyp counts as visible if its top is within 60 degrees of the view axis and 100 mm of a camera that stands at most 20 mm before or behind
the proposed place on the line and looks at the proposed place of the wall, and no wall lies between.
"""

import argparse
import json
import os
import subprocess
from pathlib import Path

import nibabel
import numpy as np

COLVIS = os.path.abspath(os.environ.get("COLVIS", "target/release/colvis"))
# The image grid is RAS in a NIfTI file, places are LPS.
LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


def run(*line):
    subprocess.run([COLVIS, *map(str, line)], check=True, stderr=subprocess.DEVNULL)


def along(line):
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def nearest(line, points):
    return np.array([np.argmin(((line - p) ** 2).sum(1)) for p in points])


class Frames:
    """Frames that do not turn about a line: the line is smoothed, its points are 2 mm apart, and each normal is that before it, made
    perpendicular again."""

    def __init__(self, line):
        mm = along(line)
        even = np.arange(0.0, mm[-1], 1.0)
        line = np.stack([np.interp(even, mm, line[:, k]) for k in range(3)], 1)
        weights = np.exp(-0.5 * (np.arange(-15, 16) / 5.0) ** 2)
        padded = np.concatenate([np.repeat(line[:1], 15, 0), line, np.repeat(line[-1:], 15, 0)])
        self.at = np.stack([np.convolve(padded[:, k], weights / weights.sum(), "valid") for k in range(3)], 1)
        self.tangent = np.gradient(self.at, axis=0)
        self.tangent /= np.linalg.norm(self.tangent, axis=1)[:, None]
        normal = np.array([0.0, -1.0, 0.0])
        self.normal = []
        for t in self.tangent:
            normal = normal - t * (normal @ t)
            normal /= np.linalg.norm(normal)
            self.normal.append(normal)
        self.normal = np.array(self.normal)
        self.binormal = np.cross(self.tangent, self.normal)

    def row(self, mm):
        return int(np.clip(round(mm), 0, len(self.at) - 1))

    def angle(self, mm, place):
        d = place - self.at[self.row(mm)]
        return np.degrees(np.arctan2(d @ self.binormal[self.row(mm)], d @ self.normal[self.row(mm)]))

    def direction(self, mm, degrees):
        n, a = self.row(mm), np.radians(degrees)
        return self.normal[n] * np.cos(a) + self.binormal[n] * np.sin(a)


def between(a, b):
    return abs((a - b + 180.0) % 360.0 - 180.0)


class Scan:
    def __init__(self, path):
        image = nibabel.load(path)
        self.hu = np.asarray(image.dataobj)
        self.voxel = np.linalg.inv(LPS @ image.affine)

    def is_lumen(self, p):
        n = np.round(self.voxel[:3, :3] @ p + self.voxel[:3, 3]).astype(int)
        if (n < 0).any() or (n >= self.hu.shape).any():
            return False
        return self.hu[tuple(n)] < -500

    def sees(self, eye, place, short_mm):
        way = place - eye
        length = np.linalg.norm(way)
        return all(self.is_lumen(eye + way * (d / length)) for d in np.arange(0.0, length - short_mm, 0.5))

    def wall(self, at, direction):
        reach = 0.0
        while reach < 60.0 and self.is_lumen(at + direction * (reach + 0.5)):
            reach += 0.5
        return at + direction * reach


def measure(seed, args):
    folder = args.folder
    names = {k: folder / f"{args.size}-{seed}-{k}" for k in ("a.nii", "b.nii", "c.nii", "t.json", "m.json", "s.json", "al.json", "bl.json")}
    if not names["t.json"].exists():
        run("phantom", "--size", args.size, "--seed", seed, "--with", args.parts, "--out", names["a.nii"], "--second", names["b.nii"],
            "--truth", names["t.json"])
    run("match", names["a.nii"], names["b.nii"], "--out", names["m.json"], "--stats", names["s.json"])
    if not names["c.nii"].exists():
        run("cleanse", names["b.nii"], "--out", names["c.nii"])
    truth, match = (json.loads(names[k].read_text()) for k in ("t.json", "m.json"))
    for scan, line, measured in (("a.nii", "al.json", 0), ("b.nii", "bl.json", 1)):
        run("centerline", names[scan], "--out", names[line], *["--cleanse"][: match["cleansed"][measured]])
    lines = [np.array(json.loads(names[k].read_text())["points"]) for k in ("al.json", "bl.json")]
    pairs, turns = np.array(match["pairs"]), np.array(match["turn_degrees"])
    if match["reversed"]:
        lines[1], pairs[:, 1] = lines[1][::-1], match["length_mm"][1] - pairs[:, 1]
    mm = [along(line) for line in lines]
    frames = [Frames(line) for line in lines]
    second = truth["second"]
    first, other = (np.array(second["points"][k]) for k in ("first", "second"))
    # Parts of the second line that are collapsed, along the true one, and so about along this one.
    closed = np.array(second["collapsed"]).reshape(-1, 2) * mm[1][-1] / second["length_mm"]
    a, b = (mm[k][nearest(lines[k], p)] for k, p in ((0, first), (1, other)))
    found = np.interp(a, pairs[:, 0], pairs[:, 1])
    sure = np.interp(a, pairs[:, 0], pairs[:, 2])
    turn = np.degrees(np.unwrap(np.radians(turns[:, 1])))
    error = abs(found - b)
    plain = abs(a * mm[1][-1] / mm[0][-1] - b)
    about = np.array([between(frames[0].angle(s, p) + np.interp(s, turns[:, 0], turn), frames[1].angle(t, q))
                      for s, p, t, q in zip(a, first, b, other)])
    inside = np.zeros(len(b), bool)
    beside = np.zeros(len(b), bool)
    for low, high in closed:
        inside |= (b > low) & (b < high)
        beside |= (b > low - 60.0) & (b < high + 60.0)
    beside &= ~inside
    scan, visible = Scan(names["c.nii"]), []
    for p, q in zip(truth["polyps"], second["polyps"]):
        place, goal = np.array(p["position"]), np.array(q["position"])
        s = mm[0][nearest(lines[0], [place])[0]]
        t = np.interp(s, pairs[:, 0], pairs[:, 1])
        towards = frames[1].direction(t, frames[0].angle(s, place) + np.interp(s, turns[:, 0], turn))
        aim = scan.wall(frames[1].at[frames[1].row(t)], towards)
        seen = False
        # Its top, 1 mm above the ball that it is.
        top = lines[1][nearest(lines[1], [goal])[0]] - goal
        top = goal + top / np.linalg.norm(top) * (0.5 * q["diameter_mm"] + 1.0)
        for back in (-20.0, 0.0, 20.0):
            eye = frames[1].at[frames[1].row(t + back)]
            axis, to = (v / np.linalg.norm(v) for v in (aim - eye, top - eye))
            near = np.linalg.norm(top - eye) < 100.0
            seen |= bool(axis @ to > 0.5 and near and scan.sees(eye, top, 0.5))
        visible.append(seen)
    stats = json.loads(names["s.json"].read_text())["prepare"]
    return {"error": error[~inside], "beside": error[beside], "about": about[~inside], "plain": plain[~inside], "visible": visible,
            "within": (error <= sure)[~inside], "seconds": stats["match_s"]}


def row(name, r):
    q = lambda v, s: float(np.quantile(v, s)) if len(v) else float("nan")
    e, p, t = r["error"], r["plain"], r["about"]
    print(f"| {name} | {q(e, .5):.1f} | {q(e, .95):.1f} | {q(r['beside'], .5):.1f} | {q(t, .5):.1f} | {q(t, .95):.0f} |"
          f" {sum(r['visible'])} of {len(r['visible'])} | {np.mean(r['within']):.0%} | {q(p, .5):.1f} | {q(p, .95):.1f} |", flush=True)


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--seeds", default="1-10")
    args.add_argument("--size", default="standard")
    args.add_argument("--with", dest="parts", default="folds,polyps,pools,noise")
    args.add_argument("--folder", type=Path, default=Path("target/phantoms/match"))
    args = args.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    first, last = (args.seeds.split("-") * 2)[:2]
    print("| seed | median mm | 95 % | beside collapse | turn median ° | 95 % | polyps visible | within the uncertainty |"
          " plain median | 95 % |\n|---|---|---|---|---|---|---|---|---|---|")
    every = []
    for seed in range(int(first), int(last) + 1):
        every.append(measure(seed, args))
        row(seed, every[-1])
    row("all", {k: np.concatenate([np.atleast_1d(r[k]) for r in every]) for k in every[0]})
    print(f"{np.mean([r['seconds'] for r in every]):.2f} s each for the match itself")


if __name__ == "__main__":
    main()
