"""One module per world declares its assignments: adding one touches that file alone."""

import importlib
import pkgutil


def assignments():
    """Every assignment there is, by name.

    Returns
    -------
    dict of str to Assignment
        From the `ASSIGNMENTS` of each module in this folder that has them.
    """
    found = {}
    for module in pkgutil.iter_modules(__path__):
        declared = getattr(importlib.import_module(f"{__name__}.{module.name}"), "ASSIGNMENTS", ())
        found.update({assignment.name: assignment for assignment in declared})
    return found
