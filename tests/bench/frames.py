#!/usr/bin/env python3
"""Frame times of colvis along a flight, and of another renderer on the same poses in the same run.

usage: python3 tests/bench/frames.py SCAN [--poses 240] [--threads 2] [--runs 1] [--check N] [--vtk "PYTHON vtk_raycast.py"]

Flies SCAN headless, spreads the poses over the flight, renders them at 512 and 1024 pixels square in high quality, and prints
one line each: median and 99th percentile of a frame, ms, and what came before the first frame. --runs N renders them N times and
prints the same of each pose's least time as well: which poses are slow, whatever else the machine did meanwhile. --vtk names a
command that takes `SCAN POSES --size N --threads N` and prints a line of JSON with median_ms. --check N renders every N-th pose
by brute force as well and prints the least and the mean PSNR; it needs NumPy and SimpleITK, without it the standard library is
enough.
"""
import argparse, json, pathlib, shlex, subprocess, tempfile

ap = argparse.ArgumentParser()
ap.add_argument("scan")
ap.add_argument("--poses", type=int, default=240)
ap.add_argument("--threads", default="2")
ap.add_argument("--runs", type=int, default=1)
ap.add_argument("--vtk")
ap.add_argument("--check", type=int, default=0)
a = ap.parse_args()


def spread(ms):
    """Median and 99th percentile."""
    ms = sorted(ms)
    return ms[len(ms) // 2], ms[int(len(ms) * 0.99)]


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
        runs = []
        for _ in range(max(1, a.runs)):
            subprocess.run([*render, "--threads", a.threads, "--stats", at("frames")], check=True, stderr=subprocess.DEVNULL)
            runs.append([f["ms"] for f in json.load(open(at("frames")))["frames"]])
        median, p99 = spread(runs[-1])
        line = f"{size}x{size}: colvis median {median:.1f} ms, p99 {p99:.1f} ms"
        if a.vtk:
            other = [*shlex.split(a.vtk), a.scan, at("poses"), "--size", str(size), "--threads", a.threads]
            found = json.loads(subprocess.run(other, check=True, capture_output=True, text=True).stdout.splitlines()[-1])
            ratio = found["median_ms"] / median
            line += f"; the other median {found['median_ms']:.0f} ms, first frame {found['first_frame_s']:.1f} s, peak {found['peak_rss_mib']} MiB: ratio {ratio:.2f}"
        print(line, flush=True)
        if a.runs > 1:
            median, p99 = spread(map(min, zip(*runs)))
            print(f"  each pose's least of {a.runs} runs: median {median:.1f} ms, p99 {p99:.1f} ms, {p99 / median:.2f} times as long")
        if a.check:
            import numpy, SimpleITK

            json.dump({"fov_degrees": 90, "poses": poses[:: a.check]}, open(at("some"), "w"))
            brute = [colvis, "render", a.scan, "--poses", at("some"), "--out", at("reference"), "--size", f"{size}x{size}"]
            subprocess.run([*brute, "--quality", "reference"], check=True, stderr=subprocess.DEVNULL)
            read = lambda path: SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(path)).astype(float)
            pairs = [(f"{at('images')}/{n * a.check:04}.png", f"{at('reference')}/{n:04}.png") for n in range(len(poses[:: a.check]))]
            psnr = sorted(10 * numpy.log10(255**2 / max(1e-9, ((read(x) - read(y)) ** 2).mean())) for x, y in pairs)
            print(f"  against brute force, {len(psnr)} poses: PSNR at least {psnr[0]:.1f} dB, mean {sum(psnr) / len(psnr):.1f} dB")
