"""The zoo of noise: as loud as is said, the same physics at every sampling rate, and never a law."""

import numpy as np
import pytest

from experiments.concealed_rig import Case, build
from experiments.concealed_rig.converter import converted
from experiments.concealed_rig.noise import Colour, Noise, noise_row
from experiments.concealed_rig.noise_kinds import NOISES, RECORDING, drawn_colours, drawn_noise

STEP_S = 4e-7
SILENCE = np.zeros(RECORDING)


def covariance(colour, lag_s):
    """Of the colour's samples at a lag, as its sampled recursion has it."""
    step, _, start = colour.sampled(lag_s)
    return (step @ start @ start.T)[0, 0]


@pytest.mark.parametrize("lag_s", [1e-7, 1e-6, 2e-5])
def test_a_memory_fades_with_its_time_and_a_bump_rings_whatever_the_sampling_rate(lag_s):
    """Covariances of autoregressions of first and second order in continuous time, in closed form."""
    assert covariance(Colour(1.0, (-1 / 3e-5 + 0j,)), lag_s) == pytest.approx(np.exp(-lag_s / 3e-5), rel=1e-12)
    a, b = 5e4, 6e5
    ringing = np.exp(-a * lag_s) * (np.cos(b * lag_s) + a / b * np.sin(b * lag_s))
    assert covariance(Colour(1.0, (-a + 1j * b, -a - 1j * b)), lag_s) == pytest.approx(ringing, abs=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_recursion_at_half_the_interval_taken_twice_is_the_recursion(order):
    kind = ("first_order", "second_order", "third_order", "fourth_order")[order - 1]
    (colour,) = drawn_colours(kind, STEP_S, np.random.default_rng(order))
    assert len(colour.poles_per_s) == order
    (whole, _, start), (half, _, _) = colour.sampled(STEP_S), colour.sampled(STEP_S / 2)
    np.testing.assert_allclose(np.linalg.eigvals(whole).prod(), np.linalg.eigvals(half).prod() ** 2, rtol=1e-9)
    assert (start @ start.T)[0, 0] == pytest.approx(1.0, rel=1e-12)
    rows = [colour.row(400, STEP_S, np.random.default_rng(k)) for k in range(400)]
    assert np.mean(np.square(rows)) == pytest.approx(1.0, abs=0.05)
    lagged = np.mean([row[1:] * row[:-1] for row in rows])
    assert lagged == pytest.approx(covariance(colour, STEP_S), abs=0.05)


@pytest.mark.parametrize("kind", NOISES)
def test_every_kind_is_as_loud_as_it_says(kind):
    """Over many draws; the tails of Student's t and few spikes are the widest."""
    signal = 3 * np.sin(np.arange(RECORDING) / 20)
    reference = float(np.mean((signal - np.median(signal)) ** 2))
    ratios = []
    for k in range(120):
        rng = np.random.default_rng([k, NOISES.index(kind)])
        noise, converter = drawn_noise(kind, "self_sensing", 2.0, 4.0, reference, rng)
        row = noise_row(noise, signal, STEP_S, rng)
        whole = converted(signal + row, converter) - signal if noise.rounding_share else row
        ratios.append(np.mean(whole**2) / noise.sigma**2)
        assert 0.999 * 2.0 * 10 ** (-60 / 20) < noise.sigma < 2.0 * 10 ** (-35 / 20)  # eight bits are the loudest
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("kind", NOISES)
def test_no_kind_is_a_line_or_a_drift(kind):
    """A pole's phase is lost within a fifth of a recording if it rings, and within a recording if it does not."""
    for k in range(40):
        for colour in drawn_colours(kind, STEP_S, np.random.default_rng(k)):
            for pole in colour.poles_per_s:
                memory = -1 / pole.real / STEP_S
                assert 0 < memory <= RECORDING * (1 + 1e-9)
                if pole.imag:
                    assert memory < RECORDING / 5


def test_one_over_f_noise_falls_by_ten_in_power_a_decade():
    colours = drawn_colours("flicker", STEP_S, np.random.default_rng(1))
    share = colours[0].share
    spectrum = []
    for f in (2e3, 2e4, 2e5):  # exact sum of Lorentzians
        w = 2 * np.pi * f
        spectrum.append(sum(share * 2 * -p.real / (p.real**2 + w**2) for c in colours for p in c.poles_per_s))
    ratios = np.array(spectrum[:-1]) / np.array(spectrum[1:])
    np.testing.assert_allclose(ratios, 10.0, rtol=0.12)


def test_a_level_follows_the_signal_or_the_recording():
    signal = np.concatenate((np.zeros(20000), np.full(20000, 2.0), np.full(20000, -2.0)))
    grows = Noise(0.1, growth=0.8, reference=4.0)
    row = noise_row(grows, signal, STEP_S, np.random.default_rng(0))
    quiet, loud = np.std(row[:20000]), np.std(row[20000:])
    assert quiet == pytest.approx(0.1 * np.sqrt(0.2), rel=0.03)
    assert loud == pytest.approx(0.1, rel=0.03)
    spread = Noise(0.1, spread=0.5)
    levels = [np.log(np.std(noise_row(spread, SILENCE, STEP_S, np.random.default_rng(k)))) for k in range(300)]
    assert np.std(levels) == pytest.approx(0.5, rel=0.12)


def test_tails_and_spikes_are_heavier_than_normal():
    def kurtosis(noise):
        row = noise_row(noise, np.zeros(200_000), STEP_S, np.random.default_rng(3))
        return np.mean(row**4) / np.mean(row**2) ** 2

    assert kurtosis(Noise(1.0)) == pytest.approx(3.0, abs=0.1)
    assert kurtosis(Noise(1.0, tail_freedom=4.5)) > 5
    assert kurtosis(Noise(1.0, spikes_per_s=1e-3 / STEP_S, spike_size=10.0)) > 8


def test_a_cases_kind_of_noise_is_the_one_asked_and_the_truth_says_so():
    built = build(Case(4, 60, meagre=True, noise="dithered_rounding"))
    truth = built.truth()
    assert truth["noise"] == "dithered_rounding"
    assert truth["instruments"]["self_sensing"]["noise"]["kind"] == "dithered_rounding"
    assert truth["instruments"]["self_sensing"]["converter_bits"] in (8, 10, 12)
    kinds = {Case(k, 61).noise_kind for k in range(200)}
    assert kinds == set(NOISES)
    with pytest.raises(ValueError, match="noise must be one of"):
        Case(0, 0, noise="hum")


def test_other_noise_changes_neither_head_nor_drives_nor_what_is_concealed():
    one, other = (build(Case(5, 62, "effect", ("creep",), "strong", True, noise=n)) for n in ("white", "bumps"))
    assert one.plant.head == other.plant.head
    assert one.plant.effects[0].variant == other.plant.effects[0].variant
    for a, b in zip(one.setup.rows, other.setup.rows, strict=True):
        np.testing.assert_array_equal(a.drive_V, b.drive_V)


def test_slow_only_is_the_gauges_part_of_the_plan():
    built = build(Case(6, 63, "effect", ("creep",), "strong", slow_only=True))
    rows = built.setup.rows
    assert {row.channel for row in rows} == {"strain_gauge"}
    assert [row.order for row in rows] == list(range(1, len(rows) + 1))
    assert any(row.repeat_of for row in rows)
    assert built.truth()["slow_only"] is True
    with pytest.raises(ValueError, match="strain gauge alone"):
        Case(0, 0, meagre=True, slow_only=True)
