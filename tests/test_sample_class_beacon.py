"""The sample classes of the beacon unit through the grader.

Each fault is graded in the variant in which it shows most: all of them, in every variant, take many minutes
(`grader grade tests/submissions/beacon-ekf --assignment beacon-ekf`). A few go through the command, in every variant.
Episodes are the public ones, so that nothing here is left to chance but a planner's wall clock.
"""

import numpy as np
import pytest

from course_lib.beacon import ekf, models
from grader.assignment import PUBLIC_SECRET
from grader.assignments import assignments
from grader.grading.evaluate import as_particles, measured, recorded_run
from tests.sample_class import FOLDER, grade_by_command, opened_benches

#: Specimen to the variant that shows its fault, and the most it may earn of that variant's points.
FAULTS = {
    "beacon-ekf": {
        "R_and_Q_swapped": ("noisy", 0.1),
        "beacon_2_with_rho_1": ("precise", 0.1),
        "beacons_2_and_4_swapped": ("default", 0.1),
        "beacons_at_the_ceiling": ("tower", 0.3),
        "bearing_clockwise": ("default", 0.1),
        "bearing_in_world_frame": ("default", 0.1),
        "bearing_unwrapped": ("behind", 0.1),
        "control_one_step_late": ("calm", 0.7),
        "corrects_before_predicting": ("calm", 0.1),
        "covariance_never_corrected": ("storm", 0.2),
        "covariance_not_propagated": ("default", 0.1),
        "covariance_of_the_mean_alone": ("storm", 0.3),
        "deviation_for_variance": ("precise", 0.5),
        "drops_incomplete_steps": ("dead", 0.1),
        "gamed_certain": ("calm", 0.4),
        "gamed_inflated": ("precise", 0.6),
        "gusts_by_time_squared": ("precise", 0.5),
        "hard_coded_room": ("hall", 0.1),
        "hard_coded_sensors": ("noisy", 0.3),
        "hard_coded_time_step": ("storm", 0.5),
        "horizontal_ranges": ("tower", 0.4),
        "identity_prior": ("outages", 0.4),
        "innovation_covariance_of_old_P": ("storm", 0.1),
        "inputs_noise_forgotten": ("shaky", 0.4),
        "inputs_variance_squared": ("shaky", 0.5),
        "jacobian_sign_far_corners": ("default", 0.1),
        "missing_as_zero": ("default", 0.1),
        "no_gusts": ("storm", 0.3),
        "no_thrust": ("default", 0.1),
        "overcautious_Q": ("default", 0.75),
        "overcautious_R": ("shaky", 0.5),
        "overconfident_R": ("alone", 0.1),
        "pseudo_measurements": ("precise", 0.1),
        "pseudo_with_unguarded_root": ("corner", 0.1),
        "pseudo_with_wrong_height": ("precise", 0.1),
        "sigma_alpha_converted_twice": ("default", 0.1),
        "starts_in_the_middle": ("corner", 0.1),
        "state_order": ("default", 0.5),
        "yaw_left_out": ("two", 0.1),
    },
    "beacon-pf": {
        "beacon_2_with_rho_1": ("two", 0.1),
        "bearing_in_world_frame": ("default", 0.1),
        "bearing_unwrapped": ("default", 0.1),
        "bootstrap": ("default", 0.1),
        "collapses_to_mean": ("two", 0.2),
        "control_one_step_late": ("precise", 0.75),
        "drops_incomplete_steps": ("hurricane", 0.1),
        "gusts_by_time_squared": ("two", 0.1),
        "hard_coded_room": ("tower", 0.1),
        "hard_coded_sensors": ("faint", 0.1),
        "horizontal_ranges": ("tower", 0.4),
        "innovation_norm": ("hurricane", 0.6),
        "inputs_variance_as_deviation": ("precise", 0.8),
        "jitter_in_every_step": ("drawn sensors", 0.2),
        "kernel_of_the_variance": ("precise", 0.1),
        "kernel_without_correlations": ("hurricane", 0.6),
        "kernel_without_shrinkage": ("faint", 0.6),
        # It forgets where few steps pass without resampling, and averages wrongly where few are near half a turn.
        "last_weights_forgotten": ("faint", 0.95),
        "mean_of_yaw_arithmetic": ("behind", 0.95),
        "no_gusts": ("two", 0.1),
        "no_process_noise": ("precise", 0.1),
        "one_innovation_for_all": ("wide", 0.4),
        "prior_counted_twice": ("hurricane", 0.75),
        "resamples_by_nothing": ("hurricane", 0.1),
        "same_noise_for_all": ("precise", 0.1),
        "sigma_not_squared": ("two", 0.6),
        "starts_all_over_the_room": ("precise", 0.1),
        "starts_sure": ("precise", 0.1),
        "too_few_particles": ("two", 0.1),
        "weights_for_logarithms": ("hurricane", 0.75),
        "weights_inverted": ("precise", 0.1),
        "weights_kept_after_resampling": ("precise", 0.1),
        "weights_without_half": ("hurricane", 0.6),
    },
    "beacon-rrt": {
        "straight_to_the_goal": ("window", 0.0),
        "cuts_corners": ("corridor", 0.0),
        "flat_obstacles": ("window", 0.0),
        "ignores_the_radius": ("window", 0.0),
        "looks_at_ends_only": ("window", 0.0),
        "no_margin": ("clutter", 0.5),
        "no_feedback": ("open", 0.0),
        "hard_coded_vehicle": ("large", 0.0),
        "ignores_yaw": ("open", 0.0),
        "crashes_without_a_path": ("windows", 0.0),
        "source_rrt": ("open", 0.0),
        "stops_short": ("open", 0.0),
        "thrusts_about_hover": ("open", 0.0),
    },
}
#: What breaks everywhere: the status, and a word of its line.
BROKEN = {
    "beacon-ekf": {
        "covariance_multiplied_backwards": ("invalid posterior", "not symmetric"),
        "joseph_minus": ("invalid posterior", "negative eigenvalue"),
        "gain_without_its_denominator": ("invalid posterior", ""),
        "missing_as_reading": ("invalid posterior", "NaN"),
        "returns_none": ("invalid posterior", ""),
    },
    "beacon-pf": {
        "wrong_shape": ("invalid posterior", "transpose"),
        "missing_as_reading": ("invalid posterior", "NaN"),
    },
    "beacon-rrt": {
        "accelerations_for_thrusts": ("invalid action", "shape (4,)"),
        "returns_nan": ("invalid action", "NaN"),
        "thinks_too_long": ("timeout", "longer than"),
        "never_leaves": ("not arrived", "time is up"),
    },
}
#: What is right, or nearly: two variants in which that is hardest, and the least it earns of each one's points.
RIGHT = {
    "beacon-ekf": {
        "good_filterpy": (("storm", "corner"), 1.0),
        "good_iterated": (("storm", "alone"), 0.9),
        "good_one_at_a_time": (("storm", "alone"), 0.9),
        "good_ukf": (("storm", "alone"), 0.9),
        "good_unwrapped_mean": (("storm", "behind"), 1.0),
    },
    "beacon-pf": {
        "good_library": (("precise", "hurricane"), 0.9),
        "good_tempered": (("yaw", "hurricane"), 0.9),
        "fair_roughened": (("precise", "tower"), 0.8),
    },
    "beacon-rrt": {"fair_tree_of_flights": (("window", "pillars"), 0.9)},
}
#: What goes through the command, in every variant: what it earns at least and at most, of all there is but for time.
CLASS = {
    "beacon-ekf": {
        "good_plain": (1.0, 1.0),
        "slow_from_the_start": (1.0, 1.0),
        "yaw_left_out": (0.3, 0.6),
    },
    "beacon-pf": {"good_plain": (0.95, 1.0), "slow_python_loop": (0.95, 1.0)},
    "beacon-rrt": {"good_plain": (0.95, 1.0), "straight_to_the_goal": (0.06, 0.06)},
}
SLOW = {"slow_from_the_start", "slow_python_loop"}


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
    for name in CLASS:
        there = {path.stem for path in (FOLDER / name).glob("*.py")}
        assert there == FAULTS[name].keys() | BROKEN[name].keys() | RIGHT[name].keys() | CLASS[name].keys()


@pytest.mark.parametrize(("name", "specimen"), [(n, s) for n, class_ in CLASS.items() for s in class_])
def test_the_class_is_told_apart(graded, name, specimen):
    result = graded[name][0][specimen]
    least, most = CLASS[name][specimen]
    earned, there = sum(v.points for v in result.variants), sum(v.max_points for v in result.variants)
    assert least - 1e-9 <= earned / there <= most + 1e-9, result.message
    if result.speed and specimen.startswith("good"):
        assert result.speed.points == result.speed.max_points
    if specimen in SLOW:
        assert result.speed.points < 0.95 * result.speed.max_points


@pytest.mark.parametrize(("name", "specimen"), [(n, s) for n, right in RIGHT.items() for s in right])
def test_what_is_right_earns_what_there_is(benches, name, specimen):
    variants, least = RIGHT[name][specimen]
    for variant in variants:
        outcomes, share = benches(name).grade_round(specimen, variant)
        assert share >= least - 1e-9, f"{share:.3f} of the points of {variant}: {[each.values for each in outcomes]}"


@pytest.mark.parametrize(("name", "specimen"), [(n, s) for n, faults in FAULTS.items() for s in faults])
def test_each_fault_costs_points_where_it_shows(benches, name, specimen):
    variant, most = FAULTS[name][specimen]
    outcomes, share = benches(name).grade_round(specimen, variant)
    assert share <= most, f"{share:.3f} of the points of {variant}: {[outcome.values for outcome in outcomes]}"


@pytest.mark.parametrize(("name", "specimen"), [(n, s) for n, broken in BROKEN.items() for s in broken])
def test_what_breaks_has_its_line(benches, name, specimen):
    status, words = BROKEN[name][specimen]
    outcomes, share = benches(name).grade_round(specimen, {"beacon-rrt": "open"}.get(name, "outages"))
    for outcome in outcomes:
        assert outcome.status == status and words in outcome.message and "\n" not in outcome.message
        assert outcome.values == {} and share == 0.0


def test_landmarks_are_what_these_filters_achieve():
    assignment = assignments()["beacon-ekf"].under(PUBLIC_SECRET)
    variant = assignment.variant("default")

    def mended(gaussian, observation, control):
        return ekf.source_step(gaussian, observation, control, variant.constants, ekf.ALL).posterior

    def blind(gaussian, observation, control):
        return ekf.predict(gaussian, control, variant.constants)

    for step, (value, _) in zip((mended, blind), assignment.landmarks["energy score"], strict=True):
        scores = []
        for episode in range(8):
            run, rng = recorded_run(assignment, variant, episode, PUBLIC_SECRET), np.random.default_rng(episode)
            gaussian = models.prior(variant.constants)
            for k in range(run.steps + 1):
                if k > 0:
                    gaussian = step(gaussian, run.observations[k - 1], run.controls[k - 1])
                particles = as_particles(gaussian, assignment.angles, k, rng)
                scores.append(measured(assignment, particles, run.truth[k], k, rng)["energy score"])
        assert np.isclose(np.mean(scores), value, rtol=0.05)
