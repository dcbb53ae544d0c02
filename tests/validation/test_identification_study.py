import numpy as np
import pytest

from inkjet_env.experiments.validation.identification_study import (
    PARAMETERS,
    held_out_errors,
    identified_heads,
    main,
    measured_pieces,
    paper_branch_law,
    published_loop,
    unit_response,
)
from inkjet_env.printhead import Printhead, respond_sampled
from inkjet_env.recordings import Recording
from tests.real_data import REAL_DATA

MEASURED = REAL_DATA / "piezo-actuator"


@pytest.fixture(scope="module")
def alone():
    """The published head identified from a single loop, and that loop."""
    return published_loop()


def test_one_loop_of_the_published_head_needs_degree_eight_and_gives_its_law_back(alone):
    found, loop = alone
    assert np.ptp(loop.drive_V) == pytest.approx(180)
    assert found.degree.by_flattening == 8
    x = np.linspace(0, 1, 101)
    difference = found.printhead.branch_law.Q(x) - Printhead.published().branch_law.Q(x)
    assert np.abs(difference).max() < 1e-3  # the paper reaches 2e-2
    recording = next(r for r in found.recordings if r.channel == "strain_gauge")
    assert recording.rms() < 2e-3 * np.ptp(recording.measured)


def test_random_heads_are_found_again():
    results = identified_heads(2, workers=1)
    errors = np.median([r.errors for r in results], axis=0)
    assert (errors < [1e-3, 5e-3, 5e-3]).all(), dict(zip(PARAMETERS, errors, strict=True))
    assert max(r.held_out_ratio for r in results) < 1.05


def test_the_peers_are_simulated_as_they_should_be():
    head, step_s = Printhead.published(), 2e-7
    time_s = step_s * np.arange(600)
    drive_V = np.interp(time_s, [0, 1e-5, 1.2e-5, 3e-5, 3.3e-5, 2e-4], [0, 0, 50, 50, 0, 0])
    linear = Printhead(head.a0, head.a1, 1.0, (1.0, 0.0))
    for state, ringing in (("demagnetised", "rest"), ("periodic", "steady")):
        recording = Recording("r", time_s, drive_V, 0 * time_s, "V", "self_sensing", initial_state=state)
        ours = respond_sampled(linear, time_s, drive_V, state, ringing=ringing).sensor_V
        theirs = unit_response(head.a0, head.a1, drive_V, recording)
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=2e-6 * np.abs(ours).max())


def test_the_papers_polynomial_is_the_published_one(alone):
    _, loop = alone
    law, truth = paper_branch_law(loop), Printhead.published().branch_law
    x = np.linspace(0, 1, 101)
    assert np.abs(law.Q(x) - truth.Q(x) / truth.Q(1)).max() < 2e-3


def test_held_out_recordings_are_predicted_better_than_by_either_peer():
    errors = held_out_errors()
    assert errors["this package"] == pytest.approx(errors["noise"], rel=0.05)
    assert errors["the paper: one-point Q, then linear fit"] > 3 * errors["this package"]
    assert errors["linear fit, no hysteresis"] > 20 * errors["this package"]


@pytest.mark.skipif(not MEASURED.is_dir(), reason=f"measured recordings are not here: {MEASURED}")
def test_the_measured_actuator_is_cut_where_it_repeats_and_told_in_micrometres(capsys):
    pieces = measured_pieces(MEASURED)
    assert [r.initial_state for r in pieces.recordings] == ["demagnetised", "periodic", "periodic", "periodic"]
    assert pieces["ring-down"].drive_V[283] == 0 != pieces["ring-down"].drive_V[284]
    main(["measured", str(MEASURED)])
    told = capsys.readouterr().out
    assert "period-3: 0.1" in told
    assert "um held out" in told
    assert "ring-down: 0.2" in told  # alone, where nothing tells how far the law swings
