"""One module per world declares its assignments: adding one touches that file alone.

Beside it, modules whose names end in `_exercises` and `_checks` hold what a world's notebook asks.
"""

import importlib
import pkgutil

#: Endings of modules that are a notebook's: they declare nothing, and take long to import.
_OF_NOTEBOOKS = ("_exercises", "_checks")


def assignments():
    """Every assignment there is, by name.

    Returns
    -------
    dict of str to Assignment
        From the `ASSIGNMENTS` of each module in this folder that has them and can be imported.
    """
    return load()[0]


def load():
    """Every assignment there is, and what is in the way of others.

    One world that cannot be imported, for want of a library or for a fault in it, keeps nobody from grading another.
    But it is not passed over in silence: commands show the lines, and a test fails.

    Returns
    -------
    found : dict of str to Assignment
    broken : list of str
        One line for each module that cannot be imported.
    """
    found, broken = {}, []
    for module in pkgutil.iter_modules(__path__):
        if module.name.endswith(_OF_NOTEBOOKS):
            continue
        try:
            declared = getattr(importlib.import_module(f"{__name__}.{module.name}"), "ASSIGNMENTS", ())
        except Exception as error:
            broken.append(f"the assignments of {module.name} cannot be loaded: {type(error).__name__}: {error}")
        else:
            found.update({assignment.name: assignment for assignment in declared})
    return found, broken
