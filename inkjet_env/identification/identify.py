"""From a campaign to a printhead: the whole of sections 3.1 and 3.2 of Zhu et al. 2024, for any head."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from inkjet_env.identification.degree import CHANCE_F, HIGHEST_DEGREE
from inkjet_env.identification.fit import CampaignFit
from inkjet_env.identification.identification import Identification
from inkjet_env.identification.outcome import outcome_of
from inkjet_env.printhead import check_name
from inkjet_env.recordings import Campaign

CLOSER = 1.1
"""Ratio of residuals from which on another initial state is the likelier one."""
DEGREE_RULES = ("flattening", "strain_gauge", "held_out")


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

    Branch law from the strain gauge (from the fast channels where there is none), ``a0, a1, b1`` by free-run output
    error on every fast recording, then everything together, weighed by the noise; one offset a channel, and the
    resonator's initial state where it is ``free``, are fitted along and nothing else.

    The scale of the branch law cannot be observed beside the gains: it is the published head's, see `convention`.

    Parameters
    ----------
    campaign : Campaign
    degree : int, optional
        Of the branch law, 1 … 12; chosen by ``degree_rule`` unless given.
    degree_rule : {"flattening", "strain_gauge", "held_out"}
        The last degree that lowers the error of all recordings together by more than chance; of the strain gauge's
        loops alone, as in the paper; the least degree that predicts loops held out one after another as well as any.
    valid_density : bool
        Whether to enforce ``p(r) ≥ 0``.
    full_scale_V : float, optional
        Change of drive at ``x = 1``, beyond which the law goes on along its tangent. Unless given, the largest that the
        strain gauge has seen (a virgin curve counts twice its drive), or any recording where that fits better.
    held_out : sequence of str, optional
        Recordings that no fit sees; see `measurements`.
    progress : callable, optional
        Told what is being done, in words, whenever that changes.

    Raises
    ------
    ValueError
        Nothing that a parameter could be identified from; the message says which recording is needed.
    """
    check_name("degree_rule", degree_rule, DEGREE_RULES)
    if degree is not None and not 1 <= degree <= HIGHEST_DEGREE:
        raise ValueError(f"degree must be 1 to {HIGHEST_DEGREE}; got {degree}.")
    if full_scale_V is not None and not 1e-3 <= full_scale_V <= 1e6:
        raise ValueError(f"full_scale_V must be a voltage of 1e-3 to 1e6 V; got {full_scale_V!r}.")

    def begun(swing_V: float | None, recorded: Campaign = campaign) -> CampaignFit:
        return CampaignFit(
            recorded, degree, degree_rule, valid_density, swing_V, held_out, progress or (lambda _: None)
        )

    with threadpool_limits(1):  # its matrices are small: threads would but wait for each other
        fit = begun(full_scale_V)
        fit.solve()
        if full_scale_V is None and fit.reached_V > 1.01 * fit.full_scale_V:
            # The fast drives go beyond the gauge's: does the law go straight on there, or does it bend on?
            wider = begun(fit.reached_V)
            wider.solve(fit.solution.model)
            if wider.deviance < fit.deviance - CHANCE_F:
                wider.notes.append(
                    f"The law bends on beyond the strain gauge's {fit.full_scale_V:g} V, as the fast recordings tell; "
                    f"full scale is {wider.full_scale_V:g} V."
                )
                fit = wider
        if unknown := [m for m in fit.fast if m.initial_state == "free"]:
            begin = (
                f"Of {len(unknown)} fast recordings it is not known what had gone before: the hysteresis was begun as "
            )
            again = begun(fit.full_scale_V, _repeating(campaign))
            fit.notes.append(
                begin + "demagnetised. " + (_doubt(fit, again) or "A repeated drive would explain no more.")
            )
        fit.widen()
        return outcome_of(fit)


def doubtful_states(campaign: Campaign, held_out: Sequence[str] | None = None) -> str | None:
    """What to say of recordings of unknown initial state that look like the answers to a repeated drive.

    Parameters
    ----------
    campaign : Campaign
    held_out : sequence of str, optional
        Recordings that no fit sees.

    Returns
    -------
    str or None
        A sentence; None where there are none.
    """
    if not any(r.initial_state == "free" and r.channel != "strain_gauge" for r in campaign.recordings):
        return None
    with threadpool_limits(1):
        fit, again = (
            CampaignFit(c, None, "flattening", False, None, held_out, lambda _: None)
            for c in (campaign, _repeating(campaign))
        )
        fit.solve()
        return _doubt(fit, again)


def _repeating(campaign: Campaign) -> Campaign:
    """The campaign, every recording of unknown initial state taken for one of a drive that had been repeating."""
    recordings = tuple(
        replace(r, initial_state="periodic") if r.initial_state == "free" else r for r in campaign.recordings
    )
    return replace(campaign, recordings=recordings)


def _left(fit: CampaignFit) -> float:
    """Root mean square of what is left of the fast recordings, in units of their own swing; the geometric mean."""
    shares = [fit.misfit[m.channel] * fit.noise[m.noise_key].rms / float(np.std(m.mean)) for m in fit.fast]
    return math.exp(float(np.mean(np.log(shares))))


def _doubt(fit: CampaignFit, again: CampaignFit) -> str | None:
    """What to say where a fit of repeated drives, not solved yet, explains more than one of unknown states."""
    again.solve(fit.solution.model)
    ratio = _left(fit) / _left(again)
    if ratio < CLOSER:
        return None
    return (
        f"As answers to drives that had been repeating these recordings are explained {ratio:.3g} times as closely: if "
        "they are, say so (initial state periodic), or what they tell is off by more than its intervals."
    )
