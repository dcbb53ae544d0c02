"""Base class of an effect: a sentence, an equation, parameters, and its action in one stage of the plant."""

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
"""Stages of the plant, in the order in which a signal passes them."""

SCALES = ("linear", "log", "reciprocal")
"""Scales on which a parameter may be fitted."""

METHODS = (
    "starts", "scaled", "superposed", "bounds", "untestable", "changes", "description", *STAGES, "random_effect_basis"
)  # fmt: skip
"""Methods that an effect may override."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect.

    Parameters
    ----------
    name : str
        Name with its unit at the end, as ``frequency_Hz``.
    unit : str
        Unit as a reader would write it; "1" for a dimensionless parameter.
    low, high : float
        Bounds, in ``unit``.
    scale : {"linear", "log", "reciprocal"}
        Coordinate in which it is fitted: the value, its logarithm or its reciprocal (a bandwidth is infinite when the
        effect is off).
    meaning : str
        Meaning in words.
    open_ended : bool
        Whether a value at a bound is as acceptable as any other, as for clipping that is harder than recordings can
        resolve. Otherwise a shape fitted at its bound means that the effect has degenerated into another one.
    plain : float, optional
        Value of a shape parameter that makes the law the simplest of its kind. A fit keeps it there, unless it starts
        elsewhere or the simple law does not suffice.
    later : bool
        Whether the law was first published without it: a printhead.json omits it while it is plain.
    """

    name: str
    unit: str
    low: float
    high: float
    scale: str = "linear"
    meaning: str = ""
    open_ended: bool = False
    plain: float | None = None
    later: bool = False

    def coordinate(self, value: float) -> float:
        """Fitted coordinate of a value in the parameter's unit."""
        if self.scale == "log":
            return math.log(value)
        return 1 / value if self.scale == "reciprocal" else value

    def value(self, coordinate: float) -> float:
        """Value, in the parameter's unit, of a fitted coordinate."""
        if self.scale == "log":
            return math.exp(coordinate)
        if self.scale == "reciprocal":
            return math.inf if coordinate == 0 else 1 / coordinate
        return coordinate

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the coordinate, lower first."""
        a, b = self.coordinate(self.low), self.coordinate(self.high)
        return min(a, b), max(a, b)


class Effect:
    """Physics that the base model leaves out, in a stage of the plant.

    An effect overrides the method of its stage and `starts`, and declares id, stage, sentence, parameters and
    strengths; the rest has defaults. Each ``strength`` parameter has no influence at zero (at infinity for a reciprocal
    one), so that the base model is the plant with every effect off.

    A method raises `SimulationError` for values that it cannot simulate, and a fit then tries others. Any other
    exception is a fault of its code and is reported as an `EffectError` that names the effect and the method.

    Attributes
    ----------
    id : str
        Name of the effect, as in a verdict and a printhead.json; unique.
    stage : {"drive", "hysteresis", "resonator", "sensing"}
        Stage of the plant in which the effect acts.
    also : tuple of str
        Further stages in which it acts, by their methods. None by default.
    sentence : str
        What the base model leaves out, in plain words.
    equation, source : str
        The law, and the publication it comes from.
    parameters : tuple of Parameter
        All parameters, in the order of the fitted coordinates.
    strengths : tuple of str
        Names of the parameters that are zero (or infinite) when the effect is off.
    terms : tuple of tuple of str
        Groups of strengths that are switched on and off together because none is a law by itself; likewise of shapes.
        Empty: every strength is a term of its own.
    plain_leaves : float
        Share of the mismatch that the law must leave unexplained before terms that its start has off are admitted;
        dimensionless, 0 to 1.
    rugged : tuple of str
        Names of strengths on which the signal depends in jumps, so that a fit ends at the nearest of many minima.
    tuned : tuple of str
        Names of strengths that change the shape of what the effect adds, such as a frequency: their starts cover the
        range, and a score that compares sizes does not scale them.
    characteristic : tuple of str
        Names of parameters of which one at least must matter: with all at rest, it would be another effect.
    signature : str
        What distinguishes it from other effects.
    confusable_with : tuple of str
        Ids of effects it may be mistaken for.
    shown_by : str
        Recording that would show it, as the object of "record".
    depends_on_order : bool
        Whether it changes with the order of the recordings within the session, so that a printhead.json with it must
        say for which recording the head stands ("order"). False by default.
    needs_neighbour : bool
        Whether the drive of the neighbouring channel (column neighbour_V) causes it. False by default.
    """

    id: ClassVar[str]
    stage: ClassVar[str]
    also: ClassVar[tuple[str, ...]] = ()
    sentence: ClassVar[str]
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    parameters: ClassVar[tuple[Parameter, ...]]
    strengths: ClassVar[tuple[str, ...]]
    terms: ClassVar[tuple[tuple[str, ...], ...]] = ()
    plain_leaves: ClassVar[float] = 0.0
    rugged: ClassVar[tuple[str, ...]] = ()
    tuned: ClassVar[tuple[str, ...]] = ()
    characteristic: ClassVar[tuple[str, ...]] = ()
    signature: ClassVar[str] = ""
    confusable_with: ClassVar[tuple[str, ...]] = ()
    shown_by: ClassVar[str] = "a different kind of drive"
    depends_on_order: ClassVar[bool] = False
    needs_neighbour: ClassVar[bool] = False

    @property
    def random(self) -> bool:
        """Whether it varies at random between recordings, so that its amplitudes are fitted to each recording.

        True for an effect that overrides `random_effect_basis`. A class may declare ``random = True`` or ``False``.
        """
        return type(self).random_effect_basis is not Effect.random_effect_basis

    @property
    def predictable(self) -> bool:
        """Whether a model with the effect predicts the response to a new drive better than the base model does.

        False for a random effect, and for one that needs the neighbour's drive, which a new drive does not include. A
        class may declare ``predictable = True`` or ``predictable = False``.
        """
        return not (self.random or self.needs_neighbour)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name in METHODS:
            owner = next(parent for parent in cls.__mro__ if name in vars(parent))
            method = vars(owner)[name]
            if isinstance(method, FunctionType) and (owner is cls or not issubclass(owner, Effect)):
                setattr(cls, name, answerable(method, name))

    def acts_in(self, stage: str) -> bool:
        """Whether it acts in a stage."""
        return stage == self.stage or stage in self.also

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        """Starting points of a fit to these recordings: all values, at medium strength, one for each guess of shape.

        An effect with several strengths has separate starts for each, with the others off.
        """
        raise NotImplementedError

    def scaled(self, values: Values, factor: float) -> dict[str, float]:
        """Values, within bounds, with which it adds about ``factor`` times as much; by default, strengths scaled so.

        ``factor`` is negative if it should act the other way.
        """
        found = dict(values)
        for p in self.parameters:
            if p.name in self.strengths and p.name not in self.tuned:
                scaled = p.coordinate(values[p.name]) * (abs(factor) if p.scale == "reciprocal" else factor)
                low, high = p.bounds
                found[p.name] = p.value(min(max(scaled, low), high))
        return found

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        """Values at full strength, which change recordings that show the effect by some per cent, a quarter at most.

        Synthetic campaigns are recorded with them. The default is the first start on a bipolar pulse. A parameter that
        is not given is off or plain, as in `complete`.

        Parameters
        ----------
        printhead : Printhead
            The head that has the effect; frequencies and times scale with its resonance.
        largest : float
            Largest magnitude of the fast channel's signal, in the sensor's unit; it scales levels such as a limit.
        noise_rms : float
            Standard deviation of the noise, in the sensor's unit; it scales amplitudes that must exceed the noise.

        Returns
        -------
        dict of str to float
            Value of each parameter, in its unit.
        """
        step_s = 1 / (100 * printhead.frequency_Hz)
        pulse_V = np.interp(np.arange(2000), [0, 10, 65, 95, 160, 180], [0.0, 90.0, 90.0, -80.0, -80.0, 0.0])
        return dict(self.starts(printhead, [Excitation("self_sensing", "demagnetised", step_s, pulse_V)])[0])

    def superposed(
        self, printhead: Printhead, excitations: Sequence[Excitation]
    ) -> tuple[list[dict[str, float]], list[dict[str, float]], csr_array] | None:
        """Starting points of the full law, if its contribution is nearly a sum of contributions of its plain law.

        Returns values of the plain law (k), starting points of the full law (n), and the weights of the former in each
        of the latter, shape (n, k). None if a fit of the full law may start at the plain one.
        """
        return None

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        """Narrower bounds of some parameters, by name; beyond them, these recordings would show another effect."""
        return {}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        """Why these recordings cannot show the effect, as the end of a sentence after "because"; None if they can."""
        return None

    def changes(self, name: str, excitation: Excitation, values: Values) -> bool:
        """Whether a parameter can change the response in a recording; if not, no simulation is spent on it."""
        return True

    def description(self, values: Values, unit: str = "V") -> str:
        """The effect with its values, in plain words for a reader who knows printheads but not this program.

        ``unit`` is the unit of the sensor's signal.
        """
        return self.sentence

    def advance_s(self, values: Values) -> float:
        """Longest time in seconds by which it acts before the drive that causes it, as a clock that is off does."""
        return 0.0

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        """Voltage at the ceramic after this effect, from the voltage before it; both at the nodes, shape (nodes,)."""
        return drive_V

    def hysteresis(
        self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        """Hysteretic drive after this effect, from that before it and the voltage at the ceramic; shape (nodes,)."""
        return hysteretic_V

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        """Resonance of the head in this recording, with this effect added to the given one."""
        return resonance

    def sensing(
        self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        """Sensor signal after this effect, with offset, at the samples; ``drive_V`` at the ceramic, at the nodes."""
        return signal

    def random_effect_basis(self, values: Values, excitation: Excitation) -> Real | None:
        """Random-effect basis, shape (n, k): signals whose amplitudes vary at random, as the phase of a hum does.

        The amplitudes are fitted to each recording separately, so such an effect explains a recording, but no
        simulation predicts it. None for an effect that is not random.
        """
        return None

    def random_amplitudes(self, count: int, rng: np.random.Generator) -> Real:
        """Random amplitudes of `random_effect_basis` in one recording, shape (count,), for a strength of 1.

        A synthetic campaign multiplies them by the first of the ``strengths``.
        """
        return rng.standard_normal(count)


def coordinates(effect: Effect, values: Values) -> Real:
    """Fitted coordinates of an effect, shape (k,), from its values."""
    with blamed(effect, f"values {dict(values)} of its parameters"):
        return np.array([p.coordinate(values[p.name]) for p in effect.parameters])


def limits(effect: Effect, printhead: Printhead, excitations: Sequence[Excitation]) -> tuple[Real, Real]:
    """Bounds of an effect's coordinates for these recordings: lower and upper, shape (k,) each."""
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
    """Values of an effect, by parameter, from its coordinates, shape (k,)."""
    return {p.name: p.value(float(z)) for p, z in zip(effect.parameters, point, strict=True)}


def complete(effect: Effect, **given: float) -> dict[str, float]:
    """All values of an effect from the given ones: strengths that are not given are off, shapes are plain.

    Raises
    ------
    ValueError
        A name that is not a parameter of the effect, or a missing shape that has no plain value.
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
    """Terms of an effect's law that are on and that are off at coordinates of shape (k,): names of parameters.

    A term is a group of strengths, off if all are exactly at their off value, or a shape, off if it is plain.
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
    """Coordinate of a parameter when its term of the law is off."""
    if parameter.name in effect.strengths or parameter.plain is None:
        return 0.0
    return parameter.coordinate(parameter.plain)


def switched_off(effect: Effect, values: Values) -> dict[str, float]:
    """The values with every strength at its off value."""
    return {**values, **_off(effect)}


def _off(effect: Effect) -> dict[str, float]:
    """Off value of every strength."""
    return {
        p.name: math.inf if p.scale == "reciprocal" else 0.0 for p in effect.parameters if p.name in effect.strengths
    }
