"""From a campaign to a printhead: sections 3.1 and 3.2 of Zhu et al. 2024, for any head."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from inkjet_env.identification.degree import F_QUANTILE_999, HIGHEST_DEGREE
from inkjet_env.identification.errors import NothingRingsError
from inkjet_env.identification.fit import LARGEST_CHANGE_V, SMALLEST_CHANGE_V, CampaignFit
from inkjet_env.identification.identification import Identification
from inkjet_env.identification.measurements import RepeatedMeasurement
from inkjet_env.identification.outcome import outcome_of
from inkjet_env.identification.work_done import WorkDone
from inkjet_env.printhead import check_name
from inkjet_env.recordings import Campaign

CLOSER = 1.1
"""Ratio of residuals above which another initial state is more likely."""
DEGREE_RULES = ("flattening", "strain_gauge", "held_out")
"""Rules for the degree of the branch law; see `identify`."""


def identify(
    campaign: Campaign,
    *,
    degree: int | None = None,
    degree_rule: str = "flattening",
    valid_density: bool = False,
    full_scale_V: float | None = None,
    held_out: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Identification:
    """Identify hysteresis and resonator from all recordings of a campaign together.

    The branch law is identified from the strain gauge (from the fast channels if there is none), then ``a0, a1, b1`` by
    free-run output error on every fast recording, then everything together, weighted by the noise. Nothing else is
    fitted except one offset per channel and, if it is ``free``, the resonator's initial state.

    If no recording shows a resonance, i.e. there is nothing but a strain gauge, or displacement that is recorded too
    slowly (see `may_ring`) or does not ring, the hysteresis is identified alone: the head is then a
    `QuasiStaticPrinthead`, and displacement counts as a gain times the hysteretic drive plus an offset.

    The scale of the branch law is not identifiable beside the gains; it is that of the published head, see
    `convention`.

    Parameters
    ----------
    campaign : Campaign
        Recordings of the head.
    degree : int, optional
        Degree of the branch law, 1 … 12; chosen by ``degree_rule`` by default.
    degree_rule : {"flattening", "strain_gauge", "held_out"}
        ``flattening``: the last degree that significantly lowers the error of all recordings together.
        ``strain_gauge``: the same for the loops of the strain gauge alone, as in the paper. ``held_out``: the lowest
        degree that predicts loops held out one after another as well as any.
    valid_density : bool
        Whether to enforce ``p(r) ≥ 0``.
    full_scale_V : float, optional
        Change of drive at ``x = 1``, in volts, beyond which the law continues along its tangent. Default: the largest
        in the strain gauge's recordings (on a virgin curve, twice the drive), or in any recording if that fits better.
    held_out : sequence of str, optional
        Names of the recordings that no fit uses; see `measurements`.
    progress : callable, optional
        Called with a description of each step, in words, as it starts, and with each part of it that is finished; the
        descriptions end in ``(k of 100)``, and k never decreases.

    Returns
    -------
    Identification
        The head with its intervals, and every recording beside its simulation.

    Raises
    ------
    UnidentifiableError
        The recordings do not determine a parameter; the message says which recording is needed. It is a ``ValueError``.
    ValueError
        An argument is out of bounds, a held-out recording does not exist, or nothing of a channel is left to be fitted.
    """
    check_name("degree_rule", degree_rule, DEGREE_RULES)
    if degree is not None and not 1 <= degree <= HIGHEST_DEGREE:
        raise ValueError(f"degree must be 1 to {HIGHEST_DEGREE}; got {degree}.")
    if full_scale_V is not None and not SMALLEST_CHANGE_V <= full_scale_V <= LARGEST_CHANGE_V:
        raise ValueError(f"full_scale_V must be a voltage of 1e-3 to 1e6 V; got {full_scale_V!r}.")

    work = WorkDone(progress or (lambda _: None))

    def found(quasi_static: bool) -> Identification:
        def begun(swing_V: float | None, recorded: Campaign = campaign) -> CampaignFit:
            return CampaignFit(
                recorded, degree, degree_rule, valid_density, swing_V, held_out, work, quasi_static=quasi_static
            )

        fit = begun(full_scale_V)
        fit.solve()
        if full_scale_V is None and fit.reached_V > 1.01 * fit.full_scale_V:
            # The other drives exceed those of the gauge: is the law straight beyond them, or does it go on bending?
            wider = begun(fit.reached_V)
            wider.solve(fit.solution.model)
            if wider.deviance < fit.deviance - F_QUANTILE_999:
                wider.notes.append(
                    f"The {'fast' if fit.fast else 'other'} recordings show that the law is still curved above the "
                    f"strain gauge's {fit.full_scale_V:g} V; full scale is {wider.full_scale_V:g} V."
                )
                fit = wider
        if unknown := [m for m in _deciding(fit) if m.initial_state == "free"]:
            which = f"{'fast ' if fit.fast else ''}{'recording' if len(unknown) == 1 else 'recordings'}"
            state = f"The initial state of {len(unknown)} {which} is unknown and was taken as demagnetised."
            again = begun(fit.full_scale_V, _repeating(campaign))
            fit.notes.append(f"{state} {_doubt(fit, again) or 'A repeated drive does not explain them better.'}")
        fit.widen()
        identified = outcome_of(fit)
        work.finish()
        return identified

    with threadpool_limits(1):  # the matrices are small: threads would only wait for each other
        try:
            return found(quasi_static=False)
        except NothingRingsError:
            if any(r.channel == "self_sensing" for r in campaign.recordings):
                raise
            return found(quasi_static=True)


def doubtful_states(
    campaign: Campaign, held_out: Sequence[str] | None = None, quasi_static: bool = False
) -> str | None:
    """Warning about recordings of unknown initial state that look like responses to a repeated drive.

    Parameters
    ----------
    campaign : Campaign
        Recordings of the head.
    held_out : sequence of str, optional
        Names of the recordings that no fit uses.
    quasi_static : bool
        Whether displacement is static, as in `measurements`.

    Returns
    -------
    str or None
        A sentence; None if there are no such recordings.
    """
    if not any(r.initial_state == "free" for r in campaign.recordings):
        return None
    with threadpool_limits(1):
        fit, again = (
            CampaignFit(
                c, None, "flattening", False, None, held_out, WorkDone(lambda _: None), quasi_static=quasi_static
            )
            for c in (campaign, _repeating(campaign))
        )
        if not any(m.initial_state == "free" for m in _deciding(fit)):
            return None
        fit.solve()
        return _doubt(fit, again)


def _deciding(fit: CampaignFit) -> Sequence[RepeatedMeasurement]:
    """The recordings whose initial state matters most: the fast ones, or all that move if there are none."""
    return fit.fast or [m for m in fit.train if not m.still]


def _repeating(campaign: Campaign) -> Campaign:
    """The campaign with every recording of unknown initial state taken as one under a repeated drive."""
    recordings = tuple(
        replace(r, initial_state="periodic") if r.initial_state == "free" else r for r in campaign.recordings
    )
    return replace(campaign, recordings=recordings)


def _relative_residual(fit: CampaignFit) -> float:
    """Geometric mean of the RMS residuals of `_deciding`, each relative to the standard deviation of its signal."""
    shares = [
        fit.misfit[m.channel] * fit.noise[m.noise_key].rms / max(float(np.std(m.mean)), 1e-300) for m in _deciding(fit)
    ]
    return math.exp(float(np.mean(np.log(np.maximum(shares, 1e-300)))))


def _doubt(fit: CampaignFit, again: CampaignFit) -> str | None:
    """Warning if a fit of repeated drives, not solved yet, explains more than one of unknown states; otherwise None."""
    again.solve(fit.solution.model)
    ratio = _relative_residual(fit) / _relative_residual(again)
    if ratio < CLOSER:
        return None
    return (
        f"A repeated drive explains these recordings {ratio:.3g} times as closely. If the drive was repeated, set the "
        "initial state to periodic; otherwise the results are wrong by more than their intervals."
    )
