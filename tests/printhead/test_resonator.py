"""The resonator's closed form against limits, an integrator and itself."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inkjet_env.printhead import LumpedElements, Printhead, Waveform
from inkjet_env.printhead.resonator import PiecewiseResponse, check_resonator, moments, pole

HEAD = Printhead.published()
LINEAR = Printhead(HEAD.a0, HEAD.a1, HEAD.b1, (1.0, 0.0))  # no hysteresis: the drive itself
OPTIMUM = Waveform(100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6)


def test_published_head_rings_at_51_7_kHz_and_keeps_86_percent_a_half_period():
    root = pole(HEAD.a0, HEAD.a1)
    assert HEAD.frequency_Hz == pytest.approx(51.69e3, abs=10)
    assert HEAD.damping_ratio == pytest.approx(0.0469, abs=5e-5)
    assert 2 * math.pi / root.imag == pytest.approx(19.37e-6, abs=5e-9)
    assert math.exp(root.real * math.pi / root.imag) == pytest.approx(0.863, abs=5e-4)


def test_the_pole_solves_the_characteristic_equation_even_near_critical_damping():
    for a1 in (1.0, 3.046e4, 2 * math.sqrt(HEAD.a0) * (1 - 1e-12)):
        root = pole(HEAD.a0, a1)
        assert abs(root) ** 2 == pytest.approx(HEAD.a0, rel=1e-14)
        assert root.real == -a1 / 2


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-3, 0.3, 1.0, 5.0, 9.9, 10.1, 30.0, 300.0])
def test_moments_keep_their_digits_at_every_size_of_the_argument(size):
    z = size * pole(HEAD.a0, HEAD.a1) / math.sqrt(HEAD.a0)
    got = moments([z], 9)[0]
    with mpmath.workdps(60):
        for k in range(9):
            exact = mpmath.hyp1f1(1, k + 2, mpmath.mpc(z)) / (k + 1)  # Kummer's function
            assert abs(complex(exact) - got[k]) < 2e-15 / (k + 1)


def test_moments_are_one_over_k_plus_one_at_zero():
    np.testing.assert_allclose(moments([0j], 9)[0], 1 / np.arange(1, 10), rtol=1e-15)


def test_a_jump_answers_with_the_impulse_response():
    """G_s on a step of U volts is U b1 e^{-a1 t/2} sin(ωt)/ω."""
    jump = LINEAR.respond(Waveform(10, 0, 0, 1e-3, 0, 0, 0))
    t = np.linspace(1e-8, 300e-6, 500)
    omega = pole(HEAD.a0, HEAD.a1).imag
    exact = 10 * HEAD.b1 * np.exp(-HEAD.a1 * t / 2) * np.sin(omega * t) / omega
    np.testing.assert_allclose(jump.sensor_V(t), exact, atol=1e-13)


def test_short_edges_approach_the_jump_linearly():
    jump = HEAD.respond(Waveform(50, -50, 0, 9e-6, 0, 9e-6, 0)).cost()
    errors = [abs(HEAD.respond(Waveform(50, -50, d, 9e-6, d, 9e-6, d)).cost() - jump) for d in (1e-9, 1e-10, 1e-11)]
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 10, rtol=0.05)


@pytest.mark.parametrize("head", [HEAD, LINEAR])
def test_closed_form_equals_an_integrator(head):
    """Runge–Kutta of order 8 on y'' + a1 y' + a0 y = b1 v', piece by piece."""
    from scipy.integrate import solve_ivp

    response = head.respond(OPTIMUM)
    knots_s, knots_V = OPTIMUM.knots()
    law = head.branch_law
    origins = [knots_V.min(), None, knots_V.max(), None, knots_V.min()]
    state = np.zeros(2)
    for i, origin in enumerate(origins):
        slope = np.diff(knots_V)[i] / np.diff(knots_s)[i]

        def rate(t, y, i=i, slope=slope, origin=origin):
            u = knots_V[i] + slope * (t - knots_s[i])
            v_rate = 0.0 if origin is None else float(law.slope(abs(u - origin) / law.full_scale_V)) * slope
            return [y[1], head.b1 * v_rate - head.a1 * y[1] - head.a0 * y[0]]

        t = np.linspace(knots_s[i], knots_s[i + 1], 30)
        # The tangent continuation makes v'' jump at x = 1; small steps keep that out of the comparison.
        path = solve_ivp(rate, t[[0, -1]], state, method="DOP853", t_eval=t, rtol=1e-12, atol=1e-13, max_step=2e-8)
        np.testing.assert_allclose(response.sensor_V(t), path.y[0], atol=2e-9)
        state = path.y[:, -1]


@given(st.lists(st.floats(0, 1e-4), min_size=5, max_size=5), st.floats(0, 100), st.floats(-100, 0))
@settings(max_examples=60, deadline=None)
def test_without_hysteresis_the_response_is_linear_in_the_drive(durations_s, U1, U2):
    t = np.linspace(0, 400e-6, 200)
    single = LINEAR.respond(Waveform(U1, U2, *durations_s)).sensor_V(t)
    double = LINEAR.respond(Waveform(2 * U1, 2 * U2, *durations_s)).sensor_V(t)
    np.testing.assert_allclose(double, 2 * single, rtol=1e-9, atol=1e-12)


@given(st.lists(st.floats(0, 5e-5), min_size=5, max_size=5), st.floats(0, 100), st.floats(-100, 0))
@settings(max_examples=80, deadline=None)
def test_every_listed_peak_is_a_local_extremum_and_the_curve_between_is_monotone(durations_s, U1, U2):
    response = HEAD.respond(Waveform(U1, U2, *durations_s))
    times, peaks = response.peak_times_s, response.peaks_V
    assert (np.diff(times) >= 0).all()
    np.testing.assert_allclose(response.sensor_V(times), peaks, rtol=1e-9, atol=1e-9)
    scale = max(1e-9, np.abs(peaks).max(initial=0.0))
    for a, b, low, high in zip(times[:-1], times[1:], peaks[:-1], peaks[1:], strict=True):
        between = response.sensor_V(np.linspace(a, b, 40))
        assert (np.diff(between) * np.sign(high - low) >= -1e-9 * scale).all()


def test_an_infinite_window_sums_the_whole_geometric_tail():
    far, infinite = HEAD.respond(OPTIMUM, window_s=3e-3), HEAD.respond(OPTIMUM, window_s=math.inf)
    assert infinite.cost() == pytest.approx(far.cost(), rel=1e-12)
    bumpy = Waveform(50, -50, 1e-6, 5e-6, 5e-6, 5e-6, 1e-6)
    ratio = math.exp(pole(HEAD.a0, HEAD.a1).real * math.pi / pole(HEAD.a0, HEAD.a1).imag)
    listed = HEAD.respond(bumpy, window_s=400e-6)
    rest = abs(listed.peaks_V[-1]) * ratio / (1 - ratio)
    assert HEAD.respond(bumpy, window_s=math.inf).cost() == pytest.approx(listed.cost() + rest, rel=1e-12)


def test_ringing_that_cancels_leaves_no_peaks_of_rounding():
    """No waveform, no peaks; and equal plateaus joined by no change of drive ring on as one."""
    assert HEAD.respond(Waveform(0, 0, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6)).peaks_V.size == 0
    assert HEAD.respond(Waveform(50, -50, 0, 0, 0, 0, 0), "periodic").peaks_V.size == 0


def test_deflection_rests_on_the_hysteretic_drive_and_moves_as_the_sensor_says():
    """Its static limit is the hysteretic drive, and the sensor reads (b1 / a0) d(deflection)/dt."""
    held = HEAD.respond(Waveform(60, 0, 3e-6, 5e-3, 1e-6, 0, 0))
    assert held.deflection_V(4.9e-3) == pytest.approx(float(held.hysteretic_V(4.9e-3)), rel=1e-12)
    response = HEAD.respond(OPTIMUM)
    t, h = np.linspace(2e-6, 200e-6, 300), 1e-9
    slope = (response.deflection_V(t + h) - response.deflection_V(t - h)) / (2 * h)
    np.testing.assert_allclose(HEAD.b1 / HEAD.a0 * slope, response.sensor_V(t), atol=1e-5)


ELEMENTS = LumpedElements(1e-6, 0.03046, 1.055e5, 0.1, 9.535e4, 2e-9, 1e3)
S = 2j * math.pi * np.geomspace(1.0, 1e7, 60)


def test_the_self_sensed_voltage_is_the_current_less_the_capacitance():
    np.testing.assert_allclose(
        ELEMENTS.G_s(S), ELEMENTS.sensing_V_per_A * (ELEMENTS.G_I(S) - ELEMENTS.capacitance_F * S), rtol=1e-8
    )
    np.testing.assert_allclose((ELEMENTS.a0, ELEMENTS.a1, ELEMENTS.b1), (HEAD.a0, HEAD.a1, 1.907e4), rtol=1e-12)


def test_transfer_functions_keep_their_limits():
    """Static deflection is force over stiffness; at resonance G_s is b1/a1, real; far above it the current is C_e s."""
    assert ELEMENTS.G_V(0.0) == pytest.approx(1 / ELEMENTS.stiffness_N_per_m)
    assert ELEMENTS.G_s(1j * math.sqrt(ELEMENTS.a0)) == pytest.approx(ELEMENTS.b1 / ELEMENTS.a1)
    assert abs(ELEMENTS.G_I(1e12j) / (ELEMENTS.capacitance_F * 1e12j) - 1) < 1e-9


def test_the_closed_form_has_the_transfer_function_G_s():
    """A long sine, as many short linear pieces, settles to the amplitude and phase of G_s."""
    frequency_Hz = 40e3
    omega = 2 * math.pi * frequency_Hz
    per_period, periods = 400, 40
    t = np.arange(per_period * periods + 1) / (per_period * frequency_Hz)
    v = np.sin(omega * t)
    response = PiecewiseResponse(HEAD.a0, HEAD.a1, HEAD.b1, np.diff(t), np.diff(v)[:, None])
    late = t[-per_period:]
    gain = (HEAD.b1 * 1j * omega) / (HEAD.a0 - omega**2 + 1j * HEAD.a1 * omega)
    np.testing.assert_allclose(response.sensor_V(late), np.imag(gain * np.exp(1j * omega * late)), atol=2e-5)


@pytest.mark.parametrize(("a0", "a1", "message"), [(-1.0, 1.0, "a0 must be"), (1.0, 2.0, "a1 must be below")])
def test_what_does_not_ring_is_refused(a0, a1, message):
    with pytest.raises(ValueError, match=message):
        check_resonator(a0, a1)


def test_lumped_elements_that_are_not_a_mass_are_refused():
    with pytest.raises(ValueError, match="mass_kg must be above 0 kg"):
        LumpedElements(0.0, 1, 1, 1, 1, 1, 1)
    with pytest.raises(ValueError, match="stiffness_N_per_m must be finite"):
        LumpedElements(1.0, 1, math.nan, 1, 1, 1, 1)
