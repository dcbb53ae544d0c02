"""Resonator stage: free decay, energy, eigenfrequencies and delays against their closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipk, lambertw

from experiments.concealed_rig.effects.course import AirBubble, ThermalDrift
from experiments.concealed_rig.effects.loss import diffusive_states
from experiments.concealed_rig.effects.spring import FerroelasticSoftening
from experiments.concealed_rig.effects.wave import WaveEcho, channel_echo, coupled_modes_Hz
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.head import drawn_head
from experiments.concealed_rig.plant import Plant, resonator_of
from experiments.concealed_rig.resonator import Resonator, motion

OMEGA = 2 * np.pi * 5e4
STEP_S = 2e-5 / 400


def ring_down(resonator, cycles=12, kick_V=2000.0, applied_V=0.0):
    """Peak sizes (two a cycle) and their times in units of 1/ω₀, after a kick of a tenth of a period.

    A peak is that of the cubic through deflection and speed at two steps: 2e-10 of its size is left.
    """
    grid = Grid(400 * (cycles + 1), STEP_S, 1, False)
    h = np.zeros(2 * grid.steps + 1)
    h[2:82] = kick_V
    moved = motion(resonator, h, np.full_like(h, applied_V), grid)
    x, v = moved.deflection_V, moved.speed_V * STEP_S * OMEGA
    k = np.flatnonzero(v[60:-1] * v[61:] < 0) + 60
    a, b, c = v[k], 3 * (x[k + 1] - x[k]) - 2 * v[k] - v[k + 1], 2 * (x[k] - x[k + 1]) + v[k] + v[k + 1]
    share = -a / (b + np.sign(b) * np.sqrt(b**2 - 3 * a * c))
    return np.abs(x[k] + share * (a + share * (b + share * c))), (k + share) * STEP_S * OMEGA


def half_period(speed_squared, start, end, points=4000):
    """∫dx/v between two turning points, by the midpoint rule in the angle of x = middle − half·cos(angle)."""
    angle = (np.arange(points) + 0.5) * np.pi / points
    half = (end - start) / 2
    x = (start + end) / 2 - half * np.cos(angle)
    return np.sum(abs(half) * np.sin(angle) / np.sqrt(speed_squared(x))) * np.pi / points


@pytest.mark.parametrize("cubic", [2e-8, -2e-8])
def test_duffings_period_is_the_complete_elliptic_integral(cubic):
    """T = 4K(m)/√(1 + k₃A²), m = k₃A²/2(1 + k₃A²); left: the step's phase error, 3e-10 of the frequency."""
    size, time = ring_down(Resonator(OMEGA, 0.0, cubic_per_V2=cubic))
    share = cubic * size[0] ** 2
    exact = np.pi * np.sqrt(1 + share) / (2 * ellipk(share / 2 / (1 + share)))
    frequency = np.pi / np.mean(np.diff(time))
    assert frequency - 1 == pytest.approx(exact - 1, rel=1e-7)
    assert exact - 1 == pytest.approx(3 * share / 8 - 21 * share**2 / 256, rel=2e-4)  # left: k₃³A⁶, 1e-4
    np.testing.assert_allclose(size, size[0], rtol=2e-9)  # a spring alone loses nothing


def test_quadratic_drag_takes_from_each_swing_what_its_energy_integral_says():
    """From peak A to peak B, (1 − 2cB)exp(2cB) = (1 + 2cA)exp(−2cA); left: the step, 3e-9 of loss and time."""
    drag = 2e-5
    size, time = ring_down(Resonator(OMEGA, 0.0, quadratic_damping_per_V=drag))
    y = 2 * drag * size[:-1]
    following = (1 + lambertw(-(1 + y) * np.exp(-y - 1)).real) / (2 * drag)
    np.testing.assert_allclose(size[:-1] - size[1:], size[:-1] - following, rtol=1e-8)
    decrement = np.log(size[:-2] / size[2:])
    np.testing.assert_allclose(decrement, 8 / 3 * drag * size[1:-1], rtol=1e-3)  # left: (cA)², 6e-4
    for k in (0, 10):

        def speed_squared(x, start=size[k]):
            gone = -(1 + 2 * drag * start) * np.exp(-2 * drag * (start + x))
            return (gone + 1 - 2 * drag * x) / (2 * drag**2)

        exact = half_period(speed_squared, -size[k], following[k])
        assert time[k + 1] - time[k] == pytest.approx(exact, rel=3e-9)


def test_viscous_damping_has_its_logarithmic_decrement_and_its_frequency():
    """Left: the step, 3e-9 of both."""
    size, time = ring_down(Resonator(OMEGA, 0.03))
    root = np.sqrt(1 - 0.03**2)
    np.testing.assert_allclose(np.log(size[:-2] / size[2:]), 2 * np.pi * 0.03 / root, rtol=1e-8)
    np.testing.assert_allclose(np.diff(time), np.pi / root, rtol=2e-8)


def test_rayleighs_law_softens_and_damps_as_its_energy_integral_says():
    """A swing S from a peak A where the law took t ends where A + t − S/2 + rS²/6 = 0, after an elliptic integral.

    To first order the decrement is 4/3 rA and the frequency falls by rA/2. Left: a turning point is the outermost
    step, 3e-5 of the amplitude short of the peak.
    """
    softening = FerroelasticSoftening(0.02, variant="rayleigh", largest_V=1500.0)
    rate = softening.parameters()["softening_per_V"]
    size, time = ring_down(softening.on_resonator(Resonator(OMEGA, 0.0), 1))
    peak, taken = size[0], -rate * size[0] ** 2  # on the virgin curve
    peaks, halves = [peak], []
    for _ in size[1:]:
        swing = (0.5 - np.sqrt(0.25 - 2 * rate * (peak + taken) / 3)) * 3 / rate
        other = 3 / rate - swing
        halves.append(2 * np.sqrt(3 / rate / other) * ellipk(swing / other))
        peak, taken = swing - peak, -taken - rate * swing**2 / 2
        peaks.append(peak)
    np.testing.assert_allclose(size[:-1] - size[1:], -np.diff(peaks), rtol=2e-4)
    np.testing.assert_allclose(np.diff(time) - np.pi, np.array(halves) - np.pi, rtol=6e-5)


def test_iwans_elements_lose_what_their_slips_take():
    """Work of 48 plays in closed form from peak to peak; left: turning points at steps, as in Rayleigh's law."""
    resonator = FerroelasticSoftening(0.02, variant="iwan", largest_V=1500.0).on_resonator(Resonator(OMEGA, 0.0), 1)
    slip, weight = np.array(resonator.slip_V), np.array(resonator.slip_weight)
    size, time = ring_down(resonator)
    x, state = -size[0], -np.maximum(size[0] - slip, 0.0)
    peaks, halves = [size[0]], []
    for side in np.resize([1.0, -1.0], size.size - 1):

        def speed_squared(to, x=x, state=state, side=side):
            to = np.atleast_1d(to)[:, None]
            free = state + side * slip  # where a play begins to move
            moved = side * (to - free) > 0
            work = np.where(moved, state * (free - x) + ((to - side * slip) ** 2 - state**2) / 2, state * (to - x))
            return x**2 - to[:, 0] ** 2 + 2 * work @ weight

        end = brentq(lambda to, v2=speed_squared: v2(to)[0], -0.9 * x, -1.01 * x, xtol=1e-9)
        halves.append(half_period(speed_squared, x, end))
        state = side * np.maximum(side * end - slip, side * state)
        x = end
        peaks.append(abs(end))
    np.testing.assert_allclose(size[:-1] - size[1:], -np.diff(peaks), rtol=2e-4)
    np.testing.assert_allclose(np.diff(time) - np.pi, np.array(halves) - np.pi, rtol=6e-5)


@pytest.mark.parametrize(("count", "left"), [(48, 2e-4), (192, 2e-5)])
def test_rayleigh_by_turning_points_and_by_jenkins_elements_move_alike(count, left):
    """Left: with 48 elements their spacing, 8e-5 of the effect; with 192 the step as well, 7e-6."""
    grid = Grid(3000, 5e-7, 4, True)
    t = np.arange(2 * grid.steps + 1) / (2 * grid.steps)
    h = 60 * np.sin(2 * np.pi * 75 * t) * np.sin(np.pi * t) ** 2 + 20 * np.sin(2 * np.pi * 31 * t)
    plain = Resonator(OMEGA, 0.05)
    slip, weight = FerroelasticSoftening(0.05, variant="iwan", largest_V=400.0).elements(count)
    base, rayleigh, iwan = (
        motion(resonator, h, np.zeros_like(h), grid).speed_V
        for resonator in (
            plain,
            FerroelasticSoftening(0.05, variant="rayleigh", largest_V=400.0).on_resonator(plain, 1),
            replace(plain, slip_V=tuple(slip), slip_weight=tuple(weight)),
        )
    )
    assert np.sqrt(np.mean((rayleigh - iwan) ** 2)) < left * np.sqrt(np.mean((rayleigh - base) ** 2))


def test_coupled_modes_answer_as_the_two_by_two_matrix_says():
    """Left: the step, 2e-7 at 40 … 60 steps a period."""
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
        assert abs(got - expected) < 5e-7 * abs(expected)


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
    """Delays of whole points: left is rounding."""
    n, line = 5000, 40
    t = np.arange(n + 1)
    out = channel_echo(np.cos(2 * np.pi * line * t / n), 313.0, 470.0, -0.6, -0.8, 1.0, True)
    e1, e2 = np.exp(-2j * np.pi * line / n * np.array([313.0, 470.0]))
    left = 0.5 * (1 - 0.8 * e2) / (1 - 0.48 * e1 * e2)
    right = 0.5 * (1 - 0.6 * e1) / (1 - 0.48 * e1 * e2)
    expected = -0.6 * e1 * left - 0.8 * e2 * right
    got = 2 * np.mean(out[:-1] * np.exp(-2j * np.pi * line * t[:-1] / n))
    assert abs(got - expected) < 1e-12


def test_a_single_return_is_a_shifted_copy():
    echo = WaveEcho(0.3, variant="single_return", nozzle_s=1e-5)
    grid = Grid(500, 1e-6, 1, True)
    signal = np.sin(2 * np.pi * 3 * np.arange(501) / 500)
    np.testing.assert_allclose(echo._echo(signal, grid)[10:], signal[:-10], rtol=0, atol=1e-12)


def two_pulses(gap_s, gain, kind):
    resonator = Resonator(
        OMEGA, 0.09, meniscus_gain=gain, meniscus_kind=kind, meniscus_s=2e-4, meniscus_damping=2.0, meniscus_V=300.0
    )
    grid = Grid(12000, 1e-7, 1, False)
    t = np.arange(2 * grid.steps + 1) * grid.half_s
    # Between the points at which the drive is known, so that rounding makes no pulse a point longer.
    starts = (1.025e-6, 1.025e-6 + gap_s)
    pulses = [np.where((t > start) & (t < start + 6e-6), 300.0, 0.0) for start in starts]
    both, one, two = (motion(resonator, h, np.zeros_like(h), grid).speed_V for h in (sum(pulses), *pulses))
    return np.sqrt(np.mean((both - one - two) ** 2))


@pytest.mark.parametrize("kind", [1.0, 2.0])
def test_the_meniscus_forgets_a_pulse_with_its_recovery_time(kind):
    """Left: what still rings of the first pulse, exp(−ζω₀·450 µs) = 3e-6, beside the gain's square: 5e-5 together."""
    near, far = (two_pulses(gap, 1e-3, kind) for gap in (4.5e-4, 6.5e-4))
    # The second-order refill with damping 2 is exp(−(2 − √3)t/T) − exp(−(2 + √3)t/T).
    slow, fast = (1.0, np.inf) if kind == 1.0 else (2 - np.sqrt(3), 2 + np.sqrt(3))
    before, after = (np.exp(-slow * gap / 2e-4) - np.exp(-fast * gap / 2e-4) for gap in (4.5e-4, 6.5e-4))
    assert far / near == pytest.approx(after / before, rel=2e-4)


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


@pytest.mark.parametrize("sharpness", [2.0, 40.0])
def test_smooth_dry_friction_takes_the_same_off_each_swing(sharpness):
    """2F(1 − π²δ²/6S²) a swing S, for ∫(1 − tanh s)s ds = π²/24; left: the step where the force turns, 5e-6."""
    size, _ = ring_down(Resonator(OMEGA, 0.0, friction_V=5.0, friction_speed_V=sharpness))
    swing = size[:-1] + size[1:]
    np.testing.assert_allclose(size[:-1] - size[1:], 10.0 * (1 - (np.pi * sharpness / swing) ** 2 / 6), rtol=1.5e-5)


@pytest.mark.parametrize("slip", [2.0, 20.0])
def test_an_element_that_slips_takes_the_same_off_each_swing_but_for_its_own_spring(slip):
    """2F(1 − 2d/S) a swing S; left: a turning point is the outermost step, 4e-5."""
    spring = 5.0 / slip
    size, _ = ring_down(Resonator(OMEGA, 0.0, added_stiffness=spring, slip_V=(slip,), slip_weight=(spring,)))
    swing = size[:-1] + size[1:]
    np.testing.assert_allclose(size[:-1] - size[1:], 10.0 * (1 - 2 * slip / swing), rtol=1e-4)


def test_a_constant_voltage_shifts_the_frequency_of_an_electrically_softened_spring():
    """Left: the step, 1e-9."""
    _, time = ring_down(Resonator(OMEGA, 0.0, electro_per_V=1e-3), applied_V=80.0)
    assert np.pi / np.mean(np.diff(time)) == pytest.approx(np.sqrt(1.08), rel=5e-9)


def test_within_the_gap_the_joint_is_linear_and_soft_and_far_beyond_it_nearly_stiff():
    """Left: the step, 2e-10 and, with the kinks at ±gap, 4e-11 of the frequency."""
    _, time = ring_down(Resonator(OMEGA, 0.0, gap_V=1e5, gap_softening=0.2))
    assert np.pi / np.mean(np.diff(time)) == pytest.approx(np.sqrt(0.8), rel=2e-9)
    size, time = ring_down(Resonator(OMEGA, 0.0, gap_V=1.0, gap_softening=0.2))
    top = size[0]

    def speed_squared(x):
        inside = np.where(np.abs(x) < 1, x**2 / 2, np.abs(x) - 0.5)
        return top**2 - x**2 - 2 * 0.2 * (top - 0.5 - inside)

    assert np.mean(np.diff(time)) == pytest.approx(half_period(speed_squared, -top, top), rel=2e-9)  # 1e-4 from π


def test_below_the_threshold_there_is_no_cavitation_and_above_it_damping_jumps():
    """Against solve_ivp from the first peak on; left: the step across the kink at the threshold, 6e-7."""
    quiet, _ = ring_down(Resonator(OMEGA, 0.02, cavitation_gain=5.0, cavitation_speed_V=1e4))
    loud, _ = ring_down(Resonator(OMEGA, 0.02, cavitation_gain=5.0, cavitation_speed_V=200.0))
    plain, _ = ring_down(Resonator(OMEGA, 0.02))
    np.testing.assert_array_equal(quiet, plain)

    def speed_and_force(t, state):
        x, v = state
        return [v, -x - 0.04 * (v + 5 * min(v + 200.0, 0.0))]

    run = solve_ivp(
        speed_and_force,
        (0, 30),
        [loud[0], 0.0],
        method="DOP853",
        rtol=1e-11,
        atol=1e-8,
        events=lambda t, state: state[1],
    )
    exact = np.abs(run.y_events[0][1:9, 0])
    np.testing.assert_allclose(loud[1:9], exact, rtol=2e-6)


@pytest.mark.parametrize("power", [0.3, 0.5])
def test_diffusive_states_are_a_fractional_derivative(power):
    """Eighteen states are within 4e-3, and that is the rule's ends and the tails' next terms: 8e-6 is left of it."""
    rate, weight, spring, damper = diffusive_states(power)
    step, scale = np.log(rate[1] / rate[0]), np.sin(np.pi * power) / np.pi
    low, high = rate[0], rate[-1]
    for w in (0.3, 1.0, 3.0):
        s = 1j * w
        got = np.sum(weight * s / (s + rate)) + spring + s * damper
        slope_high, slope_low = (r**power * s / (s + r) * (power - r / (s + r)) for r in (high, low))
        ends = step**2 / 12 * (slope_high - slope_low)  # Euler and Maclaurin
        slower = low ** (power + 1) / (power + 1) / s
        faster = s**2 * high ** (power - 2) / (2 - power) - s**3 * high ** (power - 3) / (3 - power)
        assert abs(got - s**power) < 5e-3 * w**power
        assert abs(got - scale * (ends + slower + faster) - s**power) < 2e-5 * w**power


def test_a_motion_that_runs_away_is_said():
    with pytest.raises(FloatingPointError, match="diverges"):
        ring_down(Resonator(OMEGA, 0.0, cubic_per_V2=-1e-3))
