"""System calls: a filter that lets a program compute, read and write, and refuses whatever leads out of it.

An allow-list: no processes, no sockets, no signals to others, no other's memory, no change of a file's owner, mode or
time (which Landlock does not cover), nothing that outlives the process. The rest answers EPERM; clone3 answers ENOSYS,
so that the C library makes its threads by clone; a call by another architecture's table kills.

Source: the Linux kernel's documentation, userspace-api/seccomp_filter.
"""

import ctypes
import errno
import os
import platform
import struct

from grader.sandbox import syscalls

_SET_MODE_FILTER, _GET_ACTION_AVAILABLE = 1, 2
_ALLOW, _KILL_PROCESS, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
_JUMP_EQUAL, _JUMP_ANY_BIT, _LOAD, _RETURN = 0x15, 0x45, 0x20, 0x06
# Where the kernel lays a call's number, its architecture and its arguments.
_NUMBER, _ARCHITECTURE, _ARGUMENTS = 0, 4, 16

_CLONE_THREAD = 0x00010000
_CLONE_NAMESPACES = 0x7E020080
_F_SETFL, _O_ASYNC = 4, 0x2000
#: F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_DUPFD_CLOEXEC, F_GETPIPE_SZ. Not those that ask for signals or take memory.
_FCNTLS = (0, 1, 2, 3, 1030, 1032)
#: TCGETS, TIOCGWINSZ, FIONREAD, FIONBIO, FIONCLEX, FIOCLEX.
_IOCTLS = (0x5401, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451)
#: PR_GET_DUMPABLE, PR_SET_NAME, PR_GET_NAME.
_PRCTLS = (3, 15, 16)

_libc = ctypes.CDLL(None, use_errno=True)


class _Program(ctypes.Structure):
    _fields_ = [("length", ctypes.c_ushort), ("instructions", ctypes.c_char_p)]


def problem():
    """Why this machine cannot filter system calls; empty when it can."""
    machine = platform.machine()
    if machine not in syscalls.PLAIN:
        return f"no table of system calls for {machine}"
    action = ctypes.c_uint32(_KILL_PROCESS)
    if _libc.syscall(syscalls.SECCOMP[machine], _GET_ACTION_AVAILABLE, 0, ctypes.byref(action)):
        return f"the kernel has no seccomp filters ({os.strerror(ctypes.get_errno())})"
    return ""


def restrict():
    """Refuse, from now on and for good, every call of this process that is not on the list. Sets no privileges.

    Raises
    ------
    OSError
        Among others when `no_new_privs` has not been set before.
    """
    code = program(os.getpid())
    number = syscalls.SECCOMP[platform.machine()]
    if _libc.syscall(number, _SET_MODE_FILTER, 0, ctypes.byref(_Program(len(code) // 8, code))):
        error = ctypes.get_errno()
        raise OSError(error, f"seccomp: {os.strerror(error)}")


def program(pid):
    """The filter in classic BPF, for a process that may signal itself."""
    machine = platform.machine()
    special = syscalls.SPECIAL[machine]
    refuse = [_return(_ERRNO | errno.EPERM)]
    allow = [_return(_ALLOW)]
    code = [
        _load(_ARCHITECTURE),
        _jump(_JUMP_EQUAL, syscalls.AUDIT[machine], 1, 0),
        _return(_KILL_PROCESS),
        _load(_NUMBER),
        *_when(special["clone3"], [_return(_ERRNO | errno.ENOSYS)]),
        # A thread, in no namespace of its own; never a process.
        *_when(
            special["clone"],
            [
                _argument(0),
                _jump(_JUMP_ANY_BIT, _CLONE_NAMESPACES, 2, 0),
                _jump(_JUMP_ANY_BIT, _CLONE_THREAD, 0, 1),
                *allow,
                *refuse,
            ],
        ),
        # O_ASYNC would have the kernel send signals on the program's behalf.
        *_when(
            special["fcntl"],
            [
                _argument(1),
                _jump(_JUMP_EQUAL, _F_SETFL, 0, 4),
                _argument(2),
                _jump(_JUMP_ANY_BIT, _O_ASYNC, 0, 1),
                *refuse,
                *allow,
                *_one_of(1, _FCNTLS),
            ],
        ),
        *_when(special["ioctl"], _one_of(1, _IOCTLS)),
        *_when(special["prctl"], _one_of(0, _PRCTLS)),
        *_when(special["prlimit64"], _one_of(0, (0, pid))),
        *_when(special["kill"], _one_of(0, (pid,))),
        *_when(special["tgkill"], _one_of(0, (pid,))),
    ]
    numbers = sorted(syscalls.PLAIN[machine].values())
    code += [_jump(_JUMP_EQUAL, number, len(numbers) - index, 0) for index, number in enumerate(numbers)]
    return b"".join([*code, *refuse, *allow])


def _when(number, block):
    """Run a block that returns, if this is the call; go on behind it with the call's number still loaded, if not."""
    return [_jump(_JUMP_EQUAL, number, 0, len(block)), *block]


def _one_of(index, values):
    checks = [_jump(_JUMP_EQUAL, value, len(values) - at, 0) for at, value in enumerate(values)]
    return [_argument(index), *checks, _return(_ERRNO | errno.EPERM), _return(_ALLOW)]


def _load(offset):
    return struct.pack("<HBBI", _LOAD, 0, 0, offset)


def _argument(index):
    # The lower half, which is all that the kernel looks at in these.
    return _load(_ARGUMENTS + 8 * index)


def _jump(code, value, if_true, if_false):
    return struct.pack("<HBBI", code, if_true, if_false, value)


def _return(action):
    return struct.pack("<HBBI", _RETURN, 0, 0, action)
