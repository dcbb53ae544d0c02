"""Dry friction, structural damping, self-heating and softening by the envelope, against SciPy and closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from inkjet_env.plant import Excitation, Resonance, SimulationError, catalogue
from inkjet_env.plant.effect import complete
from inkjet_env.plant.effects.structural_damping import elements
from inkjet_env.plant.recorded_motion import session_of
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
PERIOD_S = 1 / HEAD.frequency_Hz
OMEGA0 = math.sqrt(HEAD.a0)
ZETA = HEAD.damping_ratio
EFFECTS = {effect.id: effect for effect in catalogue() if effect.stage == "resonator"}
RESONANCE = Resonance(HEAD.a0, HEAD.a1, HEAD.a0)
PULSE = np.interp(np.arange(600), [20, 35, 70, 85, 130, 150], [0, 80, 80, -50, -50, 0.0])


def shot_of(drive_V=PULSE, initial_state="demagnetised", channel="displacement", per_period=100, **kwargs):
    return Excitation(channel, initial_state, PERIOD_S / per_period, drive_V, **kwargs)


def motion(effect_id, excitation, resonance=RESONANCE, **values):
    """Deflection of the resonator under the drive itself."""
    effect = EFFECTS[effect_id]
    on = effect.resonator(complete(effect, **values), resonance, excitation)
    return on.motion(excitation.drive_at_nodes_V, excitation)


def integrated(excitation, force, memory=0, rates=None):
    """Deflection by SciPy, in units of 1/ω0: ``force(x, p, z)`` and ``rates(x, p, z)`` of a memory of some numbers."""
    h = excitation.step_s * OMEGA0
    drive_V = excitation.drive_V
    state, found = np.zeros(2 + memory), [0.0]
    state[0] = found[0] = drive_V[0]
    for k in range(drive_V.size - 1):

        def slope(t, s, k=k):
            u = drive_V[k] + (drive_V[k + 1] - drive_V[k]) * t / h
            x, p, z = s[0], s[1], s[2:]
            own = [] if rates is None else rates(x, p, z)
            return np.concatenate([[p, u - x - 2 * ZETA * p - force(x, p, z)], own])

        state = solve_ivp(slope, (0, h), state, rtol=1e-8, atol=1e-9, max_step=h).y[:, -1]
        found.append(state[0])
    return np.array(found)


def order_in_steps(effect_id, **values):
    """Orders with which the motion converges as nodes are added, and its relative error at 2 nodes a sample."""
    shown = [motion(effect_id, shot_of(substeps=n), **values) for n in (2, 4, 8, 64)]
    errors = [np.linalg.norm(one - shown[-1]) / np.linalg.norm(shown[-1]) for one in shown[:-1]]
    return np.log2(np.array(errors[:-1]) / errors[1:]), errors[0]


# dry friction


def test_dry_friction_solves_its_equation():
    excitation = shot_of(PULSE[:400])
    found = motion("coulomb_friction", excitation, friction_V=3.0, speed_V=2.0)
    exact = integrated(excitation, lambda x, p, z: 3.0 * math.tanh(p / 2.0))
    assert found == pytest.approx(exact, abs=2e-3 * np.abs(exact).max())


def test_dry_friction_takes_four_times_its_size_from_the_amplitude_in_each_period():
    quiet = Resonance(HEAD.a0, 1e-6 * OMEGA0, HEAD.a0)
    excitation = shot_of(np.zeros(501), "free", start=(100.0, 0.0))
    found = motion("coulomb_friction", excitation, quiet, friction_V=2.0, speed_V=0.5)
    tops = found[::100]  # the friction does not change the period
    assert np.diff(tops) == pytest.approx(-8.0 * np.ones(5), rel=0.02)


def test_slow_dry_friction_is_viscous():
    excitation = shot_of(1e-3 * PULSE)
    damped = Resonance(HEAD.a0, HEAD.a1 + OMEGA0 * 3.0 / 40.0, HEAD.a0).motion(excitation.drive_at_nodes_V, excitation)
    found = motion("coulomb_friction", excitation, friction_V=3.0, speed_V=40.0)
    assert found == pytest.approx(damped, abs=1e-4 * np.abs(damped).max())


def test_dry_friction_converges_and_is_refused_where_it_is_too_abrupt():
    orders, error = order_in_steps("coulomb_friction", friction_V=2.0, speed_V=4.0)
    assert orders.min() > 1.8
    assert error < 1e-3
    with pytest.raises(SimulationError, match="too abruptly"):
        motion("coulomb_friction", shot_of(), friction_V=2.0, speed_V=0.01)


def test_dry_friction_in_steady_state_is_that_of_the_last_of_many_laps():
    lap = PULSE[:300]
    steady = motion("coulomb_friction", shot_of(lap, "periodic"), friction_V=1.0, speed_V=3.0)
    laps = motion("coulomb_friction", shot_of(np.tile(lap, 20)), friction_V=1.0, speed_V=3.0)[-300:]
    assert steady == pytest.approx(laps, abs=1e-4 * np.abs(laps).max())


STICKING = {"friction_V": 2.0, "speed_V": 1.0, "slip_V": 5.0}


def test_sticking_surfaces_solve_their_equation():
    excitation = shot_of(PULSE[:400])
    found = motion("coulomb_friction", excitation, **STICKING)
    exact = integrated(
        excitation,
        lambda x, p, z: 2.0 * z[0],
        memory=1,
        rates=lambda x, p, z: [(math.tanh(p / 1.0) - z[0]) * abs(p) / 5.0],
    )
    assert found == pytest.approx(exact, abs=2e-3 * np.abs(exact).max())


def test_sticking_surfaces_converge():
    orders, error = order_in_steps("coulomb_friction", **STICKING)
    assert orders.mean() > 1.8  # where the motion turns within a step, an error may be smaller by chance
    assert error < 1e-3


def test_surfaces_that_stick_over_no_distance_rub():
    free = {"friction_V": 2.0, "speed_V": 1.0}
    excitation = shot_of(PULSE[:400], substeps=64)
    rubs = motion("coulomb_friction", excitation, **free)
    errors = [
        np.abs(motion("coulomb_friction", excitation, **free, slip_V=slip_V) - rubs).max() for slip_V in (1.0, 0.01)
    ]
    assert errors[0] > 8 * errors[1]  # it falls with the root of the distance: what is turned round in is short


def test_motions_that_only_stick_are_stiffer_and_lose_less_than_friction_would_take():
    quiet = Resonance(HEAD.a0, 1e-6 * OMEGA0, HEAD.a0)
    excitation = shot_of(np.zeros(501), "free", start=(1.0, 0.0), substeps=4)
    found = motion("coulomb_friction", excitation, quiet, friction_V=4.0, speed_V=1e-3, slip_V=200.0)
    turned = (np.arange(501) / 100) * math.sqrt(1 + 4.0 / 200.0)  # a spring of f / z0 beside its own
    assert found == pytest.approx(np.cos(2 * np.pi * turned), abs=0.03)
    freely = np.cos(2 * np.pi * np.arange(501) / 100)
    assert np.abs(found - freely).max() > 0.25
    assert 0.99 < found[-150:].max() < 1  # rubbing would have stopped it within a quarter of a period


def test_sticking_surfaces_in_steady_state_are_those_of_the_last_of_many_laps():
    lap = PULSE[:300]
    steady = motion("coulomb_friction", shot_of(lap, "periodic"), **STICKING)
    laps = motion("coulomb_friction", shot_of(np.tile(lap, 20)), **STICKING)[-300:]
    assert steady == pytest.approx(laps, abs=1e-4 * np.abs(laps).max())


# structural damping


def test_the_loss_factor_is_the_same_at_every_frequency_and_the_stiffness_is_kept_at_the_heads():
    rates, weights, kept = elements(1.0, 0.0)
    w = np.geomspace(0.1, 10, 41)[:, None]
    complex_stiffness = (weights * 1j * w / (1j * w + rates)).sum(axis=1) - kept
    assert complex_stiffness.imag == pytest.approx(np.ones(41), abs=0.11)
    assert complex_stiffness.imag[10:31] == pytest.approx(np.ones(21), abs=0.05)
    assert complex_stiffness[20] == pytest.approx(1j, abs=1e-12)


@pytest.mark.parametrize("power", [-0.3, 0.5])
def test_a_power_of_the_frequency_is_that_of_a_fractional_derivative(power):
    rates, weights, _ = elements(1.0, power)
    w = np.array([[0.5], [2.0]])
    loss = (weights * 1j * w / (1j * w + rates)).sum(axis=1).imag
    assert loss[1] / loss[0] == pytest.approx(4**power, rel=0.12)


def test_structural_damping_solves_its_equation():
    excitation = shot_of(PULSE[:300])
    rates, weights, kept = elements(1.0, 0.0)

    def pull(x, p, z):
        return 0.08 * (weights @ z - kept * x)

    def relax(x, p, z):
        return p - rates * z

    found = motion("structural_damping", excitation, loss_factor=0.08)
    exact = integrated(excitation, pull, rates.size, relax)
    assert found == pytest.approx(exact, abs=1e-3 * np.abs(exact).max())


def test_a_loss_factor_adds_half_of_itself_to_the_damping_ratio_of_a_ring_down():
    quiet = Resonance(HEAD.a0, 0.002 * OMEGA0, HEAD.a0)
    excitation = shot_of(np.zeros(801), "free", start=(50.0, 0.0))
    tops = motion("structural_damping", excitation, quiet, loss_factor=0.01)[300::100]
    assert -np.log(tops[1:] / tops[:-1]) / (2 * np.pi) == pytest.approx((0.001 + 0.005) * np.ones(5), rel=0.05)


@pytest.mark.parametrize("channel", ["self_sensing", "displacement"])
def test_structural_damping_in_steady_state_has_the_response_of_its_transfer_function(channel):
    """At each harmonic; the slowest element forgets only in some periods of the drive."""
    excitation = shot_of(PULSE[:250], "periodic", channel)
    drive_V = excitation.drive_at_nodes_V
    w = 2 * np.pi * np.fft.rfftfreq(drive_V.size, excitation.node_step_s) / OMEGA0
    rates, weights, kept = elements(1.0, 0.2)
    s = 1j * w[:, None]
    law = 0.06 * ((weights * s / (s + rates)).sum(axis=1) - kept)
    shown = 1 / (1 - w**2 + 2j * ZETA * w + law)
    if channel == "self_sensing":
        shown = shown * 1j * w / OMEGA0
    exact = np.fft.irfft(np.fft.rfft(drive_V) * shown, drive_V.size)[::2]
    found = motion("structural_damping", excitation, loss_factor=0.06, power=0.2)
    assert found == pytest.approx(exact, abs=1e-3 * np.abs(exact).max())


def test_structural_damping_starts_at_rest_and_converges_with_the_second_power_of_the_step():
    held = shot_of(np.full(200, 20.0))
    kept = elements(OMEGA0, 0.0)[2]
    assert motion("structural_damping", held, loss_factor=0.05) == pytest.approx(20.0 / (1 - 0.05 * kept), rel=1e-5)
    orders, error = order_in_steps("structural_damping", loss_factor=0.05)
    assert orders.min() > 1.8
    assert error < 1e-3
    with pytest.raises(SimulationError, match="static stiffness"):
        motion("structural_damping", held, loss_factor=0.4, power=-0.5)


# self-heating


def test_self_heating_solves_its_equation():
    excitation = shot_of(PULSE[:400])
    tau = 4 * 2 * math.pi  # four periods

    def pull(x, p, z):
        return z[0] * (-0.4 * x + 2.0 * 2 * ZETA * p)

    found = motion("self_heating", excitation, cooling_s=4 * PERIOD_S, stiffness_change=-0.4, damping_change=2.0)
    exact = integrated(excitation, pull, 1, lambda x, p, z: [((p / 100) ** 2 - z[0]) / tau])
    assert found == pytest.approx(exact, abs=2e-3 * np.abs(exact).max())


@pytest.mark.parametrize("cooling_periods", [2.0, 40.0, 3000.0])
def test_the_warmth_of_a_repeated_burst_is_that_of_its_mean_power(cooling_periods):
    """A pure tone: the head rings as one of the stiffness and damping that belong to its own power, found by itself."""
    n = 400
    tone_V = 6 * np.sin(2 * np.pi * np.arange(n) / 100)
    excitation = shot_of(tone_V, "periodic")
    values = {"stiffness_change": -0.2, "damping_change": 3.0}
    found = motion("self_heating", excitation, cooling_s=cooling_periods * PERIOD_S, **values)
    amplitude_V = 0.0
    for _ in range(200):
        w = amplitude_V**2 / 2e4
        next_V = 6 / abs(1 - 0.2 * w - 1 + 2j * ZETA * (1 + 3 * w))
        amplitude_V += 0.3 * (next_V - amplitude_V)
    exact = np.abs(np.fft.rfft(found)[4]) * 2 / n
    assert exact == pytest.approx(amplitude_V, rel=3e-3 if cooling_periods > 10 else 2e-2)


def test_self_heating_in_steady_state_is_that_of_the_last_of_many_laps():
    lap, values = PULSE[:300], {"cooling_s": 8 * PERIOD_S, "stiffness_change": -0.3, "damping_change": 1.0}
    steady = motion("self_heating", shot_of(lap, "periodic"), **values)
    laps = motion("self_heating", shot_of(np.tile(lap, 40)), **values)[-300:]
    assert steady == pytest.approx(laps, abs=1e-6 * np.abs(laps).max())


def test_weak_self_heating_that_cools_at_once_or_never_is_none():
    base = RESONANCE.motion(shot_of().drive_at_nodes_V, shot_of())
    for values in ({"cooling_s": 1e4, "stiffness_change": 1.0}, {"cooling_s": PERIOD_S, "stiffness_change": 1e-9}):
        assert motion("self_heating", shot_of(), **values) == pytest.approx(base, abs=1e-5)


def test_self_heating_converges_with_the_second_power_of_the_step_and_may_run_away():
    orders, error = order_in_steps("self_heating", cooling_s=3 * PERIOD_S, stiffness_change=-0.3, damping_change=1.0)
    assert orders.min() > 1.8
    assert error < 1e-3
    with pytest.raises(SimulationError):
        motion("self_heating", shot_of(), cooling_s=PERIOD_S, stiffness_change=-10.0)


def test_what_earlier_recordings_dissipate_shifts_a_whole_recording():
    """Against the closed form: what each leaves, times what is kept of it until now; later recordings are not felt."""
    keep = math.exp(-1 / 2.5)
    session = ((1, 4e3), (2, 1e3), (4, 2e3), (5, 9e3))
    warm = (4e3 * keep**3 + 1e3 * keep**2 + 2e3) / 1e4
    values = {"session_stiffness_change": -0.05, "session_damping_change": 0.4, "memory_orders": 2.5}
    values["cooling_s"] = PERIOD_S
    excitation = shot_of(order=4, session=session)
    a0, a1 = HEAD.a0 * (1 - 0.05 * warm), HEAD.a1 * (1 + 0.4 * warm)
    expected = Resonance(a0, a1, HEAD.a0).motion(excitation.drive_at_nodes_V, excitation)
    assert motion("self_heating", excitation, **values) == pytest.approx(expected, abs=1e-9)
    cold = RESONANCE.motion(excitation.drive_at_nodes_V, excitation)
    assert motion("self_heating", shot_of(order=4), **values) == pytest.approx(cold, abs=1e-12)


def test_the_power_of_a_session_is_that_of_the_motion_and_slow_recordings_have_none():
    tone = shot_of(0.5 * np.sin(2 * np.pi * np.arange(400) / 100), "periodic", order=3)
    linear = Printhead(HEAD.a0, HEAD.a1, HEAD.b1, (1.0, 0.0), HEAD.full_scale_V)
    slow = shot_of(PULSE, channel="strain_gauge", order=1)
    ((order, power),) = session_of(linear, [tone, slow])
    amplitude_V = 0.5 / (2 * ZETA)  # at the resonance
    assert order == 3
    assert power == pytest.approx(amplitude_V**2 / 2, rel=2e-3)


# softening by the envelope


def test_softening_by_the_envelope_solves_its_equation():
    excitation = shot_of(PULSE[:400])
    tau = 2 * math.pi * 1.5

    def pull(x, p, z):
        return math.sqrt(2 * max(z[0], 0.0)) * (-4e-4 * x + 6e-4 * p)

    values = {"envelope_per_V": 2e-4, "loss_ratio": 1.5, "memory_periods": 1.5}
    found = motion("ferroelastic_softening", excitation, **values)
    exact = integrated(excitation, pull, 1, lambda x, p, z: [(p**2 - z[0]) / tau])
    assert found == pytest.approx(exact, abs=2e-3 * np.abs(exact).max())


def test_a_held_deflection_does_not_soften_the_ring_around_it():
    """Unlike the amplitude from zero, the envelope is that of the motion."""
    small = np.interp(np.arange(600), [20, 30, 60, 70], [0, 1.0, 1.0, 0.0])
    on_bias, alone = shot_of(60 + small), shot_of(small)
    changes = []
    for name in ("envelope_per_V", "softening_per_V"):
        values = {name: 2e-4, "loss_ratio": 0.1}
        moved = motion("ferroelastic_softening", on_bias, **values)
        changes.append(np.abs((moved - moved[0]) - motion("ferroelastic_softening", alone, **values)).max())
    assert changes[0] < 0.1 * changes[1]


def test_in_steady_state_the_envelope_is_the_amplitude():
    tone_V = 4 * np.sin(2 * np.pi * np.arange(300) / 100)
    steady = shot_of(tone_V, "periodic")
    values = {"loss_ratio": 1.0, "memory_periods": 30.0}
    by_envelope = motion("ferroelastic_softening", steady, envelope_per_V=2e-4, **values)
    at_once = motion("ferroelastic_softening", steady, softening_per_V=2e-4, loss_ratio=1.0)
    assert by_envelope == pytest.approx(at_once, abs=0.02 * np.abs(at_once).max())


def test_laws_without_the_envelope_are_as_before():
    effect = EFFECTS["ferroelastic_softening"]
    for start in effect.starts(HEAD, [shot_of()]):
        assert start["envelope_per_V"] == 0.0
        assert start["memory_periods"] == 1.0
