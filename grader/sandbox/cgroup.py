"""Control groups: a kernel's limits on the memory and the number of processes of a fork server and all it starts.

Versions 1, 2 and both at once (hybrid) are understood: whichever hierarchy has the controllers.

Source: the Linux kernel's documentation, admin-guide/cgroup-v1 and cgroup-v2.
"""

import errno
import os
import secrets
import sys
import time
from pathlib import Path

#: Seconds a group's last processes may take to be gone.
_PATIENCE = 5.0
_NEEDED = ("memory", "pids")
#: Where the processes go that are in the way of delegating a group of version 2.
_HOST = "grader-host"
_PREFIX = "grader-of-"


class Cgroup:
    """One group, in every hierarchy that is needed.

    Parameters
    ----------
    memory_bytes : int
    processes : int
        Threads counted.

    Raises
    ------
    OSError
        The hierarchies are not there or not ours.
    """

    def __init__(self, memory_bytes, processes):
        name = f"{_PREFIX}{os.getpid()}-{secrets.token_hex(4)}"
        self._limits = {"memory": memory_bytes, "pids": processes}
        self._paths = {}
        try:
            for controller in _NEEDED:
                version, parent = _parent(controller)
                path = parent / name
                _remove_stale(parent)
                if path not in self._paths.values():
                    path.mkdir()
                self._paths[controller] = path
                self._limit(controller, version)
        except OSError:
            self.remove()
            raise

    @staticmethod
    def problem():
        """Why this process cannot have control groups and what to do about it; an empty reason when it can."""
        remedy = (
            "run as root with the cgroup file system writable, or in a delegated group of your own: "
            "systemd-run --user --scope --property Delegate=yes COMMAND"
        )
        if sys.platform != "linux":
            return "control groups are Linux's", "grade on Linux, or in a virtual machine"
        try:
            Cgroup(1 << 30, 100).remove()
        except OSError as error:
            where = f" ({error.filename})" if error.filename else ""
            return f"no control group can be made: {error.strerror or error}{where}", remedy
        return "", ""

    def entering(self):
        """The words to put before a command that is to run, with all it starts, in the group."""
        files = [str(self._paths[controller] / "cgroup.procs") for controller in _NEEDED]
        return ["/bin/sh", "-c", 'echo $$ >"$1" && echo $$ >"$2" && shift 2 && exec "$@"', "sh", *files]

    def processes(self):
        """Numbers of the processes in the group."""
        return {int(pid) for pid in (self._paths["pids"] / "cgroup.procs").read_text().split()}

    def out_of_memory(self):
        """How many processes the kernel has killed here for want of memory."""
        path = self._paths["memory"]
        for name in ("memory.events", "memory.oom_control"):
            if (path / name).exists():
                words = (path / name).read_text().split()
                return int(words[words.index("oom_kill") + 1]) if "oom_kill" in words else 0
        return 0

    def remove(self):
        """Kill what is left in the group, and remove it."""
        for path in set(self._paths.values()):
            deadline = time.monotonic() + _PATIENCE
            while True:
                try:
                    for pid in (path / "cgroup.procs").read_text().split():
                        os.kill(int(pid), 9)
                    path.rmdir()
                    break
                except FileNotFoundError:
                    break
                except OSError:
                    # The last process is dying.
                    if time.monotonic() > deadline:
                        break
                    time.sleep(0.005)
        self._paths = {}

    def _limit(self, controller, version):
        path, value = self._paths[controller], str(self._limits[controller])
        if controller == "pids":
            (path / "pids.max").write_text(value)
        elif version == 2:
            (path / "memory.max").write_text(value)
            if (path / "memory.swap.max").exists():
                (path / "memory.swap.max").write_text("0")
        else:
            (path / "memory.limit_in_bytes").write_text(value)


def _remove_stale(parent):
    """Remove the groups whose makers were killed before they could; those that are in use cannot be removed."""
    for group in parent.glob(f"{_PREFIX}*"):
        maker = group.name.removeprefix(_PREFIX).partition("-")[0]
        if not Path("/proc", maker).exists():
            try:
                group.rmdir()
            except OSError:
                pass  # still in use, or gone


def _parent(controller):
    """Version of the hierarchy that has a controller, and this process's own group in it."""
    groups = dict(_groups())
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        words = line.split()
        kind, options = words[words.index("-") + 1], words[-1].split(",")
        mount, root = Path(words[4]), words[3]
        if kind == "cgroup" and controller in options:
            return 1, mount / os.path.relpath(groups[controller], root)
        if kind == "cgroup2" and controller in (mount / "cgroup.controllers").read_text().split():
            own = mount / os.path.relpath(groups[""], root)
            return 2, _delegating(mount if os.geteuid() == 0 else own, controller)
    raise OSError(f"no hierarchy of control groups has the controller {controller}")


def _groups():
    """Controller (empty in version 2) and the path of this process's group."""
    for line in Path("/proc/self/cgroup").read_text().splitlines():
        _, controllers, path = line.split(":", 2)
        for controller in controllers.split(","):
            yield controller, path


def _delegating(group, controller):
    """A group of version 2, this one or the one above it, whose children have the controller."""
    if group.name == _HOST:
        group = group.parent
    control = group / "cgroup.subtree_control"
    if controller in control.read_text().split():
        return group
    try:
        control.write_text(f"+{controller}")
    except OSError as error:
        if error.errno != errno.EBUSY:
            raise
        # Only a group without processes of its own can hand controllers on: those in it move down a level.
        host = group / _HOST
        host.mkdir(exist_ok=True)
        for pid in (group / "cgroup.procs").read_text().split():
            (host / "cgroup.procs").write_text(pid)
        control.write_text(f"+{controller}")
    return group
