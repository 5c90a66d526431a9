#!/usr/bin/env python3
"""Time, memory and page of `colvis batch --group` with many cases.

    python3 tests/bench/group.py COLVIS OUT/ [--cases 10000] [--like CASE/] [--chromium CHROMIUM]

Writes OUT/cases with folders of made-up cases, each with the record of CASE (the folder of a case that `colvis batch` made; without it,
a small record of this script) and numbers drawn around it, and its picture if there is one. Some fail, some are missing, there twice or
broken. Then it makes OUT/report and prints seconds, peak memory and the sizes of the pages; with Chromium also how long the first page takes to load.
"""

import argparse
import json
import os
import random
import re
import resource
import shutil
import subprocess
import time
from pathlib import Path

SMALL = {
    "id": "", "state": "done", "version": "0.2.0",
    "input": {"content": "", "voxels": 104857600, "read_with": [], "files": 1, "bytes": 150000000, "modified_ns": 1},
    "options": [],
    "steps": {
        "segment": {"key": "", "outputs": {"segment.nii.gz": ""}, "times": {"seconds": 1.8, "peak_rss_bytes": 400000000},
                    "results": {"lumen_ml": 2100.0, "fluid_ml": 140.0, "segments": [{}] * 3}},
        "centerline": {"key": "", "outputs": {"centerline.json": ""}, "times": {"seconds": 3.1, "peak_rss_bytes": 450000000},
                       "results": {"length_mm": 1650.0, "guessed_mm": [[700.0, 730.0]], "caliber_mm": 31.0, "least_caliber_mm": 6.0,
                                   "distended": 0.95}},
        "coverage": {"key": "", "outputs": {"coverage.ply": ""}, "times": {"seconds": 40.0, "peak_rss_bytes": 700000000},
                     "results": {"coverage": 0.78, "coverage_both_ways": 0.94, "missed": [{}] * 4}},
        "candidates": {"key": "", "outputs": {"candidates.json": ""}, "times": {"seconds": 6.0, "peak_rss_bytes": 500000000},
                       "results": {"candidates": 21}},
    },
    "failure": None,
}
VARIED = ["lumen_ml", "fluid_ml", "length_mm", "caliber_mm", "least_caliber_mm", "candidates", "coverage", "distended", "seconds",
          "peak_rss_bytes"]


def vary(value, draw, name=""):
    """Returns a copy of a record with numbers drawn around those of the original."""
    if isinstance(value, dict):
        return {k: vary(v, draw, k) for k, v in value.items()}
    if isinstance(value, list):
        return [vary(v, draw) for v in value]
    if name not in VARIED or not isinstance(value, (int, float)):
        return value
    if name in ("coverage", "distended"):
        return min(1.0, max(0.0, draw.gauss(value, 0.04)))
    new = value * draw.lognormvariate(0.0, 0.2)
    return round(new) if isinstance(value, int) else new


def write_cases(folder, number, record, picture):
    draw = random.Random(1)
    ids = [f"case-{n:05}" for n in range(number)]
    for n, name in enumerate(ids):
        if n % 997 == 500:
            continue
        case = folder / name
        case.mkdir(parents=True)
        own = vary(record, draw)
        own["id"] = name
        own["input"]["content"] = f"sha256:{n - n % 2 if n % 1000 == 1 else n:064x}"
        own["version"] = "0.1.9" if n % 10 == 3 else own["version"]
        if n % 100 == 7:
            step = draw.choice(["input", "segment", "centerline"])
            own["state"], own["steps"] = "failed", {}
            own["failure"] = {"step": step, "key": "", "class": {"input": "input"}.get(step, draw.choice(["incomplete", "timeout", "killed"])),
                              "line": f"{step}: no colon was found in SCAN; give --from and a point in the colon"}
        elif n % 500 == 9:
            own["steps"]["centerline"]["results"]["length_mm"] = 310.0
        text = json.dumps(own, indent=2)
        (case / "case.json").write_text(text[:len(text) // 2] if n % 3000 == 11 else text)
        if picture and own["steps"]:
            shutil.copy(picture, case / "outside.png")
    (folder / "cases.csv").write_text("".join(line + "\n" for line in ["id", *ids]))


def run(program, cases, report):
    begun = time.perf_counter()
    subprocess.run([program, "batch", "--group", cases, "--out", report], check=True)
    seconds = time.perf_counter() - begun
    return seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def load_ms(chromium, page):
    """Returns how long the page took until it was parsed and until it was loaded and laid out, ms."""
    timed = page.with_name("timed.html")
    script = ("<script>addEventListener('load', () => { document.body.offsetHeight; document.body.dataset.ms = `${performance."
              "getEntriesByType('navigation')[0].domInteractive.toFixed()} ${performance.now().toFixed()}`; });</script>")
    timed.write_text(page.read_text().replace("</body>", script + "</body>"))
    # Without a window, Chromium loads all pictures at once. With one, it loads those near to what is shown.
    lazy = "--blink-settings=lazyLoadEnabled=true"
    out = subprocess.run([chromium, "--headless", "--no-sandbox", "--disable-gpu", lazy, "--window-size=1280,900", "--dump-dom", timed.as_uri()],
                         capture_output=True, text=True, check=True).stdout
    timed.unlink()
    found = re.search(r'data-ms="(\d+) (\d+)"', out)
    return [int(n) for n in found.groups()] if found else None


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("program")
    options.add_argument("out", type=Path)
    options.add_argument("--cases", type=int, default=10000)
    options.add_argument("--like", type=Path)
    options.add_argument("--chromium")
    given = options.parse_args()
    folder, report = given.out.resolve() / "cases", given.out.resolve() / "report"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    record = json.loads((given.like / "case.json").read_text()) if given.like else SMALL
    picture = given.like / "outside.png" if given.like else None
    write_cases(folder, given.cases, record, picture if picture and picture.is_file() else None)
    os.sync()
    for name in ["first", "again"]:
        seconds, mib = run(given.program, folder, report)
        print(f"{name}: {given.cases} cases in {seconds:.2f} s, {mib:.0f} MiB at most")
    pages = sorted(report.glob("*.html"))
    print(f"index.html {(report / 'index.html').stat().st_size / 1024:.0f} KiB, {len(pages)} pages, "
          f"cases.csv {(report / 'cases.csv').stat().st_size / 1024:.0f} KiB")
    if given.chromium:
        # The browser's own start is in both.
        empty = report / "empty.html"
        empty.write_text("<!DOCTYPE html><html><head></head><body></body></html>")
        for _ in range(3):
            print("parsed and laid out after, ms:", load_ms(given.chromium, report / "index.html"), "an empty page:", load_ms(given.chromium, empty))
        empty.unlink()


if __name__ == "__main__":
    main()
