"""The other side of tests/formats/values.rs: DICOM series whose values are stored in odd ways, with the HU that pydicom reads.

    python values.py FOLDER

writes, for each case, FOLDER/CASE/*.dcm and FOLDER/CASE.i16 (HU, little-endian, slice by slice), and FOLDER/cases.json, the list
of {"name", "unlike": why pydicom itself is not the judge, or null}. Where pydicom has no decoder, or another opinion than the
standard, the HU are those that were written. Codecs need pyjpegls, pylibjpeg-openjpeg, imagecodecs and Pillow;
without one its cases are left out.
"""

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pydicom
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.encaps import encapsulate
from pydicom.pixels import apply_modality_lut
from pydicom.sequence import Sequence
from pydicom.uid import ExplicitVRBigEndian, ExplicitVRLittleEndian, JPEG2000Lossless, JPEGLosslessSV1, JPEGLSLossless

NZ, NY, NX = 4, 36, 40
CT, ENHANCED = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.2.1"


def volume():
    """Tissue on a slope, gas, and exact zeros within tissue."""
    z, y, x = np.mgrid[0:NZ, 0:NY, 0:NX]
    v = 40 + 3 * x + 2 * y + 5 * z
    v = np.where((x - 16) ** 2 + (y - 20) ** 2 < 60, -950 + x, v)
    v[:, 4:8, 4:8] = 0
    return v.astype(np.int32)


def header(k, **kw):
    d = Dataset()
    d.SOPClassUID, d.SOPInstanceUID, d.Modality = CT, f"1.2.3.4.5.{k + 1}", "CT"
    d.StudyInstanceUID, d.SeriesInstanceUID, d.SeriesNumber, d.InstanceNumber = "1.2.3", "1.2.3.4", 3, k + 1
    d.ImageType, d.PatientPosition = ["ORIGINAL", "PRIMARY", "AXIAL"], "HFS"
    d.ImageOrientationPatient, d.ImagePositionPatient = [1, 0, 0, 0, 1, 0], [-20, -30, 2 * k]
    d.PixelSpacing, d.SliceThickness, d.SamplesPerPixel = [0.8, 0.8], 2, 1
    d.PhotometricInterpretation, d.Rows, d.Columns = "MONOCHROME2", NY, NX
    d.BitsAllocated, d.BitsStored, d.HighBit, d.PixelRepresentation = 16, 16, 15, 1
    d.RescaleIntercept, d.RescaleSlope = 0, 1
    for name, value in kw.items():
        if value is None:
            delattr(d, name)
        else:
            setattr(d, name, value)
    return d


class Cases:
    def __init__(self, root):
        self.root, self.list = root, []

    def add(self, name, files, hu=None, unlike=None):
        """Writes (dataset, syntax) pairs. The HU are `hu` if pydicom is no judge (`unlike`), else pydicom's."""
        folder = self.root / name
        folder.mkdir()
        for k, (d, syntax) in enumerate(files):
            meta = FileMetaDataset()
            meta.TransferSyntaxUID, meta.MediaStorageSOPClassUID = syntax, d.SOPClassUID
            meta.MediaStorageSOPInstanceUID = d.SOPInstanceUID
            d.file_meta = meta
            big = syntax == ExplicitVRBigEndian
            pydicom.dcmwrite(folder / f"{k}.dcm", d, enforce_file_format=True, little_endian=not big, implicit_vr=False)
        if unlike is None:
            read = np.concatenate([self.read(folder / f"{k}.dcm") for k in range(len(files))])
            if hu is not None:
                assert (read == hu).all(), f"{name}: pydicom reads other values than were written"
            hu = read
        hu.astype("<i2").tofile(self.root / f"{name}.i16")
        self.list.append({"name": name, "unlike": unlike})

    @staticmethod
    def read(path):
        d = pydicom.dcmread(path)
        stored = d.pixel_array.reshape(-1, NY, NX)
        if "SharedFunctionalGroupsSequence" in d:
            d = d.SharedFunctionalGroupsSequence[0].PixelValueTransformationSequence[0]
        hu = np.asarray(apply_modality_lut(stored, d), dtype=np.float64)
        if hu.max() > 32767:
            hu = hu.astype(np.uint16).astype(np.int16).astype(np.float64)  # a table of HU is stored as two's complement
        return np.clip(np.floor(np.abs(hu) + 0.5) * np.sign(hu), -32768, 32767)


def native(d, stored, dtype="<u2", syntax=ExplicitVRLittleEndian):
    d.PixelData = np.asarray(stored).astype(dtype).tobytes()
    d["PixelData"].VR = "OW"
    return d, syntax


def packed(d, syntax, fragments, frames=1):
    if frames == 1 and len(fragments) > 1:
        item = lambda b: b"\xfe\xff\x00\xe0" + len(b).to_bytes(4, "little") + b
        d.PixelData = b"\xfe\xff\x00\xe0\0\0\0\0" + b"".join(map(item, fragments)) + b"\xfe\xff\xdd\xe0\0\0\0\0"
    else:
        d.PixelData = encapsulate(fragments)
    d["PixelData"].VR, d["PixelData"].is_undefined_length = "OB", True
    return d, syntax


def pieces(code, size=400):
    code = bytes(code) + b"\0" * (len(code) % 2)
    return [code[k : k + size] for k in range(0, len(code), size)]


def codecs():
    """(name, syntax, encode(array of uint16, bits), pydicom can judge)"""
    out = []
    if importlib.util.find_spec("openjpeg") and importlib.util.find_spec("PIL"):
        import openjpeg.utils

        encode = lambda a, n: openjpeg.utils.encode_array(a, bits_stored=n, photometric_interpretation=2)
        out.append(("j2k", JPEG2000Lossless, encode, True))
    if importlib.util.find_spec("jpeg_ls"):
        import jpeg_ls

        encode = lambda a, n: jpeg_ls.encode_buffer(a.tobytes(), *a.shape, 1, n)
        out.append(("jls", JPEGLSLossless, encode, True))
    if importlib.util.find_spec("imagecodecs"):
        import imagecodecs

        encode = lambda a, n: imagecodecs.ljpeg_encode(a, bitspersample=n)
        out.append(("ljpeg", JPEGLosslessSV1, encode, False))
    return out


def streams(cases, v):
    """Code streams whose width or sign is not the header's."""
    own = "pydicom has no decoder of lossless JPEG here"
    for codec, syntax, encode, judged in codecs():
        for width, stored in [(12, 16), (12, 13), (13, 16), (12, 12), (16, 16)]:
            files = []
            for k in range(NZ):
                d = header(k, BitsStored=stored, HighBit=stored - 1)
                code = encode((v[k] & ((1 << width) - 1)).astype(np.uint16), width)
                files.append(packed(d, syntax, pieces(code) if k % 2 else [bytes(code)]))
            cases.add(f"{codec}_signed_{width}_of_{stored}", files, v, None if judged else own)
        # An unsigned value, and the highest bit where the code stream has none.
        files = []
        for k in range(NZ):
            d = header(k, BitsStored=12, HighBit=15 if codec == "ljpeg" else 11, PixelRepresentation=0, RescaleIntercept=-1024)
            files.append(packed(d, syntax, [bytes(encode((v[k] + 1024).astype(np.uint16), 12))]))
        cases.add(f"{codec}_unsigned", files, v, None if judged else own)
        # Twelve bits of two's complement with zeros above them, in a code stream of sixteen.
        files = [
            packed(header(k, BitsStored=12, HighBit=11), syntax, [bytes(encode((v[k] & 4095).astype(np.uint16), 16))])
            for k in range(NZ)
        ]
        cases.add(f"{codec}_zeros_above", files, v, "pydicom takes the sign from the sixteenth bit, BitsStored says the twelfth")
        # Many frames, each in several fragments.
        for name, split in [("frames", False), ("fragments", True)]:
            d = enhanced()
            codes = [bytes(encode((v[k] & 4095).astype(np.uint16), 12)) for k in range(NZ)]
            codes = [c + b"\0" * (len(c) % 2) for c in codes]
            if split:
                parts = [pieces(c) for c in codes]
                item = lambda b: b"\xfe\xff\x00\xe0" + len(b).to_bytes(4, "little") + b
                lengths = [sum(len(p) + 8 for p in ps) for ps in parts]
                table = np.cumsum([0] + lengths[:-1]).astype("<u4").tobytes()
                body = b"".join(item(p) for ps in parts for p in ps)
                d.PixelData = item(table) + body + b"\xfe\xff\xdd\xe0\0\0\0\0"
                d["PixelData"].VR, d["PixelData"].is_undefined_length = "OB", True
                files = [(d, syntax)]
            else:
                files = [packed(d, syntax, codes, NZ)]
            cases.add(f"{codec}_{name}", files, v, None if judged else own)
        # A code stream of eight bits in samples of sixteen.
        grey = (v % 200).astype(np.uint8)
        files = [packed(header(k, RescaleIntercept=-1024, PixelRepresentation=0), syntax, [bytes(encode(grey[k], 8))]) for k in range(NZ)]
        cases.add(f"{codec}_eight_bits", files, grey.astype(np.int32) - 1024, None if judged else own)
    if importlib.util.find_spec("imagecodecs") and importlib.util.find_spec("PIL"):
        import imagecodecs

        # JPEG 2000 itself knows signed samples.
        for name, sign, intercept in [("signed", 1, 0), ("unsigned", 0, -1024)]:
            files = []
            for k in range(NZ):
                d = header(k, PixelRepresentation=sign, RescaleIntercept=intercept)
                code = imagecodecs.jpeg2k_encode(v[k].astype(np.int16) if sign else (v[k] + 1024).astype(np.uint16), codecformat="J2K")
                files.append(packed(d, JPEG2000Lossless, [bytes(code)]))
            cases.add(f"j2k_as_{name}", files, v)
        files = [
            packed(header(k, PixelRepresentation=1), JPEG2000Lossless, [bytes(imagecodecs.jpeg2k_encode(v[k].astype(np.int16).view(np.uint16), codecformat="J2K"))])
            for k in range(NZ)
        ]
        cases.add("j2k_unsigned_in_signed", files, v)
        files = [
            packed(header(k, PixelRepresentation=0, RescaleIntercept=-1024), JPEG2000Lossless, [bytes(imagecodecs.jpeg2k_encode((v[k] + 1024).astype(np.int16), codecformat="J2K"))])
            for k in range(NZ)
        ]
        cases.add("j2k_signed_in_unsigned", files, v, "pydicom's decoder adds half the range of a value")


def enhanced():
    d = header(0, SOPClassUID=ENHANCED, RescaleIntercept=None, RescaleSlope=None, ImagePositionPatient=None, NumberOfFrames=NZ)
    shared, change = Dataset(), Dataset()
    change.RescaleIntercept, change.RescaleSlope, change.RescaleType = 0, 1, "HU"
    shared.PixelValueTransformationSequence = Sequence([change])
    d.SharedFunctionalGroupsSequence = Sequence([shared])
    frames = []
    for k in range(NZ):
        place, frame = Dataset(), Dataset()
        place.ImagePositionPatient = [-20, -30, 2 * k]
        frame.PlanePositionSequence = Sequence([place])
        frames.append(frame)
    d.PerFrameFunctionalGroupsSequence = Sequence(frames)
    return d


def table(first, entries, bits, data, vr="OW", kind="HU", count=None):
    t = Dataset()
    t.LUTDescriptor = [len(entries) % 65536 if count is None else count, first, bits]
    t.ModalityLUTType, t.LUTData = kind, data
    t["LUTData"].VR = vr
    return Sequence([t])


def plain(cases, v):
    """Bits, rescale and Modality LUT of uncompressed values."""
    u = v + 1024
    every = range(NZ)
    cases.add("monochrome1", [native(header(k, PhotometricInterpretation="MONOCHROME1"), v[k], "<i2") for k in every], v)
    cases.add("unsigned16", [native(header(k, PixelRepresentation=0, RescaleIntercept=-1024), u[k]) for k in every], v)
    overlaid = (u & 4095) | 0xA000
    bits = dict(BitsStored=12, HighBit=11, PixelRepresentation=0, RescaleIntercept=-1024)
    cases.add("overlay_bits", [native(header(k, **bits), overlaid[k]) for k in every], v)
    cases.add("signed12", [native(header(k, BitsStored=12, HighBit=11), v[k] & 4095) for k in every], v)
    slopes = [native(header(k, RescaleSlope="0.5", RescaleIntercept=str(-1024 + k)), v[k], "<i2") for k in every]
    cases.add("slopes", slopes)
    own = [native(header(k, RescaleSlope=1 + k, RescaleIntercept=-1024 * k), v[k], "<i2") for k in every]
    cases.add("own_slopes", own)
    floats = []
    for k in every:
        for name, dtype in [("FloatPixelData", "<f4"), ("DoubleFloatPixelData", "<f8")]:
            if (k % 2 == 0) == (dtype == "<f4"):
                d = header(k, BitsAllocated=int(dtype[2]) * 8, BitsStored=None, HighBit=None, PixelRepresentation=None)
                d.RescaleSlope, d.RescaleIntercept = 2, -7
                setattr(d, name, ((v[k] + 7) / 2).astype(dtype).tobytes())
                floats.append((d, ExplicitVRLittleEndian))
    cases.add("floats", floats, v)
    big = [native(header(k), v[k], ">i2", ExplicitVRBigEndian) for k in every]
    cases.add("big_endian", big, v)
    no = dict(RescaleSlope=None, RescaleIntercept=None)
    ramp = (np.arange(4096) - 1024).astype("<i2")
    def with_table(name, stored, sequence, hu=None, unlike=None, **kw):
        files = []
        for k in every:
            d = header(k, **no, **kw)
            d.ModalityLUTSequence = sequence()
            files.append(native(d, stored[k], "<i2" if d.PixelRepresentation else "<u2"))
        cases.add(name, files, hu, unlike)
    unsigned = dict(PixelRepresentation=0, BitsStored=12, HighBit=11)
    with_table("lut", u, lambda: table(0, ramp, 16, ramp.tobytes()), v, **unsigned)
    with_table("lut_whole", u, lambda: table(0, np.zeros(65536), 16, (np.arange(65536) - 1024).astype("<u2").tobytes()), v, PixelRepresentation=0)
    # The table begins late and ends early: its ends hold on.
    short = (np.arange(900) - 900).astype("<i2")
    with_table("lut_clamped", u, lambda: table(124, short, 16, short.tobytes()), np.clip(u - 124, 0, 899) - 900, **unsigned)
    with_table("lut_signed", v, lambda: table(-1000, short, 16, short.tobytes()), np.clip(v + 1000, 0, 899) - 900)
    eight = np.arange(256, dtype="<u2")[::-1]
    with_table("lut_8_words", u % 256, lambda: table(0, eight, 8, eight.tobytes()), 255 - u % 256, **unsigned)
    with_table("lut_8_packed", u % 256, lambda: table(0, eight, 8, eight.astype(np.uint8).tobytes()), 255 - u % 256, "pydicom takes a word an entry", **unsigned)


def paddings(cases, v):
    """Declared padding; the HU are what the rules of the reader make of pydicom's values."""
    every = range(NZ)
    y, x = np.mgrid[0:NY, 0:NX]
    outside = (x - 19.5) ** 2 + (y - 17.5) ** 2 > 22**2
    why = "pydicom leaves padding as it is"
    def with_padding(name, stored, hu, dtype="<i2", **kw):
        files = []
        for k in every:
            d = header(k, **kw)
            files.append(native(d, stored[k], dtype))
        cases.add(name, files, hu, why)
    air = np.where(outside, -1024, v)
    with_padding("padding_zero_is_tissue", v, v, PixelPaddingValue=0)
    with_padding("padding_zero_outside", np.where(outside, 0, v), air, PixelPaddingValue=0)
    with_padding("padding_below", np.where(outside, -2000, v), air, PixelPaddingValue=-2000)
    with_padding("padding_above", np.where(outside, 30000, v), air, PixelPaddingValue=30000)
    limits = np.where(outside, -2000 + x % 7, v)
    with_padding("padding_range", limits, air, PixelPaddingValue=-2000, PixelPaddingRangeLimit=-1990)
    low = dict(BitsStored=12, HighBit=11, PixelRepresentation=0, RescaleIntercept=-1024)
    # −2000 as sixteen bits; within twelve it is 2096, which bone has (1072 HU).
    u = v + 1024
    u[:, 20, 30] = 2096
    bone = np.where(outside, -1024, u - 1024)
    with_padding("padding_beyond", np.where(outside, 0xF830, u), bone, "<u2", PixelPaddingValue=0xF830, **low)
    with_padding("padding_beyond_masked", np.where(outside, 0x830, u), bone, "<u2", PixelPaddingValue=0xF830, **low)
    signed = dict(BitsStored=12, HighBit=11)
    with_padding("padding_12_bits", np.where(outside, -2000, v) & 4095, air, "<u2", PixelPaddingValue=-2000, **signed)


def main(root):
    cases, v = Cases(root), volume()
    streams(cases, v)
    plain(cases, v)
    paddings(cases, v)
    (root / "cases.json").write_text(json.dumps(cases.list))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
