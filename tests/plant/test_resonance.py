"""The plant's motion against the closed form, against integrators that share nothing with it, and against itself."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from inkjet_env.identification.basis import drive_basis
from inkjet_env.plant import Excitation, Force, Mode, Plant, Resonance, SimulationError, compiled_force
from inkjet_env.plant.recorded_motion import reach_V
from inkjet_env.plant.refill import Refill
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
STEP_S = 2e-7
"""About a hundred a period of the head."""


@compiled_force
def cubic_and_drag(x_V, speed_V, values):
    """A force of both kinds."""
    return values[0] * x_V**3 + values[1] * abs(speed_V) * speed_V


PUSHED = Force(cubic_and_drag, np.array([2e-6, 3e-4]))


def pulse(samples=1000, offset_V=0.0):
    """A bipolar pulse whose corners are samples, and rest."""
    corners = [0, 20, 70, 110, 160, 200]
    return offset_V + np.interp(np.arange(samples), corners, [0.0, 80.0, 80.0, -60.0, -60.0, 0.0])


def tones(samples=1000):
    """A smooth drive, repeated every ``samples``."""
    phase = 2 * np.pi * np.arange(samples) / samples
    return 40 * np.sin(7 * phase) + 25 * np.cos(11 * phase + 1) - 25 * math.cos(1)


def error_of(motion, expected):
    """Largest error over the largest value."""
    return np.abs(motion - expected).max() / np.abs(expected).max()


def closed_form(excitation, head):
    """Motion by the closed form that identification uses."""
    basis = drive_basis(excitation.drive_V, excitation.step_s, head.full_scale_V, 8, excitation.initial_state)
    return basis.response(excitation.channel, head.a0, head.a1) @ head.branch_law.ascending[1:]


def integrated(resonance, excitation, hysteretic_V, start, rtol=1e-11):
    """Deflection and speed at the samples by an integrator for any equation, piece by piece; drive linear between."""
    ends = np.append(hysteretic_V, hysteretic_V[0]) if excitation.periodic else hysteretic_V
    h = excitation.node_step_s
    omega0 = math.sqrt(resonance.a0)
    states = [np.array(start, dtype=float)]
    softening = np.zeros(ends.size) if resonance.softening is None else np.resize(resonance.softening, ends.size)

    def slopes(t, y, i):
        part = t / h
        v = ends[i] + part * (ends[i + 1] - ends[i])
        m = softening[i] + part * (softening[i + 1] - softening[i])
        pushed = sum(force.law(y[0], y[1] / omega0, force.values) for force in resonance.forces)
        inward = resonance.a0 * (1 + m) * y[0] + resonance.drive_a0 * pushed
        return [y[1], resonance.drive_a0 * v - inward - resonance.a1 * y[1]]

    for i in range(ends.size - 1):
        found = solve_ivp(slopes, (0, h), states[-1], "DOP853", rtol=rtol, atol=1e-9, args=(i,))
        states.append(found.y[:, -1])
    return np.array(states)[:: excitation.substeps].T


@pytest.mark.parametrize("channel", ["self_sensing", "displacement", "strain_gauge"])
@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic", "free"])
@pytest.mark.parametrize("frequency_Hz", [50.0, 51.7e3])
def test_no_effect_is_the_closed_form(channel, initial_state, frequency_Hz):
    head = HEAD.varied(frequency_Hz=frequency_Hz)
    excitation = Excitation(channel, initial_state, 0.01 / frequency_Hz, pulse())
    assert error_of(Plant(head).motion(excitation.drive_at_nodes_V, excitation), closed_form(excitation, head)) < 3e-7


def test_a_constant_drive_leaves_the_head_at_rest_where_it_holds_it():
    excitation = Excitation("displacement", "demagnetised", STEP_S, pulse(offset_V=30.0))
    expected = closed_form(excitation, HEAD)
    assert expected[0] > 10
    assert error_of(Plant(HEAD).motion(excitation.drive_at_nodes_V, excitation), expected) < 3e-7
    held = Excitation("self_sensing", "demagnetised", STEP_S, np.full(50, 40.0))
    stiff = Resonance(1.1 * HEAD.a0, HEAD.a1, HEAD.a0, forces=(PUSHED,), softening=np.full(held.nodes, 0.05))
    moved = stiff.motion(np.full(held.nodes, 40.0), held) * HEAD.a0 / math.sqrt(HEAD.a0)
    assert np.abs(moved).max() < 1e-9 * 40


def held_at_V(resonance, drive_V):
    """Deflection at which a constant drive holds the head, and how far it moves from there."""
    held = Excitation("displacement", "demagnetised", STEP_S, np.full(200, drive_V))
    motion = resonance.motion(np.full(held.nodes, drive_V), held)
    return motion[0], np.ptp(motion)


@pytest.mark.parametrize("contraction", [0.02, 0.3, 0.5, 0.6, 0.9])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_rest_is_where_forces_and_spring_hold_the_drive(contraction, sign):
    """Of x + k x³ = v by bisection; an iteration leaves 3 k x² of the error before, here between 2 % and 90 %."""
    rest_V = 20.0
    cubic = sign * contraction / (3 * rest_V**2)
    drive_V = rest_V + cubic * rest_V**3
    expected = brentq(lambda x: x + cubic * x**3 - drive_V, 0, 1.02 * rest_V, xtol=1e-13)
    assert expected == pytest.approx(rest_V, rel=1e-12)
    resonance = Resonance(HEAD.a0, HEAD.a1, HEAD.a0, forces=(Force(cubic_and_drag, np.array([cubic, 0.0])),))
    found, moves = held_at_V(resonance, drive_V)
    # what 30 iterations leave, or else AT_REST of the last change of a geometric series
    left = max(contraction**30, 1e-15) if contraction <= 0.6 else 1e-6 * contraction / (1 - contraction)
    assert abs(found - expected) < 1.5 * left * rest_V
    assert moves < 4 * left * rest_V + 1e-12


@pytest.mark.parametrize(
    "cubic",
    [
        0.36 / 20.0**2,  # the iteration goes to and fro between two deflections, neither of them at rest
        5.0 / 20.0**2,  # it grows without bound
        -0.5 / 20.0**2,  # nothing holds the drive: the spring has snapped through
    ],
)
@pytest.mark.parametrize("initial_state", ["demagnetised", "free"])
def test_a_rest_that_is_not_found_is_told(cubic, initial_state):
    drive_V = 20.0 + cubic * 20.0**3 if cubic > 0 else 20.0
    resonance = Resonance(HEAD.a0, HEAD.a1, HEAD.a0, forces=(Force(cubic_and_drag, np.array([cubic, 0.0])),))
    excitation = Excitation("displacement", initial_state, STEP_S, np.full(200, drive_V), start=(1.0, 0.0))
    with pytest.raises(FloatingPointError, match="no rest was found under the first drive"):
        resonance.motion(np.full(excitation.nodes, drive_V), excitation)


def test_a_repeated_drive_has_its_steady_state_though_there_be_no_rest_where_it_starts():
    """The same period, begun at a drive of 0 V and at one where the iteration for the rest does not end."""
    resonance = Resonance(HEAD.a0, HEAD.a1, HEAD.a0, forces=(Force(cubic_and_drag, np.array([4e-4, 0.0])),))
    excitation = Excitation("displacement", "periodic", 0.5e-6, 40 * np.sin(2 * np.pi * np.arange(400) / 400) ** 3)
    drive_V = excitation.drive_at_nodes_V
    top = 2 * 100
    assert abs(drive_V[top]) == 40
    with pytest.raises(FloatingPointError, match="no rest"):
        held_at_V(resonance, 40.0)
    begun_at_the_top = resonance.motion(np.roll(drive_V, -top), excitation)
    assert error_of(np.roll(begun_at_the_top, 100), resonance.motion(drive_V, excitation)) < 1e-6


def test_the_closed_form_is_met_with_fourth_order_where_corners_are_samples():
    errors = []
    for substeps in (2, 4, 8):
        excitation = Excitation("self_sensing", "demagnetised", STEP_S, pulse(), substeps=substeps)
        errors.append(
            error_of(Plant(HEAD).motion(excitation.drive_at_nodes_V, excitation), closed_form(excitation, HEAD))
        )
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.3)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4, abs=0.3)


@pytest.mark.parametrize("initial_state", ["demagnetised", "free"])
def test_forced_motion_is_what_a_general_integrator_finds(initial_state):
    excitation = Excitation("displacement", initial_state, STEP_S, pulse(500), start=(9.0, -14.0))
    resonance = Resonance(0.95 * HEAD.a0, HEAD.a1, HEAD.a0, forces=(PUSHED,))
    start = (0.0, 0.0) if initial_state == "demagnetised" else (9.0, -14.0 * math.sqrt(resonance.a0))
    deflection, speed = integrated(resonance, excitation, excitation.drive_at_nodes_V, start)
    linear = replace(resonance, forces=()).motion(excitation.drive_at_nodes_V, excitation)
    assert error_of(linear, deflection) > 0.01  # the forces show
    assert error_of(resonance.motion(excitation.drive_at_nodes_V, excitation), deflection) < 2e-6
    sensed = resonance.motion(excitation.drive_at_nodes_V, replace(excitation, channel="self_sensing"))
    assert error_of(sensed * HEAD.a0, speed) < 5e-6


def test_a_stiffness_that_changes_in_time_is_what_a_general_integrator_finds():
    excitation = Excitation("displacement", "demagnetised", STEP_S, pulse(500))
    softening = 0.1 * np.sin(np.arange(excitation.nodes) / 150)
    resonance = Resonance(HEAD.a0, HEAD.a1, HEAD.a0, softening=softening)
    expected = integrated(resonance, excitation, excitation.drive_at_nodes_V, (0.0, 0.0))[0]
    assert error_of(replace(resonance, softening=None).motion(excitation.drive_at_nodes_V, excitation), expected) > 0.01
    assert error_of(resonance.motion(excitation.drive_at_nodes_V, excitation), expected) < 2e-6


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic", "free"])
def test_forces_are_followed_with_third_order(initial_state):
    resonance = Resonance(HEAD.a0, HEAD.a1, HEAD.a0, forces=(PUSHED,))
    found = []
    for substeps in (2, 4, 8, 16):
        excitation = Excitation(
            "displacement", initial_state, 6 * STEP_S, tones(300), substeps=substeps, start=(9.0, -14.0)
        )
        # The forcing itself is smooth here, so that its interpolation is of higher order.
        phase = 2 * np.pi * np.arange(excitation.nodes) / (300 * substeps)
        found.append(resonance.motion(40 * np.sin(7 * phase) + 25 * (np.cos(11 * phase) - 1), excitation))
    changes = [np.abs(a - b).max() for a, b in itertools.pairwise(found)]
    orders = np.log2(np.array(changes[:-1]) / changes[1:])
    assert ((orders > 2.6) & (orders < 4.4)).all(), orders


@pytest.mark.parametrize("forced", [False, True])
def test_periodic_is_the_last_of_many_laps(forced):
    samples, laps = 500, 40
    resonance = Resonance(HEAD.a0, HEAD.a1, HEAD.a0)
    if forced:
        rising = 0.05 * np.sin(2 * np.pi * np.arange(2 * samples) / (2 * samples))
        resonance = replace(resonance, forces=(PUSHED,), softening=rising)
    once = Excitation("self_sensing", "periodic", STEP_S, tones(samples))
    many = Excitation(
        "self_sensing", "demagnetised", STEP_S, np.append(np.tile(tones(samples), laps), tones(samples)[0])
    )
    lap = resonance.motion(once.drive_at_nodes_V, once)
    repeated = resonance
    if forced:
        repeated = replace(resonance, softening=np.resize(resonance.softening, many.nodes))
    last = repeated.motion(many.drive_at_nodes_V, many)[-samples - 1 : -1]
    assert error_of(lap, last) < 1e-8


def test_a_second_mode_superposes():
    excitation = Excitation("displacement", "periodic", STEP_S, pulse())
    other = HEAD.varied(frequency_Hz=2.2 * HEAD.frequency_Hz, damping_ratio=0.02)
    both = Resonance(HEAD.a0, HEAD.a1, HEAD.a0, modes=(Mode(other.a0, other.a1, 0.3),))
    drive_V = excitation.drive_at_nodes_V
    alone = [Resonance(h.a0, h.a1, h.a0).motion(drive_V, excitation) for h in (HEAD, other)]
    assert both.motion(drive_V, excitation) == pytest.approx(alone[0] + 0.3 * alone[1], abs=1e-9)


def test_a_motion_that_grows_without_bound_is_told():
    excitation = Excitation("displacement", "demagnetised", STEP_S, pulse())
    runaway = Force(cubic_and_drag, np.array([-1e-2, 0.0]))
    with pytest.raises(SimulationError, match="grows without bound"):
        Resonance(HEAD.a0, HEAD.a1, HEAD.a0, forces=(runaway,)).motion(excitation.drive_at_nodes_V, excitation)


@pytest.mark.parametrize("refills", [(), (Refill(0.1, 1.0, 1e-4, 0.0),)])
def test_a_resonator_that_does_not_ring_is_told(refills):
    excitation = Excitation("displacement", "demagnetised", STEP_S, pulse())
    for a0, a1 in ((HEAD.a0, 3 * math.sqrt(HEAD.a0)), (-HEAD.a0, HEAD.a1)):
        with pytest.raises(SimulationError, match="does not ring"):
            Resonance(a0, a1, HEAD.a0, refills=refills).motion(excitation.drive_at_nodes_V, excitation)


def test_reach_is_the_largest_deflection_up_to_the_width_of_the_hysteresis():
    excitations = [
        Excitation("self_sensing", "periodic", STEP_S, tones()),
        Excitation("strain_gauge", "periodic", 1.0, 9 * tones()),
    ]
    seen = Plant(HEAD).motion(excitations[0].drive_at_nodes_V, replace(excitations[0], channel="displacement"))
    assert reach_V(HEAD, excitations) == pytest.approx(np.abs(seen).max(), rel=0.3)
