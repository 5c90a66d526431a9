"""The other side of tests/formats/lost.rs: folders in which slices are damaged, packed or missing, beside other files.

    python lost.py FOLDER

writes a folder for each case, and cases.json: the notes that are expected, and the voxels of the slices that are left, as pydicom
reads these alone (little-endian int16, x fastest), or as they were before PNG was written. A case without voxels is refused.
"""

import gzip
import json
import os
import struct
import sys
import zipfile
import zlib
from pathlib import Path

import numpy
import pydicom
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, ImplicitVRLittleEndian, generate_uid

N, ROWS, COLS = 20, 36, 40
VOXELS = numpy.random.default_rng(5).integers(-1000, 1500, (N, ROWS, COLS)).astype(numpy.int16)
GREY = numpy.random.default_rng(6).integers(0, 256, (N, ROWS, COLS)).astype(numpy.uint8)


def slice_of(k, syntax=ExplicitVRLittleEndian):
    d = Dataset()
    d.file_meta = FileMetaDataset()
    d.file_meta.TransferSyntaxUID = syntax
    d.SOPClassUID = d.file_meta.MediaStorageSOPClassUID = CTImageStorage
    d.SOPInstanceUID = d.file_meta.MediaStorageSOPInstanceUID = generate_uid()
    d.ImageType = ["ORIGINAL", "PRIMARY", "AXIAL"]
    d.Modality, d.PatientName, d.PatientID = "CT", "Doe^Jane", "SECRET7"
    d.StudyInstanceUID, d.SeriesInstanceUID, d.SeriesNumber, d.PatientPosition = "1.2.3", "1.2.3.4", 3, "HFS"
    d.ImagePositionPatient, d.ImageOrientationPatient = [-20, -30, -100 + 1.25 * k], [1, 0, 0, 0, 1, 0]
    d.PixelSpacing, d.SliceThickness = [0.8, 0.7], 1.25
    d.SamplesPerPixel, d.PhotometricInterpretation, d.Rows, d.Columns = 1, "MONOCHROME2", ROWS, COLS
    d.BitsAllocated = d.BitsStored = 16
    d.HighBit, d.PixelRepresentation = 15, 1
    d.RescaleIntercept, d.RescaleSlope, d.RescaleType = 0, 1, "HU"
    d.PixelData = VOXELS[k].astype("<i2").tobytes()
    d["PixelData"].VR = "OW"
    return d


class Cases:
    def __init__(self, folder):
        self.folder, self.cases = folder, []

    def series(self, name, syntax=ExplicitVRLittleEndian):
        out = self.folder / name
        out.mkdir()
        for k in range(N):
            pydicom.dcmwrite(out / f"IM{k:04}.dcm", slice_of(k, syntax), enforce_file_format=True)
        return out

    def expect(self, name, voxels, *notes, **more):
        voxels.astype("<i2").tofile(self.folder / f"{name}.i16")
        dims = [int(n) for n in voxels.shape[::-1]]
        self.cases.append({"name": name, "path": name, "dims": dims, "notes": list(notes), **more})

    def left(self, name, files, *notes):
        """The slices that are left, as pydicom reads them."""
        slices = [pydicom.dcmread(f, force=True) for f in files]
        for d in slices:
            if "TransferSyntaxUID" not in d.file_meta:
                d.file_meta.TransferSyntaxUID = ImplicitVRLittleEndian if d.original_encoding[0] else ExplicitVRLittleEndian
        slices.sort(key=lambda d: d.ImagePositionPatient[2])
        self.expect(name, numpy.stack([d.pixel_array for d in slices]), *notes)

    def refused(self, name, **more):
        self.cases.append({"name": name, "path": name, **more})


def bare(path):
    """Takes preamble and meta header away."""
    b = path.read_bytes()[132:]
    path.write_bytes(b[12 + int.from_bytes(b[8:12], "little"):])


def packed(path):
    b = path.read_bytes()
    path.unlink()
    path.with_name(path.name + ".gz").write_bytes(gzip.compress(b))


def dicom(c):
    files = lambda out: sorted(out.glob("IM*.dcm"))
    out = c.series("whole")
    c.left("whole", files(out))
    damage = {
        "empty": (lambda p: p.write_bytes(b""), "4 files are empty and were skipped, the first: IM"),
        "cut": (lambda p: p.write_bytes(p.read_bytes()[:100]), "4 files are named like slices but are not slices and were skipped, the first: IM"),
        "zeros": (lambda p: p.write_bytes(bytes(len(p.read_bytes()))), "4 files are named like slices but are not slices and were skipped, the first: IM"),
        "page": (lambda p: p.write_bytes(b"<html>503 Service Unavailable</html>"), "4 files are named like slices but are not slices and were skipped, the first: IM"),
        "gz": (packed, "4 slices are compressed with gzip and were skipped (unpack them), the first: IM"),
    }
    for kind, (spoil, note) in damage.items():
        for place, spoilt in {"first": range(4), "last": range(16, 20)}.items():
            out = c.series(f"{place}_{kind}")
            kept = [f for k, f in enumerate(files(out)) if k not in spoilt]
            for k in spoilt:
                spoil(out / f"IM{k:04}.dcm")
            c.left(f"{place}_{kind}", kept, f"{note}{spoilt[0]:04}")
    # Names without an ending.
    out = c.series("no_ending")
    for f in files(out):
        f.rename(out / f.stem)
    (out / "IM0019").write_bytes(b"x" * 3000)
    c.left("no_ending", sorted(out.iterdir())[:19], "1 file is named like a slice but is not a slice and was skipped: IM0019")
    for name, syntax in {"bare": ExplicitVRLittleEndian, "bare_implicit": ImplicitVRLittleEndian}.items():
        for some in (range(16, 20), range(20)):
            out = c.series(f"{name}_{len(some)}", syntax)
            for k in some:
                bare(out / f"IM{k:04}.dcm")
            c.left(f"{name}_{len(some)}", files(out), f"{len(some)} slices without a transfer syntax: the encoding was derived from the data, the first: IM")
    for kind in ("empty", "gz"):
        out = c.series(f"middle_{kind}")
        damage[kind][0](out / "IM0009.dcm")
        c.refused(f"middle_{kind}")
    out = c.series("cut_header")
    (out / "IM0019.dcm").write_bytes((out / "IM0019.dcm").read_bytes()[:400])
    c.refused("cut_header")
    # What accompanies a scan.
    out = c.series("companions")
    for name in ("README.txt", "readme", ".DS_Store", "._IM0001.dcm.txt", "Thumbs.db", "desktop.ini", "autorun.inf", "viewer.exe",
                 "IM0001.json", "scan.json", "scan.nii.gz", "preview.jpg", "report.pdf", "LICENSE", "empty.log", "index.html"):
        (out / name).write_bytes(b"" if name == "empty.log" else b"some bytes of another kind")
    png(out / "preview.png", GREY[0])
    c.left("companions", files(out))
    out = c.series("others")
    (out / "blob").write_bytes(b"some bytes of another kind")
    with zipfile.ZipFile(out / "more.zip", "w") as z:
        z.writestr("x", "x")
    os.symlink("/nowhere/at/all", out / "lost_link")
    os.symlink(c.folder, out / "link")
    if sys.platform == "linux":
        # A regular file that cannot be read, not even by the superuser.
        os.symlink("/proc/self/mem", out / "memory")
    deep = out.joinpath(*["deeper"] * 10)
    deep.mkdir(parents=True)
    notes = ["1 archive was not opened: more.zip", "1 folder is nested too deeply and was skipped: deeper/deeper/",
             "2 links were not followed, the first: l", "1 file of another kind was skipped: blob"]
    if sys.platform == "linux":
        notes.insert(1, "1 file cannot be read and was skipped: memory")
    c.left("others", files(out), *notes)


def png(path, grey):
    """Writes a grey PNG; every reader holds the same values."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + row.tobytes() for row in grey)
    head = struct.pack(">IIBBBBB", grey.shape[1], grey.shape[0], 8, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def pictures(c):
    options = {"spacing": [1, 1, 2], "hu": [0, 255]}

    def folder(name, names=None):
        out = c.folder / name
        out.mkdir()
        for k, grey in enumerate(GREY):
            png(out / (names(k) if names else f"s{k:04}.png"), grey)
        return out

    def good(name, *notes, names=None, grey=GREY, change=None):
        out = folder(name, names)
        if change:
            change(out)
        c.expect(name, grey.astype(numpy.int16), *notes, **options)

    def bad(name, change, names=None):
        change(folder(name, names))
        c.refused(name, **options)

    good("png_whole")
    good("png_from_1", names=lambda k: f"slice{k + 1}.png")
    good("png_from_9", names=lambda k: f"s{k + 9}.png")
    good("png_twos", names=lambda k: f"s{2 * k:04}.png")
    good("png_letters", names=lambda k: f"{chr(97 + k)}.png")
    good("png_dated", names=lambda k: f"2020_{k:03}_1.png")
    good("png_capitals", names=lambda k: f"S{k:03}.PNG")

    def below(out):
        (out / "more").mkdir()
        png(out / "more" / "s0020.png", GREY[0])
        png(out / "more" / "s0021.png", GREY[0])
    good("png_below", "2 PNG files in subfolders were skipped, the first: more/s0020.png", change=below)

    def beside(out):
        for name in (".DS_Store", "._s0001.png", "s0001.json", "README.txt", "Thumbs.db"):
            (out / name).write_bytes(b"some bytes of another kind")
    good("png_companions", change=beside)
    good("png_two_names", "slices have 2 naming patterns, such as a0.png and b0.png: all are treated as one scan",
         names=lambda k: f"{'ab'[k // 10]}{k % 10}.png")
    nine = lambda out: out / "s0009.png"
    bad("png_empty", lambda out: nine(out).write_bytes(b""))
    bad("png_jpeg", lambda out: nine(out).write_bytes(b"\xff\xd8\xff\xe0\0\x10JFIF" + bytes(300)))
    bad("png_garbage", lambda out: nine(out).write_bytes(b"<html></html>"))
    bad("png_cut", lambda out: nine(out).write_bytes(nine(out).read_bytes()[:60]))
    bad("png_gap", lambda out: nine(out).unlink())
    bad("png_gap_two", lambda out: (nine(out).unlink(), (out / "s0010.png").unlink()))
    bad("png_other_ending", lambda out: (nine(out).unlink(), (out / "s0009.jpg").write_bytes(b"\xff\xd8\xff\xe0\0\x10JFIF" + bytes(300))))
    bad("png_twice", lambda out: png(out / "s09.png", GREY[0]))
    bad("png_gap_steps", lambda out: (out / "s0008.png").unlink(), names=lambda k: f"s{2 * k:04}.png")


if __name__ == "__main__":
    cases = Cases(Path(sys.argv[1]))
    dicom(cases)
    pictures(cases)
    (cases.folder / "cases.json").write_text(json.dumps(cases.cases))
