"""Large pages: to fork a process and to end it takes time for each page it has, of 4 kB or of 2 MB."""

import ctypes
import sys

_LARGE = 2 << 20
#: From Linux 6.1 on; before, it is refused and nothing changes.
_MADV_COLLAPSE = 25


def gather():
    """Move what this process has written so far into large pages, where the system can; returns how many it made.

    A worker that is forked from it copies what it changes as before, 4 kB at a time.
    """
    if sys.platform != "linux":
        return 0
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    made = 0
    with open("/proc/self/maps") as file:
        areas = [line.split() for line in file]
    for area, permissions, *_, inode in (fields[:5] for fields in areas):
        # Files' pages are shared by all their readers, and few.
        if permissions == "rw-p" and inode == "0":
            first, end = (int(address, 16) for address in area.split("-"))
            for address in range(-(-first // _LARGE) * _LARGE, end - _LARGE + 1, _LARGE):
                made += madvise(address, _LARGE, _MADV_COLLAPSE) == 0
    return made
