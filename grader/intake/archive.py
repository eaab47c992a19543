"""Zips that nobody vouches for: their members as bytes, under caps. Nothing is ever extracted by name.

`zipfile` reads the directory. The rest is checked and inflated here, because a directory may lie: about names, sizes,
places and kinds. Overlapping members are the bomb that has no large ratio (D. Fifield, *A better zip bomb*, WOOT 2019).
"""

import re
import stat
import struct
import unicodedata
import zipfile
import zlib
from collections import Counter
from pathlib import PurePosixPath
from typing import NamedTuple

from grader.intake.names import same
from grader.intake.source import SIZE_LIMITS, check_size

#: Most members of a zip, bytes of its directory, bytes of its programs together when inflated.
MOST_MEMBERS, MOST_DIRECTORY_BYTES, MOST_BYTES = 10_000, 4_000_000, 4_000_000_000
#: How many times its packed size a member of more than this many bytes may have. Outputs of a notebook reach 100.
MOST_RATIO, RATIO_BYTES = 500, 1_000_000

_LOCAL = struct.Struct("<4s5H3I2H")
_ENCRYPTED = 0x1 | 0x40 | 0x2000
_UTF8, _SIZES_FOLLOW = 0x800, 0x8
_CHUNK = 1 << 16
_AGAIN, _UNPACK = "zip the files again", "unpack it and name the folder"


class Member(NamedTuple):
    """A program in a zip: its name and ending, the bytes it occupies in the file, and what they must inflate to."""

    name: str
    ending: str
    start: int
    packed: int
    method: int
    size: int
    crc: int


def passed_over(name):
    """Whether a file or folder of this name is never looked at: hidden, or litter of some system."""
    return name.startswith(".") or name in ("__pycache__", "__MACOSX")


def inspect(path):
    """The programs in a zip, before any of them is inflated.

    Parameters
    ----------
    path : Path

    Returns
    -------
    members : list of Member
    problems : list of (str, str)
        Name of a member that is refused, and why, in one line.

    Raises
    ------
    ValueError
        Why the whole zip is refused.
    """
    try:
        # A named pipe would wait for its writer for ever.
        if not path.is_file():
            raise ValueError("is not a regular file: hand in the file itself")
        with open(path, "rb") as file:
            entries, end = _directory(file)
            places = [_place(file, entry) for entry in entries]
    except OSError as error:
        raise ValueError(f"cannot be read ({error.strerror}): check the file and its permissions") from None
    _check_places(entries, places, end)
    return _choose(entries, places)


def read(path, member):
    """The bytes of a member, never more than its directory entry says.

    Raises
    ------
    ValueError
        They are not what that entry says, or cannot be read.
    """
    lies = ValueError(f"is damaged, or not what the zip says it is: {_AGAIN}")
    parts, size, crc = [], 0, 0
    inflater = zlib.decompressobj(-zlib.MAX_WBITS) if member.method == zipfile.ZIP_DEFLATED else None
    try:
        with open(path, "rb") as file:
            file.seek(member.start)
            left = member.packed
            while left and size <= member.size:
                data = file.read(min(left, _CHUNK))
                if not data:
                    raise lies
                left -= len(data)
                if inflater:
                    data = inflater.decompress(data, member.size - size + 1)
                size, crc = size + len(data), zlib.crc32(data, crc)
                parts.append(data)
                if inflater and (inflater.eof or inflater.unconsumed_tail):
                    break
    except zlib.error:
        raise lies from None
    except OSError as error:
        raise ValueError(f"cannot be read ({error.strerror}): check the zip and its permissions") from None
    ended = left == 0 and (not inflater or (inflater.eof and not inflater.unused_data))
    if not ended or (size, crc) != (member.size, member.crc):
        raise lies
    return b"".join(parts)


class _Bounded:
    """A file of which no more than the directory's cap is read at once, so that no claimed size is believed."""

    def __init__(self, file):
        self._file = file
        self.seek, self.tell = file.seek, file.tell

    def read(self, count=-1):
        """As a file's."""
        if count > MOST_DIRECTORY_BYTES:
            raise ValueError(f"its directory is over {MOST_DIRECTORY_BYTES // 1_000_000} MB: {_UNPACK}")
        return self._file.read(count if count >= 0 else MOST_DIRECTORY_BYTES)


def _directory(file):
    """Entries of the directory, and where in the file it begins."""
    try:
        with zipfile.ZipFile(_Bounded(file)) as opened:
            entries, end = opened.infolist(), opened.start_dir
    except (zipfile.BadZipFile, NotImplementedError, UnicodeDecodeError, OverflowError, struct.error, OSError) as error:
        raise ValueError(f"is not a whole zip ({error}): {_AGAIN}") from None
    if len(entries) > MOST_MEMBERS:
        raise ValueError(f"has {len(entries)} members, at most {MOST_MEMBERS} are read: {_UNPACK}")
    return entries, end


def _place(file, entry):
    """Where a member's local header and its data begin, and where these end; None where that header says otherwise."""
    if not 0 <= entry.header_offset < 1 << 62:
        return None
    file.seek(entry.header_offset)
    header = file.read(_LOCAL.size)
    if len(header) < _LOCAL.size:
        return None
    signature, _, flags, method, _, _, crc, packed, size, name_length, extra_length = _LOCAL.unpack(header)
    name = entry.orig_filename.encode("utf-8" if entry.flag_bits & _UTF8 else "cp437")
    told = (entry.CRC, entry.compress_size, entry.file_size)
    # Zeros where a descriptor follows the data; all ones where the sizes do not fit.
    same_sizes = all(here in (there, 0xFFFFFFFF) for here, there in zip((crc, packed, size), told, strict=True))
    if (
        signature != b"PK\3\4"
        or method != entry.compress_type
        or (flags ^ entry.flag_bits) & _ENCRYPTED
        or not (same_sizes or flags & _SIZES_FOLLOW)
        or file.read(name_length) != name
    ):
        return None
    start = entry.header_offset + _LOCAL.size + name_length + extra_length
    return entry.header_offset, start, start + entry.compress_size


def _check_places(entries, places, end):
    """Refuse a zip in which not every byte belongs to one member only."""
    if entries and min(entry.header_offset for entry in entries) != 0:
        raise ValueError(f"does not begin with its first member, so that it may be read as another: {_AGAIN}")
    known = sorted(place for place in places if place)
    bounds = [first for first, _, _ in known[1:]] + [end]
    if any(after > bound for (_, _, after), bound in zip(known, bounds, strict=False)):
        raise ValueError(f"has members that overlap or run past its end: {_AGAIN}")


def _choose(entries, places):
    """Members that are programs, and those that cannot be had."""
    members, problems = [], []
    names = Counter(_key(entry.orig_filename) for entry in entries)
    for entry, place in zip(entries, places, strict=True):
        name = entry.orig_filename
        try:
            _check_name(name)
            if any(map(passed_over, _parts(name))):
                continue
            _check_kind(entry)
            ending = PurePosixPath(name).suffix.lower()
            if name.endswith("/") or ending not in SIZE_LIMITS:
                continue
            check_size(entry.file_size, ending)
            _check_packing(entry, place)
            if names[_key(name)] > 1:
                raise ValueError("is there twice, under names that some system takes for one: leave one")
        except ValueError as error:
            problems.append((name, str(error)))
        else:
            members.append(
                Member(name, ending, place[1], entry.compress_size, entry.compress_type, entry.file_size, entry.CRC)
            )
    if sum(member.size for member in members) > MOST_BYTES:
        raise ValueError(f"holds more than {MOST_BYTES // 1_000_000_000} GB of programs: {_UNPACK}")
    return members, problems


def _parts(name):
    return [part for part in name.split("/") if part not in ("", ".")]


def _key(name):
    return same("/".join(_parts(name)))


def _check_name(name):
    if name.startswith("/") or re.match("[A-Za-z]:", name):
        raise ValueError(f"has an absolute name: {_AGAIN}")
    if ".." in name.split("/"):
        raise ValueError(f"has a name that leads out of the zip: {_AGAIN}")
    if "\\" in name or any(unicodedata.category(c) in ("Cc", "Cs") for c in name):
        raise ValueError(f"has a backslash or a control character in its name: rename it, and {_AGAIN}")


def _check_kind(entry):
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind == stat.S_IFLNK:
        raise ValueError("is a link: put the file itself into the zip")
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        raise ValueError("is a device, not a file: leave it out")
    if PurePosixPath(entry.orig_filename).suffix.lower() == ".zip":
        raise ValueError("is a zip in a zip: unpack the outer one and name its folder")


def _check_packing(entry, place):
    if entry.flag_bits & _ENCRYPTED:
        raise ValueError("is encrypted: zip it again without a password")
    if place is None:
        raise ValueError(f"is not where or what the zip's directory says: {_AGAIN}")
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError("is compressed in an unusual way: zip it again with the ordinary method (deflate)")
    if entry.file_size > max(RATIO_BYTES, MOST_RATIO * entry.compress_size):
        raise ValueError(f"is compressed more than {MOST_RATIO} times, as no program is: {_AGAIN}")
