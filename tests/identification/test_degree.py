"""Degree of the branch law: found where it is known."""

import numpy as np

from inkjet_env.identification.basis import drive_basis
from inkjet_env.identification.degree import HIGHEST_DEGREE, choose_degree
from inkjet_env.identification.linearised import triangle
from inkjet_env.printhead import BranchLaw, Printhead

FULL_SCALE_V = 180.0


def block(drive_V, signal, noise):
    phi = drive_basis(drive_V, 1.0, FULL_SCALE_V, HIGHEST_DEGREE, "demagnetised").hysteretic_V()
    return triangle(np.column_stack([phi, np.ones(drive_V.size), signal]) / noise)


def choice_of(law, noise_V, seed=0, drives=4):
    rng = np.random.default_rng(seed)
    blocks, samples = [], []
    for _ in range(drives):
        drive_V = np.interp(np.arange(600), np.arange(0, 601, 50), [0, *rng.uniform(-90, 90, 12)])
        drive_V[100], drive_V[150] = 90, -90
        signal = law.hysteretic_V(drive_V, "demagnetised") + 3.0 + rng.normal(0, noise_V, drive_V.size)
        blocks.append(block(drive_V, signal, noise_V))
        samples.append(drive_V.size)
    return choose_degree(blocks, samples)


def test_a_law_of_degree_five_is_seen_to_be_one():
    law = BranchLaw((2.0, -4.0, 3.0, 0.5, 0.6, 0.0), FULL_SCALE_V)
    choice = choice_of(law, 1e-3)
    assert choice.by_flattening == 5
    assert choice.by_held_out == 5
    assert abs(choice.rms_error[4] - 1) < 0.05
    assert choice.rms_error[3] > 10


def test_noise_about_a_line_is_a_line():
    law = BranchLaw((0.8, 0.0), FULL_SCALE_V)
    choices = [choice_of(law, 0.5, seed) for seed in range(10)]
    assert [choice.by_flattening for choice in choices] == [1] * 10
    assert all(choice.by_held_out <= 3 for choice in choices)


def test_more_powers_never_fit_worse():
    choice = choice_of(Printhead.published().branch_law, 0.1)
    assert (np.diff(choice.rms_error) <= 1e-9).all()
    assert choice.degrees == tuple(range(1, HIGHEST_DEGREE + 1))


def test_the_published_loop_needs_the_published_degree():
    drive_V = 90 * np.sin(2 * np.pi * np.arange(1200) / 1200)
    law, rng = Printhead.published().branch_law, np.random.default_rng(1)
    phi = drive_basis(drive_V, 1.0, FULL_SCALE_V, HIGHEST_DEGREE, "periodic").hysteretic_V()
    signal = law.hysteretic_V(drive_V) + rng.normal(0, 0.005, 1200)
    choice = choose_degree([triangle(np.column_stack([phi, np.ones(1200), signal]) / 0.005)], [1200])
    assert choice.by_flattening == 8
    assert choice.held_out_error is choice.by_held_out is None


def test_where_the_residual_is_coloured_a_gain_must_be_larger_to_count():
    law = BranchLaw((0.06, 0.8, 0.0), FULL_SCALE_V)
    rng = np.random.default_rng(0)
    drive_V = 90 * np.sin(np.arange(600) / 50)
    blocks = [block(drive_V, law.hysteretic_V(drive_V, "demagnetised") + rng.normal(0, 5, 600), 5.0)]
    plain, wary = choose_degree(blocks, [600]), choose_degree(blocks, [600], correlation=100.0)
    assert (plain.by_flattening, wary.by_flattening) == (2, 1)
