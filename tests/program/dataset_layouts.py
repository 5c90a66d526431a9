"""Judges a layout of `colvis dataset` against the same frames in the layout `colvis`, by the rules of those who read it:
`dataset_layouts.py LAYOUT OWN OTHER`, or `dataset_layouts.py photometric OWN`. Prints `ok` and what was measured, or what is wrong."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

what, own = sys.argv[1], Path(sys.argv[2])
bad, measured = [], {}


def judge(text, is_right):
    if not is_right:
        bad.append(text)


def at_most(text, value, limit):
    measured[text] = max(value, measured.get(text, 0))
    judge(f"{text} is {value:.6g}, more than {limit}", value <= limit)


def matrix(x, y, z, w):
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


told = json.loads((own / "camera.json").read_text())
camera, width, height = told["camera"], told["width"], told["height"]
rows = list(csv.DictReader((own / "poses.csv").open()))
seconds = np.array([float(r["seconds"]) for r in rows])
places = np.array([[float(r[k]) for k in ("x_mm", "y_mm", "z_mm")] for r in rows])
quaternions = np.array([[float(r[k]) for k in ("qx", "qy", "qz", "qw")] for r in rows])
turns = [matrix(*q) for q in quaternions]
is_fisheye = camera["model"] == "fisheye"
count = len(rows)
v, u = np.mgrid[0:height, 0:width].astype(float)


def truth(kind, n):
    return np.load(own / "truth" / kind / f"{n:06}.npy")


def picture(path):
    return np.asarray(Image.open(path))


def own_picture(n):
    return picture(own / "rgb" / f"{n:06}.png")


def curve(theta, k):
    return theta + sum(c * theta ** (2 * n + 3) for n, c in enumerate(k))


def rays(fx, fy, cx, cy, k=None):
    """Directions with x right, y down, z forward: of depth 1 for a pinhole camera, of length 1 for a fisheye."""
    a, b = (u - cx) / fx, (v - cy) / fy
    if k is None:
        return np.stack([a, b, np.ones_like(a)], -1)
    r = np.hypot(a, b)
    angles = np.linspace(0, np.pi, 1_000_001)
    theta = np.interp(r, curve(angles, k), angles)
    side = np.where(r > 1e-12, np.sin(theta) / np.maximum(r, 1e-12), 1)
    return np.stack([a * side, b * side, np.cos(theta)], -1)


def project(p, fx, fy, cx, cy, k=None):
    if k is None:
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.where(p[..., 2:] > 0, p[..., :2] / p[..., 2:], np.nan)
    else:
        side = np.hypot(p[..., 0], p[..., 1])
        at = p[..., :2] * (curve(np.arctan2(side, p[..., 2]), k) / np.maximum(side, 1e-12))[..., None]
    return at * [fx, fy] + [cx, cy]


def own_camera(first=0.0):
    numbers = [camera["fx"], camera["fy"], camera["cx"] + first, camera["cy"] + first]
    return numbers, camera.get("k")


def depths(name, steps_mm, wanted):
    """Judges a picture of depth against distances in mm."""
    image = Image.open(name)
    steps = np.asarray(image).astype(np.int64)
    judge(f"{name} has no 16 bits", image.mode.startswith("I;16"))
    is_far = ~(wanted < 65535.4 * steps_mm)
    judge(f"{name}: 0 where there is depth", ((steps == 0) == (is_far | (wanted < 0.5 * steps_mm))).mean() > 0.9999)
    at_most("depth mm", np.abs(steps * steps_mm - wanted)[steps > 0].max(), 0.51 * steps_mm)


def trajectory(times, at, turn):
    """Judges poses (seconds, metres, quaternions x, y, z, w) by evo's absolute pose error."""
    from evo.core import metrics
    from evo.core.trajectory import PoseTrajectory3D

    def made(times, at, turn):
        return PoseTrajectory3D(positions_xyz=np.array(at), orientations_quat_wxyz=np.roll(turn, 1, axis=1), timestamps=np.array(times))

    ours, theirs = made(seconds, places * 1e-3, quaternions), made(times, at, turn)
    judge("evo finds the poses invalid", theirs.check()[0])
    judge("times", len(times) == count and np.abs(times - seconds).max() < 2e-6)
    ape = metrics.APE(metrics.PoseRelation.full_transformation)
    ape.process_data((ours, theirs))
    at_most("APE", ape.get_statistic(metrics.StatisticsType.max), 1e-7)


def tum(other):
    from evo.tools import file_interface

    read = file_interface.read_tum_trajectory_file(other / "groundtruth.txt")
    trajectory(read.timestamps, read.positions_xyz, np.roll(read.orientations_quat_wxyz, -1, axis=1))
    lists = {}
    for kind in ("rgb", "depth"):
        lines = (other / f"{kind}.txt").read_text().splitlines()
        judge(f"{kind}.txt does not begin with three comments", [line[0] == "#" for line in lines[:4]] == [True] * 3 + [False])
        lists[kind] = [line.split() for line in lines[3:]]
        judge(f"{kind}.txt", [name for _, name in lists[kind]] == [f"{kind}/{t}.png" for t, _ in lists[kind]])
    for n, ((_, rgb), (_, depth)) in enumerate(zip(lists["rgb"], lists["depth"], strict=True)):
        judge(f"{rgb} is another picture", (picture(other / rgb) == own_picture(n)).all())
        depths(other / depth, 1000 / 5000, truth("z", n))
    numbers = [float(x) for x in (other / "calibration.txt").read_text().split()]
    judge("calibration.txt", np.allclose(numbers, own_camera()[0], atol=1e-9))


def colmap(other):
    import pycolmap

    model = pycolmap.Reconstruction(other / "sparse/0")
    judge("counts", model.num_images() == count and model.num_cameras() == 1 and model.num_points3D() >= 40 * count)
    lens = next(iter(model.cameras.values()))
    numbers, k = own_camera(0.5)
    judge("camera", lens.model.name == ("OPENCV_FISHEYE" if is_fisheye else "PINHOLE") and (lens.width, lens.height) == (width, height))
    judge("numbers of the camera", np.allclose(lens.params, numbers + (k or []), atol=1e-9))
    errors, colours, off, tracks = [], [], [], {}
    for image in model.images.values():
        n = image.image_id - 1
        judge(f"{image.name} is another picture", (picture(other / "images" / image.name) == own_picture(n)).all())
        at_most("centre mm", np.abs(image.projection_center() - places[n]).max(), 1e-6)
        judge(f"{image.name}: turn", np.abs(image.cam_from_world().rotation.matrix() - turns[n].T).max() < 1e-9)
        points = [p for p in image.points2D if p.has_point3D()]
        judge(f"{image.name} has {len(points)} points", len(points) >= 40)
        depth = truth("depth", n)
        for p in points:
            place = model.points3D[p.point3D_id].xyz
            at = lens.img_from_cam(image.cam_from_world() * place)
            errors.append(np.inf if at is None else np.linalg.norm(at - p.xy))
            tracks.setdefault(p.point3D_id, []).append((n, p.xy))
            # Where the picture has it: the pixels around have its distance.
            x, y = np.clip(np.floor(p.xy - 0.5), 0, [width - 2, height - 2]).astype(int)
            around, far = depth[y : y + 2, x : x + 2], np.linalg.norm(place - places[n])
            off.append(max(around.min() - far, far - around.max(), 0) / far)
    for number, seen in tracks.items():
        n, (x, y) = min(seen, key=lambda s: s[0])
        judge(f"point {number} is seen once", len(seen) > 1 and len(seen) == len(model.points3D[number].track.elements))
        colours.append((own_picture(n)[int(y), int(x)] == model.points3D[number].color).all())
    model.update_point_3d_errors()
    at_most("mean reprojection px", model.compute_mean_reprojection_error(), 0.1)
    at_most("largest reprojection px", max(errors), 0.1)
    at_most("share of points off the depth around", np.mean(np.array(off) > 0.01), 0.02)
    # The first picture is another if the point is beside its camera.
    at_most("share of other colours", 1 - np.mean(colours), 0.02 if is_fisheye else 0)


def nerfstudio(other):
    all = json.loads((other / "transforms.json").read_text())
    judge("camera", all["camera_model"] == ("OPENCV_FISHEYE" if is_fisheye else "OPENCV") and (all["w"], all["h"]) == (width, height))
    k = [all[f"k{n}"] for n in range(1, 5)] if is_fisheye else None
    judge("frames", len(all["frames"]) == count and not (set(all) & {"p1", "p2"}))
    # A ray goes through the middle of a pixel, half a pixel from its corner.
    lens = [all[key] for key in ("fl_x", "fl_y", "cx", "cy")]
    lens[2:] = [c - 0.5 for c in lens[2:]]
    directions, flip = rays(*lens, k), [1, -1, -1]
    poses = [np.array(frame["transform_matrix"]) for frame in all["frames"]]
    truths = rays(*own_camera()[0], own_camera()[1])
    truths /= np.linalg.norm(truths, axis=-1, keepdims=True)
    wrong, flows = [], []
    for n, (frame, pose) in enumerate(zip(all["frames"], poses)):
        judge(f"{n} is another picture", (picture(other / frame["file_path"]) == own_picture(n)).all())
        judge(f"{n}: the pose is no rotation", np.allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3)) and np.linalg.det(pose[:3, :3]) > 0)
        depths(other / frame["depth_file_path"], 0.01, truth("depth" if is_fisheye else "z", n))
        steps = picture(other / frame["depth_file_path"]) * all["depth_unit_scale_factor"]
        world = (steps[..., None] * directions * flip) @ pose[:3, :3].T + pose[:3, 3]
        ours = places[n] + truth("depth", n)[..., None] * (truths @ turns[n].T)
        wrong.append(np.linalg.norm(10 * world - ours, axis=-1)[steps > 0].max())
        if n + 1 < count:
            local = (world - poses[n + 1][:3, 3]) @ poses[n + 1][:3, :3] * flip
            at = project(local, *lens, k) - np.stack([u, v], -1)
            flow = truth("flow-after", n)
            good = (steps > 0) & np.isfinite(flow).all(-1) & (np.abs(flow) < width).all(-1)
            flows.append(np.linalg.norm(at - flow, axis=-1)[good].max())
    at_most("points mm", max(wrong), 0.02)
    at_most("reprojection into the next frame px", max(flows), 0.1)


def vslam_lab(other):
    import yaml

    # What a sequence must have: DatasetVSLAMLab.check_sequence_integrity.
    judge("files", (other / "rgb_0").is_dir() and all((other / n).is_file() for n in ("rgb.csv", "calibration.yaml", "groundtruth.csv")))
    frames = list(csv.DictReader((other / "rgb.csv").open()))
    judge("columns of rgb.csv", list(frames[0]) == ["ts_rgb_0 (ns)", "path_rgb_0", "ts_depth_0 (ns)", "path_depth_0"])
    stamps = [int(f["ts_rgb_0 (ns)"]) for f in frames]
    judge("times of depth", stamps == [int(f["ts_depth_0 (ns)"]) for f in frames])
    judge("times do not ascend", len(frames) == count and all(a < b for a, b in zip(stamps, stamps[1:])))
    lens = yaml.safe_load((other / "calibration.yaml").read_text())["cameras"]
    judge("cameras", len(lens) == 1)
    lens = lens[0]
    keys = {"cam_name", "cam_type", "depth_name", "cam_model", "focal_length", "principal_point", "depth_factor", "image_dimension", "fps", "T_BS"}
    more = {"distortion_type", "distortion_coefficients"} if is_fisheye else set()
    judge(f"keys of calibration.yaml: {set(lens) ^ (keys | more)}", set(lens) == keys | more)
    words = ("rgb_0", "rgb+depth", "depth_0", "pinhole")
    judge("names in calibration.yaml", words == tuple(lens[k] for k in ("cam_name", "cam_type", "depth_name", "cam_model")))
    numbers, k = own_camera()
    judge("camera", np.allclose(lens["focal_length"] + lens["principal_point"], numbers) and lens["image_dimension"] == [width, height])
    judge("distortion", not is_fisheye or (lens["distortion_type"] == "equid4" and lens["distortion_coefficients"] == k))
    judge("the rest of the camera", lens["fps"] == told["frames_per_second"] and np.reshape(lens["T_BS"], (4, 4)).tolist() == np.eye(4).tolist())
    for n, frame in enumerate(frames):
        judge(f"{n} is another picture", (picture(other / frame["path_rgb_0"]) == own_picture(n)).all())
        depths(other / frame["path_depth_0"], 1000 / lens["depth_factor"], truth("z", n))
    poses = list(csv.DictReader((other / "groundtruth.csv").open()))
    judge("columns of groundtruth.csv", list(poses[0]) == ["ts (ns)", "tx (m)", "ty (m)", "tz (m)", "qx", "qy", "qz", "qw"])
    numbers = np.array([[float(x) for x in pose.values()] for pose in poses])
    trajectory(numbers[:, 0] * 1e-9, numbers[:, 1:4], numbers[:, 4:])


def sample(image, at):
    """Values between pixels, linear; NaN outside."""
    x, y = np.nan_to_num(np.floor(at), nan=-1).astype(int).transpose(2, 0, 1)
    inside = (x >= 0) & (y >= 0) & (x < width - 1) & (y < height - 1)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    a, b = (at - np.stack([x, y], -1)).transpose(2, 0, 1)
    out = image[y, x] * (1 - a) * (1 - b) + image[y, x + 1] * a * (1 - b) + image[y + 1, x] * (1 - a) * b + image[y + 1, x + 1] * a * b
    return np.where(inside, out, np.nan)


def photometric():
    """The pose that makes two pictures agree is the pose that is told: along each axis there is no better one near it.

    Frame n's pixels are put into frame n + 1 by their depth and a pose. The lamps move with the camera: what a pixel sends back changes by
    the ratio of the sum over lamps of cos/r² and the fall of their light to the side, of an evenly scattering wall, as `dataset.json` has
    them; without the cosine, 1/r² alone has its best pose off the true one where frames are some mm apart. The ratio of both exposures is
    one number for all pixels: their median."""
    lens = own_camera()
    directions = rays(*lens[0], lens[1])
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    settings = json.loads((own / "dataset.json").read_text())["look"]
    lamps, cone, gamma = settings["lights_mm"], settings["cone"], settings["sensor"]["gamma"]

    def light(n):
        """Linear red; NaN where it is too dark or too bright to be known."""
        red = own_picture(n)[..., 0] / 255.0
        return np.where((red > 0.02) & (red < 0.995), red**gamma, np.nan)

    def lit(local, normal):
        """The light of all lamps at places in the camera's frame; NaN where one grazes the wall."""
        total = 0.0
        for right, up in lamps:
            way = np.array([right, -up, 0]) - local
            r = np.linalg.norm(way, axis=-1)
            cosine = (way * normal).sum(-1) / r
            total = total + np.where(cosine > 0.1, cosine, np.nan) * (-way[..., 2] / r).clip(0) ** cone / r**2
        return np.where(total > 0, total, np.nan)

    def difference(n, move, turn):
        """Mean of |difference| over pixels that both see, as a share of the light; the pose is moved (mm) and turned (degrees)."""
        depth = truth("depth", n).astype(float)
        here, normal = np.where(np.isfinite(depth), depth, np.nan)[..., None] * directions, truth("normals", n)
        angle = np.radians(np.linalg.norm(turn))
        axis = turn / max(np.linalg.norm(turn), 1e-12) * np.sin(angle / 2)
        pose = turns[n + 1] @ matrix(*axis, np.cos(angle / 2))
        there = (places[n] + here @ turns[n].T - places[n + 1] - turns[n + 1] @ move) @ pose
        wanted = light(n) * lit(there, normal @ pose) / lit(here, normal @ turns[n])
        found = sample(light(n + 1), project(there, *lens[0], lens[1]))
        # What both see is true for the true pose, and the same for all.
        both = np.isfinite(wanted) & np.isfinite(found) & (picture(own / "truth/unseen" / f"{n:06}.png") & 3 == 0)
        gain = np.median(found[both] / wanted[both])
        return np.abs(found - gain * wanted)[both].mean() / found[both].mean(), both.mean()

    margins = []
    for n in range(count - 1):
        best, share = difference(n, np.zeros(3), np.zeros(3))
        judge(f"{n}: both see {share:.2f} of the pixels", share > 0.3)
        for axis in range(6):
            for size in (-0.5, -0.25, 0.25, 0.5):
                step = np.zeros(6)
                step[axis] = size
                other = difference(n, step[:3], step[3:])[0]
                margins.append(other / best)
                judge(f"{n}: {size} along axis {axis} differs by {other:.5f}, the true pose by {best:.5f}", other > best)
    measured.update({"difference": best, "other poses differ at least, times": min(margins), "and at most": max(margins)})


judges = {"tum": tum, "colmap": colmap, "nerfstudio": nerfstudio, "vslam-lab": vslam_lab}
if what == "photometric":
    photometric()
else:
    judges[what](Path(sys.argv[3]))
print("\n".join(bad) if bad else "ok: " + ", ".join(f"{text} {value:.3g}" for text, value in measured.items()))
