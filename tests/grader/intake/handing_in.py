"""Files to hand in, honest and otherwise."""

import json
import struct
import zlib
from types import SimpleNamespace

from grader.intake import collect

ASSIGNMENT = SimpleNamespace(
    entry_point="Estimator", parameters=("previous", "observation", "control", "constants", "rng")
)
SIGNATURE = "Estimator(previous, observation, control, constants, rng)"
GOOD = f"def {SIGNATURE}:\n    return 1\n"


def notebook(*cells, nbformat=4):
    """Bytes of a notebook with these code cells."""
    cells = [{"cell_type": "code", "source": cell, "metadata": {}, "outputs": []} for cell in cells]
    text = {"cell_type": "markdown", "source": "def Estimator(): not code", "metadata": {}}
    return json.dumps({"nbformat": nbformat, "nbformat_minor": 5, "metadata": {}, "cells": [text, *cells]}).encode()


def one(folder, name, content):
    """(submission or None, reason or None) of one file."""
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    submissions, refusals = collect.gather([path], ASSIGNMENT)
    assert len(submissions) + len(refusals) == 1
    return (submissions[0], None) if submissions else (None, refusals[0].reason)


def member(name, content=GOOD, **lies):
    """A member for `pack`; `lies` override what its headers say.

    `offset`, `local_name`, `local_size` and `local_flags` are told in one place only; `packed_data` is what is stored;
    `mode` is a Unix file's; `name` may be bytes.
    """
    content = content.encode() if isinstance(content, str) else content
    deflate = zlib.compressobj(9, wbits=-15)
    fields = {
        "name": name.encode() if isinstance(name, str) else name,
        "packed_data": deflate.compress(content) + deflate.flush(),
        "flags": 0x800,
        "method": 8,
        "size": len(content),
        "crc": zlib.crc32(content),
        "mode": 0o100644,
        "version": 20,
        "extra": b"",
    } | lies
    return fields


def pack(*members, prefix=b"", comment=b"", **lies):
    """Bytes of a zip; `lies` override fields of its end record: `count`, `directory_size`, `directory_offset`."""
    data, directory = bytearray(prefix), b""
    for each in members:
        offset, packed = len(data), each.get("packed", len(each["packed_data"]))
        name = each.get("local_name", each["name"])
        data += struct.pack(
            "<4s5H3I2H",
            b"PK\3\4",
            each["version"],
            each.get("local_flags", each["flags"]),
            each.get("local_method", each["method"]),
            0,
            0,
            each["crc"],
            packed,
            each.get("local_size", each["size"]),
            len(name),
            0,
        )
        data += name + each["packed_data"]
        directory += struct.pack(
            "<4s6H3I5H2I",
            b"PK\1\2",
            3 << 8 | 20,
            each["version"],
            each["flags"],
            each["method"],
            0,
            0,
            each["crc"],
            packed,
            each["size"],
            len(each["name"]),
            len(each["extra"]),
            0,
            0,
            0,
            each["mode"] << 16,
            each.get("offset", offset),
        )
        directory += each["name"] + each["extra"]
    count = lies.get("count", len(members))
    end = struct.pack(
        "<4s4H2IH",
        b"PK\5\6",
        0,
        0,
        count,
        count,
        lies.get("directory_size", len(directory)),
        lies.get("directory_offset", len(data) - len(prefix)),
        len(comment),
    )
    return bytes(data) + directory + end + comment


def zeros(size):
    """Bytes that deflate makes of so many zeros, without ever having them all in memory."""
    deflate, left, parts = zlib.compressobj(9, wbits=-15), size, []
    while left:
        parts.append(deflate.compress(bytes(min(left, 1 << 24))))
        left -= min(left, 1 << 24)
    return b"".join([*parts, deflate.flush()])
