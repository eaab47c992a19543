"""Raises an exception whose text is HTML, a spreadsheet's formula, terminal codes and text from right to left.

Contained from tier 0.
"""


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        raise ValueError(
            "=cmd|'/c calc'!A1 <script>hostile()</script> <img src=x onerror=hostile()> \x1b[2J\x07 \u202e [red]"
        )
    return rng.uniform(0.0, constants.L, (500, 6))
