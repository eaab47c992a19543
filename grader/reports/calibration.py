"""Whether posteriors mean what they say: coverage of their 90 % region, and the NEES of Gaussians."""

from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from grader.result import COVERAGE, NEES

#: Probability with which a calibrated filter is called overconfident, and with which it is called overcautious.
FALSE_ALARM = 0.01
#: What the coverage is of a posterior that means what it says.
NOMINAL = 0.9
# Stakes of the bets against calibration: any up to 1 / (1 - NOMINAL) = 10 leaves the bettor something.
_STAKES = np.arange(1.0, 10.0)


class Calibration(NamedTuple):
    """How well a submission knows what it does not know.

    Attributes
    ----------
    metric : str
        `COVERAGE` or `NEES`.
    value : float
        Mean over the finished episodes.
    expected : str
        What it is compared with, in words.
    verdict : str
        "overconfident", "overcautious", or empty when the episodes do not tell.
    """

    metric: str
    value: float
    expected: str
    verdict: str

    @property
    def figure(self):
        """The value in so many digits that one sees what it is compared with."""
        return f"{self.value:.2f}" if self.metric == COVERAGE else f"{self.value:#.3g}"


def coverage(episodes):
    """Coverage of the 90 % region, beside the reference's on the same episodes; None when nothing measured it.

    A calibrated filter's coverage of an episode is 0.9 in expectation, however its steps hang together, so that someone
    who bets on less with a stake λ has on average no more than the one he came with after the episodes X_1, X_2, ...:

        Π (1 + λ (0.9 - X_i))

    The filter is overconfident when the mean of such fortunes over several stakes exceeds 1 / FALSE_ALARM, which luck
    achieves with at most that probability, whenever one looks; likewise overcautious. Where the reference is off by
    itself, the bet is against the reference's mean instead: nobody is blamed for what it does too.

    Parameters
    ----------
    episodes : list of Episode

    Returns
    -------
    Calibration or None

    References
    ----------
    I. Waudby-Smith, A. Ramdas, *Estimating means of bounded random variables by betting*, JRSS B 86, 2024.
    """
    pairs = [
        (episode.values[COVERAGE], episode.reference.get(COVERAGE, NOMINAL))
        for episode in episodes
        if COVERAGE in episode.values
    ]
    if not pairs:
        return None
    values, references = np.array(pairs).T
    least, most = min(NOMINAL, references.mean()), max(NOMINAL, references.mean())
    verdict = ""
    # No bet loses more than all. Products of hundreds of episodes overflow; their logarithms do not.
    with np.errstate(divide="ignore"):
        fortunes = np.log(np.maximum(1.0 + _STAKES[:, None] * (least - values), 0.0)).sum(axis=1)
        opposite = np.log(1.0 + values - most).sum()
    if np.logaddexp.reduce(fortunes) - np.log(len(_STAKES)) >= -np.log(FALSE_ALARM):
        verdict = "overconfident"
    elif opposite >= -np.log(FALSE_ALARM):
        verdict = "overcautious"
    return Calibration(COVERAGE, float(values.mean()), f"{references.mean():.2f}", verdict)


def consistency(episodes, dimension):
    """Mean NEES of Gaussian posteriors beside its chi-square bounds; None when there were none.

    The mean over independent episodes of one NEES each, times their number E, is chi-square distributed with E d
    degrees of freedom when the Gaussians are right. That of whole episodes varies less, by an unknown amount, so that
    the bounds are wide.

    Parameters
    ----------
    episodes : list of Episode
    dimension : int
        Columns of a state.

    Returns
    -------
    Calibration or None
    """
    values = [episode.values[NEES] for episode in episodes if NEES in episode.values]
    if not values:
        return None
    value, degrees = float(np.mean(values)), len(values) * dimension
    # Quantiles of chi-square are those of the gamma distribution of shape d / 2 and scale 2.
    low, high = 2.0 * gammaincinv(degrees / 2.0, [FALSE_ALARM, 1.0 - FALSE_ALARM]) / len(values)
    verdict = "overconfident" if value > high else "overcautious" if value < low else ""
    return Calibration(NEES, value, f"{low:.3g} to {high:.3g}", verdict)


def calibrations(variants, dimension):
    """What can be said of variants together: a list of `Calibration`; `dimension` as in `consistency`."""
    episodes = [episode for variant in variants for episode in variant.episodes]
    found = [coverage(episodes), consistency(episodes, dimension)]
    return [calibration for calibration in found if calibration]
