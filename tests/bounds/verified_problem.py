"""The published head's problem as the verification sees it, and waveforms of known cost."""

import numpy as np

from inkjet_env.experiments.bounds.verification import checking, courses, enclosing, walking
from inkjet_env.experiments.bounds.verification.reading import Certificate
from inkjet_env.experiments.bounds.verification.tables import Resolution
from inkjet_env.printhead import Printhead, Waveform

HEAD = Printhead.published()
BEST = np.array(
    [100, 100, 1.0000000109989415, 10.48994805910811, 13.743827858249958, 9.814569003260661, 19.958894154308322]
)
LOWER = np.array([0, 0, 1, 1, 1, 1, 1], float)
UPPER = np.array([100, 100, 20, 20, 20, 20, 20], float)
TINY = Resolution(angles=64, height=0.074, core_V=0.5, step_V=25.0, levels=3)


def certificate(lower=LOWER, upper=UPPER, bound=-24.0, parts=((0.0, 40.0),)):
    numbers = (HEAD.a0, HEAD.a1, HEAD.b1, tuple(HEAD.coefficients), HEAD.full_scale_V, -5.0, 5.0)
    return Certificate(*numbers, tuple(lower), tuple(upper), 350.0, bound, tuple(parts))


PROBLEM = checking.problem_of(certificate())


def simulated(p):
    response = HEAD.respond(Waveform(p[0], -p[1], *(1e-6 * p[2:])))
    return response.cost(), np.abs(response.peaks_V).max(), response


def least_cost(centre, radius, least=0.0, most=40.0):
    memory = walking.memory()
    numbers = (PROBLEM.k, PROBLEM.law, PROBLEM.sup1, PROBLEM.sup2)
    return courses.least_cost(centre, radius, least, most, *numbers, *memory[:12])[0]


def followed(p, ring_us=40.0):
    z, dz, rest, seconds, cell = walking.memory()[:5]
    numbers = (PROBLEM.k, PROBLEM.law, PROBLEM.sup1, PROBLEM.sup2, ring_us)
    z[0], dz[0], rest[0] = 0.0, 0.0, 0.0
    n = enclosing.follow(0, 5, enclosing.CELL_US, np.array(p, float), np.zeros(7), *numbers, z, dz, rest, seconds, cell)
    return z[: n + 1].copy(), dz[: n + 1].copy(), seconds[:n, 0], rest[: n + 1].copy()


def random_waveforms(number, seed=0):
    rng = np.random.default_rng(seed)
    return LOWER + (UPPER - LOWER) * rng.random((number, 7))
