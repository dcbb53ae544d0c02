"""The concealed rig answers requests: the campaign stays as it is, and what follows it is the same head's."""

from contextlib import suppress

import numpy as np
import pytest

from inkjet_env.experiments.proof.answering import ConcealedRig, continued_campaign, requests_of
from inkjet_env.experiments.proof.campaign_files import unpack
from inkjet_env.experiments.proof.concealment import conceal, plant_of
from inkjet_env.experiments.proof.corpus import IDS, MOST_ATTEMPTS, SLOW, VERSION, Draw
from inkjet_env.recordings import read_campaign


def request_of(plant, channel="self_sensing", repeats=1, monitor=False):
    """A pulse at the step of the campaign's first recording of a channel."""
    row = next(row for row in plant.setup.rows if row.channel == channel)
    drive = np.zeros(600)
    drive[50:90] = 30.0
    return {
        "channel": channel, "initial_state": "periodic", "step_s": row.step_s, "drive_V": drive.tolist(),
        "neighbour_V": None, "repeats": repeats, "drive_monitor": monitor,
    }  # fmt: skip


def continued(draw, requests, tmp_path, attempt=0):
    plant = plant_of(draw, attempt)
    unpack(continued_campaign(plant, [r(plant) for r in requests], "head-0"), tmp_path / "head-0")
    return plant, read_campaign(tmp_path / "head-0")


def test_the_campaign_stays_byte_for_byte_and_answers_follow(tmp_path):
    draw = Draw(7, "effect", ("trigger_delay",), "strong", True, 3, "white")
    made = conceal(draw, "head-0")
    unpack(made.packed, tmp_path / "before")
    requests = [lambda p: request_of(p, repeats=2), lambda p: request_of(p, monitor=True)]
    plant, campaign = continued(draw, requests, tmp_path, made.attempt)
    for file in (tmp_path / "before").glob("*.csv"):
        assert (tmp_path / "head-0" / file.name).read_bytes() == file.read_bytes()
    *_, first, second, third = campaign.recordings
    assert len(campaign.recordings) == len(plant.setup.rows) + 3
    assert (first.repeat_of, second.repeat_of, third.repeat_of) == (None, first.name, None)
    assert [r.order for r in (first, second, third)] == [len(plant.setup.rows) + k for k in (1, 2, 3)]
    assert second.drive_monitor_V is None or plant.setup.instruments.monitor is not None
    assert third.drive_monitor_V is not None
    true = plant.response(first.drive_V, first.step_s)
    sigma = plant.setup.instruments.sigma["self_sensing"]
    noise = [r.sensor - true for r in (first, second)]
    assert all(0.3 * sigma < np.std(one) < 3 * sigma for one in noise)
    assert abs(np.corrcoef(*noise)[0, 1]) < 0.3  # each answer has its own


def built(draw):
    """The concealed plant of the first attempt that is physically possible."""
    for attempt in range(MOST_ATTEMPTS):
        with suppress(ValueError):
            return plant_of(draw, attempt)
    raise AssertionError(draw)


@pytest.mark.parametrize("effect", IDS[VERSION])
def test_every_effect_goes_on_after_the_last_recording(effect):
    plant = built(Draw(11, "effect", (effect,), "strong", effect not in SLOW, 5, "white"))
    rig = ConcealedRig(plant)
    ((request, order, _),) = requests_of([request_of(plant, monitor=True)], len(plant.setup.rows) + 1)
    recording = rig.record(request, order)
    assert recording.order == len(plant.setup.rows) + 1
    assert np.isfinite(recording.sensor).all()
    assert np.ptp(recording.sensor) > 0
    assert np.isfinite(recording.drive_monitor_V).all()
