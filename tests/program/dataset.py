"""Judges a dataset of colvis by its README alone, with code that shares nothing with it: `dataset.py DIR`. Prints `ok`, or what is wrong."""

import csv
import hashlib
import json
import struct
import sys
from pathlib import Path

import numpy as np
from PIL import Image

folder = Path(sys.argv[1])
bad = []


def judge(what, is_right):
    if not is_right:
        bad.append(what)


sums = [line.split("  ", 1) for line in (folder / "SHA256SUMS").read_text().splitlines()]
named = {name for _, name in sums}
there = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()} - {"SHA256SUMS"}
judge(f"checksums name other files: {named ^ there}", named == there)
for digest, name in sums:
    judge(f"{name} has another checksum", hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest)


def exr(path):
    """Reads the channels of floats that are not compressed: OpenEXR File Layout."""
    data = path.read_bytes()
    judge(f"{path} begins wrongly", data[:8] == bytes([0x76, 0x2F, 0x31, 1, 2, 0, 0, 0]))
    at, head = 8, {}
    while data[at]:
        name, kind, rest = data[at:].split(b"\0", 2)
        size = struct.unpack("<I", rest[:4])[0]
        head[name.decode()] = rest[4 : 4 + size]
        at += len(name) + len(kind) + 6 + size
    # A name, its end, and 16 bytes for each channel.
    names, left = [], head["channels"]
    while left[0]:
        name, left = left.split(b"\0", 1)
        judge(f"{path}: {name} is not of floats", left[0] == 2)
        names, left = [*names, name.decode()], left[16:]
    x0, y0, x1, y1 = struct.unpack("<4i", head["dataWindow"])
    wide, high = x1 - x0 + 1, y1 - y0 + 1
    offsets = struct.unpack(f"<{high}Q", data[at + 1 : at + 1 + 8 * high])
    rows = [np.frombuffer(data, "<f4", wide * len(names), o + 8).reshape(len(names), wide) for o in offsets]
    return dict(zip(names, np.stack(rows, 1)))


told = json.loads((folder / "camera.json").read_text())
camera, width, height = told["camera"], told["width"], told["height"]
look = json.loads((folder / "dataset.json").read_text())["look"]
exposures = {int(row["frame"]): float(row["exposure"]) for row in csv.DictReader((folder / "exposure.csv").open())}
poses = []
for row in csv.DictReader((folder / "poses.csv").open()):
    x, y, z, w = (float(row[k]) for k in ("qx", "qy", "qz", "qw"))
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])
    poses.append((np.array([float(row[k]) for k in ("x_mm", "y_mm", "z_mm")]), turn))


def growing():
    """Angles up to where the radius stops to grow, and the radii."""
    angles = np.linspace(0, np.pi, 2_000_001)
    radii = angles + sum(c * angles ** (2 * n + 3) for n, c in enumerate(camera["k"]))
    last = np.argmax(np.diff(radii) <= 0) or len(angles) - 1
    return angles[: last + 1], radii[: last + 1]


def rays():
    """Directions in the camera's frame: x right, y down, z forward."""
    v, u = np.mgrid[0:height, 0:width].astype(float)
    a, b = (u - camera["cx"]) / camera["fx"], (v - camera["cy"]) / camera["fy"]
    if camera["model"] == "perspective":
        d = np.stack([a, b, np.ones_like(a)], -1)
        return d / np.linalg.norm(d, axis=-1, keepdims=True)
    r = np.hypot(a, b)
    angles, radii = growing()
    theta = np.where(r <= radii[-1], np.interp(r, radii, angles), np.nan)
    side = np.where(r > 1e-12, np.sin(theta) / np.maximum(r, 1e-12), 1.0)
    return np.stack([a * side, b * side, np.cos(theta)], -1)


def project(p):
    if camera["model"] == "perspective":
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = np.where(p[..., 2:] > 0, p[..., :2] / p[..., 2:], np.nan).transpose(2, 0, 1)
    else:
        side = np.hypot(p[..., 0], p[..., 1])
        theta = np.arctan2(side, p[..., 2])
        r = theta + sum(c * theta ** (2 * n + 3) for n, c in enumerate(camera["k"]))
        r = np.where(theta <= growing()[0][-1], r, np.nan)
        a, b = p[..., 0] * r / np.maximum(side, 1e-12), p[..., 1] * r / np.maximum(side, 1e-12)
    return np.stack([a * camera["fx"] + camera["cx"], b * camera["fy"] + camera["cy"]], -1)


def load(kind, n):
    return np.load(folder / "truth" / kind / f"{n:06}.npy")


def wall():
    """Reads the corners of the wall's faces, and the first frame that sees each."""
    data = (folder / "wall.ply").read_bytes()
    end = data.index(b"end_header\n") + 11
    counts, kinds, now = {}, {}, None
    for word in (line.split() for line in data[:end].decode().splitlines()):
        if word[0] == "element":
            now, counts[word[1]] = word[1], int(word[2])
        elif word[0] == "property" and word[1] != "list":
            kinds.setdefault(now, []).append((word[2], {"float": "<f4", "double": "<f8", "ushort": "<u2", "uchar": "u1"}[word[1]]))
    points = np.frombuffer(data, kinds["vertex"], counts["vertex"], end)
    face = [("count", "u1"), ("corners", "<i4", 3)] + kinds["face"]
    faces = np.frombuffer(data, face, counts["face"], end + points.nbytes)
    judge("faces with other corners than three", (faces["count"] == 3).all())
    points = np.stack([points[axis].astype(float) for axis in "xyz"], -1)
    return points[faces["corners"]], faces["first_frame"]


def gone(x, mm, t):
    """Where tissue goes: the README's words."""
    wave = lambda s: np.sin(s - 2 * np.pi * t / 10) - np.sin(s)
    y = x
    for _ in range(200):
        y1, y2, y3 = np.moveaxis(y, -1, 0)
        k, q = 2 * np.pi / 240, 2 * np.pi / 60
        a = np.stack([0.2 * np.sin(k * y1), 0.5 * np.cos(k * y2 + 0.7), 0.6 + 0.4 * np.cos(k * y3 + 1.9)], -1)
        w = np.stack([wave(q * y2 + 0.3), wave(q * y3 + 2.1), wave(q * y1 + 4.4)], -1)
        y = x - mm * (np.sin(2 * np.pi * t / 4) * a + w / 6)
    return y


directions = rays()
settings = json.loads((folder / "dataset.json").read_text())
seconds = [float(row["seconds"]) for row in csv.DictReader((folder / "poses.csv").open())]
faces, first_frames = wall()
errors, steps, seen_wrong, hidden_wrong, seen_all, hidden_all = [], [], 0, 0, 0, 0
for n, (eye, turn) in enumerate(poses):
    picture = np.asarray(Image.open(folder / "rgb" / f"{n:06}.png"))
    judge(f"picture {n} is {picture.shape}", picture.shape == (height, width, 3))
    depth, z, normals = (load(k, n) for k in ("depth", "z", "normals"))
    judge(f"{n}: types", all(x.dtype == np.float32 for x in (depth, z, normals)))
    hit = np.isfinite(depth)
    judge(f"{n}: little wall, {hit.mean()}", hit.mean() > 0.5)
    world = directions @ turn.T
    judge(f"{n}: z", np.nanmax(np.abs(depth * directions[..., 2] - z)[hit]) < 1e-3)
    judge(f"{n}: lengths of normals", np.abs(np.linalg.norm(normals[hit].astype(float), axis=-1) - 1).max() < 1e-6)
    judge(f"{n}: normals away from the camera", ((normals * world).sum(-1)[hit] < 0).all())
    judge(f"{n}: normals where there is no wall", np.isnan(normals[~hit]).all())
    shading = load("shading", n)
    cosine = np.clip(-(normals * world).sum(-1), 0, 1)
    judge(f"{n}: light", np.median(np.abs(shading * depth**2 - cosine)[hit]) < 0.12 and (shading[~hit] == 0).all())
    places = eye + depth[..., None] * world
    unseen = np.asarray(Image.open(folder / "truth/unseen" / f"{n:06}.png"))
    for kind, other, bits in (("flow-before", n - 1, unseen >> 2), ("flow-after", n + 1, unseen & 3)):
        flow = load(kind, n)
        if not 0 <= other < len(poses):
            judge(f"{n}: {kind} to nowhere", np.isnan(flow).all() and (bits == 2).all())
            continue
        eye2, turn2 = poses[other]
        # What is deformed moves: its way to the frame after is told.
        moving = folder / "truth/scene-flow"
        if moving.is_dir() and kind == "flow-before":
            continue
        moved = load("scene-flow", n) if moving.is_dir() else 0
        local = (places + moved - eye2) @ turn2
        at = project(local)
        if camera["model"] != "perspective":
            at[((at < -0.5) | (at >= [width - 0.5, height - 0.5])).any(-1)] = np.nan
        v, u = np.mgrid[0:height, 0:width]
        own = at - np.stack([u, v], -1)
        both = hit & np.isfinite(own).all(-1)
        # Nearly across the axis a pinhole need not show anything.
        clear = np.abs(local[..., 2]) > 0.002 * np.linalg.norm(local, axis=-1)
        judge(f"{n}: {kind} is where it is not", (np.isfinite(flow).all(-1) == both)[clear | ~hit].mean() > 0.999)
        # Towards the plane through a pinhole, pixels are so long that float32 depths do not tell them apart.
        near = np.abs(at - [width / 2, height / 2]).max(-1) < 2 * max(width, height)
        errors.append(np.linalg.norm(flow - own, axis=-1)[both & near & np.isfinite(flow).all(-1)])
        # Depth there, and whether the point is seen, by the four pixels around.
        depth2 = load("depth", other)
        inside = both & (at >= 0).all(-1) & (at[..., 0] < width - 1.01) & (at[..., 1] < height - 1.01)
        far = np.linalg.norm(local, axis=-1)
        x, y = np.floor(at[inside]).astype(int).T
        corners = np.stack([depth2[y, x], depth2[y, x + 1], depth2[y + 1, x], depth2[y + 1, x + 1]])
        share = at[inside] - np.stack([x, y], -1)
        a, b = share.T
        there = corners[0] * (1 - a) * (1 - b) + corners[1] * a * (1 - b) + corners[2] * (1 - a) * b + corners[3] * a * b
        state, far = bits[inside], far[inside]
        flat = corners.max(0) - corners.min(0) < 0.02 * far
        steps.append(np.abs(there - far)[(state == 0) & flat])
        # Off edges the depth around tells whether something is before the point.
        room = 0.2 + 0.02 * far
        seen_all, hidden_all = seen_all + (flat & (state == 0)).sum(), hidden_all + (flat & (state == 1)).sum()
        seen_wrong += (flat & (state == 0) & (far > there + room)).sum()
        hidden_wrong += (flat & (state == 1) & (far < there - room)).sum()
    if (folder / "linear").is_dir():
        light = exr(folder / "linear" / f"{n:06}.exr")
        linear = np.stack([light[c] for c in "RGB"], -1)
        picture = np.asarray(Image.open(folder / "rgb" / f"{n:06}.png")).astype(float)
        judge(f"{n}: linear light where there is no wall", (linear[~hit] == 0).all() and (linear[hit] >= 0).all())
        back = lambda number: np.clip(number / 255, 0, None) ** look["sensor"]["gamma"] / exposures[n]
        room = 1e-6 * linear
        is_back = (linear >= back(picture - 0.501) - room) & ((linear <= back(picture + 0.501) + room) | (picture == 255))
        judge(f"{n}: {(~is_back).sum()} numbers of the picture do not give linear light back", is_back.all())
        # Pillow keeps 8 of the 16 bits.
        albedo = np.asarray(Image.open(folder / "albedo" / f"{n:06}.png")).astype(float) / 255
        fallen = (linear - light["gloss"][..., None])[hit] / albedo[hit]
        judge(f"{n}: colours are lit differently", (np.ptp(fallen, axis=-1) <= 0.06 * fallen.max(-1) + 1e-7).mean() > 0.99)
    # The faces that this frame is the first to see are where its pixels see them.
    corners = faces[first_frames == n][:2000]
    if settings.get("deformation"):
        corners = gone(corners, settings["deformation"]["mm"], seconds[n])
    local = (corners.mean(1) - eye) @ turn
    at = np.round(project(local[None])[0]).astype(int)
    at = np.clip(at, 0, [width - 1, height - 1])
    far = np.linalg.norm(local, axis=-1)
    # Pixels are as wide as they are far away.
    off = np.abs(far - depth[at[:, 1], at[:, 0]]) / (0.3 + 2 * far / max(width, height))
    if len(off) > 50:
        judge(f"{n}: faces {np.median(off):.2f} pixels off those that see them", np.median(off) < 1)
    labels = np.asarray(Image.open(folder / "truth/labels" / f"{n:06}.png"))
    judge(f"{n}: labels", ((labels > 0) == hit).mean() > 0.999)
    along = load("along", n)
    judge(f"{n}: places in the colon", np.isfinite(along[hit]).mean() > 0.95 and (np.abs(along[..., 2][np.isfinite(along[..., 2])]) <= 3.1416).all())
errors, steps = np.concatenate(errors), np.concatenate(steps)
judge(f"{len(exposures)} exposures", sorted(exposures) == list(range(len(poses))) and min(exposures.values()) > 0)
judge(f"flow errs by up to {errors.max():.4f} px", errors.max() <= 0.02)
judge(f"depth to the next frame errs by {np.median(steps):.4f} mm in the median", np.median(steps) <= 0.05)
judge(f"{seen_wrong} of {seen_all} are seen and hidden", seen_wrong <= 1e-3 * seen_all)
judge(f"{hidden_wrong} of {hidden_all} are hidden and seen", hidden_wrong <= 1e-3 * max(hidden_all, 1) + 2)
print("\n".join(bad) if bad else f"ok: flow {errors.max():.5f} px, depth {np.median(steps):.4f} mm, {seen_all} seen, {hidden_all} hidden")
