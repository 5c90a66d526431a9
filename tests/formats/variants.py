"""The other side of tests/formats/variants.rs: the variants of NRRD and MetaImage headers.

    python variants.py FOLDER

writes a file (with its data) for each, and cases.json: the notes that are expected, and the voxels (little-endian int16, x fastest)
and the world coordinates of four corners as SimpleITK reads them. A case without voxels is refused.
"""

import bz2
import gzip
import json
import sys
import zlib
from pathlib import Path

import numpy
import SimpleITK

SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
X, Y, Z = 4, 3, 2
VOXELS = numpy.random.default_rng(7).integers(-1000, 1500, (Z, Y, X)).astype(numpy.int16)
RAW, BIG = VOXELS.astype("<i2").tobytes(), VOXELS.astype(">i2").tobytes()
TEXT = "\n".join(str(v) for v in VOXELS.ravel()).encode() + b"\n"
SPACE = "names no space: left-posterior-superior is assumed"
UNKNOWN = "does not name the patient's sides: left-posterior-superior is assumed"
NO_SPACING = "has no spacing: 1 mm is assumed"
DIRECTIONS = "space directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (10,20,30)\n"
LPS = "space: left-posterior-superior\n" + DIRECTIONS


class Cases:
    def __init__(self, folder):
        self.folder, self.cases = folder, []

    def file(self, name, content, *notes, bad=False, itk=True, data=None, voxels=None, corners=None):
        path = self.folder / name
        path.write_bytes(content)
        for other, b in (data or {}).items():
            (self.folder / other).write_bytes(b)
        case = {"name": path.stem, "path": name}
        if not bad:
            image = SimpleITK.ReadImage(str(path)) if itk else None
            array = SimpleITK.GetArrayFromImage(image) if voxels is None else voxels
            array = array.reshape(array.shape[-3:]) if array.ndim > 2 else array[None]
            assert array.min() >= -1024, name
            array.astype("<i2").tofile(self.folder / f"{path.stem}.i16")
            dims = [int(n) for n in array.shape[::-1]]
            if image is not None and image.GetDimension() == 3:
                far = [n - 1 for n in dims]
                corners = [image.TransformIndexToPhysicalPoint(p) for p in ((0, 0, 0), (far[0], 0, 0), (0, far[1], 0), (0, 0, far[2]))]
            case |= {"dims": dims, "notes": list(notes)}
            if corners is not None:
                case["corners"] = [list(c) for c in corners]
        self.cases.append(case)

    def nrrd(self, name, lines, *notes, end=".nrrd", head="NRRD0005\ntype: short\ndimension: 3\nsizes: 4 3 2\n",
             endian="endian: little\n", encoding="encoding: raw\n", body=RAW, **more):
        self.file(f"nrrd_{name}{end}", (head + endian + encoding + lines + "\n").encode() + body, *notes, **more)

    def mha(self, name, lines, *notes, end=".mha", sizes="NDims = 3\nDimSize = 4 3 2\n", spacing="ElementSpacing = 1 2 3\n",
            kind="ElementType = MET_SHORT\n", last="LOCAL", body=RAW, **more):
        head = f"ObjectType = Image\n{sizes}{spacing}{kind}{lines}ElementDataFile = {last}\n"
        self.file(f"mha_{name}{end}", head.encode() + body, *notes, **more)


def nrrd(c):
    c.nrrd("raw", LPS)
    c.nrrd("big", LPS, endian="endian: big\n", body=BIG)
    c.nrrd("gzip", LPS, encoding="encoding: gzip\n", body=gzip.compress(RAW))
    c.nrrd("gz", LPS, encoding="encoding: gz\n", body=gzip.compress(RAW))
    c.nrrd("gzip_big", LPS, encoding="encoding: gzip\n", endian="endian: big\n", body=gzip.compress(BIG))
    for word in ("ascii", "text", "txt"):
        c.nrrd(word, LPS, encoding=f"encoding: {word}\n", endian="", body=TEXT)
    c.nrrd("hex", LPS, encoding="encoding: hex\n", body=RAW.hex().encode(), bad=True)
    c.nrrd("bzip2", LPS, encoding="encoding: bzip2\n", body=bz2.compress(RAW), bad=True)
    c.nrrd("line_skip", LPS + "line skip: 2\n", body=b"one\ntwo\n" + RAW)
    c.nrrd("byte_skip", LPS + "byte skip: 7\n", body=b"seven77" + RAW)
    c.nrrd("both_skips", LPS + "line skip: 1\nbyte skip: 7\n", body=b"one\nseven77" + RAW)
    c.nrrd("byte_skip_end", LPS + "byte skip: -1\n", body=b"anything before" + RAW)
    c.nrrd("byte_skip_gzip", LPS + "byte skip: 7\n", encoding="encoding: gzip\n", body=gzip.compress(b"seven77" + RAW))
    c.nrrd("line_skip_gzip", LPS + "line skip: 1\n", encoding="encoding: gzip\n", body=b"one\n" + gzip.compress(RAW))
    c.nrrd("detached", LPS + "data file: d.raw\n", end=".nhdr", body=b"", data={"d.raw": RAW})
    c.nrrd("detached_dot", LPS + "data file: ./d2.raw\n", end=".nhdr", body=b"", data={"d2.raw": RAW})
    c.nrrd("detached_gzip", LPS + "datafile: d.gz\n", end=".nhdr", encoding="encoding: gzip\n", body=b"", data={"d.gz": gzip.compress(RAW)})
    c.nrrd("detached_skip", LPS + "data file: d3.raw\nline skip: 1\nbyte skip: 3\n", end=".nhdr", body=b"", data={"d3.raw": b"one\nabc" + RAW})
    c.nrrd("detached_end", LPS + "data file: d4.raw\nbyteskip: -1\n", end=".nhdr", body=b"", data={"d4.raw": b"header!" + RAW})
    c.nrrd("list", LPS + "data file: LIST\nl0.raw\nl1.raw\n", end=".nhdr", body=b"", bad=True, data={"l0.raw": RAW[:24], "l1.raw": RAW[24:]})
    c.nrrd("pattern", LPS + "data file: l%d.raw 0 1 1\n", end=".nhdr", body=b"", bad=True)
    for name, space in {"ras": "right-anterior-superior", "las": "LAS", "lps": "LPS", "capitals": "Right-Anterior-Superior"}.items():
        c.nrrd(f"space_{name}", f"space: {space}\n" + DIRECTIONS)
    c.nrrd("space_scanner", "space: scanner-xyz\n" + DIRECTIONS, UNKNOWN)
    c.nrrd("space_right_handed", "space: 3D-right-handed\n" + DIRECTIONS, UNKNOWN)
    c.nrrd("space_left_handed", "space: 3D-left-handed\n" + DIRECTIONS, bad=True)
    c.nrrd("space_rai", "space: RAI\n" + DIRECTIONS, bad=True)
    c.nrrd("space_time", "space: LPST\n" + DIRECTIONS, bad=True)
    c.nrrd("space_dimension", "space dimension: 3\n" + DIRECTIONS, SPACE)
    c.nrrd("oblique", "space: LPS\nspace directions: (0.8,0.6,0) (-1.2,1.6,0) (0,0,3)\nspace origin: (10,20,30)\n")
    c.nrrd("sheared", "space: LPS\nspace directions: (1,0,0) (0,2,0) (0,0.9,2.8)\nspace origin: (10,20,30)\n")
    c.nrrd("kinds", LPS + "kinds: domain domain domain\ncontent: a scan\n# a comment\nkey:=value\n")
    c.nrrd("centers", LPS + "centerings: cell cell cell\n")
    c.nrrd("centers_node", LPS + "centers: node node node\n")
    c.nrrd("space_units", LPS + 'space units: "mm" "mm" "mm"\n')
    c.nrrd("measurement_frame", LPS + "measurement frame: (1,0,0) (0,1,0) (0,0,1)\n")
    c.nrrd("none_last", LPS.replace("(0,0,3)", "(0,0,3) none"), head="NRRD0005\ntype: short\ndimension: 4\nsizes: 4 3 2 1\n", voxels=VOXELS, itk=False,
           corners=[(10, 20, 30), (13, 20, 30), (10, 24, 30), (10, 20, 33)])
    c.nrrd("none_first", LPS.replace("(1,0,0)", "none (1,0,0)"), head="NRRD0005\ntype: short\ndimension: 4\nsizes: 1 4 3 2\nkinds: list domain domain domain\n",
           voxels=VOXELS, itk=False, corners=[(10, 20, 30), (13, 20, 30), (10, 24, 30), (10, 20, 33)])
    c.nrrd("vector", LPS.replace("(1,0,0)", "none (1,0,0)"), head="NRRD0005\ntype: short\ndimension: 4\nsizes: 3 4 3 2\nkinds: vector domain domain domain\n",
           body=RAW * 3, bad=True)
    # Spacings, and the ends of axes.
    c.nrrd("spacings", "spacings: 1 2 3\n", SPACE)
    c.nrrd("no_spacing", "", SPACE, NO_SPACING)
    mins = "axis mins: 10 20 30\n"
    c.nrrd("mins", "spacings: 1 2 3\n" + mins, SPACE)
    c.nrrd("mins_old_name", "spacings: 1 2 3\naxismins: 10 20 30\n", SPACE)
    c.nrrd("mins_node", "spacings: 1 2 3\ncenters: node node node\n" + mins, SPACE)
    c.nrrd("mins_cell", "spacings: 1 2 3\ncenters: cell cell cell\n" + mins, SPACE)
    c.nrrd("mins_mixed", "spacings: 1 2 3\ncenterings: cell node ???\n" + mins, SPACE)
    c.nrrd("mins_maxs", "spacings: 1 2 3\naxis maxs: 14 26 36\n" + mins, SPACE)
    # SimpleITK takes 1 mm here; the format's definition gives the spacing.
    c.nrrd("maxs_give_spacing", "axis maxs: 14 26 36\n" + mins, SPACE, voxels=VOXELS, itk=False,
           corners=[(10.5, 21, 31.5), (13.5, 21, 31.5), (10.5, 25, 31.5), (10.5, 21, 34.5)])
    c.nrrd("mins_nan", "spacings: 1 2 3\naxis mins: 10 nan 30\n", bad=True)
    c.nrrd("ends_contradict", "spacings: 1 2 3\naxis mins: 1 2 3\naxis maxs: 14 26 36\n", bad=True)
    for name in ("signed short", "short int", "int16_t", "INT16"):
        c.nrrd(f"type_{name.replace(' ', '_')}", LPS, head=f"NRRD0004\ntype: {name}\ndimension: 3\nsizes: 4 3 2\n")
    for name, kind in {"float": "<f4", "double": "<f8", "int": "<i4"}.items():
        c.nrrd(f"type_{name}", LPS, head=f"NRRD0001\ntype: {name}\ndimension: 3\nsizes: 4 3 2\n", body=VOXELS.astype(kind).tobytes())
    c.nrrd("carriage_returns", LPS.replace("\n", "\r\n"))
    c.nrrd("short", LPS, body=RAW[:-2], bad=True)


def metaimage(c):
    c.mha("raw", "")
    c.mha("binary", "BinaryData = True\n")
    c.mha("big", "BinaryData = True\nBinaryDataByteOrderMSB = True\n", body=BIG)
    c.mha("big_old_name", "BinaryData = True\nElementByteOrderMSB = True\n", body=BIG)
    c.mha("text", "BinaryData = False\n", body=TEXT)
    packed = zlib.compress(RAW)
    c.mha("packed", f"BinaryData = True\nCompressedData = True\nCompressedDataSize = {len(packed)}\n", body=packed)
    # SimpleITK does not find the end of such data.
    c.mha("packed_no_size", "BinaryData = True\nCompressedData = True\n", body=packed, voxels=VOXELS, itk=False)
    c.mha("detached", "", end=".mhd", last="m.raw", body=b"", data={"m.raw": RAW})
    c.mha("detached_packed", f"CompressedData = True\nCompressedDataSize = {len(packed)}\n", end=".mhd", last="m.zraw", body=b"", data={"m.zraw": packed})
    c.mha("header_size", "HeaderSize = 11\n", end=".mhd", last="h.raw", body=b"", data={"h.raw": b"eleven-byte" + RAW})
    c.mha("headerless", "HeaderSize = -1\n", end=".mhd", last="n.raw", body=b"", data={"n.raw": b"whatever it is" + RAW})
    c.mha("list", "", end=".mhd", last="LIST\nl0.raw\nl1.raw", body=b"", bad=True)
    c.mha("pattern", "", end=".mhd", last="l%d.raw 0 1 1", body=b"", bad=True)
    for key in ("TransformMatrix", "Rotation", "Orientation"):
        c.mha(f"matrix_{key}", f"{key} = 0.8 0.6 0 -0.6 0.8 0 0 0 1\n")
    for key in ("Offset", "Position", "Origin"):
        c.mha(f"origin_{key}", f"{key} = 10 20 30\n")
    c.mha("centre", "CenterOfRotation = 5 5 5\nTransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 10 20 30\n")
    c.mha("anatomical", "AnatomicalOrientation = RAI\n")
    c.mha("size_only", "", spacing="ElementSize = 1 2 3\n")
    c.mha("size_and_spacing", "ElementSize = 4 5 6\n")
    c.mha("no_spacing", "", NO_SPACING, spacing="")
    c.mha("modality", "Modality = MET_MOD_CT\nComment = a scan\n")
    c.mha("minmax", "ElementMin = -1000\nElementMax = 1500\n")
    c.mha("four", "", sizes="NDims = 4\nDimSize = 4 3 2 1\n", spacing="ElementSpacing = 1 2 3 1\n", voxels=VOXELS, itk=False)
    c.mha("carriage_returns", "Offset = 1 2 3\r\n")
    c.mha("channels", "ElementNumberOfChannels = 1\n")
    c.mha("vector", "ElementNumberOfChannels = 3\n", body=RAW * 3, bad=True)
    for name, kind in {"MET_FLOAT": "<f4", "MET_DOUBLE": "<f8", "MET_INT": "<i4", "MET_LONG_LONG": "<i8"}.items():
        c.mha(f"type_{name}", "", kind=f"ElementType = {name}\n", body=VOXELS.astype(kind).tobytes())
    c.mha("short", "", body=RAW[:-2], bad=True)
    c.mha("no_type", "", kind="", bad=True)
    c.mha("spacing_zero", "", spacing="ElementSpacing = 1 0 3\n", bad=True)


if __name__ == "__main__":
    cases = Cases(Path(sys.argv[1]))
    nrrd(cases)
    metaimage(cases)
    (cases.folder / "cases.json").write_text(json.dumps(cases.cases))
