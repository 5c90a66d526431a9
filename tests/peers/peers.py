"""The other side of tests/formats/peers.rs: independent readers and writers (SimpleITK, nibabel, pydicom).

For more of DICOM's codecs: pyjpegls, pylibjpeg-openjpeg, imagecodecs.

    python peers.py check FOLDER    reads a.* and mask.nii.gz in FOLDER and compares them with expected.json
    python peers.py write FOLDER    writes the volume of expected.json in every form that peers can write
"""

import importlib.util
import json
import sys
from pathlib import Path

import nibabel
import numpy
import pydicom
import SimpleITK

SYNTAXES = [None, pydicom.uid.RLELossless]
for module, syntax in {
    "jpeg_ls": pydicom.uid.JPEGLSLossless,
    "openjpeg": pydicom.uid.JPEG2000Lossless,
    "imagecodecs": pydicom.uid.JPEGLosslessSV1,
}.items():
    # pydicom reaches OpenJPEG through another package.
    if importlib.util.find_spec(module) and (module != "openjpeg" or importlib.util.find_spec("pylibjpeg")):
        SYNTAXES.append(syntax)
if pydicom.uid.JPEGLosslessSV1 in SYNTAXES:
    import imagecodecs

LPS_RAS = numpy.diag([-1.0, -1.0, 1.0, 1.0])


def volume(facts):
    """The array (z, y, x) whose value at linear index i is i * 37 % 3000 - 1000."""
    x, y, z = facts["dims"]
    i = numpy.arange(x * y * z, dtype=numpy.int64)
    return (i * 37 % 3000 - 1000).astype(numpy.int16).reshape(z, y, x)


def image(facts):
    out = SimpleITK.GetImageFromArray(volume(facts))
    out.SetSpacing(facts["spacing_mm"])
    out.SetOrigin(facts["origin_mm"])
    out.SetDirection(facts["direction"])
    return out


def corners(facts):
    x, y, z = (n - 1 for n in facts["dims"])
    return [(0, 0, 0), (x, 0, 0), (0, y, 0), (0, 0, z), (x, y, z)]


def check(folder, facts):
    expected, grid = volume(facts), image(facts)
    for path in sorted(folder.glob("a.*")):
        if path.suffix in (".raw", ".gz") and not path.name.endswith(".nii.gz"):
            continue
        got = SimpleITK.ReadImage(str(path))
        assert got.GetPixelID() == SimpleITK.sitkInt16, path
        assert (SimpleITK.GetArrayFromImage(got) == expected).all(), path
        for corner in corners(facts):
            a = got.TransformIndexToPhysicalPoint(corner)
            b = grid.TransformIndexToPhysicalPoint(corner)
            assert numpy.allclose(a, b, atol=2e-3), (path, a, b)
        if ".nii" in path.name:
            got = nibabel.load(path)
            assert (numpy.asarray(got.dataobj).transpose(2, 1, 0) == expected).all(), path
            assert got.header["sform_code"] == 1 and got.header["qform_code"] == 1, path
            for form in (got.get_sform(), got.get_qform()):
                for corner in corners(facts):
                    a = (LPS_RAS @ form @ [*corner, 1])[:3]
                    b = grid.TransformIndexToPhysicalPoint(corner)
                    assert numpy.allclose(a, b, atol=2e-3), (path, a, b)
        print("agrees:", path.name)
    mask = SimpleITK.ReadImage(str(folder / "mask.nii.gz"))
    assert mask.GetPixelID() == SimpleITK.sitkUInt8
    assert (SimpleITK.GetArrayFromImage(mask) == expected % 3).all()


def write(folder, facts):
    grid, array = image(facts), volume(facts)
    for name in ("s.nii", "s.nii.gz", "s.mha", "s.mhd", "s.nrrd", "s.nhdr"):
        SimpleITK.WriteImage(grid, str(folder / name), useCompression=name != "s.nii")
    affine = numpy.eye(4)
    steps = numpy.array(facts["direction"]).reshape(3, 3) @ numpy.diag(facts["spacing_mm"])
    affine[:3, :3], affine[:3, 3] = steps, facts["origin_mm"]
    for kind in (nibabel.Nifti1Image, nibabel.Nifti2Image, nibabel.Nifti1Pair):
        out = kind(array.transpose(2, 1, 0).astype(numpy.float32), LPS_RAS @ affine)
        nibabel.save(out, folder / f"n{kind.__name__}.{'img' if kind is nibabel.Nifti1Pair else 'nii.gz'}")
    direction = numpy.array(facts["direction"]).reshape(3, 3)
    if numpy.linalg.det(direction) > 0:
        dicom(folder / "dicom_itk", grid, facts, by_itk)
        dicom(folder / "dicom_pydicom", grid, facts, by_pydicom)
        enhanced(folder / "enhanced.dcm", facts)


def dicom(folder, grid, facts, writer):
    folder.mkdir()
    for k in range(facts["dims"][2]):
        # Names in an order that is not that of the slices.
        writer(folder / f"{k * 7919 % 1000:04}.dcm", grid, facts, k)


def texts(facts, k):
    direction = numpy.array(facts["direction"]).reshape(3, 3)
    step = direction[:, 2] * facts["spacing_mm"][2]
    position = [f"{v:.8g}" for v in numpy.array(facts["origin_mm"]) + k * step]
    orientation = [f"{v:.10g}" for v in [*direction[:, 0], *direction[:, 1]]]
    return position, orientation


def by_itk(path, grid, facts, k):
    slice_ = grid[:, :, k]
    position, orientation = texts(facts, k)
    for tag, value in {
        "0008|0060": "CT", "0020|000e": "1.2.826.0.1.3680043.2.1125.1", "0020|0013": str(k),
        "0020|0032": "\\".join(position), "0020|0037": "\\".join(orientation),
        "0028|1052": "-1024", "0028|1053": "1", "0008|0008": "ORIGINAL\\PRIMARY\\AXIAL",
    }.items():
        slice_.SetMetaData(tag, value)
    writer = SimpleITK.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    writer.SetFileName(str(path))
    writer.Execute(slice_)


def enhanced(path, facts):
    """All slices as frames of one Enhanced CT, last slice first."""
    d = dataset(facts, pydicom.uid.EnhancedCTImageStorage, 1)
    d.NumberOfFrames = facts["dims"][2]
    item, sequence = pydicom.Dataset, pydicom.Sequence
    frames, pixels = [], []
    for k in reversed(range(facts["dims"][2])):
        position, orientation = texts(facts, k)
        frame, place, plane = item(), item(), item()
        place.ImagePositionPatient, plane.ImageOrientationPatient = position, orientation
        frame.PlanePositionSequence, frame.PlaneOrientationSequence = sequence([place]), sequence([plane])
        frames.append(frame)
        pixels.append((volume(facts)[k] + 1024).astype(numpy.uint16).tobytes())
    shared, measures, values = item(), item(), item()
    x, y, _ = facts["spacing_mm"]
    measures.PixelSpacing, measures.SliceThickness = [f"{y:.10g}", f"{x:.10g}"], "1"
    values.RescaleIntercept, values.RescaleSlope, values.RescaleType = "-1024", "1", "HU"
    shared.PixelMeasuresSequence, shared.PixelValueTransformationSequence = sequence([measures]), sequence([values])
    d.SharedFunctionalGroupsSequence, d.PerFrameFunctionalGroupsSequence = sequence([shared]), sequence(frames)
    d.PixelData = b"".join(pixels)
    pydicom.dcmwrite(path, d, enforce_file_format=True)


def by_pydicom(path, grid, facts, k):
    position, orientation = texts(facts, k)
    d = dataset(facts, pydicom.uid.CTImageStorage, k + 1)
    d.ImagePositionPatient, d.ImageOrientationPatient = position, orientation
    x, y, _ = facts["spacing_mm"]
    d.PixelSpacing, d.SliceThickness = [f"{y:.10g}", f"{x:.10g}"], "1"
    d.RescaleIntercept, d.RescaleSlope = "-1024", "1"
    d.PixelData = (volume(facts)[k] + 1024).astype(numpy.uint16).tobytes()
    # Each slice by the next of the codecs that are installed.
    syntax = SYNTAXES[k % len(SYNTAXES)]
    if syntax == pydicom.uid.JPEGLosslessSV1:
        d.PixelData = pydicom.encaps.encapsulate([imagecodecs.ljpeg_encode(volume(facts)[k].view(numpy.uint16) + 1024)])
        d["PixelData"].VR = "OB"
        d.file_meta.TransferSyntaxUID = syntax
    elif syntax:
        d.compress(syntax)
    pydicom.dcmwrite(path, d, enforce_file_format=True)


def dataset(facts, sop_class, number):
    """What every image has, in twelve bits."""
    assert volume(facts).min() >= -1024 and volume(facts).max() < 3072
    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID = sop_class
    meta.MediaStorageSOPInstanceUID = f"1.2.3.{number}"
    meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    d = pydicom.Dataset()
    d.file_meta = meta
    d.SOPClassUID, d.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    d.Modality, d.SeriesInstanceUID, d.PatientPosition = "CT", "1.2.3", "HFS"
    d.Rows, d.Columns, d.SamplesPerPixel = facts["dims"][1], facts["dims"][0], 1
    d.PhotometricInterpretation = "MONOCHROME2"
    d.BitsAllocated, d.BitsStored, d.HighBit, d.PixelRepresentation = 16, 12, 11, 0
    return d


if __name__ == "__main__":
    action, folder = sys.argv[1], Path(sys.argv[2])
    {"check": check, "write": write}[action](folder, json.loads((folder / "expected.json").read_text()))
