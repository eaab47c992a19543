"""The sample classes of the DR20 unit through the grader.

Each program is graded in one public run of the variant in which its fault shows most; two go through the command, in
every variant. Seeds are fixed: nothing here is left to chance.
"""

import pytest

from grader.reports.calibration import calibrations
from tests.sample_class import FOLDER, grade_by_command, opened_benches

#: Specimen to the variant that shows its fault, the most it may earn of its points, and the run, if not the first.
FAULTS = {
    "dr20-local": {
        "Ts_missing_in_y": ("default", 0.2),
        "beams_in_reverse": ("default", 0.2),
        "bearings_clockwise_from_left": ("default", 0.2),
        "bearings_in_world_frame": ("default", 0.2),
        "collapses_to_mean": ("noisy", 0.7),
        "control_ignored": ("fast", 0.2),
        "control_one_step_late": ("fast", 0.65),
        "walks_through_walls": ("default", 0.6, 1),
        "walls_are_unlikely": ("default", 0.6, 1),
        "gamed_certain": ("noisy", 0.7),
        "gamed_inflated": ("precise", 0.7),
        "gaussian_without_outliers": ("clutter", 0.2),
        "hard_coded_bearings": ("beams", 0.2),
        "hard_coded_map": ("flat", 0.2),
        "hard_coded_noise": ("noisy", 0.3),
        "hard_coded_robot": ("mount", 0.4),
        "hard_coded_sensor": ("clutter", 0.3, 1),
        "hard_coded_time_step": ("coarse", 0.2),
        "jitter_in_every_step": ("precise", 0.75),
        "likelihoods_summed": ("precise", 0.3),
        "mean_of_heading_arithmetic": ("noisy", 0.95),
        "missing_as_r_max": ("near-sighted", 0.2),
        "mount_ignored": ("mount", 0.45),
        "no_motion_noise": ("noisy", 0.2),
        "no_short_readings": ("clutter", 0.3, 1),
        "norm_as_weight": ("default", 0.2),
        "rays_backwards": ("default", 0.2),
        "resamples_before_weighting": ("default", 0.2),
        "same_noise_for_all": ("noisy", 0.2),
        "scan_one_step_late": ("fast", 0.5),
        "sigma_as_variance": ("noisy", 0.6),
        "sigma_squared_as_deviation": ("default", 0.2),
        "starts_all_over_the_room": ("flat", 0.6),
        "starts_on_half_the_circle": ("default", 0.2),
        "starts_with_heading_zero": ("default", 0.2),
        "state_order": ("default", 0.2),
        "too_few_particles": ("default", 0.65),
        "turns_clockwise": ("fast", 0.2),
        "walls_without_ends": ("flat", 0.2),
        "weights_inverse_distance": ("precise", 0.75),
        "weights_inverted": ("default", 0.2),
        "weights_kept_after_resampling": ("default", 0.2),
        "yaw_noise_in_degrees": ("noisy", 0.2),
    },
    "dr20-global": {
        "collapses_to_best": ("default", 0.9),
        "gaussian_without_outliers": ("clutter", 0.3),
        "likelihoods_summed": ("default", 0.5),
        "source_weights_and_jitter": ("default", 0.5),
        "starts_in_the_middle": ("default", 0.2),
        "starts_on_half_the_circle": ("default", 0.2),
        "too_few_particles": ("default", 0.65),
    },
    "dr20-kidnapped": {
        "alphas_swapped": ("twice", 0.2),
        "average_of_normalised_weights": ("twice", 0.2),
        "averages_from_zero": ("twice", 0.8),
        "averages_reset": ("twice", 0.5),
        "collapses_to_best": ("twice", 0.97),
        "fair_textbook": ("twice", 0.5),
        "injected_on_half_the_circle": ("twice", 0.95),
        "likelihoods_summed": ("twice", 0.5),
        "plain_mcl": ("twice", 0.2),
        "source_augmented": ("twice", 0.4),
    },
}
#: What breaks everywhere: the status, and a word of its line.
BROKEN = {
    "dr20-local": {
        "all_weights_zero": ("crashed", "one of them positive"),
        "missing_as_reading": ("invalid posterior", "NaN"),
        "wrong_shape": ("invalid posterior", "transpose"),
    },
    "dr20-global": {},
    "dr20-kidnapped": {},
}
#: What is right, or nearly: the variant in which it is graded, and the least it earns.
RIGHT = {
    "dr20-local": {
        "fair_likelihood_field": ("near-sighted", 0.8),
        "fair_missing_left_out": ("near-sighted", 0.9),
        "fair_textbook": ("noisy", 0.8),
        "good_heading_unwrapped": ("fast", 0.9),
        "good_kld": ("default", 0.8),
    },
    "dr20-global": {
        "fair_gaussian": ("default", 0.8),
        "fair_noise_as_told": ("default", 0.8),
        "fair_starts_in_tables": ("default", 0.8),
        "good_kld": ("default", 0.8),
        "good_plain": ("default", 0.9),
    },
    "dr20-kidnapped": {"good_augmented": ("twice", 0.9), "good_mixture": ("twice", 0.8)},
}
#: What goes through the command, in every variant: what it earns at least and at most, of all there is but for time.
CLASS = {"dr20-local": {"good_plain": (0.85, 1.0), "source_weights_and_jitter": (0.0, 0.4)}}


@pytest.fixture(scope="module")
def benches():
    """One bench per assignment."""
    with opened_benches() as bench:
        yield bench


@pytest.fixture(scope="module")
def graded(tmp_path_factory):
    """Results by assignment and name, and the report, from the command."""
    return {name: grade_by_command(name, specimens, tmp_path_factory.mktemp(name)) for name, specimens in CLASS.items()}


def test_every_specimen_is_graded_here():
    for name in FAULTS:
        there = {path.stem for path in (FOLDER / name).glob("*.py")}
        assert there == FAULTS[name].keys() | BROKEN[name].keys() | RIGHT[name].keys() | CLASS.get(name, {}).keys()


@pytest.mark.parametrize(("name", "specimen"), [(n, s) for n, class_ in CLASS.items() for s in class_])
def test_the_class_is_told_apart(graded, name, specimen):
    result = graded[name][0][specimen]
    least, most = CLASS[name][specimen]
    earned, there = sum(v.points for v in result.variants), sum(v.max_points for v in result.variants)
    assert least <= earned / there <= most + 1e-9, result.message
    if specimen.startswith("good"):
        assert result.speed.points == result.speed.max_points
        assert not any(calibration.verdict for calibration in calibrations(result.variants, 3))


def test_the_report_draws_the_map(graded):
    for _, page in graded.values():
        assert '"rings": [[[' in page


@pytest.mark.parametrize(("name", "specimen"), [(n, s) for n, right in RIGHT.items() for s in right])
def test_what_is_right_earns_what_there_is(benches, name, specimen):
    variant, least = RIGHT[name][specimen]
    outcome, share = benches(name).grade(specimen, variant)
    assert share >= least, f"{share:.3f} of the points of {variant}: {outcome.values or outcome.message}"


@pytest.mark.parametrize(("name", "specimen"), [(n, s) for n, faults in FAULTS.items() for s in faults])
def test_each_fault_costs_points_where_it_shows(benches, name, specimen):
    variant, most, *episode = FAULTS[name][specimen]
    outcome, share = benches(name).grade(specimen, variant, *episode)
    assert share <= most, f"{share:.3f} of the points of {variant}: {outcome.values or outcome.message}"


@pytest.mark.parametrize(("name", "specimen"), [(n, s) for n, broken in BROKEN.items() for s in broken])
def test_what_breaks_has_its_line(benches, name, specimen):
    status, words = BROKEN[name][specimen]
    outcome, share = benches(name).grade(specimen, "clutter")
    assert outcome.status == status and words in outcome.message and "\n" not in outcome.message
    assert outcome.values == {} and share == 0.0
