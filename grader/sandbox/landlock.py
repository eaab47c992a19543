"""Landlock: which files a process may still reach, given up by the process itself and needing no privilege.

The rules are an allow-list of hierarchies; what is not on it can be neither opened nor listed nor changed. A second
call can only take more away. Needs Linux 6.2 (ABI 3): before it a file could be truncated behind the rules.

Source: the Linux kernel's documentation, userspace-api/landlock.
"""

import ctypes
import os
import struct

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION_FLAG, _PATH_BENEATH = 1, 1
_PR_SET_NO_NEW_PRIVS = 38

#: The first ABI that covers truncation.
LEAST_ABI = 3

_WRITE_FILE, _READ_FILE, _READ_DIR, _REMOVE_DIR, _REMOVE_FILE = 1 << 1, 1 << 2, 1 << 3, 1 << 4, 1 << 5
_MAKE_DIR, _MAKE_REG, _TRUNCATE = 1 << 7, 1 << 8, 1 << 14
_ALL_SINCE = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 5: (1 << 16) - 1}
_TO_READ = _READ_FILE | _READ_DIR
_TO_WRITE = _TO_READ | _WRITE_FILE | _REMOVE_DIR | _REMOVE_FILE | _MAKE_DIR | _MAKE_REG | _TRUNCATE
_OF_A_FILE = _READ_FILE | _WRITE_FILE | _TRUNCATE
_BIND_AND_CONNECT_TCP = 3
_ABSTRACT_SOCKETS_AND_SIGNALS = 3

_libc = ctypes.CDLL(None, use_errno=True)


def abi():
    """The kernel's version of Landlock; 0 when it has none."""
    return max(0, _libc.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint(_VERSION_FLAG)))


def restrict(readable, listable, writable, alone=False):
    """Give up all files but these, for this process and all it starts, for good.

    Parameters
    ----------
    readable, writable : iterable of str
        Files, and directories with everything beneath; those that do not exist are left out.
    listable : iterable of str
        Directories of which, and of everything beneath, no more than the names may be read.
    alone : bool
        Give up TCP, abstract sockets and signals to any process outside as well, as far as the kernel can.

    Raises
    ------
    OSError
    """
    version = abi()
    handled = _ALL_SINCE[max(since for since in _ALL_SINCE if since <= version)]
    network = _BIND_AND_CONNECT_TCP if alone and version >= 4 else 0
    scope = _ABSTRACT_SOCKETS_AND_SIGNALS if alone and version >= 6 else 0
    # A kernel refuses a structure longer than the one it knows, unless the rest is zero.
    attributes = struct.pack("<QQQ", handled, network, scope)
    ruleset = _call(_CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), ctypes.c_uint(0))
    try:
        for paths, rights in ((readable, _TO_READ), (listable, _READ_DIR), (writable, _TO_WRITE)):
            for path in paths:
                _allow(ruleset, path, rights)
        if _libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0):
            raise OSError(ctypes.get_errno(), "no_new_privs was refused")
        _call(_RESTRICT_SELF, ruleset, ctypes.c_uint(0))
    finally:
        os.close(ruleset)


def _allow(ruleset, path, rights):
    try:
        beneath = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return  # what is not there, or not for us, cannot be read anyway
    try:
        if not os.path.isdir(path):
            rights &= _OF_A_FILE
        _call(_ADD_RULE, ruleset, _PATH_BENEATH, struct.pack("<Qi", rights, beneath), ctypes.c_uint(0))
    finally:
        os.close(beneath)


def _call(number, *arguments):
    result = _libc.syscall(number, *arguments)
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, f"Landlock: {os.strerror(code)}")
    return result
