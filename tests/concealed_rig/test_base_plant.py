"""The base plant against closed forms, SciPy and itself on finer grids."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import TransferFunction, lsim

from experiments.concealed_rig.battery import measuring_plan
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.head import LARGEST_DRIVE_V, Head, drawn_head
from experiments.concealed_rig.linear import filtered, linear_motion, relaxations
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.other_hysteresis import bouc_wen, product_preisach
from experiments.concealed_rig.plant import Hysteresis, Plant, noise_free
from experiments.concealed_rig.play import changing_play_sum_V, play_sum_V, play_sums_V
from experiments.concealed_rig.resonator import Resonator, motion

CONSTANT = Head(5e4, 0.05, 1.9e4, 0.02, 0.0, 0.0, 1.5, 0.0, 0.75, 45.0, "polynomial", (1.0,))


def legs(turning, points=60):
    return np.concatenate([np.linspace(a, b, points + 1)[:-1] for a, b in itertools.pairwise(turning)])


def test_a_branch_is_the_virgin_curve_twice_as_large():
    """Masing's rule: from a turning point, Q(Δ) = 2·virgin(Δ/2)."""
    threshold, weight = CONSTANT.plays(4000)
    virgin_V = np.linspace(0, 90, 401)
    virgin = play_sum_V(virgin_V, threshold, weight, False)
    drive = legs([0, -90, 90], 400)
    loop = play_sum_V(drive, threshold, weight, False)
    way = drive[400:] + 90
    np.testing.assert_allclose(loop[400:] - loop[400], 2 * np.interp(way / 2, virgin_V, virgin), rtol=0, atol=1e-12)
    assert virgin[-1] == pytest.approx(45.0 / 2, rel=1e-13)  # Q(180 V)/2


def test_plays_of_constant_density_and_the_everett_function_agree():
    """Left: the distance of 4000 plays, squared, 7e-8."""
    drive = np.append(legs([0, 80, -60, 50, -30, 70, -90, 20, 95, 0, 40, 100, -100, 0]), 0.0)
    threshold, weight = CONSTANT.plays(4000)
    density = weight[0] / (threshold[1] - threshold[0])
    for periodic in (False, True):
        everett = density / 4 * product_preisach(drive, periodic)
        plays = play_sum_V(drive, threshold, weight, periodic)
        np.testing.assert_allclose(plays, everett, rtol=0, atol=2e-7 * np.max(np.abs(plays)))


@pytest.mark.parametrize("law", ["plays", "preisach", "bouc_wen"])
def test_a_loop_that_is_closed_is_wiped_out_by_plays_and_preisach_but_not_by_bouc_wen(law):
    with_loop, without = legs([0, 60, -20, 30, -20, 90]), legs([0, 60, -20, 90])

    def end(drive):
        if law == "plays":
            return play_sum_V(np.append(drive, 90.0), *CONSTANT.plays(), False)[-1]
        if law == "preisach":
            return product_preisach(100 * np.tanh(np.append(drive, 90.0) / 100), False)[-1]
        return bouc_wen(np.append(drive, 35.0), False, 60.0, 1.5, 0.6)[-1]

    if law == "bouc_wen":
        assert abs(end(legs([0, 60, -20, 30, -20])) - end(legs([0, 60, -20]))) > 1e-3
    else:
        assert end(with_loop) == pytest.approx(end(without), rel=1e-12)


def test_minor_loops_of_plays_are_congruent_anywhere_and_of_the_product_preisach_only_between_the_same_voltages():
    def loop(law, history):
        drive = legs([*history, 40, 60, 40])
        y = law(np.append(drive, 40.0))[-121:]
        return y - y[0]

    def shifted(law):
        drive = legs([0, 90, 10, 30, 10])
        y = law(np.append(drive, 10.0))[-121:]
        return y - y[0]

    def plays(drive):
        return play_sum_V(drive, *CONSTANT.plays(8000), False)

    def preisach(drive):
        return product_preisach(100 * np.tanh(drive / 100), False)

    for law in (plays, preisach):
        np.testing.assert_allclose(loop(law, [0, 90]), loop(law, [0, 70, -50, 100]), rtol=0, atol=1e-11)
    np.testing.assert_allclose(shifted(plays), loop(plays, [0, 90]), rtol=0, atol=1e-13 * np.ptp(shifted(plays)))
    assert np.ptp(shifted(preisach)) > 1.2 * np.ptp(loop(preisach, [0, 90]))


def test_bouc_wen_of_order_one_saturates_exponentially():
    z = bouc_wen(np.linspace(0, 200, 801), False, 50.0, 1.0, 0.6)
    np.testing.assert_allclose(z, 1 - np.exp(-np.linspace(0, 200, 801) / 50), rtol=0, atol=1e-11)


@pytest.mark.parametrize("law", ["bouc_wen", "preisach"])
def test_other_laws_have_the_plays_opening_and_their_own_slope_after_a_turn(law):
    """Left: Bouc–Wen's creep after a virgin start, 1e-7 of its opening, and its steps, below 1e-7 of the slope."""
    loop = np.append(legs([0, 90, -90, 90, -90, 0], 400), 0.0)
    row = Measurement("strain_gauge", "arbitrary", "periodic", 1e-3, loop)
    head = drawn_head(np.random.default_rng(3))
    own, other = (noise_free(Plant(head, (), Hysteresis(name)), row) for name in ("plays", law))

    def opening(y):
        return abs(y[800 - 200] - y[800 + 200]) / head.gauge_gain_V_per_V

    assert opening(other) == pytest.approx(opening(own), rel=3e-7)
    slope = np.diff(other)[800] / 0.45 / head.gauge_gain_V_per_V
    scale = Hysteresis().scale_V
    if law == "preisach":
        # Branches are squares in G = s·tanh(u/s), so the loop opens by twice its largest G², and turns off flat.
        g = scale * np.tanh(loop / scale)
        expected = opening(own) / (2 * g[400] ** 2) * (g[801] - g[800]) ** 2 / 0.45
    else:
        order, beta = Hysteresis().order, Hysteresis().beta

        def change(u, z, side):
            return side * (1 - np.abs(z) ** order * (beta * side * np.sign(z) + 1 - beta)) / scale

        z, at_zero = [0.0], []
        for side in (1.0, -1.0) * 8:
            way = solve_ivp(change, (0, 180), z, args=(side,), rtol=1e-10, atol=1e-12, t_eval=[0, 0.45, 90, 180])
            z = way.y[:, -1]
            at_zero.append(way.y[0, 2])
        amplitude = opening(own) / abs(at_zero[-1] - at_zero[-2])
        rising = solve_ivp(change, (0, 0.45), z, args=(1.0,), rtol=1e-11, atol=1e-13).y[0]
        expected = amplitude * (1 / scale - (rising[-1] - rising[0]) / 0.45)
    assert slope - head.reversible == pytest.approx(expected, rel=3e-7)


def test_changing_plays_without_a_change_are_the_plays():
    drive = np.append(legs([0, 80, -70, 60, 0]), 0.0)
    head = drawn_head(np.random.default_rng(1))
    for periodic in (False, True):
        plain = play_sum_V(drive, *head.plays(), periodic)
        np.testing.assert_allclose(changing_play_sum_V(drive, *head.plays(), periodic), plain, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            play_sums_V(drive, head.plays()[0], head.plays()[1][None], periodic)[0], plain, rtol=0, atol=1e-12
        )


def test_the_sum_of_plays_converges_with_the_square_of_their_distance():
    head = drawn_head(np.random.default_rng(0))
    drive = np.append(legs([0, 83, -61, 47, 0]), 0.0)
    fine = play_sum_V(drive, *head.plays(38400), False)
    errors = [np.sqrt(np.mean((play_sum_V(drive, *head.plays(n), False) - fine) ** 2)) for n in (150, 300, 600)]
    assert errors[2] < 5e-7 * np.max(np.abs(drive))
    assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(2.0, abs=0.1)


def test_runge_kutta_is_of_fourth_order_in_both_ways_of_writing_it():
    omega, zeta, n, step = 2 * np.pi * 5e4, 0.05, 60, 1e-6
    exact = solve_ivp(
        lambda t, s: [s[1], np.sin(0.7 * t) ** 3 - s[0] - 2 * zeta * s[1]],
        (0, n * step * omega),
        [0.0, 0.0],
        rtol=1e-12,
        atol=1e-13,
        t_eval=np.arange(n) * step * omega,
    ).y[1]
    errors = []
    for substeps in (2, 4, 8):
        grid = Grid(n, step, substeps, False)
        h = np.sin(0.7 * np.arange(2 * grid.steps + 1) * grid.half_s * omega) ** 3
        moved = motion(Resonator(omega, zeta), h, np.zeros_like(h), grid).speed_V
        np.testing.assert_allclose(linear_motion(omega, zeta, h, grid)[1], moved, rtol=0, atol=1e-12)
        errors.append(np.max(np.abs(grid.at_samples(moved) - exact)))
    assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(4.0, abs=0.03)


def test_first_order_hold_is_exact_for_straight_lines():
    t = np.linspace(0, 40, 4001)
    drive = np.interp(t, [0, 3, 10, 12, 40], [0, 1, 1, -0.5, 0])
    _, y, _ = lsim(TransferFunction([1.0, 0.0], [1.0, 0.1, 1.0]), drive, t)
    np.testing.assert_allclose(filtered([1.0, 0.0], [1.0, 0.1, 1.0], drive, 0.01, False), y, rtol=0, atol=1e-11)
    _, y, _ = lsim(TransferFunction([1.0], [2.0, 1.0]), drive, t)
    np.testing.assert_allclose(relaxations(drive, np.array([2.0]), 0.01, False)[0], y, rtol=0, atol=1e-13)
    np.testing.assert_allclose(filtered([1.0], [2.0, 1.0], drive, 0.01, False), y, rtol=0, atol=1e-12)


def test_periodic_states_equal_the_end_of_a_long_run():
    """Left is rounding: 14 periods of vibration, 60 of the relaxation, leave nothing of the start."""
    head = drawn_head(np.random.default_rng(4))
    one = np.append(legs([0, 70, 70, -40, 0, 0, 0], 60), np.zeros(200))
    row = Measurement("self_sensing", "arbitrary", "periodic", 4e-7, one)
    long = Measurement("self_sensing", "arbitrary", "demagnetised", 4e-7, np.tile(one, 14))
    settled, last = noise_free(Plant(head), row), noise_free(Plant(head), long)[-one.size :]
    np.testing.assert_allclose(settled, last, rtol=0, atol=1e-13 * np.max(np.abs(last)))
    relaxed = relaxations(np.append(one, one[0]), np.array([3e-4]), 4e-7, True)[0]
    run = relaxations(np.tile(one, 60), np.array([3e-4]), 4e-7, False)[0]
    np.testing.assert_allclose(relaxed[: one.size], run[-one.size :], rtol=0, atol=1e-11)


def test_nothing_concealed_agrees_with_scipy_to_one_in_a_million():
    """A smooth density in closed form, Q(Δ) = reversible·Δ + c·Δ²/4, through solve_ivp, edge by edge."""
    head, dt = CONSTANT, 4e-7
    density = head.plays()[1][0] / (LARGEST_DRIVE_V / 600)
    drive = np.concatenate(
        (np.zeros(5), np.linspace(0, 80, 31), np.full(40, 80.0), np.linspace(80, 0, 21), np.zeros(300))
    )
    drive[36:76] = 80.0
    signal = noise_free(
        Plant(head, steps_per_period=320), Measurement("self_sensing", "trapezoid", "demagnetised", dt, drive)
    )
    t = np.arange(drive.size) * dt
    top = int(np.argmax(drive >= 80))
    down = int(np.flatnonzero(drive >= 80)[-1])

    def hysteretic(now):
        u = np.interp(now, t, drive)
        virgin = density * u**2 / 2
        return head.reversible * u + (virgin if now <= t[down] else density * (3200 - (80 - u) ** 2 / 4))

    w0, zeta = head.angular_rad_per_s, head.damping_ratio
    state, out = [0.0, 0.0], [0.0]
    edges = [0, 5, top, down, int(np.flatnonzero(drive > 0)[-1]) + 1, drive.size - 1]
    for first, last in itertools.pairwise(edges):
        run = solve_ivp(
            lambda x, s: [w0 * s[1], w0 * (hysteretic(x) - s[0] - 2 * zeta * s[1])],
            (t[first], t[last]),
            state,
            rtol=1e-11,
            atol=1e-10,
            t_eval=t[first : last + 1],
            max_step=2e-6,
        )
        state = run.y[:, -1]
        out.extend(run.y[1, 1:])
    expected = head.b1_per_s / w0 * np.array(out)
    np.testing.assert_allclose(signal, expected, rtol=0, atol=1e-6 * np.max(np.abs(expected)))


def test_the_steps_error_over_a_campaign_is_far_below_the_noise():
    head = drawn_head(np.random.default_rng(8))
    rows = measuring_plan(head, np.random.default_rng(8), meagre=True)
    for row in rows:
        coarse, fine = (noise_free(Plant(head, steps_per_period=n), row) for n in (160, 640))
        largest = max(np.max(np.abs(fine)), 1.0)
        assert np.sqrt(np.mean((coarse - fine) ** 2)) < 6e-7 * largest  # the largest is 2.4e-7
