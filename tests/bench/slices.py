"""Compares the cross-sections of `colvis slice` with SimpleITK's linear resampling.

    python tests/bench/slices.py [--colvis target/release/colvis] [--scan SCAN]... [--at X,Y,Z]... [--json F.json]

Needs SimpleITK and numpy (`pip install SimpleITK numpy`). Tests axial, coronal, sagittal and oblique planes through a phantom and
through each scan, in HU, and slabs against the same samples from SimpleITK. Prints a row for each image: the number of pixels
inside the scan, the largest difference there in HU, and the number of pixels that only one program counts as inside. Fails if a
difference exceeds 0.5 HU, or if the pixels of the last kind exceed 1 % in an image. Both programs use world coordinates in mm LPS;
SimpleITK converts NIfTI's RAS when it reads a file.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile

import numpy as np
import SimpleITK as sitk

AXES = {  # right and down, in world coordinates
    "axial": ((1, 0, 0), (0, 1, 0)),
    "coronal": ((1, 0, 0), (0, 0, -1)),
    "sagittal": ((0, 1, 0), (0, 0, -1)),
}
PLANES = ["axial", "coronal", "sagittal", "0,0,1", "1,2,0.5", "-0.3,0.2,-0.9", "0.01,0,-1", "1,-1,1"]
SLABS = [None, (5.0, "mean"), (10.0, "max"), (7.3, "min")]
SIZES = [(512, 512, None), (201, 160, 0.37)]
ALLOWED = 0.5
OUTSIDE = -1024.0


def arguments():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--colvis", default="target/release/colvis")
    p.add_argument("--scan", action="append", default=[])
    p.add_argument("--at", action="append", default=[], metavar="X,Y,Z", help="points for all scans (default: three in each)")
    p.add_argument("--json", help="also write the rows to this file")
    return p.parse_args()


def axes(plane):
    """Right and down of an image, from their written definition, independent of the program's code."""
    if plane in AXES:
        return tuple(np.array(a, float) for a in AXES[plane])
    normal = np.array([float(c) for c in plane.split(",")])
    normal /= np.linalg.norm(normal)
    tilt = math.degrees(math.acos(min(1.0, abs(normal[2]))))
    up = np.array([0.0, -1.0, 0.0]) if tilt <= 1.0 else np.array([0.0, 0.0, 1.0])
    right = np.cross(-normal, up)
    right /= np.linalg.norm(right)
    return right, np.cross(-normal, right)


def resampled(image, at, right, down, size, side):
    """SimpleITK's image; pixels outside the scan are NaN."""
    grid = sitk.Image([size[0], size[1], 1], sitk.sitkFloat32)
    across = np.cross(right, down)
    grid.SetDirection(np.stack([right, down, across], axis=1).ravel().tolist())
    grid.SetSpacing([side, side, 1.0])
    grid.SetOrigin((at - right * side * (size[0] - 1) / 2 - down * side * (size[1] - 1) / 2).tolist())
    picture = sitk.Resample(image, grid, sitk.Transform(), sitk.sitkLinear, math.nan, sitk.sitkFloat64)
    return sitk.GetArrayFromImage(picture)[0]


def expected(image, at, plane, size, side, slab):
    right, down = axes(plane)
    across = np.cross(right, down)
    if slab is None:
        hu = resampled(image, at, right, down, size, side)
        return np.where(np.isnan(hu), OUTSIDE, hu), ~np.isnan(hu)
    mm, kind = slab
    steps = 2 * math.ceil(mm / min(image.GetSpacing()))
    places = [mm * (k / steps - 0.5) for k in range(steps + 1)]
    stack = np.stack([resampled(image, at + across * t, right, down, size, side) for t in places])
    inside = ~np.isnan(stack)
    some = inside.any(axis=0)
    if kind == "mean":
        weights = np.where(inside, 1.0, 0.0)
        weights[[0, -1]] *= 0.5
        total = np.where(inside, stack, 0.0) * weights
        hu = total.sum(axis=0) / np.maximum(weights.sum(axis=0), 1e-9)
    elif kind == "max":
        hu = np.where(inside, stack, -np.inf).max(axis=0)
    else:
        hu = np.where(inside, stack, np.inf).min(axis=0)
    return np.where(some, hu, OUTSIDE), some


def ours(colvis, scan, at, plane, size, side, slab, out):
    command = [colvis, "slice", scan, f"--at={','.join(repr(float(c)) for c in at)}", f"--plane={plane}", "--out", out]
    command += ["--size", f"{size[0]}x{size[1]}"]
    command += [f"--mm-per-pixel={side}"] if side else []
    command += [f"--slab={slab[0]},{slab[1]}"] if slab else []
    said = subprocess.run(command, stderr=subprocess.PIPE, text=True)
    if said.returncode:
        sys.exit(said.stderr)
    return np.load(out)


def points(image):
    """Points in a scan: the middle, one away from voxel centres, one near the border."""
    dims = np.array(image.GetSize(), float)
    shares = [(0.5, 0.5, 0.5), (0.371, 0.448, 0.629), (0.93, 0.12, 0.05)]
    return [np.array(image.TransformContinuousIndexToPhysicalPoint(((dims - 1) * np.array(s)).tolist())) for s in shares]


def main():
    a = arguments()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        phantom = os.path.join(folder, "phantom.nii.gz")
        subprocess.run([a.colvis, "phantom", "--size", "small", "--out", phantom], check=True)
        quick = os.path.join(folder, "scan.nii")
        for name, scan in [("phantom", phantom)] + [(os.path.basename(s), s) for s in a.scan]:
            image = sitk.Cast(sitk.ReadImage(scan), sitk.sitkInt16)
            # colvis reads the file for each image; uncompressed, that is quick.
            sitk.WriteImage(image, quick)
            given = [np.array([float(c) for c in p.split(",")]) for p in a.at] if scan != phantom else []
            for n, at in enumerate(given or points(image)):
                for plane in PLANES:
                    for size in SIZES if n == 0 else SIZES[1:]:
                        for slab in SLABS if size is SIZES[1] and n < 2 else SLABS[:1]:
                            side = size[2] or min(image.GetSpacing())
                            out = os.path.join(folder, "a.npy")
                            hu = ours(a.colvis, quick, at, plane, size, size[2], slab, out)
                            wanted, inside = expected(image, at, plane, size, side, slab)
                            assert hu.dtype == np.float32 and hu.shape == wanted.shape
                            # At the scan's outermost border, rounding decides what is inside.
                            apart = (np.abs(hu - wanted) > ALLOWED) & ((hu == OUTSIDE) | ~inside)
                            largest = float(np.abs(hu - wanted)[inside & ~apart].max(initial=0.0))
                            rows.append(
                                {
                                    "scan": name,
                                    "at": [round(float(c), 2) for c in at],
                                    "plane": plane,
                                    "size": f"{size[0]}x{size[1]}",
                                    "slab": f"{slab[0]:g},{slab[1]}" if slab else "",
                                    "inside": int(inside.sum()),
                                    "largest_hu": largest,
                                    "border": int(apart.sum()),
                                }
                            )
                            r = rows[-1]
                            print(
                                f"{name:22} {str(r['at']):26} {plane:14} {r['size']:8} {r['slab']:8} "
                                f"{r['inside']:7} inside, {largest:.5f} HU, {r['border']} at the border",
                                flush=True,
                            )
    worst = max(rows, key=lambda r: r["largest_hu"])
    border = max(r["border"] / max(1, r["inside"]) for r in rows)
    print(f"{len(rows)} images: at most {worst['largest_hu']:.5f} HU; {100 * border:.3f} % of the pixels at the border")
    if a.json:
        with open(a.json, "w") as f:
            json.dump(rows, f, indent=1)
    if worst["largest_hu"] > ALLOWED or border > 0.01:
        sys.exit("the images differ")


if __name__ == "__main__":
    main()
