"""No attack: the honest wrong answer, particles anywhere in the room, above which no attack may score."""


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
