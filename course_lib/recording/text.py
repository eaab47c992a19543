"""Columns of numbers in a text file, read so that what is wrong with it is said by file and line."""

from pathlib import Path

import numpy as np


class RecordingError(ValueError):
    """A recording cannot be read: which file, which line, what to do."""


def data_folder(folder, needed, source):
    """The folder that holds a recording.

    Parameters
    ----------
    folder : str or Path
    needed : sequence of str
        Names that must be in it.
    source : str
        Where the data are to be had, for the message.

    Returns
    -------
    Path

    Raises
    ------
    RecordingError
        The folder, or a file in it, is missing.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise RecordingError(f"there is no folder {folder}: get {source} and name the folder it is in")
    if missing := [name for name in needed if not (folder / name).is_file()]:
        raise RecordingError(f"{folder} lacks {', '.join(missing)}: copy it from {source}")
    return folder


def read_lines(path):
    """Numbered lines, split into words; comments (from `#` on) and empty lines left out.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of (int, list of str)

    Raises
    ------
    RecordingError
        The file cannot be read, or is not text.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read ({error}): copy it again from its source") from None
    lines = ((number, line.partition("#")[0].split()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, words) for number, words in lines if words]


def to_table(path, lines, columns):
    """Lines of numbers as an array.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of (int, list of str)
        As from `read_lines`.
    columns : sequence of str
        What each line must hold. A first column called `time` must not decrease.

    Returns
    -------
    ndarray, shape (len(lines), len(columns))

    Raises
    ------
    RecordingError
        There are no lines, or one does not hold a finite number for each column, or goes back in time.
    """
    if not lines:
        raise RecordingError(f"{path} holds no line of {' '.join(columns)}: copy it again from its source")
    rows = []
    for number, words in lines:
        if len(words) != len(columns):
            raise RecordingError(
                f"{path}, line {number}: {len(columns)} numbers expected ({' '.join(columns)}), {len(words)} found: "
                "mend or delete the line"
            )
        try:
            rows.append([float(word) for word in words])
        except ValueError as error:
            raise RecordingError(f"{path}, line {number}: {error}: mend or delete the line") from None
    table = np.array(rows)
    bad = ~np.isfinite(table).all(axis=1)
    if bad.any():
        number = lines[np.argmax(bad)][0]
        raise RecordingError(f"{path}, line {number}: a number is not finite: mend or delete the line")
    back = np.diff(table[:, 0]) < 0.0
    if columns[0] == "time" and back.any():
        number = lines[np.argmax(back) + 1][0]
        raise RecordingError(f"{path}, line {number}: time goes back: sort the file by its time column")
    return table
