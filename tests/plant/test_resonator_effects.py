"""Effects of the resonator stage against formulas and integrators that share nothing with them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from inkjet_env.plant import Plant, Resonance, Shot, catalogue
from inkjet_env.plant.effect import coordinates, values_at
from inkjet_env.plant.effects.meniscus_refill import drawn_back
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
PERIOD_S = 1 / HEAD.frequency_Hz
EFFECTS = {effect.id: effect for effect in catalogue() if effect.stage == "resonator"}
RESONANCE = Resonance(HEAD.a0, HEAD.a1, HEAD.a0)


def ring_down(effect_id, values, amplitude_V, damping_ratio=0.002):
    """Frequency and damping ratio relative to those at rest, after letting go at an amplitude: two numbers."""
    omega0 = math.sqrt(HEAD.a0)
    quiet = Resonance(HEAD.a0, 2 * damping_ratio * omega0, HEAD.a0)
    shot = Shot("displacement", "free", PERIOD_S / 60, np.zeros(240), start=(amplitude_V, 0.0), parts=4)
    free = np.zeros(shot.nodes)
    swings = []
    for resonance in (EFFECTS[effect_id].resonator(values, quiet, shot), quiet):
        x = resonance.motion(free, shot)
        p = resonance.motion(free, replace(shot, channel="self_sensing")) * HEAD.a0 / omega0
        turns = np.unwrap(np.arctan2(-p, x))[-1] / (2 * np.pi)
        swings.append((turns, np.log(np.hypot(x[-1], p[-1]) / amplitude_V)))
    (turns, decay), (base_turns, base_decay) = swings
    return turns / base_turns - 1, (base_decay - decay) / (2 * np.pi * turns)


def pulses(samples=1500):
    """Two steep bipolar pulses with rest after each."""
    corners = [0, 20, 70, 110, 160, 200, 500, 510, 550, 560]
    return np.interp(np.arange(samples), corners, [0.0, 80.0, 80.0, -60.0, -60.0, 0.0, 0.0, 45.0, 45.0, 0.0])


def session(orders=8):
    """The same pulses at several amplitudes, one after the other."""
    sizes = np.resize([0.4, 1.2, 0.8, -1.0], orders)
    return [
        Shot("self_sensing", "periodic", PERIOD_S / 50, size * pulses(900), order=order)
        for order, size in enumerate(sizes, start=1)
    ]


def test_a_duffing_spring_follows_its_backbone():
    k = 1e-6
    for amplitude_V in (40.0, 80.0):
        frequency, damping = ring_down("cubic_stiffness", {"stiffening_per_V2": k}, amplitude_V)
        mean_square = amplitude_V**2 * 0.9512  # of an amplitude that falls as e^{-2π 0.002 · 4 periods}
        assert frequency == pytest.approx(3 / 8 * k * mean_square, rel=0.03)
        assert abs(damping) < 1e-5


def test_drag_adds_damping_in_proportion_to_the_amplitude_and_no_frequency():
    c = 2e-5
    for amplitude_V in (40.0, 80.0):
        frequency, damping = ring_down("quadratic_damping", {"damping_per_V": c}, amplitude_V)
        assert damping == pytest.approx(4 / (3 * math.pi) * c * amplitude_V, rel=0.05)
        assert abs(frequency) < 1e-5


def test_the_ceramic_shifts_frequency_and_damping_in_proportion_to_the_amplitude():
    values = {"softening_per_V": 1e-5, "loss_ratio": 1.7}
    for amplitude_V in (40.0, 80.0):
        frequency, damping = ring_down("ferroelastic_softening", values, amplitude_V)
        assert frequency == pytest.approx(-1e-5 * amplitude_V, rel=0.05)
        assert damping == pytest.approx(1.7e-5 * amplitude_V, rel=0.05)


@pytest.mark.parametrize("channel", ["self_sensing", "displacement"])
def test_a_second_mode_is_its_transfer_function_beside_the_heads(channel):
    values = {"frequency_Hz": 1.9 * HEAD.frequency_Hz, "damping_ratio": 0.03, "strength": 0.2}
    shot = Shot(channel, "demagnetised", PERIOD_S / 100, pulses())
    drive_V = shot.drive_at_nodes_V
    omega = 2 * math.pi * values["frequency_Hz"]
    slope = [1.0, 0.0] if channel == "self_sensing" else [1.0]
    expected = 0.0
    for size, natural, damping in ((1.0, math.sqrt(HEAD.a0), HEAD.damping_ratio), (0.2, omega, 0.03)):
        system = (size * natural**2 * np.array(slope), [1.0, 2 * damping * natural, natural**2])
        expected = expected + lsim(system, drive_V, shot.time_s)[1][:: shot.parts]
    if channel == "self_sensing":
        expected = expected / HEAD.a0
    motion = EFFECTS["second_mode"].resonator(values, RESONANCE, shot).motion(drive_V, shot)
    assert np.abs(motion - expected).max() < 2e-6 * np.abs(expected).max()


def test_an_echo_is_the_motion_again_delay_later():
    """Between samples the copy is cubic: corners of the self-sensing signal lie within 2e-4 of its largest value."""
    for channel, tolerance in (("displacement", 2e-6), ("self_sensing", 2e-4)):
        shot = Shot(channel, "demagnetised", PERIOD_S / 100, pulses())
        finer_V = np.interp(np.arange(14991) / 10, np.arange(1500), shot.drive_V)
        fine = Shot(channel, "demagnetised", PERIOD_S / 1000, finer_V)
        values = {"delay_s": 1.237 * PERIOD_S, "strength": -0.4}  # 123.7 samples: whole on the fine grid
        echoing = EFFECTS["wave_echo"].resonator(values, RESONANCE, shot)
        exact = RESONANCE.motion(fine.drive_at_nodes_V, fine)
        late = np.append(np.zeros(1237), exact[:-1237])
        expected = (exact - 0.4 * late)[::10]
        error = np.abs(echoing.motion(shot.drive_at_nodes_V, shot) - expected).max() / np.abs(expected).max()
        assert error < tolerance, channel


@pytest.mark.parametrize("recovery_periods", [0.3, 4.0, 15.0])
def test_refill_follows_its_differential_equation(recovery_periods):
    recovery_s = recovery_periods * PERIOD_S
    shot = Shot("self_sensing", "demagnetised", PERIOD_S / 100, pulses())
    speed = np.abs(np.diff(shot.drive_at_nodes_V)) / shot.node_step_s
    times = shot.time_s
    for node in (50, 300, 1100, 2998):  # the convolution integral over intervals of constant speed
        begin, end = times[:node], times[1 : node + 1]
        weights = recovery_s * (np.exp((end - times[node]) / recovery_s) - np.exp((begin - times[node]) / recovery_s))
        expected = np.sum(weights * speed[:node]) / 100
        assert drawn_back(shot, recovery_s)[node] == pytest.approx(expected, rel=1e-10)


def test_refill_repeats_with_its_drive():
    recovery_s = 15 * PERIOD_S
    once = Shot("self_sensing", "periodic", PERIOD_S / 100, pulses(600))
    many = Shot("self_sensing", "demagnetised", PERIOD_S / 100, np.append(np.tile(pulses(600), 60), 0.0))
    last = drawn_back(many, recovery_s)[-once.nodes - 1 : -1]
    assert drawn_back(once, recovery_s) == pytest.approx(last, rel=1e-10)


def test_refill_of_a_steep_edge_changes_stiffness_by_what_is_told_for_100_volts():
    shot = Shot("self_sensing", "demagnetised", PERIOD_S / 100, np.interp(np.arange(50), [10, 11], [0.0, 100.0]))
    values = {"recovery_s": 50 * PERIOD_S, "stiffness_change": 0.03}
    softening = EFFECTS["meniscus_refill"].resonator(values, RESONANCE, shot).softening
    assert softening[22] == pytest.approx(0.03, rel=2e-4)
    assert np.all(softening[:21] == 0)


def test_a_drift_moves_frequency_and_damping_with_the_order_and_leaves_the_gain():
    off = dict.fromkeys(EFFECTS["thermal_drift"].strengths, 0.0)
    values = off | {"frequency_drift": -0.02, "damping_drift": 0.3, "frequency_bow": 0.01, "damping_twist": 0.1}
    at = {
        order: EFFECTS["thermal_drift"].resonator(values, RESONANCE, replace(session(1)[0], order=order))
        for order in (1, 16, 31)
    }
    assert (at[1].a0, at[1].a1) == (HEAD.a0, HEAD.a1)
    assert math.sqrt(at[31].a0 / HEAD.a0) == pytest.approx(0.98)
    assert at[31].a1 / math.sqrt(at[31].a0) == pytest.approx(1.3 * HEAD.a1 / math.sqrt(HEAD.a0))
    assert math.sqrt(at[16].a0 / HEAD.a0) == pytest.approx(1 - 0.01 + 0.01)  # halfway, and the bow
    assert {resonance.drive_a0 for resonance in at.values()} == {HEAD.a0}


def test_a_bubble_is_there_from_its_onset_on():
    values = {"onset_order": 4.0, "frequency_change": -0.03, "bubble_frequency_Hz": 9e4, "bubble_damping_ratio": 0.1}
    values["bubble_strength"] = 0.05
    shots = session(6)
    bubble = [EFFECTS["air_bubble"].resonator(values, RESONANCE, shot) for shot in shots]
    assert [len(resonance.modes) for resonance in bubble] == [0, 0, 0, 1, 1, 1]
    assert [math.sqrt(r.a0 / HEAD.a0) for r in bubble] == pytest.approx([1, 1, 1, 0.97, 0.97, 0.97])
    between = EFFECTS["air_bubble"].resonator(values | {"onset_order": 3.75}, RESONANCE, shots[2])
    assert between.modes[0].strength == pytest.approx(0.25 * 0.05)


def test_effects_of_the_resonator_leave_the_strain_gauge_alone():
    slow = Shot("strain_gauge", "periodic", 0.01, 60 * np.sin(2 * np.pi * np.arange(200) / 200), order=9)
    fast = session(9)
    for effect in EFFECTS.values():
        start = effect.starts(HEAD, fast)[0]
        assert np.array_equal(Plant(HEAD, effects=((effect, start),)).signal(slow), Plant(HEAD).signal(slow))


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=list(EFFECTS))
@pytest.mark.parametrize("frequency_Hz", [50.0, 51.7e3])
def test_starts_change_the_recordings_by_a_few_per_cent(effect, frequency_Hz):
    head = HEAD.varied(frequency_Hz=frequency_Hz)
    shots = [replace(shot, step_s=0.02 / frequency_Hz, kept={}) for shot in session()]
    base = np.concatenate([Plant(head).signal(shot) for shot in shots])
    for start in effect.starts(head, shots):
        on = np.concatenate([Plant(head, effects=((effect, start),)).signal(shot) for shot in shots])
        assert 0.003 < np.linalg.norm(on - base) / np.linalg.norm(base) < 0.2, start


def damped_least_squares(residual, z, bounds, most_steps=30):
    """Size of what Levenberg and Marquardt's method leaves."""
    left, damping = residual(z), 1e-3
    widths = 1e-4 * np.where(z == 0, 0.01, np.abs(z))
    for _ in range(most_steps):
        slopes = np.array([(residual(z + row) - left) / row.sum() for row in np.diag(widths)]).T
        normal, before = slopes.T @ slopes, left @ left
        while damping < 1e6:
            step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), slopes.T @ left, rcond=1e-14)[0]
            moved = np.clip(z - step, *bounds)
            tried = residual(moved)
            damping *= 0.1 if tried @ tried < before else 10
            if tried @ tried < before:
                break
        else:
            break
        z, left = moved, tried
        if left @ left > 0.999 * before:
            break
    return math.sqrt(left @ left)


TRUTHS = {
    "cubic_stiffness": [{"stiffening_per_V2": -8e-7}, {"stiffening_per_V2": 3e-6}],
    "quadratic_damping": [{"damping_per_V": 5e-4}],
    "ferroelastic_softening": [
        {"softening_per_V": 2e-4, "loss_ratio": 0.15},
        {"softening_per_V": 5e-5, "loss_ratio": 6.0},
    ],
    "meniscus_refill": [{"recovery_s": 30 * PERIOD_S, "stiffness_change": -0.02}],
    "second_mode": [
        {"frequency_Hz": 0.43 * HEAD.frequency_Hz, "damping_ratio": 0.01, "strength": -0.1},
        {"frequency_Hz": 2.7 * HEAD.frequency_Hz, "damping_ratio": 0.006, "strength": 0.03},
        {"frequency_Hz": 5.0 * HEAD.frequency_Hz, "damping_ratio": 0.15, "strength": 0.02},
        {"frequency_Hz": 1.12 * HEAD.frequency_Hz, "damping_ratio": 0.02, "strength": 0.1},
    ],
    "wave_echo": [
        {"delay_s": 0.45 * PERIOD_S, "strength": 0.1},
        {"delay_s": 1.9 * PERIOD_S, "strength": -0.2},
        {"delay_s": 3.05 * PERIOD_S, "strength": 0.1},
    ],
    "air_bubble": [
        {"onset_order": 6.0, "frequency_change": -0.03, "bubble_frequency_Hz": 2.1 * HEAD.frequency_Hz,
         "bubble_damping_ratio": 0.05, "bubble_strength": 0.04},
        {"onset_order": 4.0, "frequency_change": 0.02, "bubble_frequency_Hz": 0.4 * HEAD.frequency_Hz,
         "bubble_damping_ratio": 0.1, "bubble_strength": -0.08},
    ],
    "thermal_drift": [
        {"frequency_drift": -0.04, "frequency_bow": 0.01, "frequency_twist": 0.0,
         "damping_drift": 0.5, "damping_bow": 0.0, "damping_twist": -0.1},
    ],
}  # fmt: skip


@pytest.mark.parametrize(("name", "truth"), [(name, truth) for name, truths in TRUTHS.items() for truth in truths])
def test_a_fit_from_the_starts_that_look_most_like_it_finds_the_truth(name, truth):
    effect, shots = EFFECTS[name], session()
    plant = Plant(HEAD)
    bounds = np.array([parameter.bounds for parameter in effect.parameters]).T

    def added(values):
        on = plant.with_effects([(effect, values)])
        return np.concatenate([on.signal(shot) for shot in shots]) - base

    base = np.concatenate([plant.signal(shot) for shot in shots])
    seen = added(truth)
    size = np.linalg.norm(seen)
    looks = []
    for start in effect.starts(HEAD, shots):
        column = added(start)
        factor = column @ seen / (column @ column)
        looks.append((abs(column @ seen) / np.linalg.norm(column), np.clip(factor, -3.0, 3.0), start))
    looks.sort(key=lambda look: -look[0])
    best = np.inf
    for _, factor, start in looks[:3]:
        scaled = {n: value * factor if n in effect.strengths else value for n, value in start.items()}
        begin = np.clip(coordinates(effect, scaled), *bounds)
        left = damped_least_squares(lambda z: added(values_at(effect, z)) - seen, begin, bounds)
        best = min(best, left / size)
        if best < 1e-3:
            break
    assert best < 1e-3
