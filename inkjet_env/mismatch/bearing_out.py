"""Whether held-out recordings that were foretold badly bear a name out once they are fitted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from inkjet_env.mismatch.attribute import Hypothesis, attribute, base_hypothesis
from inkjet_env.mismatch.crew import Crew
from inkjet_env.mismatch.diagnosis import LEFT_OVER
from inkjet_env.mismatch.joint_fit import JointFit
from inkjet_env.mismatch.signatures import signatures


def borne_out(joint: JointFit, chosen: Hypothesis, crew: Crew, progress: Callable[[str], None]) -> bool:
    """Whether effects that foretold held-out recordings badly explain them once these may tell the values too.

    When a bubble came between two recordings that were fitted, nothing tells of those in between whether it was
    there. An effect that is not there does no better for being told.

    Parameters
    ----------
    joint : JointFit
    chosen : Hypothesis
        On the same recordings.
    crew : Crew
        Where the fits run.
    progress : callable
    """
    everything = [replace(o, fitted=o.shot.samples) for o in joint.observed]
    whole = JointFit(everything, joint.noise, joint.base.head, joint.standing)
    found, told = signatures(whole, chosen.fit.effects, crew), base_hypothesis(whole)
    for effect in chosen.fit.effects:
        beside = found.beside(told.columns)
        told = next(iter(attribute(whole, told, [effect], beside, crew, progress)), told)
    before = after = noise = 0.0
    for key in sorted({o.noise_key for o in joint.observed}):
        mine = [o for o in joint.observed if o.noise_key == key]
        seen = np.concatenate([told.fit.left[o.name][o.rows(held_out=False)] for o in mine])
        unseen = np.concatenate([told.fit.left[o.name][o.rows(held_out=True)] for o in mine])
        before += sum(float(np.sum(whole.base.left[o.name][o.rows(held_out=True)] ** 2)) for o in mine)
        after += float(unseen @ unseen)
        noise += unseen.size * (float(seen @ seen) / seen.size if seen.size else 1.0)
    return before - after >= (1 - LEFT_OVER) * (before - noise)
