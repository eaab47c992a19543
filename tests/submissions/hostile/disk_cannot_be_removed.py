"""Leaves closed folders, odd names, pipes, links to elsewhere and a file of a tebibyte of nothing for the clean-up.

Contained from tier 0.
"""

import contextlib
import os

os.makedirs("closed/inside/more")
os.symlink("/", "closed/root")
os.symlink("closed", "closed/loop")
os.mkfifo("closed/pipe")
for name in ("new\nline", "\x1b[2J", "-rf", "a" * 200, b"not \xff text", " "):
    open(os.path.join(b"closed" if isinstance(name, bytes) else "closed", name), "w").close()
with contextlib.suppress(OSError), open("closed/sparse", "wb") as file:
    file.truncate(1 << 40)
os.chmod("closed/inside", 0)
os.chmod("closed", 0)
os.chmod(".", 0)


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
