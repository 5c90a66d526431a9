#!/usr/bin/env python3
"""What a batch costs: seconds and memory of a case by its size, how busy the cores are, and whether memory is kept to.

    COLVIS=target/release/colvis target/peers/bin/python tests/bench/batch.py sizes|cores|memory [--folder DIR] [--do STEPS]

One phantom is resampled to each size. `sizes` compares each case with a straight line through all of them (time = a + b * voxels, by least
squares of relative errors). `cores` runs as many small cases as `--cases` says, and tells the share of two cores that was used. `memory` runs
three cases of about 2 GB each in 4 GB, and tells the most that all processes had at once.
"""

import argparse
import csv
import json
import os
import resource
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import SimpleITK as sitk

COLVIS = os.path.abspath(os.environ.get("COLVIS", "target/release/colvis"))
SIZES = [(64, 64, 64), (128, 128, 128), (256, 256, 256), (512, 512, 400), (768, 768, 600), (1024, 1024, 800)]


def phantom(folder: Path) -> Path:
    path = folder / "standard.nii"
    if not path.exists():
        made = ["--size", "standard", "--with", "folds,polyps,pools,noise", "--seed", "1"]
        subprocess.run([COLVIS, "phantom", "--out", path, *made], check=True)
    return path


def resampled(folder: Path, size: tuple) -> Path:
    path = folder / ("x".join(map(str, size)) + ".nii")
    if path.exists():
        return path
    scan = sitk.ReadImage(str(phantom(folder)))
    spacing = [s * n / m for s, n, m in zip(scan.GetSpacing(), scan.GetSize(), size)]
    origin = [o + 0.5 * (new - old) for o, new, old in zip(scan.GetOrigin(), spacing, scan.GetSpacing())]
    grid = (size, sitk.Transform(), sitk.sitkLinear, origin, spacing, scan.GetDirection())
    # Coarser voxels are means, as a scanner's are.
    coarse = [max(0.0, 0.5 * (new / old - 1.0)) * old for new, old in zip(spacing, scan.GetSpacing())]
    if any(c > 0 for c in coarse):
        scan = sitk.SmoothingRecursiveGaussian(sitk.Cast(scan, sitk.sitkFloat32), [max(c, 1e-3) for c in coarse])
    sitk.WriteImage(sitk.Cast(sitk.Resample(scan, *grid, -1000.0), sitk.sitkInt16), str(path))
    return path


def batch(folder: Path, scans: list, out: str, *more: str) -> Path:
    manifest = folder / f"{out}.csv"
    with manifest.open("w", newline="") as to:
        rows = csv.writer(to)
        rows.writerow(["id", "path", "options"])
        rows.writerows([name, scan, "--guide path"] for name, scan in scans)
    subprocess.run(["rm", "-rf", folder / out], check=True)
    subprocess.run([COLVIS, "batch", manifest, "--out", folder / out, *more], check=False)
    return folder / out


def took(case: Path):
    record = json.loads((case / "case.json").read_text())
    times = [step["times"] for step in record["steps"].values()]
    seconds = sum(t["seconds"] for t in times)
    return record, seconds, max((t["peak_rss_bytes"] for t in times), default=0)


def sizes(folder: Path, do: list):
    scans = [("x".join(map(str, size)), resampled(folder, size)) for size in SIZES]
    out = batch(folder, scans, "sizes", "--jobs", "1", *do)
    rows = []
    for name, _ in scans:
        record, seconds, peak = took(out / name)
        rows.append((name, record["input"]["voxels"], seconds, peak, record["state"], record["failure"]))
    voxels, seconds = (np.array([r[n] for r in rows], float) for n in (1, 2))
    lines = {}
    for what, values in (("s", seconds), ("MB", np.array([r[3] / 1e6 for r in rows]))):
        design = np.stack([np.ones_like(voxels), voxels], 1)
        lines[what] = np.linalg.lstsq(design / values[:, None], np.ones_like(values), rcond=None)[0]
    print("| voxels | million | s | s/million | off the line | MB | MB/million | off the line | |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name, n, s, peak, state, failure in rows:
        off = [v / (lines[w] @ [1.0, n]) - 1.0 for w, v in (("s", s), ("MB", peak / 1e6))]
        why = "" if failure is None else failure["line"]
        print(f"| {name} | {n / 1e6:.1f} | {s:.2f} | {s / n * 1e6:.3f} | {off[0]:+.0%} | {peak / 1e6:.0f} |"
              f" {peak / n:.2f} | {off[1]:+.0%} | {state} {why} |")
    for what, (a, b) in lines.items():
        print(f"line: {a:.2f} {what} + {b * 1e6:.4f} {what} per million voxels")


def cores(folder: Path, do: list, cases: int):
    scan = resampled(folder, (256, 256, 256))
    begun, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    batch(folder, [(f"c{n}", scan) for n in range(cases)], "cores", "--jobs", "2", "--threads", "1", *do)
    wall, after = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    busy = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    print(f"{cases} cases in {wall:.1f} s, processor time {busy:.1f} s: {busy / wall / 2:.1%} of two cores")


def memory(folder: Path, do: list):
    scan = resampled(folder, (1024, 1024, 640))
    most, running = 0, True

    def watch():
        nonlocal most
        while running:
            all_of_them = 0
            for status in Path("/proc").glob("[0-9]*/status"):
                try:
                    if (status.parent / "exe").resolve() == Path(COLVIS):
                        text = status.read_text()
                        all_of_them += int(text.split("VmRSS:")[1].split()[0]) * 1024
                except (OSError, IndexError):
                    continue
            most = max(most, all_of_them)
            time.sleep(0.05)

    watcher = threading.Thread(target=watch)
    watcher.start()
    out = batch(folder, [(f"m{n}", scan) for n in range(3)], "memory", "--jobs", "3", "--threads", "1",
                "--memory", "4G", *do)
    running = False
    watcher.join()
    peaks = [took(out / f"m{n}")[2] / 2**30 for n in range(3)]
    print(f"peaks of the cases {', '.join(f'{p:.2f}' for p in peaks)} GB; all processes at once {most / 2**30:.2f} of 4 GB")


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("what", choices=["sizes", "cores", "memory"])
    args.add_argument("--folder", type=Path, default=Path("target/phantoms/batch"))
    args.add_argument("--do")
    args.add_argument("--cases", type=int, default=40)
    args = args.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    do = ["--do", args.do] if args.do else []
    if args.what == "sizes":
        sizes(args.folder.resolve(), do)
    elif args.what == "cores":
        cores(args.folder.resolve(), do, args.cases)
    else:
        memory(args.folder.resolve(), do)


if __name__ == "__main__":
    main()
