#!/usr/bin/env python3
"""Frame times of colvis along a flight, and of another renderer on the same poses in the same run.

usage: python3 tests/bench/frames.py SCAN [--poses 24] [--threads 2] [--vtk "PYTHON vtk_raycast.py"]

Flies SCAN headless, spreads the poses over the flight, renders them at 512 and 1024 pixels square in high quality, and prints
one line each: median and slowest frame, ms, and what came before the first frame. --vtk names a command that takes
`SCAN POSES --size N --threads N` and prints a line of JSON with median_ms. Nothing but the standard library is needed.
"""
import argparse, json, pathlib, shlex, subprocess, tempfile

ap = argparse.ArgumentParser()
ap.add_argument("scan")
ap.add_argument("--poses", type=int, default=24)
ap.add_argument("--threads", default="2")
ap.add_argument("--vtk")
a = ap.parse_args()
colvis = pathlib.Path(__file__).resolve().parents[2] / "target/release/colvis"
with tempfile.TemporaryDirectory() as folder:
    at = lambda name: f"{folder}/{name}"
    fly = [colvis, "fly", a.scan, "--headless", "--log", at("log"), "--stats", at("stats"), "--threads", a.threads]
    subprocess.run(fly, check=True, stderr=subprocess.DEVNULL)
    stats = json.load(open(at("stats")))
    before = {k: round(v, 3) for k, v in stats["prepare"].items()}
    print(f"flight: {stats['state']}, {stats['length_mm']:.0f} mm, peak {stats['peak_rss_bytes'] / 2**20:.0f} MiB; before it: {before}")
    steps = [json.loads(line) for line in open(at("log"))]
    chosen = steps[:: max(1, len(steps) // a.poses)][: a.poses]
    poses = [{k: s[k] for k in ("position", "forward", "up")} for s in chosen]
    json.dump({"fov_degrees": 90, "poses": poses}, open(at("poses"), "w"))
    for size in (512, 1024):
        render = [colvis, "render", a.scan, "--poses", at("poses"), "--out", at("images"), "--size", f"{size}x{size}"]
        subprocess.run([*render, "--threads", a.threads, "--stats", at("frames")], check=True, stderr=subprocess.DEVNULL)
        ms = sorted(f["ms"] for f in json.load(open(at("frames")))["frames"])
        line = f"{size}x{size}: colvis median {ms[len(ms) // 2]:.0f} ms, slowest {ms[-1]:.0f} ms"
        if a.vtk:
            other = [*shlex.split(a.vtk), a.scan, at("poses"), "--size", str(size), "--threads", a.threads]
            found = json.loads(subprocess.run(other, check=True, capture_output=True, text=True).stdout.splitlines()[-1])
            ratio = found["median_ms"] / ms[len(ms) // 2]
            line += f"; the other median {found['median_ms']:.0f} ms, first frame {found['first_frame_s']:.1f} s, peak {found['peak_rss_mib']} MiB: ratio {ratio:.2f}"
        print(line)
