"""The other side of tests/formats/headers.rs: DICOM headers with what a reader of voxels does not need, or with damage.

    python headers.py FOLDER

writes a folder of slices for each case, and cases.json with the notes that are expected, and the voxels as pydicom reads them
(little-endian int16, x fastest); where pydicom cannot, as they were before. A case without voxels is refused.
"""

import json
import sys
from pathlib import Path

import numpy
import openjpeg.utils as openjpeg
import pydicom
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate, encapsulate_extended
from pydicom.sequence import Sequence
from pydicom.uid import (EnhancedCTImageStorage, ExplicitVRLittleEndian, ImplicitVRLittleEndian,
                         JPEG2000Lossless, RLELossless)

sys.dont_write_bytecode = True
from lost import VOXELS, Cases, slice_of

N = 5
DAMAGE = "5 slices with damaged elements that are not needed: these were skipped, the first: IM0000.dcm"
FORM = "5 slices with an encoding other than their transfer syntax: they are read as encoded, the first: IM0000.dcm"
SYNTAX = "5 slices without a transfer syntax: the encoding was derived from the data, the first: IM0000.dcm"
FRAMES = "5 slices with NumberOfFrames 0: 1 is assumed, the first: IM0000.dcm"


def codestream(voxels):
    """JPEG 2000, lossless."""
    return bytes(openjpeg.encode_array(voxels, bits_stored=16, photometric_interpretation=2))


def element(group, number, vr, value, length=None):
    """An explicit element; `length` may lie."""
    length = len(value) if length is None else length
    head = group.to_bytes(2, "little") + number.to_bytes(2, "little") + vr
    long = vr in (b"OB", b"OW", b"SQ", b"UN", b"UT")
    return head + (bytes(2) + length.to_bytes(4, "little") if long else length.to_bytes(2, "little")) + value


def item(value, length=None):
    return b"\xfe\xff\x00\xe0" + (len(value) if length is None else length).to_bytes(4, "little") + value


OPEN, CLOSE, END = 0xFFFFFFFF, b"\xfe\xff\x0d\xe0\0\0\0\0", b"\xfe\xff\xdd\xe0\0\0\0\0"


def sequence(group, number, vr, *items):
    """A sequence of undefined length, with items of undefined length."""
    return element(group, number, vr, b"".join(item(i, OPEN) + CLOSE for i in items) + END, OPEN)


def implicit(group, number, value):
    return group.to_bytes(2, "little") + number.to_bytes(2, "little") + len(value).to_bytes(4, "little") + value


class Headers(Cases):
    astray = []

    def files(self, name, syntax=ExplicitVRLittleEndian, edit=None, change=None):
        out = self.folder / name
        out.mkdir()
        for k in range(N):
            d = slice_of(k, syntax)
            if edit:
                edit(d, k)
            path = out / f"IM{k:04}.dcm"
            pydicom.dcmwrite(path, d, enforce_file_format=True)
            if change:
                path.write_bytes(change(path.read_bytes()))
        return sorted(out.iterdir())

    def good(self, name, *notes, **more):
        files = self.files(name, **more)
        try:
            arrays = numpy.stack([pydicom.dcmread(f, force=True).pixel_array for f in files])
        except Exception:
            # It refuses some that others read; what they hold is known.
            arrays = VOXELS[:N]
        # It is led astray by some, too.
        self.astray += [name] * int(arrays.shape != VOXELS[:N].shape or (arrays != VOXELS[:N]).any())
        self.expect(name, VOXELS[:N], *notes)

    def bad(self, name, **more):
        self.files(name, **more)
        self.refused(name)


def before(tag, extra):
    """Puts bytes before an element of a file in explicit form."""
    def change(b):
        at = b.index(tag, 132)
        return b[:at] + extra + b[at:]
    return change


NAME, PIXELS, SPACING = b"\x10\0\x10\0PN", b"\xe0\x7f\x10\0OW", b"\x28\0\x30\0DS"


def icon(packed, native=False):
    def edit(d, k):
        i = Dataset()
        i.SamplesPerPixel, i.PhotometricInterpretation, i.Rows, i.Columns = 1, "MONOCHROME2", 8, 8
        i.BitsAllocated = i.BitsStored = 8
        i.HighBit, i.PixelRepresentation = 7, 0
        i.PixelData = bytes(64) if native else encapsulate(packed)
        i["PixelData"].VR = "OB"
        i["PixelData"].is_undefined_length = not native
        d.IconImageSequence = Sequence([i])
        d["IconImageSequence"].is_undefined_length = True
    return edit


def not_needed(c):
    c.good("icon_native", edit=icon(None, native=True))
    streams = [codestream(v) for v in VOXELS[:N]]
    def j2k(d, k, parts=1, bot=True):
        d.file_meta.TransferSyntaxUID = JPEG2000Lossless
        d.PixelData = encapsulate([streams[k]], fragments_per_frame=parts, has_bot=bot)
        d["PixelData"].VR, d["PixelData"].is_undefined_length = "OB", True
    def with_icon(d, k):
        icon([streams[0]])(d, k)
        j2k(d, k)
    def rle_with_icon(d, k):
        icon([b"\1" + bytes(99)])(d, k)
        d.compress(RLELossless, encoding_plugin="pydicom", generate_instance_uid=False)
    c.good("icon_packed_native", edit=icon([streams[0]]))
    c.good("icon_packed", edit=with_icon)
    c.good("icon_packed_two", edit=lambda d, k: (icon([streams[0], streams[1]])(d, k), j2k(d, k)))
    c.good("icon_packed_rle", edit=rle_with_icon)
    rows = element(0x28, 0x10, b"US", b"\7\0")
    words = element(8, 0x60, b"CS", b"MR")
    irows = implicit(0x28, 0x10, b"\7\0")
    # Private sequences and unknown values, whose items have the other form; nested.
    private = {
        "un_explicit": sequence(9, 0x1010, b"UN", rows),
        "un_explicit_two": sequence(9, 0x1010, b"UN", words + rows, rows),
        "un_explicit_nested": sequence(9, 0x1010, b"UN", sequence(8, 0x1140, b"SQ", rows) + rows),
        "un_implicit": sequence(9, 0x1010, b"UN", irows),
        "un_defined_explicit": element(9, 0x1010, b"UN", item(rows)),
        "un_defined_implicit": element(9, 0x1010, b"UN", item(irows)),
        "sq_implicit": element(9, 0x1010, b"SQ", item(irows)),
        "sq_implicit_open": sequence(9, 0x1010, b"SQ", irows),
        "sq_public_implicit": element(8, 0x1140, b"SQ", item(implicit(8, 0x1150, b"1.2.3 "))),
        "sq_public_implicit_open": sequence(8, 0x1140, b"SQ", implicit(8, 0x1150, b"1.2.3 ")),
        "sq_empty": element(9, 0x1010, b"SQ", b""),
        "sq_empty_open": sequence(9, 0x1010, b"SQ"),
        "sq_empty_item": sequence(9, 0x1010, b"SQ", b""),
        "sq_rubbish": element(9, 0x1010, b"SQ", b"rubbish of odd length that holds no item"),
        "un_rubbish": element(9, 0x1010, b"UN", bytes(range(200))),
    }
    deep = rows
    for _ in range(30):
        deep = element(9, 0x1010, b"SQ", item(deep))
    private["sq_deep"] = deep
    for name, extra in private.items():
        c.good(name, change=before(NAME, extra))
    c.good("frames_0", FRAMES, edit=lambda d, k: setattr(d, "NumberOfFrames", 0))
    c.good("frames_none", edit=lambda d, k: setattr(d, "NumberOfFrames", None))
    c.good("frames_1", edit=lambda d, k: setattr(d, "NumberOfFrames", 1))
    c.good("trailing_padding", change=lambda b: b + element(0xFFFC, 0xFFFC, b"OB", bytes(64)))
    # The last delimiter.
    c.good("end", edit=j2k, change=lambda b: b[:-8])
    c.good("end_zeros", edit=j2k, change=lambda b: b[:-8] + bytes(8))
    c.good("end_many_zeros", edit=j2k, change=lambda b: b[:-8] + bytes(700))
    c.good("end_then_padding", edit=j2k, change=lambda b: b[:-8] + element(0xFFFC, 0xFFFC, b"OB", bytes(64)))
    c.good("end_padded", edit=j2k, change=lambda b: b + element(0xFFFC, 0xFFFC, b"OB", bytes(64)))
    for bot in (True, False):
        c.good(f"fragments_3_{bot}", edit=lambda d, k: j2k(d, k, 3, bot))
    c.bad("fragment_cut", edit=j2k, change=lambda b: b[:-40])
    c.bad("fragments_cut_between", edit=lambda d, k: j2k(d, k, 2), change=lambda b: b[:b.rindex(b"\xfe\xff\x00\xe0")])
    c.bad("pixels_cut", change=lambda b: b[:-7])
    def no_syntax(b):
        at = b.index(b"\2\0\x10\0UI")
        return b[:at] + b[at + 8 + int.from_bytes(b[at + 6:at + 8], "little"):]
    c.bad("syntax_missing_compressed", edit=j2k, change=no_syntax)
    c.good("syntax_missing", SYNTAX, change=no_syntax)
    frames(c, streams)


def frames(c, streams):
    """Frames of one file in one or several fragments, with each kind of offset table."""
    for name, parts, table in [("one", 1, "basic"), ("one_none", 1, None), ("one_extended", 1, "extended"), ("two", 2, "basic"), ("two_none", 2, None)]:
        d = slice_of(0, JPEG2000Lossless)
        d.SOPClassUID = d.file_meta.MediaStorageSOPClassUID = EnhancedCTImageStorage
        d.NumberOfFrames, places = N, []
        for k in range(N):
            frame, place = Dataset(), Dataset()
            place.ImagePositionPatient = [-20, -30, -100 + 1.25 * k]
            frame.PlanePositionSequence = Sequence([place])
            places.append(frame)
        d.PerFrameFunctionalGroupsSequence = Sequence(places)
        if table == "extended":
            d.PixelData, d.ExtendedOffsetTable, d.ExtendedOffsetTableLengths = encapsulate_extended(streams)
        else:
            d.PixelData = encapsulate(streams, fragments_per_frame=parts, has_bot=table == "basic")
        d["PixelData"].VR, d["PixelData"].is_undefined_length = "OB", True
        path = c.folder / f"enhanced_{name}.dcm"
        pydicom.dcmwrite(path, d, enforce_file_format=True)
        c.expect(f"enhanced_{name}", VOXELS[:N])
        c.cases[-1]["path"] = path.name


def forms(c):
    """Explicit data under an implicit transfer syntax, and the reverse; data without any."""
    def renamed(to):
        def change(b):
            at = b.index(b"\2\0\x10\0UI")
            old = 8 + int.from_bytes(b[at + 6:at + 8], "little")
            uid = str(to).encode() + (b"\0" if len(to) % 2 else b"")
            meta = b[144:at] + element(2, 0x10, b"UI", uid) + b[at + old:]
            length = int.from_bytes(b[140:144], "little") + 8 + len(uid) - old
            return b[:140] + length.to_bytes(4, "little") + meta
        return change
    c.good("implicit_as_explicit", FORM, syntax=ImplicitVRLittleEndian, change=renamed(ExplicitVRLittleEndian))
    c.good("explicit_as_implicit", FORM, change=renamed(ImplicitVRLittleEndian))
    # Sequences, too.
    def with_sequence(d, k):
        i = Dataset()
        i.ReferencedSOPClassUID, i.ReferencedSOPInstanceUID = "1.2.3", "1.2.3.4"
        d.ReferencedImageSequence = Sequence([i, i])
    c.good("implicit_as_explicit_nested", FORM, syntax=ImplicitVRLittleEndian, edit=with_sequence, change=renamed(ExplicitVRLittleEndian))
    c.good("explicit_as_implicit_nested", FORM, edit=with_sequence, change=renamed(ImplicitVRLittleEndian))
    # One element in implicit form.
    c.good("one_implicit", change=before(NAME, implicit(9, 0x1010, b"ab")))


def damage(c):
    """Damage outside what is needed, and inside."""
    spots = {
        "too_short": element(0x18, 0x1020, b"LO", b"software 1.2.3.4", 4),
        "too_long": element(0x18, 0x1020, b"LO", b"software", 14),
        "beyond": element(0x18, 0x1020, b"UT", b"software", 0x7FFFFFF0),
        "no_vr": b"\x18\0\x20\x10\xab\xcd\x08\0software",
        "no_item": element(0x18, 0x9346, b"SQ", b"\x11\x22\x33\x44 no item here", OPEN),
        "open_item": element(0x18, 0x9346, b"SQ", item(element(8, 0x100, b"SH", b"1234"), OPEN), OPEN),
        "cut_item": element(0x18, 0x9346, b"SQ", item(element(8, 0x100, b"SH", b"1234"), 4000)),
    }
    place = b"\x18\0\x00\x51CS"
    for name, extra in spots.items():
        c.good(f"damage_{name}", DAMAGE, change=before(place, extra))
    # Before the pixel data.
    c.good("damage_before_pixels", DAMAGE, change=before(PIXELS, element(0x40, 0x275, b"SQ", b"rubbish!" * 4, OPEN)))
    # What could have been there is needed.
    c.bad("rubbish_between", change=before(place, b"\xfe\xca\xed\xfe rubbish between two elements"))
    # A stray delimiter.
    c.good("stray_end", DAMAGE, change=before(place, END))
    def at(tag, n, new):
        def change(b):
            i = b.index(tag, 132) + n
            return b[:i] + new + b[i + len(new):]
        return change
    c.bad("rows_without_vr", change=at(b"\x28\0\x10\0US", 4, b"\xab\xcd"))
    c.bad("spacing_too_long", change=at(SPACING, 6, b"\x12\0"))
    c.bad("modality_beyond_the_file", change=lambda b: b.replace(b"\x08\0\x60\0CS\2\0CT", element(8, 0x60, b"UN", b"CT", 0x7FFFFFF0)))
    c.bad("position_lost", change=at(b"\x20\0\x32\0DS", 0, b"\xab\xcd\xef\x01\x02\x03"))
    c.bad("cut_in_the_header", change=lambda b: b[:500])
    c.bad("frames_negative", edit=lambda d, k: setattr(d, "NumberOfFrames", -1))
    c.bad("frames_words", change=before(b"\x28\0\x10\0US", element(0x28, 8, b"IS", b"many")))


if __name__ == "__main__":
    headers = Headers(Path(sys.argv[1]))
    for part in (not_needed, forms, damage):
        part(headers)
    assert not headers.astray, headers.astray
    (headers.folder / "cases.json").write_text(json.dumps(headers.cases))
