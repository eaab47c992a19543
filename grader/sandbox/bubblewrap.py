"""bubblewrap: the command line that puts a fork server into namespaces of its own.

In them there are no other processes, no network, and of the file system only what Python needs, read-only.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

_PACKAGES = Path(__file__).parents[2]
#: What the fork server needs in order to make, drop to another user, kill and clean up after its workers.
_CAPABILITIES = ("CHOWN", "DAC_OVERRIDE", "DAC_READ_SEARCH", "FOWNER", "KILL", "SETGID", "SETUID")
_SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib64", "/lib32", "/etc/ld.so.cache", "/etc/localtime", "/etc/fonts")
_SYSTEM += ("/etc/alternatives",)


def problem():
    """Why this machine cannot use bubblewrap and what to do about it; an empty reason when it can."""
    if sys.platform != "linux":
        return "bubblewrap is Linux's", "grade on Linux, or in a virtual machine"
    if not shutil.which("bwrap"):
        return "the command bwrap is not installed", "install the package bubblewrap"
    try:
        done = subprocess.run(
            [*command("/tmp"), sys.executable, "-c", "pass"], capture_output=True, text=True, timeout=30, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"bwrap does not work ({error})", "reinstall the package bubblewrap"
    if done.returncode == 0:
        return "", ""
    words = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
    return (
        f"bwrap failed: {words[-1][:200]}",
        "allow user namespaces: in a container, start it with --security-opt seccomp=unconfined or more privileges; "
        "on Ubuntu, an AppArmor profile for bwrap or sysctl kernel.apparmor_restrict_unprivileged_userns=0; on Debian, "
        "sysctl kernel.unprivileged_userns_clone=1",
    )


def command(directory):
    """The words to put before a Python command.

    Parameters
    ----------
    directory : str
        The only one that can be written in, but for the caches of compiled kernels and fonts.
    """
    words = ["bwrap", "--die-with-parent", "--unshare-ipc", "--unshare-pid", "--unshare-net", "--unshare-uts"]
    words += ["--unshare-cgroup-try", "--hostname", "sandbox", "--cap-drop", "ALL"]
    if os.geteuid() == 0:
        # No namespace of users: a worker could then drop to no other than the one who made it.
        words += [word for name in _CAPABILITIES for word in ("--cap-add", f"CAP_{name}")]
    else:
        words += ["--unshare-user"]
    for path in _SYSTEM:
        if os.path.islink(path):
            words += ["--symlink", os.readlink(path), path]
        else:
            words += ["--ro-bind-try", path, path]
    words += ["--proc", "/proc", "--dev", "/dev", "--tmpfs", "/tmp"]
    for path in _python():
        words += ["--ro-bind-try", path, path]
    for path in _caches():
        words += ["--bind-try", path, path]
    return [*words, "--bind", directory, directory, "--chdir", "/", "--"]


def _python():
    """The interpreter's files, its environment's, and of this project what runs in a sandbox."""
    prefixes = {os.path.realpath(prefix) for prefix in (sys.base_prefix, sys.prefix)}
    needed = [path for path in sorted(prefixes) if not path.startswith("/usr")]
    return [*needed, *(str(_PACKAGES / path) for path in ("course_lib", "grader/__init__.py", "grader/sandbox"))]


def _caches():
    """Where compiled kernels and fonts are kept: without them every start would take many seconds."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    modules = (_PACKAGES / "course_lib").rglob("*.py")
    caches = {home / "numba", home / "matplotlib", *(module.parent / "__pycache__" for module in modules)}
    for cache in caches:
        try:
            cache.mkdir(parents=True, exist_ok=True)
        except OSError:
            pass  # not ours: then another of them is
    return map(str, sorted(caches))
