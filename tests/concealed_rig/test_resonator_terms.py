"""Each further term of the equation of motion against the same equation, written out anew, by SciPy, and its energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from experiments.concealed_rig.effects.effect import Situation
from experiments.concealed_rig.effects.loss import SelfHeating, StructuralDamping, constant_loss_states
from experiments.concealed_rig.effects.spring import FerroelasticSoftening, QuadraticDamping
from experiments.concealed_rig.effects.wave import SecondMode, half_steps
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.head import drawn_head
from experiments.concealed_rig.linear import linear_motion
from experiments.concealed_rig.resonator import Motion, Resonator, motion

OMEGA, ZETA = 2 * np.pi * 5e4, 0.04
GRID = Grid(1200, 2e-5 / 200, 1, False)
STEP = GRID.step_s * OMEGA
FORCING_V = 120.0


def forcing(t):
    """A smooth burst of four periods, at rest before and after, t in units of 1/ω₀."""
    length = 8 * np.pi
    return FORCING_V * np.sin(0.9 * t) * np.sin(np.pi * np.clip(t / length, 0, 1)) ** 4


def moved(resonator):
    h = forcing(np.arange(2 * GRID.steps + 1) * STEP / 2)
    return motion(resonator, h, np.zeros_like(h), GRID)


def exact(acceleration, further=0):
    """Deflection by an eighth-order method; `acceleration(h, x, v, rest)` gives v' and the derivatives of the rest."""

    def change(t, state):
        pull, *rest = acceleration(forcing(t), state[0], state[1], state[2:])
        return [state[1], pull, *rest]

    t = np.arange(GRID.steps + 1) * STEP
    run = solve_ivp(change, (0, t[-1]), np.zeros(2 + further), method="DOP853", rtol=1e-10, atol=1e-9, t_eval=t)
    return run.y[0]


CASES = {
    "bounded_cubic": (
        {"cubic_per_V2": 2e-6, "cubic_bound_per_V2": 1e-5},
        lambda h, x, v, r: [h - x - 2e-6 * x**3 / (1 + 1e-5 * x**2) - 2 * ZETA * v],
    ),
    "power_of_drag": (
        {"quadratic_damping_per_V": 1e-4, "drag_power": 1.3},
        lambda h, x, v, r: [h - x - 2 * ZETA * v - (1e-4 * abs(v)) ** 1.3 * v],
    ),
    "stribeck": (
        {"friction_V": 4.0, "friction_speed_V": 20.0, "stribeck": 0.8, "stribeck_speed_V": 60.0},
        lambda h, x, v, r: [h - x - 2 * ZETA * v - 4 * (1 + 0.8 * np.exp(-((v / 60) ** 2))) * np.tanh(v / 20)],
    ),
    "envelope": (
        {"envelope_softening_per_V": 2e-4, "envelope_loss_per_V": 1e-4},
        lambda h, x, v, r: [h - x + 2e-4 * np.hypot(x, v) * x - 2 * ZETA * v - 1e-4 * np.hypot(x, v) * v],
    ),
    "quadratic": (
        {"quadratic_per_V": 3e-4},
        lambda h, x, v, r: [h - x - 3e-4 * x**2 - 2 * ZETA * v],
    ),
    "inertance": (
        {"inertance_per_V": 4e-4},
        lambda h, x, v, r: [(h - x - 2 * ZETA * v - 2e-4 * v**2) / (1 + 4e-4 * x)],
    ),
    "van_der_pol": (
        {"van_der_pol": 0.6, "van_der_pol_V": 150.0},
        lambda h, x, v, r: [h - x - 2 * ZETA * (1 - 0.6 * (1 - (x / 150) ** 2)) * v],
    ),
    "stop": (
        {"stop_V": 100.0, "stop_stiffness": 0.8, "stop_loss_per_V": 2e-3},
        lambda h, x, v, r: [h - x - 2 * ZETA * v - (x > 100) * (0.8 + 2e-3 * v) * (x - 100)],
    ),
    "autoparametric": (
        {"auto_per_V": 2e-3, "auto_ratio": 1.9, "auto_damping": 0.03},
        lambda h, x, v, r: [
            h - x - 2 * ZETA * v - 4e-3 * x * r[0],
            r[1],
            -1.9 * (1.9 * r[0] + 0.06 * r[1]) - 2e-3 * x**2,
        ],
    ),
    "warming": (
        {"meniscus_gain": -0.1, "meniscus_kind": 4.0, "meniscus_s": 1e-4, "meniscus_V": 90.0, "meniscus_loss": -0.3},
        lambda h, x, v, r: [
            h - (1 - 0.1 * r[0]) * x - 2 * ZETA * (1 - 0.3 * r[0]) * v,
            ((v / 90) ** 2 - r[0]) / (1e-4 * OMEGA),
        ],
    ),
    "outflow": (
        {"meniscus_gain": 0.1, "meniscus_kind": 3.0, "meniscus_s": 1e-4, "meniscus_V": 90.0},
        lambda h, x, v, r: [
            h - (1 + 0.1 * r[0]) * x - 2 * ZETA * v,
            (max(v, 0.0) / 90 - r[0]) / (1e-4 * OMEGA),
        ],
    ),
}
FURTHER = {"autoparametric": 2, "warming": 1, "outflow": 1}


@pytest.mark.parametrize("name", CASES)
def test_a_term_moves_the_resonator_as_the_equation_written_anew_does(name):
    """Left: the step, 1e-6; of the stop, whose force has a kink, the step across it, 2.1e-5."""
    numbers, acceleration = CASES[name]
    found = moved(Resonator(OMEGA, ZETA, **numbers)).deflection_V
    expected = exact(acceleration, FURTHER.get(name, 0))
    plain = moved(Resonator(OMEGA, ZETA)).deflection_V
    assert np.max(np.abs(found - plain)) > 0.01 * np.max(np.abs(plain))  # the term is no trifle
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=(4e-5 if name == "stop" else 5e-6) * np.max(np.abs(expected))
    )


@pytest.mark.parametrize("coefficient", [4e-4, -4e-4])
def test_a_mass_that_follows_the_deflection_keeps_the_energy(coefficient):
    """(1 + m x)v²/2 + x²/2 after the forcing; left: the step over twenty periods."""
    run = moved(Resonator(OMEGA, 0.0, inertance_per_V=coefficient))
    x, v = run.deflection_V, run.speed_V
    energy = ((1 + coefficient * x) * v**2 + x**2)[850:]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


def test_structural_loss_takes_the_same_share_of_each_swing_at_any_frequency():
    """Σ c iω/(iω + λ): its imaginary part is 1 between the rates' ends, less what lies beyond them."""
    rate, weight = constant_loss_states(0.01, 30.0)
    for w in (0.1, 0.3, 1.0, 3.0):
        beyond = (np.arctan(0.01 / w) + np.arctan(w / 30.0)) * 2 / np.pi
        assert np.sum(weight * 1j * w / (1j * w + rate)).imag == pytest.approx(1 - beyond, abs=2e-2)
    # Viscous loss would grow tenfold over this decade.
    loss = [np.sum(weight * 1j * w / (1j * w + rate)).imag for w in (0.2, 2.0)]
    assert loss[1] / loss[0] == pytest.approx(1.0, abs=0.07)


def test_structural_damping_is_said_as_the_damping_ratio_at_the_resonance():
    for variant, power in (("springpot", 0.4), ("constant_loss", 0.5)):
        effect = StructuralDamping(0.02, variant=variant, power=power, slowest=0.01)
        resonator = effect.on_resonator(Resonator(OMEGA, 0.0), 1)
        rate, weight = (np.array(a) for a in (resonator.diffusive_rate, resonator.diffusive_weight))
        loss = np.sum(weight * 1j / (1j + rate)).imag / 2 + resonator.damping_ratio
        assert loss == pytest.approx(effect.parameters()["damping_ratio_at_resonance"], rel=4e-2)


def test_all_powers_of_drag_have_one_force_at_the_largest_speed():
    for variant, power in (("drag", 1.0), ("turbulent", 0.8), ("orifice", 1.3)):
        drag = QuadraticDamping(0.5, variant=variant, power=power, damping_ratio=0.05, largest_V=80.0)
        resonator = drag.on_resonator(Resonator(OMEGA, 0.05), 1)
        n = resonator.drag_power or 1.0
        assert (resonator.quadratic_damping_per_V * 80.0) ** n == pytest.approx(0.5 * 2 * 0.05, rel=1e-12)


def test_the_envelopes_loss_is_about_rayleighs():
    """Work a period at the amplitude A: ∮ c A v dx = πcA³; Rayleigh's law takes (4/3) r A³."""
    envelope = FerroelasticSoftening(0.1, variant="envelope", largest_V=100.0, loss=4 / (3 * np.pi))
    resonator = envelope.on_resonator(Resonator(OMEGA, 0.0), 1)
    assert np.pi * resonator.envelope_loss_per_V == pytest.approx(4 / 3 * 1e-3, rel=1e-12)


def test_a_head_that_warms_within_a_session_cools_after_it():
    head = drawn_head(np.random.default_rng(1))
    power = (0.0, 4.0, 4.0, 0.0, 0.0)
    situation = Situation(head, 5, False, {"self_sensing": 0.01}, 8.0, 150.0, 150.0, 8e7, (0.0,) * 5, power)
    effects = [SelfHeating.drawn(situation, np.random.default_rng(k)) for k in range(30)]
    warming = next(effect for effect in effects if effect.variant == "session")
    course = np.array(warming.course)
    assert course[0] == 0.0
    assert course[1] < course[2] < 1.0
    assert course[2] > course[3] > course[4] > course[5] > 0
    keep = np.exp(-1 / warming.recordings)
    assert course[2] == pytest.approx(1 - keep**2, rel=1e-12)


def test_a_cascaded_mode_is_the_second_one_shaken_by_the_first():
    """As one tone: first response times second; left: what the cubic between the steps lacks."""
    grid = Grid(1000, 2e-7, 2, True)
    t = np.arange(2 * grid.steps + 1) * grid.half_s
    h = np.sin(2 * np.pi * 5 * t / (1000 * 2e-7))
    first = Motion(*linear_motion(OMEGA, 0.05, h, grid))
    mode = SecondMode(0.3, variant="cascaded", resonance_Hz=5e4, frequency_Hz=4e4, damping_ratio=0.03)
    added = mode.on_motion(first, h, Resonator(OMEGA, 0.05), grid, 1).deflection_V - first.deflection_V
    w = 2 * np.pi * 5 / (1000 * 2e-7)
    line = np.exp(-1j * w * grid.step_times_s[:-1])
    one, two = (1 / (1 - (w / p) ** 2 + 2j * z * w / p) for p, z in ((OMEGA, 0.05), (2 * np.pi * 4e4, 0.03)))
    got = 2j * np.mean(added[:-1] * line)
    assert got == pytest.approx(0.3 * one * two, rel=1e-4)
    wave = np.cos(np.linspace(0, 2 * np.pi, 201))
    np.testing.assert_allclose(
        half_steps(wave, Grid(200, 1.0, 1, True))[1::2], np.cos((np.arange(200) + 0.5) * np.pi / 100), atol=2e-7
    )
