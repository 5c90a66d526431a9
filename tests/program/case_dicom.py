"""Judges the DICOM objects of a report: `case_dicom.py REPORT/ MASK.nii.gz STUDY/ IDENTITY`.

REPORT/ is what `colvis case --dicom` wrote, MASK the lumen that `colvis segment` wrote, STUDY/ the DICOM series that was read (or
`none`), IDENTITY `yes` if the report may tell whose scan it is. Prints `ok`.
"""

import json
import sys
from pathlib import Path

import highdicom
import numpy as np
import pydicom
import SimpleITK as sitk

report, mask, study, identity = Path(sys.argv[1]), sys.argv[2], sys.argv[3], sys.argv[4] == "yes"
findings = json.loads((report / "findings.json").read_text())["findings"]
outside = json.loads((report / "findings.json").read_text())["outside"]

objects = {path.name: pydicom.dcmread(path) for path in sorted(report.glob("*.dcm"))}
uids = [o.SOPInstanceUID for o in objects.values()]
assert len(set(uids)) == len(uids)
for name, o in objects.items():
    assert o.file_meta.MediaStorageSOPInstanceUID == o.SOPInstanceUID and o.is_little_endian, name
    told = [o.get(key, "") for key in ("SeriesDescription", "ImageComments", "ContentDescription")]
    assert any("esearch use only" in text for text in told), f"{name}: {told}"
assert len({o.StudyInstanceUID for o in objects.values()}) == 1
assert len({o.FrameOfReferenceUID for o in objects.values() if "FrameOfReferenceUID" in o}) == 1

slices = [] if study == "none" else [pydicom.dcmread(p) for p in sorted(Path(study).glob("*.dcm"))]
if identity:
    for o in objects.values():
        for key in ("PatientName", "PatientID", "PatientBirthDate", "StudyInstanceUID"):
            assert o[key].value == slices[0][key].value, key
        assert o.ContentDate > "20200101" and "PatientIdentityRemoved" not in o
else:
    for o in objects.values():
        assert o.PatientIdentityRemoved == "YES" and str(o.PatientID).startswith("scan-")

# The structured report: one group a finding, with its points, measures, and pictures.
sr = highdicom.sr.srread(report / "report.dcm")
assert sr.SOPClassUID == pydicom.uid.Comprehensive3DSRStorage
groups = sr.content.get_planar_roi_measurement_groups()
assert len(groups) == len(findings) + len(outside)
captures = {o.SOPInstanceUID: o for name, o in objects.items() if name.startswith("capture-")}
assert len(captures) == len(findings)


def walk(item):
    for child in item.get("ContentSequence", []):
        yield child
        yield from walk(child)


for group, finding in zip(groups, findings):
    assert group.tracking_identifier == f"finding {finding['id']}"
    assert np.abs(group.roi.value[0] - finding["place"]).max() < 0.01
    assert len(group.finding_sites) == 1
    numbers = {m.name.meaning: m.value for m in group.get_measurements()}
    for name, key in (("Polyp size, largest dimension", "diameter_mm"), ("Height", "height_mm"), ("Volume", "volume_mm3")):
        assert finding.get(key) is None or abs(numbers[name] - finding[key]) < 1e-9, (name, numbers)
    lines = [i for i in walk(group[0]) if i.ValueType == "SCOORD3D" and i.GraphicType == "POLYLINE"]
    assert len(lines) == (finding.get("ends") is not None)
    for line in lines:
        assert np.abs(np.reshape(line.GraphicData, (2, 3)) - finding["ends"]).max() < 0.01
        assert line.ReferencedFrameOfReferenceUID == objects["segments.dcm"].FrameOfReferenceUID
    images = [i.ReferencedSOPSequence[0].ReferencedSOPInstanceUID for i in walk(group[0]) if i.ValueType == "IMAGE"]
    assert sum(uid in captures for uid in images) == 1
    sources = [s for s in slices if s.SOPInstanceUID in images]
    assert len(sources) == identity
    for s in sources:
        normal = np.cross(s.ImageOrientationPatient[:3], s.ImageOrientationPatient[3:])
        assert abs(np.dot(np.subtract(s.ImagePositionPatient, finding["place"]), normal)) < 2.0
evidence = {
    image.ReferencedSOPInstanceUID
    for e in sr.CurrentRequestedProcedureEvidenceSequence
    for series in e.ReferencedSeriesSequence
    for image in series.ReferencedSOPSequence
}
referred = {i.ReferencedSOPSequence[0].ReferencedSOPInstanceUID for i in walk(sr) if i.ValueType == "IMAGE"}
assert evidence == referred and set(captures) <= evidence

# The segmentation: the voxels of the lumen, each in one segment of the colon; and those of findings, which are not lumen.
lumen = sitk.ReadImage(mask)
inside = sitk.GetArrayFromImage(lumen) != 0
seen, of_findings = np.zeros(inside.shape, int), np.zeros(inside.shape, int)
own = {s.SOPInstanceUID: s for s in slices}
for name in objects:
    if not name.startswith("segments"):
        continue
    seg = highdicom.seg.segread(report / name)
    assert seg.segmentation_type.value == "BINARY" and seg.NumberOfFrames <= 400
    frames = np.atleast_3d(seg.pixel_array)
    assert frames.shape[0] == seg.NumberOfFrames and frames.any(axis=(1, 2)).all()
    assert seg.get_volume(combine_segments=False).array.sum() == frames.sum()
    for frame, group in zip(frames, seg.PerFrameFunctionalGroupsSequence):
        number = group.SegmentIdentificationSequence[0].ReferencedSegmentNumber
        position = [float(x) for x in group.PlanePositionSequence[0].ImagePositionPatient]
        shared = seg.SharedFunctionalGroupsSequence[0]
        row, column = np.reshape([float(x) for x in shared.PlaneOrientationSequence[0].ImageOrientationPatient], (2, 3))
        between, beside = [float(x) for x in shared.PixelMeasuresSequence[0].PixelSpacing]
        j, i = np.nonzero(frame)
        world = np.array(position) + np.outer(i * beside, row) + np.outer(j * between, column)
        index = np.array([lumen.TransformPhysicalPointToContinuousIndex(p) for p in world[[0, -1]]])
        assert np.abs(index - index.round()).max() < 0.01
        to_index = np.linalg.inv(np.reshape(lumen.GetDirection(), (3, 3)) * lumen.GetSpacing())
        at = ((world - lumen.GetOrigin()) @ to_index.T).round().astype(int)
        label = seg.get_segment_description(number).segment_label
        target = of_findings if label.startswith("finding") else seen
        np.add.at(target, (at[:, 2], at[:, 1], at[:, 0]), 1)
        if identity:
            source = group.DerivationImageSequence[0].SourceImageSequence[0].ReferencedSOPInstanceUID
            assert np.allclose([float(x) for x in own[source].ImagePositionPatient], position, atol=1e-3)
    if identity:
        [series] = seg.ReferencedSeriesSequence
        assert series.SeriesInstanceUID == slices[0].SeriesInstanceUID
        assert {i.ReferencedSOPInstanceUID for i in series.ReferencedInstanceSequence} <= set(own)
assert (seen == inside).all() and not (of_findings[inside]).any()
assert of_findings.any() == any(f.get("ends") is not None for f in findings)

for name, capture in objects.items():
    if name.startswith("capture-"):
        assert capture.BurnedInAnnotation == "NO" and capture.pixel_array.shape[1:] == (360, 360, 3)
        assert capture.pixel_array.std(axis=(1, 2, 3)).min() > 5, "an empty picture"
        assert list(capture.FrameLabelVector)[:3] == ["view", "axial", "along"]
print("ok")
