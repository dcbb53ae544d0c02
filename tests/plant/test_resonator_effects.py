"""Effects of the resonator stage against formulas and integrators that share nothing with them."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lsim

from inkjet_env.plant import Excitation, Plant, Resonance, SimulationError, catalogue
from inkjet_env.plant.effect import complete
from inkjet_env.plant.effects.meniscus_refill import drawn_back
from inkjet_env.printhead import Printhead
from tests.plant.sessions import PERIOD_S, pulses, session

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue() if effect.stage == "resonator"}
RESONANCE = Resonance(HEAD.a0, HEAD.a1, HEAD.a0)


def ring_down(effect_id, values, amplitude_V, damping_ratio=0.002):
    """Frequency and damping ratio relative to those at rest, after letting go at an amplitude: two numbers."""
    omega0 = math.sqrt(HEAD.a0)
    quiet = Resonance(HEAD.a0, 2 * damping_ratio * omega0, HEAD.a0)
    excitation = Excitation("displacement", "free", PERIOD_S / 60, np.zeros(240), start=(amplitude_V, 0.0), substeps=4)
    free = np.zeros(excitation.nodes)
    swings = []
    for resonance in (EFFECTS[effect_id].resonator(values, quiet, excitation), quiet):
        x = resonance.motion(free, excitation)
        p = resonance.motion(free, replace(excitation, channel="self_sensing")) * HEAD.a0 / omega0
        turns = np.unwrap(np.arctan2(-p, x))[-1] / (2 * np.pi)
        swings.append((turns, np.log(np.hypot(x[-1], p[-1]) / amplitude_V)))
    (turns, decay), (base_turns, base_decay) = swings
    return turns / base_turns - 1, (base_decay - decay) / (2 * np.pi * turns)


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
    values = complete(EFFECTS["ferroelastic_softening"], softening_per_V=1e-5, loss_ratio=1.7)
    for amplitude_V in (40.0, 80.0):
        frequency, damping = ring_down("ferroelastic_softening", values, amplitude_V)
        assert frequency == pytest.approx(-1e-5 * amplitude_V, rel=0.05)
        assert damping == pytest.approx(1.7e-5 * amplitude_V, rel=0.05)


@pytest.mark.parametrize("channel", ["self_sensing", "displacement"])
def test_a_second_mode_is_its_transfer_function_beside_the_heads(channel):
    values = complete(EFFECTS["second_mode"], frequency_Hz=1.9 * HEAD.frequency_Hz, damping_ratio=0.03, strength=0.2)
    excitation = Excitation(channel, "demagnetised", PERIOD_S / 100, pulses())
    drive_V = excitation.drive_at_nodes_V
    omega = 2 * math.pi * values["frequency_Hz"]
    slope = [1.0, 0.0] if channel == "self_sensing" else [1.0]
    expected = 0.0
    for size, natural, damping in ((1.0, math.sqrt(HEAD.a0), HEAD.damping_ratio), (0.2, omega, 0.03)):
        system = (size * natural**2 * np.array(slope), [1.0, 2 * damping * natural, natural**2])
        expected = expected + lsim(system, drive_V, excitation.time_s)[1][:: excitation.substeps]
    if channel == "self_sensing":
        expected = expected / HEAD.a0
    motion = EFFECTS["second_mode"].resonator(values, RESONANCE, excitation).motion(drive_V, excitation)
    assert np.abs(motion - expected).max() < 2e-6 * np.abs(expected).max()


@pytest.mark.parametrize("channel", ["self_sensing", "displacement"])
def test_two_modes_are_those_of_a_mass_on_a_mass(channel):
    """The partial fractions of what the first mass does, its drive on it, give strength and exchange."""
    w1, w2, mass, z1, z2 = math.sqrt(HEAD.a0), 1.8 * math.sqrt(HEAD.a0), 0.03, 0.04, 0.06
    second = np.array([1.0, 2 * z2 * w2, w2**2])
    both = np.polyadd(np.polymul([1.0, 2 * z1 * w1, w1**2], second), mass * np.polymul(second[1:], [1.0, 0.0, 0.0]))
    low, high = sorted((pole for pole in np.roots(both) if pole.imag > 0), key=abs)
    residues = [
        w1**2 * np.polyval(second, pole) / np.polyval(np.polyder(both), pole) for pole in (low, high)
    ]  # w1² N / D = Σ (A s + B) / (s² + a1 s + a0)
    (a, b), (other_a, other_b) = (
        (2 * r.real, -2 * (r * p.conjugate()).real) for r, p in zip(residues, (low, high), strict=True)
    )
    assert a == pytest.approx(-other_a, rel=1e-6)
    head = Resonance(abs(low) ** 2, -2 * low.real, abs(low) ** 2)
    share = b / abs(low) ** 2
    values = complete(
        EFFECTS["second_mode"], frequency_Hz=abs(high) / (2 * math.pi), damping_ratio=-high.real / abs(high),
        strength=other_b / abs(high) ** 2 / share, exchange=other_a / abs(low) / share,
    )  # fmt: skip
    excitation = Excitation(channel, "demagnetised", PERIOD_S / 100, pulses())
    drive_V = excitation.drive_at_nodes_V
    found = share * EFFECTS["second_mode"].resonator(values, head, excitation).motion(drive_V, excitation)
    slope = [1.0, 0.0] if channel == "self_sensing" else [1.0]
    expected = lsim((w1**2 * np.polymul(second, slope), both), drive_V, excitation.time_s)[1][:: excitation.substeps]
    if channel == "self_sensing":
        expected = expected / abs(low) ** 2
    assert found == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("recovery_periods", [0.3, 4.0, 15.0])
def test_refill_follows_its_differential_equation(recovery_periods):
    recovery_s = recovery_periods * PERIOD_S
    excitation = Excitation("self_sensing", "demagnetised", PERIOD_S / 100, pulses())
    speed = np.abs(np.diff(excitation.drive_at_nodes_V)) / excitation.node_step_s
    times = excitation.time_s
    for node in (50, 300, 1100, 2998):  # the convolution integral over intervals of constant speed
        begin, end = times[:node], times[1 : node + 1]
        weights = recovery_s * (np.exp((end - times[node]) / recovery_s) - np.exp((begin - times[node]) / recovery_s))
        expected = np.sum(weights * speed[:node]) / 100
        assert drawn_back(excitation, recovery_s)[node] == pytest.approx(expected, rel=1e-10)


def test_refill_repeats_with_its_drive():
    recovery_s = 15 * PERIOD_S
    once = Excitation("self_sensing", "periodic", PERIOD_S / 100, pulses(600))
    many = Excitation("self_sensing", "demagnetised", PERIOD_S / 100, np.append(np.tile(pulses(600), 60), 0.0))
    last = drawn_back(many, recovery_s)[-once.nodes - 1 : -1]
    assert drawn_back(once, recovery_s) == pytest.approx(last, rel=1e-10)


def test_refill_of_a_steep_edge_changes_stiffness_by_what_is_told_for_100_volts():
    excitation = Excitation(
        "self_sensing", "demagnetised", PERIOD_S / 100, np.interp(np.arange(50), [10, 11], [0.0, 100.0])
    )
    values = complete(EFFECTS["meniscus_refill"], recovery_s=50 * PERIOD_S, stiffness_change=0.03)
    softening = EFFECTS["meniscus_refill"].resonator(values, RESONANCE, excitation).softening
    assert softening[22] == pytest.approx(0.03, rel=2e-4)
    assert np.all(softening[:21] == 0)


def test_a_drift_moves_frequency_and_damping_with_the_order_and_leaves_the_gain():
    values = complete(EFFECTS["thermal_drift"], last_order=28.0, frequency_9=-0.02, damping_9=0.3, frequency_4=0.01)
    at = {
        order: EFFECTS["thermal_drift"].resonator(values, RESONANCE, replace(session(1)[0], order=order))
        for order in (1, 13, 28, 40)
    }
    assert (at[1].a0, at[1].a1) == (HEAD.a0, HEAD.a1)
    assert math.sqrt(at[28].a0 / HEAD.a0) == pytest.approx(0.98)
    assert at[28].a1 / math.sqrt(at[28].a0) == pytest.approx(1.3 * HEAD.a1 / math.sqrt(HEAD.a0))
    assert math.sqrt(at[13].a0 / HEAD.a0) == pytest.approx(1.01)
    assert (at[40].a0, at[40].a1) == (at[28].a0, at[28].a1)  # after the session, as at its end
    assert {resonance.drive_a0 for resonance in at.values()} == {HEAD.a0}


def test_the_course_of_a_drift_goes_through_its_values_and_straight_on_between_them():
    course = {f"frequency_{k}": 0.01 * k for k in range(1, 10)}
    values = complete(EFFECTS["thermal_drift"], last_order=10.0, **course)
    for order in (1, 2, 4.5, 7.25, 10):
        resonance = EFFECTS["thermal_drift"].resonator(values, RESONANCE, replace(session(1)[0], order=order))
        assert math.sqrt(resonance.a0 / HEAD.a0) - 1 == pytest.approx(0.01 * (order - 1))


@pytest.mark.parametrize("turns", [0.7, 1.3, 2.0])
def test_a_drift_can_follow_two_swings_of_the_room(turns):
    effect, orders = EFFECTS["thermal_drift"], np.arange(1, 31)

    def course(order):
        return 0.02 * np.sin(2 * np.pi * turns * (order - 1) / 29)

    values = {f"frequency_{k}": course(1 + 29 * k / 9) for k in range(1, 10)}
    values = complete(effect, last_order=30.0, **values)
    excitations = [replace(session(1)[0], order=int(order)) for order in orders]
    found = [math.sqrt(effect.resonator(values, RESONANCE, excitation).a0 / HEAD.a0) - 1 for excitation in excitations]
    assert np.linalg.norm(found - course(orders)) < 0.1 * np.linalg.norm(course(orders))


def test_a_value_of_a_drift_changes_the_recordings_near_it_alone():
    effect, excitations = (
        EFFECTS["thermal_drift"],
        [replace(excitation, order=3 * k + 1) for k, excitation in enumerate(session(10))],
    )
    off = complete(effect, last_order=28.0)
    for k in (1, 5, 9):
        name = f"damping_{k}"
        moved = [effect.resonator(off | {name: 0.1}, RESONANCE, s).a1 != HEAD.a1 for s in excitations]
        assert moved == [effect.changes(name, excitation, off) for excitation in excitations]
        assert 0 < sum(moved) <= 4


def test_a_short_session_has_fewer_values():
    effect, excitations = EFFECTS["thermal_drift"], session(8)
    bounds = effect.bounds(HEAD, excitations)
    free = [p.name for p in effect.parameters if bounds.get(p.name, (0.0, 1.0)) != (0.0, 0.0)]
    assert free == ["last_order", *(f"{what}_{k}" for what in ("frequency", "damping") for k in range(1, 5))]


def relaxed_by_brute_force(flow, recovery_s, step_s):
    """Of a first-order lag, small steps of Heun's method on the flow at the nodes."""
    state, found = flow[0], [flow[0]]
    for before, after in pairwise(flow):
        for part in range(20):
            now = before + (after - before) * (part + 0.5) / 20
            state += (now - state) * -math.expm1(-step_s / 20 / recovery_s)
        found.append(state)
    return np.array(found)


def test_the_flow_before_changes_the_stiffness_and_it_recovers():
    excitation = Excitation("self_sensing", "demagnetised", PERIOD_S / 100, pulses())
    drive_V = excitation.drive_at_nodes_V
    values = complete(EFFECTS["meniscus_refill"], recovery_s=8 * PERIOD_S, flow_change=0.2)
    refilled = EFFECTS["meniscus_refill"].resonator(values, RESONANCE, excitation).refilled(drive_V, excitation)
    p = RESONANCE.motion(drive_V, excitation) * HEAD.a0 / math.sqrt(HEAD.a0)
    expected = 0.2 * relaxed_by_brute_force(np.abs(p) / 100, 8 * PERIOD_S, excitation.step_s)
    assert refilled.softening[::2] == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())
    assert not refilled.refills


def test_the_flow_of_a_repeated_drive_is_in_steady_state():
    once = Excitation("self_sensing", "periodic", PERIOD_S / 100, pulses(900))
    many = Excitation("self_sensing", "demagnetised", PERIOD_S / 100, np.append(np.tile(pulses(900), 30), 0.0))
    values = {"recovery_s": 6 * PERIOD_S, "flow_change": 0.1, "power": 2.0, "second_order": 2.0}
    values = complete(EFFECTS["meniscus_refill"], **values)
    steady, last = (
        EFFECTS["meniscus_refill"].resonator(values, RESONANCE, s).refilled(s.drive_at_nodes_V, s).softening
        for s in (once, many)
    )
    assert last[-once.nodes - 1 : -1] == pytest.approx(steady, abs=1e-4 * np.abs(steady).max())


def test_a_bubble_is_there_from_its_onset_on():
    values = {"onset_order": 4.0, "frequency_change": -0.03, "bubble_frequency_Hz": 9e4, "bubble_damping_ratio": 0.1}
    values = complete(EFFECTS["air_bubble"], **values, bubble_strength=0.05, damping_change=0.4)
    excitations = session(6)
    bubble = [EFFECTS["air_bubble"].resonator(values, RESONANCE, excitation) for excitation in excitations]
    assert [len(resonance.modes) for resonance in bubble] == [0, 0, 0, 1, 1, 1]
    assert [math.sqrt(r.a0 / HEAD.a0) for r in bubble] == pytest.approx([1, 1, 1, 0.97, 0.97, 0.97])
    assert [r.a1 / HEAD.a1 for r in bubble] == pytest.approx([1, 1, 1, *[0.97 * 1.4] * 3])
    grown = [EFFECTS["air_bubble"].resonator(values | {"growth_orders": 1.5}, RESONANCE, e) for e in excitations]
    shares = [0, 0, 0, 0.4, 0.8, 1.0]
    assert [math.sqrt(r.a0 / HEAD.a0) for r in grown] == pytest.approx([1 - 0.03 * share for share in shares])
    for resonance, share in zip(grown[3:], shares[3:], strict=True):
        assert resonance.modes[0].strength == pytest.approx(0.05 * share)
        assert math.sqrt(resonance.modes[0].a0) == pytest.approx(2 * math.pi * 9e4 * share ** (-1 / 3))
    between = EFFECTS["air_bubble"].resonator(values | {"onset_order": 3.75}, RESONANCE, excitations[2])
    assert between.modes[0].strength == pytest.approx(0.25 * 0.05)


@pytest.mark.parametrize("state", ["demagnetised", "periodic", "free"])
@pytest.mark.parametrize("step_s", [1e-3, 0.1, 10.0])
def test_a_slowly_sampled_head_is_at_rest_in_every_sample(state, step_s):
    """The spring's equation without inertia; what the drive's slope adds falls with the sampling step."""
    drive_V, k = 20 * np.sin(np.arange(120) / 10), 1e-6
    start = (1.0, 0.0) if state == "free" else (0.0, 0.0)
    excitation = Excitation("displacement", state, step_s, drive_V, start=start, substeps=8)
    resonance = EFFECTS["cubic_stiffness"].resonator({"stiffening_per_V2": k}, RESONANCE, excitation)
    x = resonance.motion(excitation.drive_at_nodes_V, excitation)[1:]
    assert np.abs(x + k * x**3 - drive_V[1:]).max() < 1e-6 / step_s


def test_effects_of_the_resonator_leave_the_strain_gauge_alone():
    slow = Excitation("strain_gauge", "periodic", 0.01, 60 * np.sin(2 * np.pi * np.arange(200) / 200), order=9)
    fast = session(9)
    for effect in EFFECTS.values():
        start = effect.starts(HEAD, fast)[0]
        assert np.array_equal(Plant(HEAD, effects=((effect, start),)).signal(slow), Plant(HEAD).signal(slow))


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=list(EFFECTS))
@pytest.mark.parametrize("frequency_Hz", [50.0, 51.7e3])
def test_starts_change_the_recordings_by_a_few_per_cent(effect, frequency_Hz):
    head = HEAD.varied(frequency_Hz=frequency_Hz)
    excitations = [replace(excitation, step_s=0.02 / frequency_Hz, cache={}) for excitation in session()]
    base = np.concatenate([Plant(head).signal(excitation) for excitation in excitations])
    for start in effect.starts(head, excitations):
        on = np.concatenate([Plant(head, effects=((effect, start),)).signal(excitation) for excitation in excitations])
        assert 0.003 < np.linalg.norm(on - base) / np.linalg.norm(base) < 0.2, start


def test_a_ring_down_of_slipping_elements_follows_rayleigh():
    """Δf/f = -r A / 2 and Δζ = 2 r A / 3π, of loops between the parabolas ``(k - r A) x ± r (A² - x²) / 2``."""
    for amplitude_V in (20.0, 80.0):
        values = complete(EFFECTS["ferroelastic_softening"], rayleigh_per_V=2e-5, loss_ratio=1.0)
        frequency, damping = ring_down("ferroelastic_softening", values, amplitude_V)
        assert frequency == pytest.approx(-1e-5 * amplitude_V, rel=0.05)
        assert damping == pytest.approx(4e-5 * amplitude_V / (3 * math.pi), rel=0.05)


def test_slipping_elements_remember_where_they_turned():
    """Against Iwan's elements one by one, in small explicit steps, under a repeated drive and from rest."""
    values = complete(EFFECTS["ferroelastic_softening"], rayleigh_per_V=1e-3, power=0.5, loss_ratio=1.0)
    excitation = Excitation("displacement", "demagnetised", PERIOD_S / 100, pulses()[:600] + 5.0)
    resonance = EFFECTS["ferroelastic_softening"].resonator(values, RESONANCE, excitation)
    found = resonance.motion(excitation.drive_at_nodes_V, excitation)
    slips_V = (np.arange(400) + 0.5) * 0.75
    weights = 2e-3 * 0.75 * (slips_V / 100) ** 0.5
    x = 5.0
    for _ in range(200):
        x = 5.0 + weights @ np.clip(0.0, x - slips_V, x + slips_V)
    plays, p, steps = np.clip(0.0, x - slips_V, x + slips_V), 0.0, 40
    h, omega0, rate = excitation.step_s / steps, math.sqrt(HEAD.a0), HEAD.a1 / math.sqrt(HEAD.a0)
    expected = [x]
    for before, after in pairwise(excitation.drive_V):
        for part in (np.arange(steps) + 0.5) / steps:
            middle = x + 0.5 * h * omega0 * p
            plays = np.clip(plays, middle - slips_V, middle + slips_V)
            p += h * omega0 * (before + part * (after - before) - middle + weights @ plays - rate * p)
            x = middle + 0.5 * h * omega0 * p
        expected.append(x)
    assert found == pytest.approx(np.array(expected), abs=0.01 * np.abs(expected).max())


def test_a_bubble_can_be_an_oscillator_that_hangs_on_the_head():
    """Poles and residues of the coupled pair give the values; the step response is that of the pair."""
    effect, ratio, tuning, zeta, zeta_b = EFFECTS["air_bubble"], 0.02, 0.8, 0.06, 0.05
    # x'' + 2ζx' + x = v + μ(Ω²(y - x) + 2ζbΩ(y' - x')), y'' = Ω²(x - y) + 2ζbΩ(x' - y'), time in 1/ω0
    spring, rate = tuning**2, 2 * zeta_b * tuning
    a = np.array(
        [
            [0, 1, 0, 0],
            [-1 - ratio * spring, -2 * zeta - ratio * rate, ratio * spring, ratio * rate],
            [0, 0, 0, 1],
            [spring, rate, -spring, -rate],
        ]
    )
    poles, vectors = np.linalg.eig(a)
    b = np.linalg.solve(vectors, np.array([0, 1, 0, 0]))
    residues = vectors[0] * b  # x(s) = Σ residue / (s - pole)
    upper = np.flatnonzero(poles.imag > 0)
    bubble, head = sorted(upper, key=lambda k: abs(poles[k]))
    first, second = (-2 * (residues[k] * poles[k].conjugate()).real / abs(poles[k]) ** 2 for k in (head, bubble))
    detuned, damping = abs(poles[head]), -poles[head].real / abs(poles[head])
    base = Resonance(HEAD.a0, 2 * zeta * math.sqrt(HEAD.a0), HEAD.a0)
    values = complete(
        effect, onset_order=2.0, frequency_change=detuned - 1, damping_change=damping / zeta - 1,
        bubble_frequency_Hz=abs(poles[bubble]) * HEAD.frequency_Hz,
        bubble_damping_ratio=-poles[bubble].real / abs(poles[bubble]), bubble_strength=second,
        static_change=first - 1 / detuned**2,
        exchange=2 * residues[bubble].real / detuned,
    )  # fmt: skip
    drive_V = np.interp(np.arange(900), [20, 60, 300, 320], [0.0, 80.0, 80.0, -40.0])
    excitation = Excitation("displacement", "demagnetised", PERIOD_S / 50, drive_V, order=5, substeps=8)
    found = effect.resonator(values, base, excitation).motion(excitation.drive_at_nodes_V, excitation)
    times = np.arange(900) * 2 * np.pi / 50
    expected = lsim((a, np.array([[0], [1], [0], [0]]), np.array([[1, 0, 0, 0]]), 0), drive_V, times)[1]
    assert expected[-1] != pytest.approx(-40.0, abs=0.01)
    assert found == pytest.approx(expected, abs=1e-3 * 80)
    hanging = complete(
        effect, onset_order=2.0, bubble_frequency_Hz=tuning * HEAD.frequency_Hz, bubble_damping_ratio=zeta_b,
        mass_ratio=ratio,
    )  # fmt: skip
    given = effect.resonator(hanging, base, excitation).motion(excitation.drive_at_nodes_V, excitation)
    assert given == pytest.approx(found, abs=1e-6 * 80)


def test_a_light_oscillator_hardly_changes_the_head_and_an_overdamped_one_is_refused():
    base, drive_V = Resonance(HEAD.a0, HEAD.a1, HEAD.a0), np.interp(np.arange(500), [20, 60], [0.0, 80.0])
    excitation = Excitation("self_sensing", "demagnetised", PERIOD_S / 50, drive_V)
    alone = base.motion(excitation.drive_at_nodes_V, excitation)
    light = base.with_oscillator(1e-9, 0.7 * HEAD.a0, 0.1 * math.sqrt(HEAD.a0))
    assert light.motion(excitation.drive_at_nodes_V, excitation) == pytest.approx(alone, abs=1e-7 * np.abs(alone).max())
    with pytest.raises(SimulationError, match="overdamped"):
        base.with_oscillator(0.01, HEAD.a0, 3 * math.sqrt(HEAD.a0))
