"""One room per world: adding a world touches its room alone. Imports `lessons`, the nouns, and `course_lib`.

`declaration` has a world's `ASSIGNMENTS`; `exercises` and `*_checks` are what its notebook asks.
"""

import importlib
import pkgutil


def assignments():
    """Every assignment there is, by name.

    Returns
    -------
    dict of str to Assignment
        From the `ASSIGNMENTS` of each world's `declaration` that can be imported.
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
        One line for each world whose declaration cannot be imported.
    """
    found, broken = {}, []
    for world in pkgutil.iter_modules(__path__):
        try:
            declaration = importlib.import_module(f"{__name__}.{world.name}.declaration")
        except Exception as error:
            broken.append(f"the assignments of {world.name} cannot be loaded: {type(error).__name__}: {error}")
        else:
            found.update({assignment.name: assignment for assignment in declaration.ASSIGNMENTS})
    return found, broken
