"""A rig of a generator and an oscilloscope over VISA."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass

import numpy as np

from inkjet_env.printhead import DriverLimits
from inkjet_env.recordings import Recording
from inkjet_env.rig.request import Request
from inkjet_env.rig.visa.generator import Generator
from inkjet_env.rig.visa.instrument import Instrument
from inkjet_env.rig.visa.oscilloscope import BEFORE, Oscilloscope, ScopeInput
from inkjet_env.typing import Real

POINTS_A_CYCLE = 100
"""Points of the generator per cycle of a demagnetising drive."""


@dataclass(frozen=True)
class Demagnetisation:
    """A cycle of a sine, then cycles whose amplitude falls linearly to 0 V, then a rest.

    Parameters
    ----------
    peak_V : float
        Amplitude of the first cycle, in volts at the head; at least the largest drive that the ceramic has seen.
    cycles : int
        Number of cycles in which the amplitude falls, by ``peak_V / cycles`` in each.
    frequency_Hz : float
        Frequency, in hertz; far below the head's resonance.
    rest_s : float
        Time at 0 V afterwards, in which the head comes to rest, in seconds.
    """

    peak_V: float
    cycles: int = 50
    frequency_Hz: float = 200.0
    rest_s: float = 0.5

    def __post_init__(self) -> None:
        for name in ("peak_V", "frequency_Hz"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} of a demagnetisation must be finite and above 0; got {value!r}.")
        if self.cycles < 1 or not 0 <= self.rest_s < math.inf:
            raise ValueError("a demagnetisation needs at least 1 cycle, and a finite rest_s of at least 0 s.")

    @property
    def rate_Hz(self) -> float:
        """Points per second."""
        return POINTS_A_CYCLE * self.frequency_Hz

    @property
    def duration_s(self) -> float:
        """Time until the head is at rest, in seconds."""
        return (1 + self.cycles) / self.frequency_Hz + self.rest_s

    def drive_V(self) -> Real:
        """The drive at `rate_Hz`, in volts, from 0 V to 0 V."""
        cycle = np.arange(POINTS_A_CYCLE * (1 + self.cycles) + 1) / POINTS_A_CYCLE
        share = np.minimum(1.0, (1 + self.cycles - cycle) / self.cycles)
        drive_V = self.peak_V * share * np.sin(2 * np.pi * cycle)
        return np.asarray(drive_V, dtype=np.float64)


class VisaRig:
    """A `Rig`: a generator whose amplifier drives the head, and an oscilloscope that the generator triggers.

    ``periodic``: the drive is repeated for ``settling_s`` and at least ``settling_repetitions``, then one repetition is
    recorded from the trigger on, averaged over as many as the input says. ``demagnetised``: the ceramic is
    demagnetised, the head comes to rest, and the drive is put out once; for each average all of it anew. Instruments
    are connected for one recording at a time, and the output is off before and after it.

    Parameters
    ----------
    generator : Generator
        Generator and amplifier.
    oscilloscope : Oscilloscope
        Oscilloscope and its inputs.
    limits : DriverLimits
        What the amplifier can do. A request beyond its voltages is refused.
    demagnetisation : Demagnetisation, optional
        How the ceramic is demagnetised; without it, a request for that is refused.
    settling_s : float
        Least time in which a repeated drive settles, in seconds.
    settling_repetitions : int
        Least number of repetitions in which it settles.
    timeout_s : float
        Longest time that an instrument may take to answer, in seconds.
    arming_s : float
        Time from arming the oscilloscope to a single drive, in seconds, beyond what it records before the trigger.
    library : str
        VISA library, as in PyVISA: empty for the installed one, ``@py`` for PyVISA-py, ``FILE.yaml@sim`` for simulated
        instruments.

    Attributes
    ----------
    identities : tuple of str
        Maker, model, serial number and firmware that generator and oscilloscope gave.

    Raises
    ------
    InstrumentError
        An instrument cannot be reached.
    ValueError
        The demagnetising drive is beyond the limits.
    """

    def __init__(
        self,
        generator: Generator,
        oscilloscope: Oscilloscope,
        *,
        limits: DriverLimits,
        demagnetisation: Demagnetisation | None = None,
        settling_s: float = 0.5,
        settling_repetitions: int = 3,
        timeout_s: float = 5.0,
        arming_s: float = 0.2,
        library: str = "",
    ) -> None:
        self.generator, self.oscilloscope, self.demagnetisation = generator, oscilloscope, demagnetisation
        self.settling_s, self.settling_repetitions = settling_s, settling_repetitions
        self.timeout_s, self.arming_s, self.library = timeout_s, arming_s, library
        self._limits = limits
        if demagnetisation is not None:
            self._check_voltages("the demagnetising drive", demagnetisation.peak_V * np.array([-1.0, 1.0]))
        with self._connected() as links:  # what is missing is told before any work
            self.identities = tuple(link.ask("*IDN?") for link in links)

    def limits(self) -> DriverLimits:
        """What the driver can do."""
        return self._limits

    def record(self, request: Request, order: int) -> Recording:
        """Take one recording.

        Parameters
        ----------
        request : Request
            What to record.
        order : int
            Position of the recording within the session: 1, 2, 3 …

        Raises
        ------
        ValueError
            The rig has no input for it, or cannot demagnetise, or the drive is beyond the limits.
        InstrumentError
            An instrument reports an error, does not answer, or answers what cannot be used.
        """
        scope = self.oscilloscope
        sensor = scope.inputs.get(request.channel)
        if sensor is None:
            raise ValueError(
                f"{request.name}: a recording of {request.channel} is asked for, and the oscilloscope has inputs for "
                f"{', '.join(scope.inputs)} only. Connect the sensor and add its input, or begin with a campaign that "
                "needs none."
            )
        if request.neighbour_V is not None:
            raise ValueError(
                f"{request.name}: the neighbouring channel is to be driven too, and this rig drives one. Have it "
                "recorded through the session's folders: leave out --rig."
            )
        inputs = [sensor]
        if request.drive_monitor:
            if scope.monitor is None:
                raise ValueError(
                    f"{request.name}: the voltage at the head is asked for too, and the oscilloscope has no input for "
                    "it. Connect the amplifier's monitor, and give the oscilloscope its monitor."
                )
            inputs.append(scope.monitor)
        self._check_voltages(request.name, request.drive_V)
        take = self._repeated if request.initial_state == "periodic" else self._once
        traces = take(request, inputs)
        return request.answered(traces[0], sensor.unit, order, traces[1] if request.drive_monitor else None)

    def _repeated(self, request: Request, inputs: Sequence[ScopeInput]) -> list[Real]:
        """One repetition of a repeated drive, of each input."""
        generator, scope, averages = self.generator, self.oscilloscope, inputs[0].averages
        period_s = request.step_s * request.drive_V.size
        span_s = scope.span_s(period_s)
        with self._connected() as (driving, recording):
            wave_V = generator.held_V(request.drive_V, request.step_s, periodic=True)
            scale_V = generator.load(driving, {"drive": wave_V})
            scope.set_up(recording, inputs, span_s, averages)
            generator.select(driving, "drive", generator.points_per_step / request.step_s, scale_V, repeat=True)
            generator.output(driving, on=True)
            time.sleep(max(self.settling_s, self.settling_repetitions * period_s))
            scope.arm(recording, inputs)
            scope.wait(recording, 2 * averages * (span_s + period_s) + self.timeout_s)
            return [scope.read(recording, one, request.drive_V.size, request.step_s) for one in inputs]

    def _once(self, request: Request, inputs: Sequence[ScopeInput]) -> list[Real]:
        """A drive that is put out once, after demagnetisation, of each input; the mean over its averages."""
        generator, scope, demagnetisation = self.generator, self.oscilloscope, self.demagnetisation
        if demagnetisation is None:
            raise ValueError(
                f"{request.name}: a demagnetised head is asked for, and the rig has no demagnetisation. Give one, such "
                "as Demagnetisation(peak_V=100)."
            )
        span_s = scope.span_s(request.step_s * request.drive_V.size)
        taken = []
        with self._connected() as (driving, recording):
            wave_V = generator.held_V(request.drive_V, request.step_s, periodic=False)
            scale_V = generator.load(driving, {"demag": demagnetisation.drive_V(), "drive": wave_V})
            scope.set_up(recording, inputs, span_s, averages=1)
            for _ in range(inputs[0].averages):
                generator.select(driving, "demag", demagnetisation.rate_Hz, scale_V, repeat=False)
                generator.output(driving, on=True)
                generator.fire(driving)
                time.sleep(demagnetisation.duration_s)
                generator.select(driving, "drive", generator.points_per_step / request.step_s, scale_V, repeat=False)
                scope.arm(recording, inputs)
                time.sleep(self.arming_s + BEFORE * span_s)
                generator.fire(driving)
                scope.wait(recording, 2 * span_s + self.timeout_s)
                taken.append([scope.read(recording, one, request.drive_V.size, request.step_s) for one in inputs])
        return list(np.mean(taken, axis=0))

    def _check_voltages(self, name: str, drive_V: Real) -> None:
        """Refuse a drive that the amplifier would clip, or that the head does not stand."""
        voltages = DriverLimits(self._limits.lowest_V, self._limits.highest_V)
        for excess in voltages.excesses(np.arange(drive_V.size, dtype=np.float64), drive_V):
            raise ValueError(f"{name} {excess} Ask for less, or correct the limits.")

    @contextmanager
    def _connected(self) -> Iterator[tuple[Instrument, Instrument]]:
        """Generator and oscilloscope; the generator's output is off at the end, whatever happened."""
        generator, scope = self.generator, self.oscilloscope
        driving = Instrument(generator.address, "generator", self.library, self.timeout_s, generator.commands.error)
        with closing(driving):
            recording = Instrument(scope.address, "oscilloscope", self.library, self.timeout_s, scope.commands.error)
            with closing(recording):
                try:
                    for link in (driving, recording):
                        link.send("*CLS")
                    yield driving, recording
                except BaseException:
                    generator.output(driving, on=False, checked=False)  # the first error is the one to tell
                    raise
                generator.output(driving, on=False)
