"""Maps in the format of ROS: a YAML file that names an image, as map_server and nav2 read and write them.

References
----------
ROS wiki, *map_server*, section 1, map format.
"""

from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from course_lib.geometry.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from course_lib.recording.text import RecordingError

MODES = ("trinary", "scale", "raw")
#: What map_saver writes: grey levels, and thresholds between which the middle one lies.
LEVELS = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}
THRESHOLDS = {"occupied_thresh": 0.65, "free_thresh": 0.196}


def read_ros_map(path):
    """Read a map.

    A pixel's occupancy p is its darkness (its lightness, if `negate` is 1): the cell is occupied where p is above
    `occupied_thresh`, free where it is below `free_thresh`, and unknown in between. In mode `scale` transparent pixels
    are unknown, too; grey ones remain so, for the grid has no cell that is partly occupied. In mode `raw` pixels are
    percentages, and above 100 unknown.

    Parameters
    ----------
    path : str or Path
        The YAML file; the image lies where it says, seen from its folder.

    Returns
    -------
    OccupancyGrid
        Its row 0 is the lowest of the image.

    Raises
    ------
    RecordingError
        A file cannot be read, or an entry is missing or not supported.
    """
    path = Path(path)
    entries = _entries(path)
    resolution = _number(path, entries, "resolution")
    occupied, free = _number(path, entries, "occupied_thresh"), _number(path, entries, "free_thresh")
    if not resolution > 0.0:
        raise RecordingError(f"{path}: resolution must be positive, not {resolution}: give a cell's side in metres")
    if not 0.0 <= free <= occupied <= 1.0:
        raise RecordingError(
            f"{path}: free_thresh {free} and occupied_thresh {occupied} must be between 0 and 1, the first not above "
            "the second: mend them"
        )
    origin = entries["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise RecordingError(f"{path}: origin must be [x, y, yaw], not {origin!r}: mend it")
    origin = [_finite(path, "origin", value) for value in origin]
    mode, negate = entries.get("mode", "trinary"), entries["negate"]
    if mode not in MODES:
        raise RecordingError(f"{path}: mode {mode!r} is not supported: make it one of {', '.join(MODES)}")
    if negate not in (0, 1):
        raise RecordingError(f"{path}: negate must be 0 or 1, not {negate!r}: mend it")

    levels, opaque = _pixels(path, entries["image"])
    if mode == "raw":
        occupancy, opaque = levels / 100.0, levels <= 100.0
    else:
        occupancy = levels / 255.0 if negate else 1.0 - levels / 255.0
        if mode == "trinary":
            opaque = True
    cells = np.where(occupancy > occupied, OCCUPIED, np.where(occupancy < free, FREE, UNKNOWN))
    return OccupancyGrid(np.where(opaque, cells, UNKNOWN)[::-1], resolution, tuple(origin))


def write_ros_map(grid, path):
    """Write a map as map_saver does: a YAML file and, beside it, a binary .pgm of the same name.

    Parameters
    ----------
    grid : OccupancyGrid
    path : str or Path
        The YAML file, whose name ends in .yaml.

    Raises
    ------
    ValueError
        The name ends in something else.
    """
    path = Path(path)
    if path.suffix != ".yaml":
        raise ValueError(f"{path} must end in .yaml: the image beside it has the same name")
    image = path.with_suffix(".pgm")
    pixels = np.select([grid.cells == kind for kind in LEVELS], list(LEVELS.values())).astype(np.uint8)
    Image.fromarray(np.ascontiguousarray(pixels[::-1])).save(image)
    entries = {"image": image.name, "mode": "trinary", "resolution": float(grid.resolution)}
    entries |= {"origin": list(grid.origin), "negate": 0, **THRESHOLDS}
    path.write_text(yaml.safe_dump(entries, sort_keys=False, default_flow_style=None), encoding="utf-8")


def _entries(path):
    try:
        entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read ({error}): name the map's YAML file") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        raise RecordingError(f"{path}{where}: not YAML ({getattr(error, 'problem', None)}): mend it") from None
    if not isinstance(entries, dict):
        raise RecordingError(f"{path} holds no entries: name the map's YAML file")
    needed = ("image", "resolution", "origin", "negate", *THRESHOLDS)
    if missing := [name for name in needed if name not in entries]:
        raise RecordingError(f"{path} lacks {', '.join(missing)}: add what map_saver would write")
    return entries


def _number(path, entries, name):
    return _finite(path, name, entries[name])


def _finite(path, name, value):
    # YAML takes 1e-2 for text, for it lacks a decimal point; ROS reads it.
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise RecordingError(f"{path}: {name} must be a finite number, not {value!r}: mend it")
    return number


def _pixels(path, name):
    """Grey levels from 0 to 255, and which pixels are opaque."""
    if not isinstance(name, str):
        raise RecordingError(f"{path}: image must be the name of a file, not {name!r}: mend it")
    image_path = path.parent / name
    try:
        with Image.open(image_path) as image:
            if image.mode not in ("1", "L", "LA", "P", "PA", "RGB", "RGBA"):
                raise RecordingError(f"{image_path}: pixels of kind {image.mode} are not supported: save 8 bits")
            channels = np.asarray(image.convert("RGBA"), dtype=float)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        if isinstance(error, RecordingError):
            raise
        raise RecordingError(f"{image_path} cannot be read ({error}): save it again as .pgm or .png") from None
    return channels[..., :3].mean(axis=-1), channels[..., 3] == 255.0
