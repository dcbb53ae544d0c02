"""What an effect of the catalogue is: a sentence, an equation, parameters, and what it does in its stage."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_array

from inkjet_env.plant.errors import answerable, blamed
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.resonance import Resonance
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

Values = Mapping[str, float]
"""Values of an effect's parameters by name, in their units."""

STAGES = ("drive", "hysteresis", "resonator", "sensing")
SCALES = ("linear", "log", "reciprocal")
METHODS = ("starts", "superposed", "bounds", "untestable", "changes", "description", *STAGES, "random_effect_basis")
"""Of an effect, which it may override."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Parameters
    ----------
    name : str
        With its unit at the end, as ``frequency_Hz``.
    unit : str
        As a reader would write it; "1" where it has none.
    low, high : float
        Bounds.
    scale : {"linear", "log", "reciprocal"}
        In what it is fitted: itself, its logarithm, or one over itself (a bandwidth that is infinite where nothing is
        left out).
    meaning : str
        What it is, in words.
    open_ended : bool
        Whether a value at a bound is as good as any: a clipping harder than can be told. Else an effect fitted with a
        shape at its bound has become something else.
    plain : float, optional
        Of a shape, the value that makes the law the simplest of its kind: there a fit leaves it, unless it begins
        elsewhere or the simple law does not do.
    """

    name: str
    unit: str
    low: float
    high: float
    scale: str = "linear"
    meaning: str = ""
    open_ended: bool = False
    plain: float | None = None

    def coordinate(self, value: float) -> float:
        """What is fitted, from the value."""
        if self.scale == "log":
            return math.log(value)
        return 1 / value if self.scale == "reciprocal" else value

    def value(self, coordinate: float) -> float:
        """The value, from what is fitted."""
        if self.scale == "log":
            return math.exp(coordinate)
        if self.scale == "reciprocal":
            return math.inf if coordinate == 0 else 1 / coordinate
        return coordinate

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the coordinate, lower first."""
        a, b = self.coordinate(self.low), self.coordinate(self.high)
        return min(a, b), max(a, b)


class Effect:
    """Physics that the base model leaves out, as one stage of the plant does it.

    An effect overrides the method of its stage and `starts`, and declares id, stage, sentence, parameters and
    strengths; the rest has defaults. The value of each ``strength`` parameter at which nothing happens is
    zero (infinity for a reciprocal one), so that the base model is the plant with every effect off.

    For values that it cannot simulate a method raises `SimulationError`, and a fit tries others. Whatever else it
    raises is a fault of its code, and is told as an `EffectError` that names the effect and the method.

    Attributes
    ----------
    id : str
    stage : {"drive", "hysteresis", "resonator", "sensing"}
    sentence : str
        What the base model leaves out, in plain words.
    equation, source : str
    parameters : tuple of Parameter
    strengths : tuple of str
        Names of the parameters that are zero (or infinite) when the effect is off.
    terms : tuple of tuple of str
        Strengths that come and go together, where each is not a law by itself; shapes that do.
    plain_leaves : float
        Share of the mismatch that the law must leave before terms that its start has off are let in.
    signature : str
        What sets it apart.
    confusable_with : tuple of str
        Ids of effects it may be mistaken for.
    shown_by : str
        The recording that would show it.
    depends_on_order : bool
        Whether it changes with the order of the recordings within the session, so that a printhead.json with it must
        say at which recording the head is meant ("order"). False unless declared.
    needs_neighbour : bool
        Whether the drive of the neighbouring channel (column neighbour_V) causes it. False unless declared.
    """

    id: ClassVar[str]
    stage: ClassVar[str]
    sentence: ClassVar[str]
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    parameters: ClassVar[tuple[Parameter, ...]]
    strengths: ClassVar[tuple[str, ...]]
    terms: ClassVar[tuple[tuple[str, ...], ...]] = ()
    plain_leaves: ClassVar[float] = 0.0
    signature: ClassVar[str] = ""
    confusable_with: ClassVar[tuple[str, ...]] = ()
    shown_by: ClassVar[str] = "recordings of another kind"
    depends_on_order: ClassVar[bool] = False
    needs_neighbour: ClassVar[bool] = False

    @property
    def random(self) -> bool:
        """Whether it differs at random from recording to recording, so that its amplitudes are fitted to each one.

        True of an effect with `random_effect_basis`. A class may declare ``random = True`` or ``False`` itself.
        """
        return type(self).random_effect_basis is not Effect.random_effect_basis

    @property
    def predictable(self) -> bool:
        """Whether a model with the effect predicts the response to a new drive better than the base model does.

        False of a random effect, and of one that needs the neighbour's drive, which a new drive does not tell. A class
        may declare ``predictable = True`` or ``predictable = False`` itself.
        """
        return not (self.random or self.needs_neighbour)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name in METHODS:
            owner = next(parent for parent in cls.__mro__ if name in vars(parent))
            method = vars(owner)[name]
            if isinstance(method, FunctionType) and (owner is cls or not issubclass(owner, Effect)):
                setattr(cls, name, answerable(method, name))

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        """Starting points for a fit on these shots: complete values of middling strength, one for each guess of shape.

        Of an effect with several strengths each gets starts of its own, with the others off.
        """
        raise NotImplementedError

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        """Values at full strength: the effect then changes recordings that show it by some per cent, a quarter at most.

        Synthetic campaigns are recorded with them. An effect that declares none has those of its first start on a
        bipolar pulse. A parameter that is not given is off or plain, as in `complete`.

        Parameters
        ----------
        printhead : Printhead
            The head that has the effect; frequencies and times follow its resonance.
        largest : float
            Largest magnitude of the fast channel's signal, in the sensor's unit; for a level that the signal reaches.
        noise_rms : float
            Standard deviation of the noise, in the sensor's unit; for an amplitude that is told from it.

        Returns
        -------
        dict of str to float
            By parameter, in its unit.
        """
        step_s = 1 / (100 * printhead.frequency_Hz)
        pulse_V = np.interp(np.arange(2000), [0, 10, 65, 95, 160, 180], [0.0, 90.0, 90.0, -80.0, -80.0, 0.0])
        return dict(self.starts(printhead, [Excitation("self_sensing", "demagnetised", step_s, pulse_V)])[0])

    def superposed(
        self, printhead: Printhead, excitations: Sequence[Excitation]
    ) -> tuple[list[dict[str, float]], list[dict[str, float]], csr_array] | None:
        """Starting points of the whole law where what it adds is nearly a sum of what its plain law adds.

        Values of the plain law (k of them), starting points (n), and how much of each of the former makes up each of
        the latter, shape (n, k). None where a fit of the whole law may begin at the plain one.
        """
        return None

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        """Narrower bounds of some parameters, by name: beyond them these shots would show something else."""
        return {}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        """Why these shots cannot show the effect, as the end of a sentence after "because"; None where they can."""
        return None

    def changes(self, name: str, excitation: Excitation, values: Values) -> bool:
        """Whether a parameter can change anything in a shot; where not, no simulation is spent on it."""
        return True

    def description(self, values: Values, unit: str = "V") -> str:
        """The effect with its values, in plain words for a reader who knows printheads and not this program.

        ``unit``: of the sensor's signal.
        """
        return self.sentence

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        """Voltage at the ceramic from what came so far, both at the nodes."""
        return drive_V

    def hysteresis(
        self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        """Hysteretic drive from what the law gives for the voltage at the ceramic, all at the nodes."""
        return hysteretic_V

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        """How the head rings in this shot."""
        return resonance

    def sensing(
        self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        """The sensor's signal, offset included, at the samples; the voltage at the ceramic is given at the nodes."""
        return signal

    def random_effect_basis(self, values: Values, excitation: Excitation) -> Real | None:
        """Columns, shape (n, k), of what differs from recording to recording by chance: the phase of a hum.

        Their amplitudes are fitted to each recording by itself, so that such an effect explains a recording, but no
        simulation predicts it. None where there are no such.
        """
        return None

    def random_amplitudes(self, count: int, rng: np.random.Generator) -> Real:
        """Amplitudes of `random_effect_basis` in one recording, shape (count,), drawn for a strength of 1.

        A synthetic campaign multiplies them by the first of the ``strengths``.
        """
        return rng.standard_normal(count)


def coordinates(effect: Effect, values: Values) -> Real:
    """What is fitted of an effect, shape (k,), from its values."""
    with blamed(effect, f"values {dict(values)} of its parameters"):
        return np.array([p.coordinate(values[p.name]) for p in effect.parameters])


def limits(effect: Effect, printhead: Printhead, excitations: Sequence[Excitation]) -> tuple[Real, Real]:
    """Bounds of what is fitted of an effect in these shots: lower and upper, shape (k,) each."""
    narrower = effect.bounds(printhead, excitations)
    ends = []
    with blamed(effect, "a bound of its parameters"):
        for p in effect.parameters:
            low, high = p.bounds
            if p.name in narrower:
                a, b = sorted(p.coordinate(value) for value in narrower[p.name])
                low, high = max(low, a), min(high, b)
            ends.append((low, high))
    return np.array([low for low, _ in ends]), np.array([high for _, high in ends])


def values_at(effect: Effect, point: Real) -> dict[str, float]:
    """Values of an effect from what is fitted, shape (k,)."""
    return {p.name: p.value(float(z)) for p, z in zip(effect.parameters, point, strict=True)}


def complete(effect: Effect, **given: float) -> dict[str, float]:
    """All values of an effect from those that matter: strengths that are not given are off, shapes are plain.

    Raises
    ------
    ValueError
        A name that is no parameter of the effect's, or a shape without which it says nothing.
    """
    plain = {p.name: p.plain for p in effect.parameters if p.plain is not None}
    names = [p.name for p in effect.parameters]
    if unknown := sorted(set(given) - set(names)):
        raise ValueError(f"{effect.id} has no parameter {unknown[0]!r}; it has {', '.join(names)}.")
    values = plain | _off(effect) | given
    if missing := [name for name in names if name not in values]:
        raise ValueError(f"{effect.id} needs a value of {missing[0]!r}.")
    return {name: values[name] for name in names}


def terms_of(effect: Effect, point: Real) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    """Parts of an effect's law that are on and that are not, at what is fitted, shape (k,): names of parameters.

    A term is some strengths, off where they are all exactly nothing, or a shape, off where it is plain.
    """
    at = dict(zip((p.name for p in effect.parameters), point, strict=True))
    strengths = effect.terms or tuple((name,) for name in effect.strengths)
    named = {name for term in strengths for name in term}
    shapes = tuple((p.name,) for p in effect.parameters if p.plain is not None and p.name not in named)
    on: list[tuple[str, ...]] = []
    off: list[tuple[str, ...]] = []
    for term in (*strengths, *shapes):
        (off if all(at[p.name] == rest(effect, p) for p in effect.parameters if p.name in term) else on).append(term)
    return on, off


def rest(effect: Effect, parameter: Parameter) -> float:
    """What is fitted of a parameter where its part of the law is off."""
    if parameter.name in effect.strengths or parameter.plain is None:
        return 0.0
    return parameter.coordinate(parameter.plain)


def switched_off(effect: Effect, values: Values) -> dict[str, float]:
    """The values with every strength at nothing."""
    return {**values, **_off(effect)}


def _off(effect: Effect) -> dict[str, float]:
    """The strengths at nothing."""
    return {
        p.name: math.inf if p.scale == "reciprocal" else 0.0 for p in effect.parameters if p.name in effect.strengths
    }
