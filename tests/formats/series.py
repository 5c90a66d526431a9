"""The other side of tests/formats/series.rs: series that are several passes, and what each of them holds.

    python series.py FOLDER

writes a folder (or a file) for each case, and cases.json: for each case its passes in the order of the list, each with the words
that tell it, its position, and a file with its voxels as SimpleITK or pydicom reads them alone (little-endian int16, x fastest);
or the words of the error.
"""

import json
import random
import sys
from pathlib import Path

import numpy
import pydicom
import SimpleITK
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.sequence import Sequence
from pydicom.uid import CTImageStorage, EnhancedCTImageStorage, ExplicitVRLittleEndian, RLELossless, generate_uid

ROWS, COLS, STEP = 6, 7, 1.25
random.seed(3)


def values(seed, n):
    """Voxels that no two passes share."""
    return numpy.random.default_rng(seed).integers(-1000, 1500, (n, ROWS, COLS)).astype(numpy.int16)


def header(syntax=ExplicitVRLittleEndian, sop=CTImageStorage):
    d = Dataset()
    d.file_meta = FileMetaDataset()
    d.file_meta.TransferSyntaxUID = syntax
    d.SOPClassUID = d.file_meta.MediaStorageSOPClassUID = sop
    d.SOPInstanceUID = d.file_meta.MediaStorageSOPInstanceUID = generate_uid()
    d.Modality, d.PatientName, d.PatientID = "CT", "Doe^Jane", "SECRET7"
    d.StudyInstanceUID, d.SeriesInstanceUID, d.SeriesNumber = "1.2.3", "1.2.3.4", 3
    d.FrameOfReferenceUID, d.PatientPosition = "1.2.3.9", "HFS"
    d.ImageType = ["ORIGINAL", "PRIMARY", "AXIAL"]
    d.SamplesPerPixel, d.PhotometricInterpretation = 1, "MONOCHROME2"
    d.Rows, d.Columns = ROWS, COLS
    d.BitsAllocated = d.BitsStored = 16
    d.HighBit, d.PixelRepresentation = 15, 1
    return d


def run(seed, n=16, start=0.0, step=STEP, each=None, orientation=(1, 0, 0, 0, 1, 0), **same):
    """One pass: n slices from `start` mm. `each(d, k)` edits a slice, `same` names elements of all."""
    out, (x, y) = [], (numpy.array(orientation[:3]), numpy.array(orientation[3:]))
    for k, voxels in enumerate(values(seed, n)):
        d = header()
        place = numpy.array([-20.0, -30.0, -100.0]) + numpy.cross(x, y) * (start + k * step)
        d.ImagePositionPatient = [round(float(v), 4) for v in place]
        d.ImageOrientationPatient = list(orientation)
        d.PixelSpacing, d.SliceThickness = [0.8, 0.7], STEP
        d.RescaleIntercept, d.RescaleSlope, d.RescaleType = 0, 1, "HU"
        for name, value in same.items():
            setattr(d, name, value)
        if each:
            each(d, k)
        d.PixelData = voxels.astype("<i2").tobytes()
        d["PixelData"].VR = "OW"
        out.append(d)
    return out


def written(folder, slices, shuffled=True):
    folder.mkdir(parents=True, exist_ok=True)
    names = list(range(len(slices)))
    if shuffled:
        random.shuffle(names)
    paths = []
    for name, d in zip(names, slices):
        paths.append(folder / f"{name:04}.dcm")
        pydicom.dcmwrite(paths[-1], d, enforce_file_format=True)
    return paths


def read(paths):
    """The volume of one pass alone, as SimpleITK reads it, in the order of its positions along the normal."""
    def along(path):
        d = pydicom.dcmread(path, stop_before_pixels=True)
        o = numpy.array(d.ImageOrientationPatient, float)
        return float(numpy.cross(o[:3], o[3:]) @ numpy.array(d.ImagePositionPatient, float))
    reader = SimpleITK.ImageSeriesReader()
    reader.SetFileNames([str(p) for p in sorted(paths, key=along)])
    return SimpleITK.GetArrayFromImage(reader.Execute()).astype("<i2")


class Cases:
    def __init__(self, folder):
        self.folder, self.cases = folder, []

    def expect(self, name, passes, arrays, path=None, **more):
        for k, ((words, position), array) in enumerate(zip(passes, arrays)):
            array.astype("<i2").tofile(self.folder / f"{name}.{k}.i16")
        listed = [{"words": w, "position": p, "dims": [int(n) for n in a.shape[::-1]]} for (w, p), a in zip(passes, arrays)]
        self.cases.append({"name": name, "path": path or name, "passes": listed, **more})

    def passes(self, name, *passes, **more):
        """Passes that must be listed apart: (words, slices), in the order of the list."""
        everything = [d for _, slices in passes for d in slices]
        paths = dict(zip(map(id, everything), written(self.folder / name, everything)))
        arrays = [read([paths[id(d)] for d in slices]) for _, slices in passes]
        told = [(w, "prone" if slices[0].get("PatientPosition") == "HFP" else "supine") for w, slices in passes]
        self.expect(name, told, arrays, **more)

    def refused(self, name, why, *passes):
        written(self.folder / name, [d for slices in passes for d in slices])
        self.cases.append({"name": name, "path": name, "refused": why})


def two(c):
    """Two passes that an attribute tells apart, wherever the second begins."""
    differing = [
        ("acquisition", {"AcquisitionNumber": 1}, {"AcquisitionNumber": 2}, "acquisition 1", "acquisition 2"),
        ("kernel", {"ConvolutionKernel": "B30f"}, {"ConvolutionKernel": "B70f"}, "kernel B30f", "kernel B70f"),
        ("energy", {"KVP": "80"}, {"KVP": "140.0"}, "80 kV", "140 kV"),
        ("mono", {"MonoenergeticEnergyEquivalent": 50.0}, {"MonoenergeticEnergyEquivalent": 70.0}, "50 keV", "70 keV"),
        ("phase", {"TemporalPositionIdentifier": 9}, {"TemporalPositionIdentifier": 10}, "temporal position 9", "temporal position 10"),
        ("trigger", {"TriggerTime": "0"}, {"TriggerTime": "350"}, "trigger delay 0 ms", "trigger delay 350 ms"),
        ("thickness", {"SliceThickness": "1.5"}, {"SliceThickness": "3"}, "1.5 mm thick", "3 mm thick"),
        ("diameter", {"ReconstructionDiameter": "350"}, {"ReconstructionDiameter": "500"}, "field of view 350 mm", "field of view 500 mm"),
        ("type", {"ImageType": ["DERIVED", "PRIMARY", "AXIAL", "AVERAGE"]}, {"ImageType": ["DERIVED", "PRIMARY", "AXIAL", "MIN IP"]},
         "type AVERAGE", "type MIN IP"),
        ("description", {"SeriesDescription": "Mono 50 keV"}, {"SeriesDescription": "Mono 70 keV"}, "Mono 50 keV", "Mono 70 keV"),
        ("comment", {"ImageComments": "MonoE 50 keV, Doe"}, {"ImageComments": "MonoE 70 keV, Doe"}, "MonoE 50 keV, …", "MonoE 70 keV, …"),
        ("contrast", {}, {"ContrastBolusAgent": "Iodine"}, "no contrast", "contrast Iodine"),
        ("event", {"IrradiationEventUID": "1.7.1"}, {"IrradiationEventUID": "1.7.2"}, "irradiation event 1", "irradiation event 2"),
    ]
    shifts = {"half": STEP / 2, "third": STEP / 3, "same": 0.0, "overlap": 12.25 * STEP, "onto": 12 * STEP, "gap": 22.4 * STEP}
    for what, one, other, first, second in differing:
        for shift, start in shifts.items():
            if what == "event":
                words = (f"{first}", f"{second}")
                # A UID has no order: the list has that of the files.
                c.passes(f"{what}_{shift}", (words[0], run(1, **one)), (words[1], run(2, start=start, **other)), unordered=True)
            else:
                c.passes(f"{what}_{shift}", (first, run(1, **one)), (second, run(2, start=start, **other)))
    number = lambda d, k: setattr(d, "InstanceNumber", k + 1)
    later = lambda d, k: setattr(d, "InstanceNumber", k + 31)
    for shift in ("half", "third", "same", "overlap", "onto"):
        start = shifts[shift]
        c.passes(f"instance_{shift}", ("pass 1", run(1, each=number)), ("pass 2", run(2, start=start, each=later)))
        clock = lambda at: lambda d, k: setattr(d, "AcquisitionTime", f"10{at:02}{(k // 2):02}.5")
        c.passes(f"time_{shift}", ("pass 1", run(1, each=clock(10))), ("pass 2", run(2, start=start, each=clock(11))))
        down = lambda at: lambda d, k: setattr(d, "AcquisitionTime", f"10{at:02}{(30 - k // 2):02}.5")
        c.passes(f"down_{shift}", ("pass 1", run(1, each=down(10))), ("pass 2", run(2, start=start, each=down(11))))


def always(c):
    """What separates wherever the passes lie."""
    shifts = {"half": STEP / 2, "same": 0.0, "end": 16 * STEP, "gap": 20 * STEP, "apart": 19.4 * STEP}
    for shift, start in shifts.items():
        for second in ("HFP", "FFS"):
            words = ("HFS", "FFS") if second == "FFS" else ("", "")
            c.passes(f"{second}_{shift}", (words[0], run(1)), (words[1], run(2, start=start, PatientPosition=second)), unordered=True)
        c.passes(f"frame_{shift}", ("frame of reference 1", run(1)),
                 ("frame of reference 2", run(2, start=start, FrameOfReferenceUID="1.2.3.10")), unordered=True)
        c.passes(f"plane_{shift}", ("", run(1)), ("", run(2, start=start, orientation=(1, 0, 0, 0, 0, -1))), unordered=True)
        c.passes(f"spacing_{shift}", ("", run(1)), ("", run(2, start=start, PixelSpacing=[0.5, 0.5])), unordered=True)
    # A position that only some slices tell.
    some = lambda d, k: k < 9 and delattr(d, "PatientPosition")
    prone = run(1, PatientPosition="HFP", each=some)
    name = "some_positions"
    paths = written(c.folder / name, prone, shuffled=False)
    c.expect(name, [("", "prone")], [read(paths)])


def one(c):
    """One pass, whatever varies in it."""
    def whole(name, slices):
        paths = written(c.folder / name, slices)
        c.expect(name, [("", "supine")], [read(paths)])
    half = lambda name, a, b: lambda d, k: setattr(d, name, a if k < 11 else b)
    number = lambda d, k: setattr(d, "InstanceNumber", k + 1)
    whole("one_acquisition", run(1, 20, each=half("AcquisitionNumber", 1, 2)))
    whole("one_kernel", run(1, 20, each=half("ConvolutionKernel", "B30f", "B31f")))
    whole("one_slabs", run(1, 40, each=lambda d, k: setattr(d, "AcquisitionNumber", k // 4)))
    whole("one_each", run(1, 20, each=lambda d, k: setattr(d, "AcquisitionNumber", k)))
    whole("one_odd", run(1, 20, each=lambda d, k: k == 7 and setattr(d, "ConvolutionKernel", "X")))
    mixed = [3, 4, 9, 10, 11, 15, 18]
    whole("one_mixed", run(1, 20, each=lambda d, k: setattr(d, "ImageComments", str(k in mixed))))
    whole("one_current", run(1, 20, each=lambda d, k: setattr(d, "XRayTubeCurrent", str(100 + k % 2))))
    whole("one_time", run(1, 20, each=lambda d, k: setattr(d, "ContentTime", f"1010{(k * 7) % 20:02}")))
    whole("one_down", run(1, 20, each=lambda d, k: setattr(d, "InstanceNumber", 20 - k)))
    whole("one_frames", run(1, 20, each=lambda d, k: setattr(d, "FrameOfReferenceUID", f"1.2.3.{k + 9}")))
    whole("one_steps", run(1, 60, each=lambda d, k: (setattr(d, "AcquisitionNumber", k // 30), number(d, k))))
    whole("one_rounded", run(1, 40, step=0.625, each=lambda d, k: setattr(
        d, "ImagePositionPatient", [-20, -30, round(-100 + 0.625 * k, 1)])))


def missing(c):
    """One pass without some slices: it is opened only where gaps are allowed, and nothing else is lost."""
    number = lambda d, k: setattr(d, "InstanceNumber", k + 1)
    def without(name, slices, *lost):
        paths = written(c.folder / name, [d for k, d in enumerate(slices) if k not in lost])
        c.cases.append({"name": name, "path": name, "slots": len(slices), "missing": len(lost)})
    at = lambda name, first, a, b: lambda d, k: (number(d, k), setattr(d, name, a if k < first else b))
    without("missing_acquisition", run(1, 40, each=at("AcquisitionNumber", 8, 1, 2)), 8)
    without("missing_type", run(1, 40, each=at("ImageType", 1, ["DERIVED"], ["ORIGINAL"])), 1)
    without("missing_at_ends", run(1, 40, each=number), 1, 3)
    without("missing_halves", run(1, 40, each=number), *range(1, 20, 2))


def several(c):
    kernels, starts = ("B30f", "B45f", "B70f"), (0, STEP / 3, 2 * STEP / 3)
    third = [(f"kernel {w}", run(k, start=s, ConvolutionKernel=w)) for k, (w, s) in enumerate(zip(kernels, starts))]
    c.passes("three_thirds", *third)
    c.passes("three_same", *[(f"kernel {w}", run(k, ConvolutionKernel=w)) for k, w in enumerate(kernels)])
    # Two attributes separate four passes.
    four = [(f"acquisition {a}, kernel {w}", run(2 * a + k, AcquisitionNumber=a, ConvolutionKernel=w))
            for a in (1, 2) for k, w in enumerate(kernels[:2])]
    c.passes("four_same", *four)
    # Two attributes disagree: the kernel changes half way down each pass, and the comment wherever it likes.
    def disagree(d, k):
        d.ConvolutionKernel = "B30f" if k < 8 else "B70f"
        d.ImageComments = "ab"[k * k % 3 % 2]
    for shift, start in {"half": STEP / 2, "same": 0.0, "onto": 12 * STEP}.items():
        c.passes(f"disagree_{shift}", ("acquisition 1", run(1, AcquisitionNumber=1, each=disagree)),
                 ("acquisition 2", run(2, start=start, AcquisitionNumber=2, each=disagree)))
    # A pass of another length and spacing.
    c.passes("coarse", ("kernel B30f", run(1, 20, ConvolutionKernel="B30f")),
             ("kernel B70f", run(2, 7, start=3.1, step=3.0, ConvolutionKernel="B70f")))
    # A position, and within it a kernel.
    c.passes("position_kernel", ("kernel B30f", run(1, ConvolutionKernel="B30f")), ("kernel B70f", run(2, ConvolutionKernel="B70f")),
             ("", run(3, start=30, PatientPosition="HFP")), unordered=True)


def nothing(c):
    """Passes that no header tells apart."""
    lie, values_ = "spaced like those of two or more passes", "have the same position as another but different values"
    c.refused("lost_third", lie, run(1), run(2, start=STEP / 3))
    c.refused("lost_tenth", lie, run(1), run(2, start=STEP / 10))
    c.refused("lost_overlap", lie, run(1), run(2, start=10.3 * STEP))
    c.refused("lost_thirds", lie, run(1), run(2, start=0.3), run(3, start=0.7))
    c.refused("lost_mixed", lie, run(1, 20), run(2, 8, start=3.1, step=3.0))
    c.refused("lost_same", values_, run(1), run(2))
    c.refused("lost_onto", values_, run(1), run(2, start=12 * STEP))


def enhanced(c):
    """Two stacks, two phases in one file."""
    def file(name, groups, shared=None):
        d = header(sop=EnhancedCTImageStorage)
        d.NumberOfFrames = sum(len(v) for v, _, _ in groups)
        frames, pixels = [], []
        for voxels, start, edit in groups:
            for k in range(len(voxels)):
                frame, place, content = Dataset(), Dataset(), Dataset()
                place.ImagePositionPatient = [-20, -30, -100 + start + k * STEP]
                frame.PlanePositionSequence = Sequence([place])
                edit(frame, content)
                frame.FrameContentSequence = Sequence([content])
                frames.append((frame, voxels[k]))
        random.shuffle(frames)
        common, plane, measures, hu = Dataset(), Dataset(), Dataset(), Dataset()
        plane.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
        measures.PixelSpacing, measures.SliceThickness = [0.8, 0.7], STEP
        hu.RescaleIntercept, hu.RescaleSlope, hu.RescaleType = 0, 1, "HU"
        common.PlaneOrientationSequence, common.PixelMeasuresSequence = Sequence([plane]), Sequence([measures])
        common.PixelValueTransformationSequence = Sequence([hu])
        d.SharedFunctionalGroupsSequence = Sequence([common])
        d.PerFrameFunctionalGroupsSequence = Sequence([f for f, _ in frames])
        d.PixelData = b"".join(v.astype("<i2").tobytes() for _, v in frames)
        d["PixelData"].VR = "OW"
        pydicom.dcmwrite(c.folder / f"{name}.dcm", d, enforce_file_format=True)

    def told(name, *passes):
        file(name, [(values(seed, 12), start, edit) for seed, start, edit, _ in passes])
        arrays = []
        whole = pydicom.dcmread(c.folder / f"{name}.dcm")
        frames = whole.PerFrameFunctionalGroupsSequence
        for seed, *_ in passes:
            # The frames of the pass in the order of their positions, as pydicom reads the file.
            own = [(float(f.PlanePositionSequence[0].ImagePositionPatient[2]), a) for f, a in zip(frames, whole.pixel_array)
                   if any((a == v).all() for v in values(seed, 12))]
            arrays.append(numpy.stack([a for _, a in sorted(own, key=lambda p: p[0])]))
        c.expect(name, [(words, "supine") for *_, words in passes], arrays, path=f"{name}.dcm")

    stack = lambda n: lambda f, content: setattr(content, "StackID", str(n))
    temporal = lambda n: lambda f, content: setattr(content, "TemporalPositionIndex", n)

    def kernel(name):
        def edit(frame, content):
            own = Dataset()
            own.ConvolutionKernel = name
            frame.CTReconstructionSequence = Sequence([own])
        return edit

    def cardiac(percent):
        def edit(frame, content):
            own = Dataset()
            own.NominalPercentageOfCardiacPhase = percent
            frame.CardiacSynchronizationSequence = Sequence([own])
        return edit

    for name, start in {"same": 0.0, "half": STEP / 2, "overlap": 8.3 * STEP}.items():
        told(f"enhanced_stack_{name}", (1, 0, stack(1), "stack 1"), (2, start, stack(2), "stack 2"))
        told(f"enhanced_temporal_{name}", (1, 0, temporal(1), "temporal position 1"), (2, start, temporal(2), "temporal position 2"))
        told(f"enhanced_kernel_{name}", (1, 0, kernel("Br40"), "kernel Br40"), (2, start, kernel("Hr60"), "kernel Hr60"))
        told(f"enhanced_cardiac_{name}", (1, 0, cardiac(40.0), "cardiac phase 40 %"), (2, start, cardiac(75.0), "cardiac phase 75 %"))
    plain = lambda f, content: None
    file("enhanced_nothing", [(values(1, 12), 0, plain), (values(2, 12), 0, plain)])
    c.cases.append({"name": "enhanced_nothing", "path": "enhanced_nothing.dcm", "refused": "and no header separates the passes"})
    v = values(1, 12)
    file("enhanced_copies", [(v, 0, plain), (v[3:5], 3 * STEP, plain)])
    c.expect("enhanced_copies", [("", "supine")], [v], path="enhanced_copies.dcm",
             note="2 slices are duplicates of others and were left out, the first: frame ")
    file("enhanced_one_differs", [(v, 0, plain), (v[5:6] + 1, 3 * STEP, plain)])
    c.cases.append({"name": "enhanced_one_differs", "path": "enhanced_one_differs.dcm",
                    "refused": "enhanced_one_differs.dcm: has the same position as frame "})


def copies(c):
    """Every slice, or some, twice."""
    def packed(slices):
        out = []
        for d in slices:
            e = pydicom.dcmread(pydicom.filebase.DicomBytesIO(stored(d)))
            e.compress(RLELossless, encoding_plugin="pydicom", generate_instance_uid=False)
            out.append(e)
        return out

    def stored(d):
        out = pydicom.filebase.DicomBytesIO()
        pydicom.dcmwrite(out, d, enforce_file_format=True)
        return out.getvalue()

    def twice(name, slices, more, note):
        paths = written(c.folder / name, slices + more, shuffled=False)
        c.expect(name, [("", "supine")], [read(paths[:len(slices)])], note=note)
    note = lambda n: f"{n} slices are duplicates of others and were left out, the first: "
    twice("copies_rle", run(1), packed(run(1)), note(16))
    twice("copies_some", run(1), packed(run(1)[:5]), note(5))
    twice("copies_bytes", run(1), run(1)[2:6], note(4))
    twice("copies_one", run(1), run(1)[2:3], " duplicates ")
    number = lambda d, k: (setattr(d, "InstanceNumber", k + 1), setattr(d, "AcquisitionTime", f"1010{k // 2:02}"))
    twice("copies_numbered", run(1, 40, each=number), run(1, 40, each=number)[8:9], " duplicates ")
    twice("copies_of_three", run(1, 40, each=number), run(1, 40, each=number)[8:29:10], note(3))
    own = lambda d, k: setattr(d, "FrameOfReferenceUID", f"1.2.3.{k + 9}")
    twice("copies_of_frames", run(1, 40, each=own), run(1, 40, each=own)[8:9], " duplicates ")
    scaled = run(1)[4:5]
    scaled[0].RescaleIntercept = 1
    name = "copies_scaled"
    written(c.folder / name, run(1) + scaled)
    c.cases.append({"name": name, "path": name, "refused": "but different values"})


def media(c):
    """A DICOMDIR as the input."""
    from pydicom.fileset import FileSet
    def medium(name, slices):
        fileset = FileSet()
        for k, d in enumerate(slices):
            d.StudyID, d.StudyDate, d.StudyTime, d.AccessionNumber, d.InstanceNumber = "1", "20200101", "100000", "", k + 1
            d.file_meta.MediaStorageSOPInstanceUID = d.SOPInstanceUID
            fileset.add(d)
        fileset.write(c.folder / name)
        return sorted(p for p in (c.folder / name).rglob("*") if p.is_file() and p.name != "DICOMDIR")
    paths = medium("medium", run(1))
    c.expect("medium", [("", "supine")], [read(paths)], path="medium/DICOMDIR")
    c.expect("medium_folder", [("", "supine")], [read(paths)], path="medium")
    # Slices beside the medium's own, which the index does not list.
    medium("beside", run(1))
    written(c.folder / "beside" / "more", run(2, SeriesInstanceUID="1.2.3.5", SeriesNumber=4))
    c.expect("beside", [("", "supine")], [read(paths)], path="beside/DICOMDIR")
    # A lost slice, told.
    for path in medium("lost_last", run(1))[-1:]:
        path.unlink()
    array = read(paths)
    for end in ("/DICOMDIR", ""):
        c.expect(f"lost_last{end[:2].strip('/')}", [("", "supine")], [array[:-1]], path=f"lost_last{end}",
                 note="DICOMDIR lists 1 files that are missing, the first: ")
    # Small letters, and a version behind the name.
    for path in sorted(medium("letters", run(1))):
        path.rename(path.with_name(path.name.lower() + ";1"))
    c.expect("letters", [("", "supine")], [array], path="letters/DICOMDIR")
    for path in medium("gone", run(1)):
        path.unlink()
    c.cases.append({"name": "gone", "path": "gone/DICOMDIR", "refused": "is the index of a medium, and none of the files that it lists exists"})
    # A name that leads out of the folder.
    for path in medium("out", run(1))[-1:]:
        path.rename(c.folder / "stolen.dcm")
    index = pydicom.dcmread(c.folder / "out" / "DICOMDIR")
    for record in index.DirectoryRecordSequence:
        if record.DirectoryRecordType == "IMAGE" and record.InstanceNumber == 16:
            record.ReferencedFileID = ["..", "stolen.dcm"]
    index.save_as(c.folder / "out" / "DICOMDIR")
    c.expect("out", [("", "supine")], [array[:-1]], path="out/DICOMDIR", note="DICOMDIR lists 1 files outside its folder, which were left out")


def orders(c):
    """The position and the plane, for every order of the axes."""
    planes = {
        "axial": [(1, 0, 0, 0, 1, 0), (-1, 0, 0, 0, 1, 0), (0, 1, 0, -1, 0, 0), (1, 0, 0, 0, -1, 0), (0, 1, 0, 1, 0, 0)],
        "coronal": [(1, 0, 0, 0, 0, -1), (0, 0, 1, 1, 0, 0), (-1, 0, 0, 0, 0, 1)],
        "sagittal": [(0, 1, 0, 0, 0, -1), (0, 0, 1, 0, 1, 0), (0, -1, 0, 0, 0, -1)],
    }
    for plane, orientations in planes.items():
        for k, orientation in enumerate(orientations):
            for code, position in {"HFS": "supine", "FFP": "prone", "HFDL": "left decubitus", "FFDR": "right decubitus"}.items():
                name = f"order_{plane}_{k}_{code}"
                paths = written(c.folder / name, run(1, 8, orientation=orientation, PatientPosition=code))
                c.expect(name, [("", position)], [read(paths)], plane=plane)


if __name__ == "__main__":
    cases = Cases(Path(sys.argv[1]))
    for part in (two, always, one, missing, several, nothing, enhanced, copies, media, orders):
        part(cases)
    (cases.folder / "cases.json").write_text(json.dumps(cases.cases))
