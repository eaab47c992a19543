"""What every unit's filters share: arrays in, arrays out."""

from course_lib.filters.bootstrap import (
    ZeroLikelihoodError,
    bootstrap_step,
    predict,
    resample,
    roughen,
    update,
)
from course_lib.filters.particles import (
    Gaussian,
    Particles,
    Step,
    covariance,
    effective_sample_size,
    entropy,
    equally_weighted,
    mean,
    mode,
    normalise,
)
from course_lib.filters.resampling import multinomial, residual, stratified, systematic

__all__ = [
    "Gaussian",
    "Particles",
    "Step",
    "ZeroLikelihoodError",
    "bootstrap_step",
    "covariance",
    "effective_sample_size",
    "entropy",
    "equally_weighted",
    "mean",
    "mode",
    "multinomial",
    "normalise",
    "predict",
    "resample",
    "residual",
    "roughen",
    "stratified",
    "systematic",
    "update",
]
