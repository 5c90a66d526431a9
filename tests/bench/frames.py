#!/usr/bin/env python3
"""Measures frame times of colvis along a flight, and of another renderer on the same poses in the same run.

usage: python3 tests/bench/frames.py SCAN [--colvis BINARY] [--sizes 512,1024] [--poses 240] [--threads 2] [--runs 1]
                                     [--overlay NAME] [--check N] [--vtk "PYTHON vtk_raycast.py"] [--json OUT]

Flies SCAN headless and prints the preparation times. Then spreads the poses over the flight, renders them at 512 and 1024 pixels
square in high quality, and prints the median and 99th percentile of the frame time in ms for each size. At the end it flies the
scan headless with images, by the presets default and lean, and prints the peak memory and the seconds from the scan in memory
to the first image.

--runs N renders the poses N times and also prints the same figures for each pose's shortest time. That shows which poses are
slow, whatever else ran on the machine. --overlay NAME renders them with that overlay, too, by turns, and prints what it adds to the
median. --vtk names a command that takes `SCAN POSES --size N --threads N` and prints one line of
JSON with median_ms. --check N also renders every Nth pose by brute force and prints the least and the mean PSNR; it needs NumPy
and SimpleITK. Without it the standard library is enough. --json also writes all numbers to a file.

The program is --colvis, else the environment variable COLVIS, else target/release/colvis.
"""
import argparse, json, os, pathlib, shlex, subprocess, sys, tempfile

ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
ap.add_argument("scan")
ap.add_argument("--colvis", default=os.environ.get("COLVIS"))
ap.add_argument("--sizes", default="512,1024", help="image sizes, pixels")
ap.add_argument("--poses", type=int, default=240)
ap.add_argument("--threads", default="2")
ap.add_argument("--runs", type=int, default=1)
ap.add_argument("--overlay", help="translucency or coats")
ap.add_argument("--vtk")
ap.add_argument("--check", type=int, default=0)
ap.add_argument("--json", help="also write the numbers to this file")
a = ap.parse_args()
if a.check:
    try:
        import numpy, SimpleITK
    except ImportError as e:
        sys.exit(f"--check needs NumPy and SimpleITK: {e}")


def spread(ms):
    """Median and 99th percentile."""
    ms = sorted(ms)
    return ms[len(ms) // 2], ms[int(len(ms) * 0.99)]


def run(command):
    """Runs a program and returns its output; exits with its errors if it fails."""
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"{shlex.join(map(str, command))}: exit status {done.returncode}\n{done.stderr[-2000:]}")
    return done.stdout


def ask(command):
    """The last line of JSON that another program prints, or None and the reason if it fails.

    The numbers of colvis stay valid either way.
    """
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if done.returncode == 0:
            return json.loads(done.stdout.strip().splitlines()[-1]), None
        why = f"exit status {done.returncode}: {(done.stderr.strip().splitlines() or ['no output'])[-1]}"
    except (OSError, ValueError, IndexError) as e:
        why = f"{type(e).__name__}: {e}"
    print(f"the other program failed: {why}", file=sys.stderr)
    return None, why


def load(path):
    with open(path) as f:
        return json.load(f)


def images_psnr(images, others, numbers):
    """PSNR of image pairs in dB, in ascending order."""
    read = lambda path: SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(path)).astype(float)
    pairs = [(f"{images}/{n:04}.png", f"{others}/{k:04}.png") for k, n in enumerate(numbers)]
    return sorted(float(10 * numpy.log10(255**2 / max(1e-9, ((read(x) - read(y)) ** 2).mean()))) for x, y in pairs)


colvis = a.colvis or str(pathlib.Path(__file__).resolve().parents[2] / "target/release/colvis")
out = {"scan": os.path.basename(a.scan), "sizes": [], "memory": []}
with tempfile.TemporaryDirectory() as folder:
    at = lambda name: f"{folder}/{name}"
    run([colvis, "fly", a.scan, "--headless", "--log", at("log"), "--stats", at("stats"), "--threads", a.threads])
    stats = load(at("stats"))
    before = {k: round(v, 3) for k, v in stats["prepare"].items()}
    out.update(state=stats["state"], length_mm=stats["length_mm"], prepare=before, peak_rss_bytes=stats["peak_rss_bytes"])
    print(f"flight: {stats['state']}, {stats['length_mm']:.0f} mm, peak {stats['peak_rss_bytes'] / 2**20:.0f} MiB; preparation: {before}")
    with open(at("log")) as log:
        steps = [json.loads(line) for line in log]
    chosen = steps[:: max(1, len(steps) // a.poses)][: a.poses]
    poses = [{k: s[k] for k in ("position", "forward", "up")} for s in chosen]
    out["poses"] = len(poses)
    with open(at("poses"), "w") as f:
        json.dump({"fov_degrees": 90, "poses": poses}, f)
    for size in map(int, a.sizes.split(",")):
        render = [colvis, "render", a.scan, "--poses", at("poses"), "--out", at("images"), "--size", f"{size}x{size}"]
        runs, coloured = [], []
        for _ in range(max(1, a.runs)):
            if a.overlay:
                run([*render, "--threads", a.threads, "--stats", at("frames"), "--overlay", a.overlay])
                coloured.append([f["ms"] for f in load(at("frames"))["frames"]])
            run([*render, "--threads", a.threads, "--stats", at("frames")])
            frames = load(at("frames"))["frames"]
            runs.append([f["ms"] for f in frames])
        median, p99 = spread(runs[-1])
        rays = sum(f["rays"] for f in frames) / (len(frames) * size * size)
        row = {"size": size, "median_ms": median, "p99_ms": p99, "rays_a_pixel": rays}
        line = f"{size}x{size}: colvis median {median:.1f} ms, p99 {p99:.1f} ms, {rays:.2f} rays a pixel"
        if a.vtk:
            other = [*shlex.split(a.vtk), a.scan, at("poses"), "--size", str(size), "--threads", a.threads]
            found, why = ask(other)
            row["peer_failed"] = why
        if a.vtk and found:
            ratio = found["median_ms"] / median
            line += f"; other renderer: median {found['median_ms']:.0f} ms, first frame {found['first_frame_s']:.1f} s, peak {found['peak_rss_mib']} MiB, ratio {ratio:.2f}"
            row["peer"] = {**found, "ratio": ratio}
        print(line, flush=True)
        if a.runs > 1:
            median, p99 = spread(map(min, zip(*runs)))
            row["least"] = {"runs": a.runs, "median_ms": median, "p99_ms": p99}
            print(f"  shortest of {a.runs} runs for each pose: median {median:.1f} ms, p99 {p99:.1f} ms, ratio {p99 / median:.2f}")
        if a.overlay:
            plain, painted = (spread(map(min, zip(*all)))[0] for all in (runs, coloured))
            row["overlay"] = {"name": a.overlay, "runs": a.runs, "plain_ms": plain, "median_ms": painted}
            print(f"  {a.overlay}: median {painted:.2f} ms instead of {plain:.2f} ms, {100 * (painted / plain - 1):+.1f} %")
        if a.check:
            with open(at("some"), "w") as f:
                json.dump({"fov_degrees": 90, "poses": poses[:: a.check]}, f)
            run([colvis, "render", a.scan, "--poses", at("some"), "--out", at("reference"), "--size", f"{size}x{size}", "--quality", "reference"])
            psnr = images_psnr(at("images"), at("reference"), range(0, len(poses), a.check))
            row["psnr"] = {"poses": len(psnr), "least_db": psnr[0], "mean_db": sum(psnr) / len(psnr)}
            print(f"  against brute force, {len(psnr)} poses: PSNR least {psnr[0]:.1f} dB, mean {sum(psnr) / len(psnr):.1f} dB")
        out["sizes"].append(row)
    largest = max(map(int, a.sizes.split(",")))
    for preset in ("default", "lean"):
        fly = [colvis, "fly", a.scan, "--headless", "--preset", preset, "--seconds", "2", "--fps", "10", "--size", f"{largest}x{largest}"]
        run([*fly, "--record", at(f"{preset}/"), "--stats", at("stats"), "--threads", a.threads])
        stats = load(at("stats"))
        first = sum(v for k, v in stats["prepare"].items() if k != "load_s") + stats["frames"][0]["ms"] / 1e3
        out["memory"].append({"preset": preset, "peak_rss_bytes": stats["peak_rss_bytes"], "first_frame_s": first})
        print(f"flight with images, {preset}: peak {stats['peak_rss_bytes'] / 2**20:.0f} MiB, first image {first:.2f} s after the scan is in memory")
if a.json:
    with open(a.json, "w") as f:
        json.dump(out, f, indent=1)
