"""Raises an exception whose text is no text, and whose class has no name.

Contained from tier 0.
"""


class Meta(type):
    __name__ = property(lambda cls: 1 / 0)


class Wordless(Exception, metaclass=Meta):
    def __str__(self):
        return 7


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        raise Wordless
    return rng.uniform(0.0, constants.L, (500, 6))
