"""The verdict in at most four sentences: which effect is missing, how much it explains, and how much is left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from inkjet_env.mismatch.diagnosis import NamedEffect
from inkjet_env.mismatch.localization.location import Location
from inkjet_env.mismatch.settings import VerdictSettings
from inkjet_env.plant.wording import percent, span_text

MOST_BANDS, MOST_NAMED = 2, 3
"""Largest numbers of frequency bands and of recordings in a headline."""


def headline(
    verdict: str,
    named: Sequence[NamedEffect],
    groups: Sequence[tuple[str, ...]],
    closure: float,
    left_over: float,
    closest: tuple[tuple[str, ...], float] | None,
    location: Location,
    settings: VerdictSettings,
    noise_known: bool = True,
    unseen: Sequence[str] = (),
    minor: Sequence[NamedEffect] = (),
) -> str:
    """The verdict for a reader who has five seconds.

    Parameters
    ----------
    verdict : {"none", "named", "set", "unknown"}
        As `Diagnosis` has it.
    named : sequence of NamedEffect
        Effects found; they are listed in the order of how much they explain.
    groups : sequence of tuple of str
        Groups of effects that cannot be distinguished.
    closure, left_over : float
        Shares, as `Diagnosis` has them.
    closest : (tuple of str, float), optional
        Effects of the hypothesis that explains most, and the share of the mismatch that it explains.
    location : Location
        Where the mismatch is; stated if the verdict is unknown.
    settings : VerdictSettings
        Thresholds of the verdict.
    noise_known : bool
        Whether the noise was estimated from anything but the fit's own residuals.
    unseen : sequence of str
        Held-out recordings in which alone a mismatch shows.
    minor : sequence of NamedEffect
        Effects that explain little, but beyond doubt.
    """
    if verdict == "none" and not noise_known:
        return (
            "No effect of the catalogue explains more than the base model. The noise of these recordings is unknown, "
            "however, so an effect may have been missed: repeat a recording, or record with zero drive."
        )
    if verdict == "none":
        late = "" if math.isnan(closure) else ", the held-out ones once they are fitted as well"
        return f"The base model explains these recordings to within their noise{late}: they show no missing effect."
    if verdict == "unknown" and unseen and left_over <= settings.left_over:
        names = ", ".join(unseen[:MOST_NAMED]) + (" and others" if len(unseen) > MOST_NAMED else "")
        return (
            f"Unknown: {names} {'shows' if len(unseen) == 1 else 'show'} a mismatch that the fitted recordings do not "
            "show. Hold out other recordings and diagnose again."
        )
    if verdict == "unknown":
        fitted = [n.effect.id for n in named]
        foretold = not closure < settings.least_closure  # or nothing was held out
        return _unknown(left_over, fitted, foretold, closest, location, max(map(len, groups), default=0), settings)
    remains = [f"They leave {percent(left_over)} of the mismatch beyond noise."] if left_over > 0 else []
    little = [f"Minor, but beyond doubt: {_joined([n.effect.id for n in minor], 'and')}."] if minor else []
    if verdict == "set":
        alike = "; ".join(_joined(group, "or") for group in groups)
        first = f"{alike[0].upper()}{alike[1:]}: these recordings cannot distinguish between them."
        certain = [n.effect.id for n in _by_weight(named) if all(n.effect.id not in group for group in groups)]
        return " ".join([first, *_explained("Either", certain, closure), *remains, *little])
    most, *others = _by_weight(named)
    if remains and not others:
        remains = [remains[0].replace("They leave", "It leaves")]
    return " ".join([most.sentence, *_explained("It", [n.effect.id for n in others], closure), *remains, *little])


def probabilities_text(probabilities: Mapping[str, float]) -> str:
    """The explanations that are at least one percent probable, as a phrase.

    Examples
    --------
    >>> probabilities_text({"creep": 0.93, "none of these": 0.066, "nothing": 0.004})
    'creep 93 %, none of these 6.6 %'
    """
    most = sorted(probabilities.items(), key=lambda pair: -pair[1])
    return ", ".join(f"{name.replace('_', ' ')} {percent(p)}" for name, p in most if p >= 0.01)


def _by_weight(named: Sequence[NamedEffect]) -> list[NamedEffect]:
    return sorted(named, key=lambda n: -n.delta_nll)


def _explained(who: str, others: Sequence[str], closure: float) -> list[str]:
    """Sentence on the explained share of the mismatch and the other effects; empty if there is nothing to say."""
    if closure < 0:
        also = f"{_also(others)}; h" if others else "H"
        return [f"{also}eld-out recordings were predicted worse, but are explained once they are fitted as well."]
    share = "" if math.isnan(closure) else f"{percent(min(closure, 1.0), 3)} of the mismatch"
    if others:
        also = _also(others)
        return [f"{also}; together they explain {share}." if share else f"{also}."]
    return [f"{who} explains {share}."] if share else []


def _also(others: Sequence[str]) -> str:
    names = _joined(others, "and")
    return f"{names[0].upper()}{names[1:]} {'is' if len(others) == 1 else 'are'} present as well"


def _unknown(
    left_over: float,
    fitted: Sequence[str],
    foretold: bool,
    closest: tuple[tuple[str, ...], float] | None,
    location: Location,
    alike: int,
    settings: VerdictSettings,
) -> str:
    said = (
        "Unknown: something is missing that the catalogue does not have. "
        f"{percent(left_over)} of the mismatch is not explained by any of its effects"
    )
    if left_over <= settings.left_over and alike > settings.most_alike:
        said = f"Unknown: a small mismatch is present, and each of {alike} effects explains it equally well"
    elif left_over <= settings.left_over and fitted:
        fitted_well = _together(fitted)
        said = f"Unknown: {fitted_well} explains the fitted recordings but predicts the held-out ones poorly"
        if foretold:
            several = len(fitted) > 1
            said = (
                f"Unknown: {fitted_well} {'together explain' if several else 'explains'} these recordings, but so may "
                f"physics that the catalogue lacks{', which several laws often imitate' if several else ''}"
            )
    elif left_over <= settings.left_over:
        said = "Unknown: the residuals have structure that noise has not, but no effect of the catalogue explains it"
    elif closest is not None and closest[1] <= 1 - left_over + settings.left_over:
        ids, part = closest
        said += f"; {_together(ids)} comes closest and explains {percent(min(part, 1.0))}"
        if part >= settings.least_closure and not foretold:
            said += ", but predicts the held-out recordings poorly"
    where = []
    if location.recordings:
        where.append(f"in {location.recordings[0]}")
    if location.frequency_Hz:
        bands = location.frequency_Hz[:MOST_BANDS]
        where.append("at " + " and ".join(span_text(low, high, "Hz") for low, high in bands))
    return f"{said}. The mismatch is largest {', '.join(where)}." if where else f"{said}."


def _together(ids: Sequence[str]) -> str:
    """Names of effects that act together.

    Examples
    --------
    >>> _together(("second_mode",)), _together(("second_mode", "creep", "wave_echo"))
    ('second mode', 'second mode with creep and wave echo')
    """
    first, *others = ids
    return f"{_joined((first,), 'and')} with {_joined(others, 'and')}" if others else _joined((first,), "and")


def _joined(ids: Sequence[str], word: str) -> str:
    """Names of effects in a list.

    Examples
    --------
    >>> _joined(("second_mode", "air_bubble", "creep"), "or")
    'second mode, air bubble or creep'
    """
    names = [name.replace("_", " ") for name in ids]
    return f" {word} ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
