"""The model that is linear in the branch law, against the closed form, the play operators and quadrature."""

import mpmath
import numpy as np
import pytest

from inkjet_env.identification.basis import drive_basis
from inkjet_env.printhead import PlayOperators, Printhead, Waveform, respond_sampled
from inkjet_env.printhead.compiled_gradient import moments as moments_kernel
from inkjet_env.printhead.resonator import moments

HEAD = Printhead.published()
FULL_SCALE_V = HEAD.full_scale_V
STATES = (("demagnetised", "rest"), ("periodic", "steady"))


def head_of_degree(degree, rng):
    coefficients = (*rng.normal(0, 1, degree - 1), 1.0, 0.0)
    return Printhead(HEAD.a0, HEAD.a1, HEAD.b1, coefficients, FULL_SCALE_V)


def basis_of(head, drive_V, step_s, state):
    weights = np.array(head.coefficients[-2::-1])
    return drive_basis(drive_V, step_s, head.full_scale_V, weights.size, state), weights


def relative(difference, scale):
    return np.abs(difference).max() / np.abs(scale).max()


@pytest.mark.parametrize(("state", "ringing"), STATES)
@pytest.mark.parametrize("degree", range(1, 13))
def test_the_self_sensed_response_is_the_closed_form_for_every_degree(degree, state, ringing):
    rng = np.random.default_rng(degree)
    head = head_of_degree(degree, rng)
    drive_V = rng.uniform(-90, 90, 60)
    step_s = 2e-6
    basis, weights = basis_of(head, drive_V, step_s, state)
    expected = respond_sampled(head, step_s * np.arange(60), drive_V, state, ringing=ringing).sensor_V
    assert relative(head.b1 * basis.response("self_sensing", head.a0, head.a1) @ weights - expected, expected) < 1e-10


@pytest.mark.parametrize(("state", "ringing"), STATES)
def test_beyond_full_scale_the_law_goes_on_along_its_tangent(state, ringing):
    rng = np.random.default_rng(5)
    drive_V = rng.uniform(-250, 250, 80)
    assert np.abs(np.diff(drive_V)).max() > 1.5 * FULL_SCALE_V
    basis, weights = basis_of(HEAD, drive_V, 1e-6, state)
    expected = respond_sampled(HEAD, 1e-6 * np.arange(80), drive_V, state, ringing=ringing).sensor_V
    assert relative(HEAD.b1 * basis.response("self_sensing", HEAD.a0, HEAD.a1) @ weights - expected, expected) < 1e-10


@pytest.mark.parametrize(("state", "ringing"), STATES)
@pytest.mark.parametrize("step_s", [1e-8, 3e-6, 2e-5, 1e-3])
def test_the_sampling_step_may_be_far_shorter_or_longer_than_the_ringing(step_s, state, ringing):
    drive_V = np.random.default_rng(1).uniform(-90, 90, 30)
    drive_V[10:15] = drive_V[10]  # a drive that stands still, too
    basis, weights = basis_of(HEAD, drive_V, step_s, state)
    expected = respond_sampled(HEAD, step_s * np.arange(30), drive_V, state, ringing=ringing).sensor_V
    assert relative(HEAD.b1 * basis.response("self_sensing", HEAD.a0, HEAD.a1) @ weights - expected, expected) < 1e-9


@pytest.mark.parametrize("state", ["demagnetised", "periodic"])
def test_the_hysteretic_drive_is_that_of_play_operators_with_its_level(state):
    drives_V = np.random.default_rng(2).uniform(-90, 90, (60, 12))
    errors = []
    for operators in (100, 200, 400):
        plays = PlayOperators.of_branch_law(HEAD.branch_law, operators)
        differences = []
        for drive_V in drives_V:
            basis, weights = basis_of(HEAD, drive_V, 1.0, state)
            differences.append(basis.hysteretic_V() @ weights - plays.hysteretic_V(drive_V, state))
        errors.append(np.sqrt(np.mean(np.square(differences))))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.25)
    assert errors[-1] < 1e-3


def test_displacement_is_the_deflection_of_the_closed_form():
    waveform = Waveform(90.0, -80.0, 4e-6, 9e-6, 6e-6, 8e-6, 5e-6)
    response = HEAD.respond(waveform, "demagnetised")
    step_s = 0.5e-6
    time_s = step_s * np.arange(300)
    basis, weights = basis_of(HEAD, response.drive_V(time_s), step_s, "demagnetised")
    expected = response.deflection_V(time_s)
    assert relative(basis.response("displacement", HEAD.a0, HEAD.a1) @ weights - expected, expected) < 1e-10


def test_a_periodic_displacement_is_what_many_repetitions_settle_to():
    drive_V = np.random.default_rng(3).uniform(-90, 90, 40)
    step_s, laps = 2e-6, 40
    once, weights = basis_of(HEAD, drive_V, step_s, "periodic")
    many, _ = basis_of(HEAD, np.tile(drive_V, laps), step_s, "demagnetised")
    settled = (many.response("displacement", HEAD.a0, HEAD.a1) @ weights)[-40:]
    found = once.response("displacement", HEAD.a0, HEAD.a1) @ weights
    assert relative(found - settled, settled) < 1e-10


def test_a_slow_drive_is_followed_by_the_displacement():
    drive_V = 90 * np.sin(2 * np.pi * np.arange(400) / 400)
    basis, weights = basis_of(HEAD, drive_V, 1e-3, "periodic")
    static = basis.hysteretic_V() @ weights
    # It lags by a1/a0 = 0.3 µs.
    assert relative(basis.response("displacement", HEAD.a0, HEAD.a1) @ weights - static, static) < 1e-5
    assert np.array_equal(basis.response("strain_gauge", HEAD.a0, HEAD.a1), basis.hysteretic_V())


def test_a_free_state_rings_as_the_resonator_does():
    basis, _ = basis_of(HEAD, np.zeros(50), 1e-6, "free")
    states = basis.free_states(HEAD.a0, HEAD.a1)
    rate = np.exp(-HEAD.a1 / 2 * 1e-6)
    turn = 1e-6 * np.sqrt(HEAD.a0 - HEAD.a1**2 / 4)
    # y[k+1] = 2 ρ cos(ωT) y[k] - ρ² y[k-1]: what sampling makes of y'' + a1 y' + a0 y = 0.
    left = states[2:] - 2 * rate * np.cos(turn) * states[1:-1] + rate**2 * states[:-2]
    assert np.abs(left).max() < 1e-13
    assert np.linalg.matrix_rank(states) == 2


def moments_of(z, count):
    result = np.empty(count, dtype=np.complex128)
    moments_kernel(complex(z), result.size, result)
    return result


def test_compiled_moments_equal_those_of_the_closed_form():
    sizes, angles = np.geomspace(1e-6, 300, 120), np.linspace(np.pi / 2, np.pi, 7)
    z = (sizes[:, None] * np.exp(1j * angles)).ravel()
    found = np.array([moments_of(value, 12) for value in z])
    assert np.abs((found - moments(z, 12)) * np.arange(1, 13)).max() < 1e-13


@pytest.mark.parametrize("size", [1e-6, 0.3, 0.999, 1.0, 5.0, 11.9, 12.1, 60.0, 300.0])
def test_compiled_moments_equal_quadrature(size):
    count = 12
    with mpmath.workdps(30):
        z = size * mpmath.exp(1j * mpmath.mpf("1.62"))
        nodes = mpmath.linspace(0, 1, 2 + int(size / 4))
        exact = [complex(mpmath.quad(lambda s, k=k: mpmath.exp(z * (1 - s)) * s**k, nodes)) for k in range(count)]
    error = np.abs(moments_of(complex(z), count) - exact) * np.arange(1, count + 1)
    assert error.max() < 3e-14
