"""Resonator stage: free decay, energy, eigenfrequencies and delays against their closed forms."""

import numpy as np
import pytest

from experiments.concealed_rig.effects.course import AirBubble, ThermalDrift
from experiments.concealed_rig.effects.outside_motion import diffusive_states
from experiments.concealed_rig.effects.spring import FerroelasticSoftening
from experiments.concealed_rig.effects.wave import WaveEcho, channel_echo, coupled_modes_Hz
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.head import drawn_head
from experiments.concealed_rig.plant import Plant, resonator_of
from experiments.concealed_rig.resonator import Resonator, motion

OMEGA = 2 * np.pi * 5e4
STEP_S = 2e-5 / 400


def ring_down(resonator, cycles=12, kick_V=2000.0, applied_V=0.0):
    """Peak sizes (two a cycle) and their times in units of 1/ω₀, after a kick of a tenth of a period."""
    grid = Grid(400 * (cycles + 1), STEP_S, 1, False)
    h = np.zeros(2 * grid.steps + 1)
    h[2:82] = kick_V
    moved = motion(resonator, h, np.full_like(h, applied_V), grid)
    x, v = moved.deflection_V, moved.speed_V
    k = np.flatnonzero(v[60:-1] * v[61:] < 0) + 60
    share = v[k] / (v[k] - v[k + 1])
    return np.abs(x[k] + share * (x[k + 1] - x[k])), (k + share) * STEP_S * OMEGA


def test_duffings_frequency_grows_by_three_eighths_of_k3_a2():
    for cubic in (2e-8, -2e-8):
        size, time = ring_down(Resonator(OMEGA, 0.0, cubic_per_V2=cubic))
        frequency = np.pi / np.mean(np.diff(time))
        assert frequency - 1 == pytest.approx(3 * cubic * np.mean(size) ** 2 / 8, rel=0.03)
        np.testing.assert_allclose(size, size[0], rtol=1e-4)  # a spring alone loses nothing


def test_quadratic_drag_gives_a_decrement_in_proportion_to_the_amplitude():
    size, time = ring_down(Resonator(OMEGA, 0.0, quadratic_damping_per_V=2e-5))
    decrement = -np.log(size[2:] / size[:-2])
    np.testing.assert_allclose(decrement, 8 / 3 * 2e-5 * size[1:-1], rtol=0.02)
    assert np.pi / np.mean(np.diff(time)) == pytest.approx(1.0, abs=1e-3)


def test_viscous_damping_has_its_logarithmic_decrement():
    size, _ = ring_down(Resonator(OMEGA, 0.03))
    np.testing.assert_allclose(np.log(size[:-2] / size[2:]), 2 * np.pi * 0.03 / np.sqrt(1 - 0.03**2), rtol=2e-4)


@pytest.mark.parametrize("law", ["rayleigh", "iwan"])
def test_rayleighs_law_softens_and_damps_in_proportion_to_the_amplitude(law):
    """Energy lost a cycle is 4/3 r A³, so the decrement is 4/3 r A and the frequency falls by r A/2."""
    softening = FerroelasticSoftening(0.02, variant=law, largest_V=1500.0)
    rate = softening.parameters()["softening_per_V"]
    size, time = ring_down(softening.on_resonator(Resonator(OMEGA, 0.0), 1))
    # The kick itself is the virgin curve; from the second cycle on both laws go round loops.
    decrement = -np.log(size[4:] / size[2:-2])
    np.testing.assert_allclose(decrement, 4 / 3 * rate * size[3:-1], rtol=0.06)
    frequency = 2 * np.pi / (time[4:] - time[2:-2])
    np.testing.assert_allclose(1 - frequency, rate * size[3:-1] / 2, rtol=0.1)


def test_rayleigh_by_turning_points_and_by_jenkins_elements_move_alike():
    grid = Grid(3000, 5e-7, 4, True)
    t = np.arange(2 * grid.steps + 1) / (2 * grid.steps)
    h = 60 * np.sin(2 * np.pi * 75 * t) * np.sin(np.pi * t) ** 2 + 20 * np.sin(2 * np.pi * 31 * t)
    base, *both = (
        motion(resonator, h, np.zeros_like(h), grid).speed_V
        for resonator in (
            Resonator(OMEGA, 0.05),
            *(
                FerroelasticSoftening(0.05, variant=law, largest_V=400.0).on_resonator(Resonator(OMEGA, 0.05), 1)
                for law in ("rayleigh", "iwan")
            ),
        )
    )
    effect = np.sqrt(np.mean((both[0] - base) ** 2))
    assert np.sqrt(np.mean((both[0] - both[1]) ** 2)) < 0.05 * effect


def test_coupled_modes_answer_as_the_two_by_two_matrix_says():
    mass, ratio, zeta, second_zeta = 0.1, 1.3, 0.04, 0.03
    resonator = Resonator(OMEGA, zeta, mass_ratio=mass, second_ratio=ratio, second_damping=second_zeta)
    grid = Grid(2000, 4e-7, 4, True)
    for line in (30, 37, 45):
        w = 2 * np.pi * line / (2000 * 4e-7) / OMEGA
        h = np.cos(2 * np.pi * line * np.arange(2 * grid.steps + 1) / (2 * grid.steps))
        x = motion(resonator, h, np.zeros_like(h), grid).deflection_V[:-1]
        pull = ratio**2 + 2j * second_zeta * ratio * w
        matrix = np.array([[1 - w**2 + 2j * zeta * w + mass * pull, -mass * pull], [-pull, pull - w**2]])
        expected = np.linalg.solve(matrix, [1, 0])[0]
        got = 2 * np.mean(x * np.exp(-2j * np.pi * line * np.arange(x.size) / x.size))
        assert abs(got - expected) < 1e-5 * abs(expected)


def test_coupled_eigenfrequencies_part_and_their_product_stays():
    low, high = coupled_modes_Hz(5e4, 0.05, 1.2)
    assert low < 5e4 < 6e4 < high
    assert low * high == pytest.approx(5e4 * 6e4, rel=1e-12)
    np.testing.assert_allclose(coupled_modes_Hz(5e4, 1e-9, 1.2), [5e4, 6e4], rtol=1e-7)


def test_waves_come_back_after_twice_the_length_over_the_speed():
    source = np.zeros(4000)
    source[10] = 1.0
    out = channel_echo(source, 700e-8, 900e-8, -0.5, 0.8, 1e-8, False)
    first, second = 710, 910
    assert out[first] == pytest.approx(-0.25)
    assert out[second] == pytest.approx(0.4)
    assert out[1610] == pytest.approx(-0.4)  # both ways round
    assert np.flatnonzero(np.abs(out) > 1e-12).tolist()[:3] == [first, second, 1610]


def test_a_steady_tone_in_the_channel_is_the_geometric_series_of_its_reflections():
    n, line = 5000, 40
    t = np.arange(n + 1)
    out = channel_echo(np.cos(2 * np.pi * line * t / n), 313.0, 470.0, -0.6, -0.8, 1.0, True)
    e1, e2 = np.exp(-2j * np.pi * line / n * np.array([313.0, 470.0]))
    left = 0.5 * (1 - 0.8 * e2) / (1 - 0.48 * e1 * e2)
    right = 0.5 * (1 - 0.6 * e1) / (1 - 0.48 * e1 * e2)
    expected = -0.6 * e1 * left - 0.8 * e2 * right
    got = 2 * np.mean(out[:-1] * np.exp(-2j * np.pi * line * t[:-1] / n))
    assert abs(got - expected) < 1e-6


def test_a_single_return_is_a_shifted_copy():
    echo = WaveEcho(0.3, variant="single_return", nozzle_s=1e-5)
    grid = Grid(500, 1e-6, 1, True)
    signal = np.sin(2 * np.pi * 3 * np.arange(501) / 500)
    np.testing.assert_allclose(echo._echo(signal, grid)[10:], signal[:-10], atol=1e-12)


def two_pulses(gap_s, gain, kind):
    resonator = Resonator(
        OMEGA, 0.09, meniscus_gain=gain, meniscus_kind=kind, meniscus_s=2e-4, meniscus_damping=2.0, meniscus_V=300.0
    )
    grid = Grid(12000, 1e-7, 1, False)
    t = np.arange(2 * grid.steps + 1) * grid.half_s
    pulses = [np.where((t > start) & (t < start + 6e-6), 300.0, 0.0) for start in (1e-6, 1e-6 + gap_s)]
    both, one, two = (motion(resonator, h, np.zeros_like(h), grid).speed_V for h in (sum(pulses), *pulses))
    return np.sqrt(np.mean((both - one - two) ** 2))


@pytest.mark.parametrize("kind", [1.0, 2.0])
def test_the_meniscus_forgets_a_pulse_with_its_recovery_time(kind):
    near, far = (two_pulses(gap, 1e-3, kind) for gap in (3e-4, 5e-4))
    # The second-order refill with damping 2 is slowest at (2 − √3)/T.
    rate = 1.0 if kind == 1.0 else 2 - np.sqrt(3)
    assert far / near == pytest.approx(np.exp(-2e-4 / 2e-4 * rate), rel=0.05)


def test_a_bubble_changes_nothing_before_its_onset_and_drift_follows_its_course():
    head = drawn_head(np.random.default_rng(1))
    base = Resonator(head.angular_rad_per_s, head.damping_ratio)
    bubble = AirBubble(0.1, variant="attached", frequency_Hz=3e4, onset=5)
    assert resonator_of(Plant(head, (bubble,)), 4) == base
    assert resonator_of(Plant(head, (bubble,)), 5).mass_ratio == 0.1
    drift = ThermalDrift(0.01, variant="sinusoid", course=(0.0, 1.0, -0.5), damping_factor=3.0)
    warm = resonator_of(Plant(head, (drift,)), 2)
    assert warm.angular_rad_per_s == pytest.approx(1.01 * base.angular_rad_per_s)
    decay = warm.damping_ratio * warm.angular_rad_per_s / (base.damping_ratio * base.angular_rad_per_s)
    assert decay == pytest.approx(1.03)
    assert resonator_of(Plant(head, (drift,)), 9) == resonator_of(Plant(head, (drift,)), 3)


def test_dry_friction_takes_the_same_off_each_cycle():
    smooth = Resonator(OMEGA, 0.0, friction_V=5.0, friction_speed_V=2.0)
    slips = Resonator(OMEGA, 0.0, added_stiffness=2.5, slip_V=(2.0,), slip_weight=(2.5,))
    for resonator in (smooth, slips):
        size, _ = ring_down(resonator)
        np.testing.assert_allclose(size[2:8] - size[4:10], 4 * 5.0, rtol=0.03)


def test_a_constant_voltage_shifts_the_frequency_of_an_electrically_softened_spring():
    _, time = ring_down(Resonator(OMEGA, 0.0, electro_per_V=1e-3), applied_V=80.0)
    assert np.pi / np.mean(np.diff(time)) == pytest.approx(np.sqrt(1.08), rel=1e-5)


def test_within_the_gap_the_joint_is_linear_and_soft_and_far_beyond_it_stiff():
    _, time = ring_down(Resonator(OMEGA, 0.0, gap_V=1e5, gap_softening=0.2))
    assert np.pi / np.mean(np.diff(time)) == pytest.approx(np.sqrt(0.8), rel=1e-5)
    _, time = ring_down(Resonator(OMEGA, 0.0, gap_V=1.0, gap_softening=0.2))
    assert np.pi / np.mean(np.diff(time)) == pytest.approx(1.0, abs=3e-4)


def test_below_the_threshold_there_is_no_cavitation():
    quiet, _ = ring_down(Resonator(OMEGA, 0.02, cavitation_gain=5.0, cavitation_speed_V=1e4))
    loud, _ = ring_down(Resonator(OMEGA, 0.02, cavitation_gain=5.0, cavitation_speed_V=200.0))
    plain, _ = ring_down(Resonator(OMEGA, 0.02))
    np.testing.assert_array_equal(quiet, plain)
    assert loud[4] < 0.9 * plain[4]


@pytest.mark.parametrize("power", [0.3, 0.5])
def test_diffusive_states_are_a_fractional_derivative(power):
    rate, weight, spring, damper = diffusive_states(power)
    for w in (0.3, 1.0, 3.0):
        got = np.sum(weight * 1j * w / (1j * w + rate)) + spring + 1j * w * damper
        assert abs(got - (1j * w) ** power) < 0.01 * w**power


def test_a_motion_that_runs_away_is_said():
    with pytest.raises(FloatingPointError, match="diverges"):
        ring_down(Resonator(OMEGA, 0.0, cubic_per_V2=-1e-3))
