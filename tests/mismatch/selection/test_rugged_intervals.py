"""Intervals of values over which the likelihood is rugged: an update interval, of which a node more or less is all."""

import numpy as np
import pytest

from inkjet_env.identification.outcome import QUANTILE_90
from inkjet_env.mismatch.fitting.dataset import finer
from inkjet_env.mismatch.selection.hypotheses import settled
from inkjet_env.mismatch.selection.rugged_intervals import rugged_reaches
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import complete

UPDATE_S = 2.1317e-6


@pytest.fixture(scope="module")
def stepped(recorded_as, fitted, effects):
    joint = fitted(recorded_as("generator_steps", update_s=UPDATE_S))
    active = ActiveEffects.of([(effects["generator_steps"], complete(effects["generator_steps"], update_s=UPDATE_S))])
    return settled(joint, joint.fit(active))


def by_the_derivatives(chosen):
    """Half-widths of 90 % intervals of the coordinates that are fitted, infinite ones of the others."""
    q, free = chosen.joint.basis[0], ~chosen.fit.idle
    jacobian = chosen.fit.jacobian[:, free]
    root = np.linalg.pinv(jacobian - q @ (q.T @ jacobian))
    found = np.full(free.size, np.inf)
    found[free] = QUANTILE_90 * np.linalg.norm(root, axis=1)
    return found


def test_it_holds_every_value_that_is_about_as_likely_however_sure_the_derivatives_are(stepped):
    reaches = by_the_derivatives(stepped) / 8  # derivatives that are too sure
    found = rugged_reaches(stepped, reaches, QUANTILE_90)
    fit, joint = stepped.fit, stepped.joint

    def nll(distance):
        theta = fit.active.theta.copy()
        theta[0] += distance
        return joint.fit(fit.active.at(theta), fit.head, most_steps=0).nll

    likely = [d for d in np.linspace(-16, 16, 129) * reaches[0] if nll(d) - fit.nll <= 0.5 * QUANTILE_90**2]
    assert max(map(abs, likely)) > 2 * reaches[0]
    assert found[0] > max(map(abs, likely)) / 2**0.5  # to within a step of its search


def test_it_is_about_as_wide_as_the_nodes_are_coarse(stepped):
    found = rugged_reaches(stepped, by_the_derivatives(stepped), QUANTILE_90)
    joint = stepped.joint
    finer_nodes = joint.anew(observed=finer(joint.observed, 2 * joint.observed[0].excitation.substeps))
    again = settled(finer_nodes, finer_nodes.fit(stepped.fit.active, stepped.fit.head))
    assert abs(again.fit.active.theta[0] - stepped.fit.active.theta[0]) < 2 * found[0]


def test_it_is_nowhere_narrower_than_by_the_derivatives(stepped):
    wide = np.full(5, 1e-7)
    assert np.all(rugged_reaches(stepped, wide, QUANTILE_90) >= wide)


def test_a_smooth_likelihood_needs_none_of_it(recorded_as, fitted, effects):
    joint, effect = fitted(recorded_as("quadratic_damping", damping_per_V=3e-4)), effects["quadratic_damping"]
    chosen = settled(joint, joint.fit(ActiveEffects.of([(effect, {"damping_per_V": 3e-4})])))
    reaches = np.array([1e-6])
    assert rugged_reaches(chosen, reaches, QUANTILE_90) is reaches
