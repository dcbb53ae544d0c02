"""Lags far above the resonance: a recording has the frequency, damping and bandwidth that the truth states.

What is realised is where a refit of an independent computation, 20 times finer, to the plant's recording ends.
"""

import numpy as np
import pytest

from experiments.concealed_rig.effects.drive import AmplifierBandwidth
from experiments.concealed_rig.effects.electronics import DriveResonance
from experiments.concealed_rig.effects.sensing import SensorBandwidth
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.head import drawn_head
from experiments.concealed_rig.linear import filtered
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.plant import Plant, noise_free
from experiments.concealed_rig.play import play_sum_V, smooth_play_sum_V

HEAD = drawn_head(np.random.default_rng(2))
SAMPLES, STEP_S = 360, 1 / HEAD.resonance_Hz / 50
CORNERS, LEVELS_V = np.array([20, 24, 60, 68, 100, 103]), np.array([0.0, 85.0, 85.0, -60.0, -60.0, 0.0])
ROW = Measurement("self_sensing", "bipolar", "demagnetised", STEP_S, np.interp(np.arange(SAMPLES), CORNERS, LEVELS_V))


def ramp_answer(t, w, zeta, lead):
    """Of (1 + lead·s)/(s²/w² + 2ζs/w + 1) to a ramp from t = 0."""
    late, fast = np.maximum(t, 0.0), w * np.sqrt(1 - zeta**2)
    fade, cos, sin = np.exp(-zeta * w * late), np.cos(fast * late), np.sin(fast * late)
    ramp = late - 2 * zeta / w + fade * (2 * zeta / w * cos + (2 * zeta**2 - 1) / fast * sin)
    step = 1 - fade * (cos + zeta * w / fast * sin)
    return np.where(t > 0, ramp + lead * step, 0.0)


def recorded(frequency_Hz, zeta, variant):
    """The recording: lag in closed form, plays one by one, resonator exact for straight lines; steps of 1/320 ringing.

    The second section of a ladder is exact for straight lines too.
    """
    finer = int(np.ceil(320 * frequency_Hz * STEP_S))
    t = np.arange((SAMPLES - 1) * finer + 1) * (STEP_S / finer)
    slopes = np.concatenate(([0.0], np.diff(LEVELS_V) / np.diff(CORNERS * STEP_S), [0.0]))
    w = 2 * np.pi * frequency_Hz
    lead = 2 * zeta / w if variant == "ferrite" else 0.0
    late = (ramp_answer(t - k * STEP_S, w, zeta, lead) for k in CORNERS)
    drive = sum(bend * answer for bend, answer in zip(np.diff(slopes), late, strict=True))
    if variant == "ladder":
        drive = filtered([1.0], [1 / (1.7 * w) ** 2, 2 * zeta / (1.7 * w), 1.0], drive, t[1], False)
    hysteretic = HEAD.reversible * drive + play_sum_V(drive, *HEAD.plays(), False)
    sensor = filtered([HEAD.b1_per_s, 0.0], [1.0, HEAD.a1_per_s, HEAD.a0_per_s2], hysteretic, t[1], False)
    return sensor[::finer] + HEAD.self_sensing_offset_V


def realised(recording, computed, *stated, step=0.01):
    """Relative errors of the parameters, in their order."""
    columns = []
    for k in range(len(stated)):
        up, down = ([p * (1 + s) if i == k else p for i, p in enumerate(stated)] for s in (step, -step))
        columns.append((computed(*up) - computed(*down)) / (2 * step))
    return np.linalg.lstsq(np.stack(columns, axis=1), recording - computed(*stated), rcond=None)[0]


@pytest.mark.parametrize("variant", ["series", "ladder", "ferrite"])
@pytest.mark.parametrize(("ratio", "zeta"), [(15, 0.02), (40, 0.12), (90, 0.03), (220, 0.08)])
def test_a_drive_rings_at_its_frequency_and_fades_with_its_damping(variant, ratio, zeta):
    effect = DriveResonance(1 / ratio, variant=variant, resonance_Hz=HEAD.resonance_Hz, damping_ratio=zeta)
    stated = effect.parameters()
    errors = realised(
        noise_free(Plant(HEAD, (effect,)), ROW),
        lambda f, z: recorded(f, z, variant),
        stated["frequency_Hz"],
        stated["damping_ratio"],
    )
    assert abs(errors[0]) < 1e-3
    assert abs(errors[1]) < 1e-2


@pytest.mark.parametrize("ratio", [30, 450])
def test_an_amplifier_has_its_bandwidth(ratio):
    effect = AmplifierBandwidth(1 / ratio, variant="second_order", resonance_Hz=HEAD.resonance_Hz)
    recording = noise_free(Plant(HEAD, (effect,)), ROW)
    (error,) = realised(recording, lambda f: recorded(f, 0.7, "series"), effect.parameters()["bandwidth_Hz"])
    assert abs(error) < 1e-3


@pytest.mark.parametrize("ratio", [20, 500, 2000])
def test_a_sensing_amplifier_delays_and_lowers_a_tone_by_its_bandwidth(ratio):
    """Of what it takes away; left: straight lines between points eight times as close as the steps."""
    grid, bandwidth = Grid(1600, 1 / HEAD.resonance_Hz / 160, 1, True), ratio * HEAD.resonance_Hz
    tone = np.sin(2 * np.pi * np.arange(1601) / 160)
    effect = SensorBandwidth(1 / ratio, variant="first_order", resonance_Hz=HEAD.resonance_Hz)
    out = effect.on_sensor(tone, np.zeros(3201), ROW, grid)[:-1]
    taken = 1 - 2j * np.mean(out * np.exp(-2j * np.pi * np.arange(1600) / 160))
    expected = 1 - 1 / (1 + 1j * HEAD.resonance_Hz / bandwidth)
    assert abs(taken / expected - 1) < 5e-3


@pytest.mark.parametrize("periodic", [False, True])
def test_plays_see_where_a_smooth_drive_turns_between_its_points(periodic):
    """A ringing of 16 points a period: points alone miss up to 2e-2 of it, (π/16)²/2, and parabolas 5e-4."""
    t = np.arange(480 * 40 + 1) / 40
    fine = 50 * np.sin(2 * np.pi * t / 480) + 8 * np.sin(np.pi * t / 480) ** 2 * np.sin(2 * np.pi * t / 16.1)
    exact = play_sum_V(fine, *HEAD.plays(), periodic)[::40]
    missed, left = (summed(fine[::40], *HEAD.plays(), periodic) - exact for summed in (play_sum_V, smooth_play_sum_V))
    assert np.max(np.abs(left)) < 0.1 * np.max(np.abs(missed))


@pytest.mark.parametrize("periodic", [False, True])
def test_branches_are_the_plays_even_of_a_drive_that_fades_to_nothing(periodic):
    """Each value twice, so that there is no parabola: left is rounding. The first ringing fades to 1e-320 V."""
    k = np.arange(3000)
    ringing = 30 * np.exp(-k / 4) * np.sin(k)
    drive = np.repeat(np.concatenate((ringing, 80 * np.sin(k / 300) * np.cos(k / 7), ringing[::-1])), 2)
    plain, smooth = (summed(drive, *HEAD.plays(), periodic) for summed in (play_sum_V, smooth_play_sum_V))
    np.testing.assert_allclose(smooth, plain, rtol=0, atol=1e-11)
