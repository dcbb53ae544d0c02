"""An oscilloscope that records sensors, and the voltage at the head, from the generator's trigger on."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from inkjet_env.printhead import check_name
from inkjet_env.recordings.recording import CHANNELS, SENSOR_COLUMNS
from inkjet_env.rig.visa.commands import OscilloscopeCommands
from inkjet_env.rig.visa.instrument import Instrument, InstrumentError, NoAnswerError
from inkjet_env.typing import Real

BEFORE = 0.1
"""Largest part of the screen before the trigger; it is recorded before a trigger counts."""
SPAN = 1.25
"""Time across the screen over that of a recording; more than 1 / (1 − `BEFORE`)."""
ASK_EVERY_S = 0.05
"""Time between two questions whether a recording is complete, in seconds."""
SLACK = 1e-6
"""Excess of a time over a limit that is rounding, in sampling steps."""


@dataclass(frozen=True)
class ScopeInput:
    """One input of an oscilloscope, and what is connected to it.

    Parameters
    ----------
    number : int
        Number of the input: 1, 2, 3 …
    range_V : float
        Voltage from the bottom to the top of the screen, at the tip of the probe.
    offset_V : float
        Voltage in the middle of the screen.
    probe : float
        Attenuation of the probe, 10 for 10:1; the oscilloscope takes it into account.
    per_V : float
        What is recorded per volt at the tip of the probe, in ``unit``: micrometres per volt of a vibrometer, or volts
        at the head per volt of an amplifier's monitor.
    unit : {"V", "um", "nm"}
        Unit of what is recorded.
    averages : int
        Number of times that a recording is taken and averaged.
    """

    number: int
    range_V: float
    offset_V: float = 0.0
    probe: float = 1.0
    per_V: float = 1.0
    unit: str = "V"
    averages: int = 1

    def __post_init__(self) -> None:
        check_name("unit", self.unit, SENSOR_COLUMNS)
        for name in ("range_V", "probe"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} of input {self.number} must be finite and above 0; got {value!r}.")
        if not (math.isfinite(self.per_V) and self.per_V != 0):
            raise ValueError(f"per_V of input {self.number} must be finite and not 0; got {self.per_V!r}.")
        if self.averages < 1:
            raise ValueError(f"averages of input {self.number} must be at least 1; got {self.averages}.")


@dataclass(frozen=True)
class Oscilloscope:
    """An oscilloscope, triggered by the generator as a waveform begins.

    Parameters
    ----------
    address : str
        VISA address.
    inputs : mapping of str to ScopeInput
        Input of each sensor, by channel: ``self_sensing``, ``strain_gauge``, ``displacement``.
    monitor : ScopeInput, optional
        Input that measures the voltage at the head.
    trigger : str
        Source of the trigger, in the oscilloscope's words.
    level_V : float
        Level of the trigger's rising edge, in volts.
    delay_s : float
        Time from the trigger to the first point of a waveform at the head, in seconds, as measured.
    commands : OscilloscopeCommands
        Its commands.
    """

    address: str
    inputs: Mapping[str, ScopeInput]
    monitor: ScopeInput | None = None
    trigger: str = "EXT"
    level_V: float = 1.0
    delay_s: float = 0.0
    commands: OscilloscopeCommands = field(default_factory=OscilloscopeCommands)

    def __post_init__(self) -> None:
        if not self.inputs:
            raise ValueError("inputs must name the input of at least one sensor, such as {'self_sensing': …}.")
        for channel in self.inputs:
            check_name("channel", channel, CHANNELS)
        if self.monitor is not None and self.monitor.unit != "V":
            raise ValueError(f"the monitor's unit must be V; got {self.monitor.unit}.")

    def span_s(self, duration_s: float) -> float:
        """Time across the screen for a recording of so many seconds."""
        return SPAN * (duration_s + abs(self.delay_s))

    def set_up(self, link: Instrument, inputs: Sequence[ScopeInput], span_s: float, averages: int) -> None:
        """Set up time base, trigger and inputs; ``averages`` triggers make a recording."""
        commands = self.commands
        mode = commands.single if averages == 1 else commands.average
        values = {"span_s": span_s, "trigger": self.trigger, "level_V": self.level_V, "averages": averages}
        for template in (*commands.set_up, *mode):
            link.send(template.format(**values))
        for one in inputs:
            for template in commands.input_set_up:
                link.send(
                    template.format(input=one.number, range_V=one.range_V, offset_V=one.offset_V, probe=one.probe)
                )

    def arm(self, link: Instrument, inputs: Sequence[ScopeInput]) -> None:
        """Begin a recording, which waits for the trigger."""
        names = (self.commands.input_name.format(input=one.number) for one in inputs)
        command = self.commands.arm.format(inputs=self.commands.input_separator.join(names))
        link.send(command, checked=False)  # the answer would come after the trigger

    def wait(self, link: Instrument, longest_s: float) -> None:
        """Wait until the recording is complete.

        Raises
        ------
        InstrumentError
            It is not after ``longest_s`` seconds.
        """
        end_s = time.monotonic() + longest_s
        untriggered = (
            f"{link.name} has no complete recording after {longest_s:.3g} s. Is the generator's sync output connected "
            f"to its trigger input {self.trigger}, and does it cross {self.level_V:g} V?"
        )
        while (left_s := end_s - time.monotonic()) > 0:
            try:
                answer = link.ask(self.commands.finished, timeout_s=left_s)
            except NoAnswerError:
                break
            if answer == self.commands.finished_answer:
                link.check(self.commands.arm)
                return
            time.sleep(ASK_EVERY_S)
        raise InstrumentError(untriggered)

    def read(self, link: Instrument, one: ScopeInput, samples: int, step_s: float) -> Real:
        """What an input has recorded, at the samples of a request, shape (samples,), in the input's unit.

        Between the oscilloscope's samples a cubic spline is used.

        Raises
        ------
        InstrumentError
            The oscilloscope sent another number of samples than it stated, clipped the signal, recorded too short a
            time, or sampled more coarsely than was asked for.
        """
        commands = self.commands
        for template in commands.read:
            link.send(template.format(input=one.number))
        scaling = link.numbers(commands.scaling.format(input=one.number), 10)
        stated = round(scaling[2])
        x_step_s, x_origin_s, x_reference, y_step_V, y_origin_V, y_reference = scaling[4:10]
        words = link.words(commands.samples.format(input=one.number), commands.big_endian)
        link.check(commands.samples)
        where = f"{link.name}: its input {one.number}"
        if words.size != stated or stated < 2:
            raise InstrumentError(
                f"{where} stated {stated} samples and sent {words.size}. Raise the timeout, or record fewer samples."
            )
        if not x_step_s > 0:
            raise InstrumentError(f"{where} stated {x_step_s:g} s between its samples. Adapt the commands to it.")
        clipped = np.count_nonzero((words <= commands.lowest) | (words >= commands.highest))
        if clipped:
            raise InstrumentError(
                f"{where} clips {clipped} of {stated} samples: the signal leaves its screen of {one.range_V:g} V "
                f"around {one.offset_V:g} V. Raise its range_V, or move its offset_V."
            )
        if x_step_s > step_s * (1 + SLACK):
            raise InstrumentError(
                f"{where} takes a sample every {x_step_s:.4g} s; one every {step_s:.4g} s was asked for. Give the "
                "oscilloscope more memory, or use fewer of its inputs."
            )
        at_s = (np.arange(stated) - x_reference) * x_step_s + x_origin_s
        wanted_s = step_s * np.arange(samples) + self.delay_s
        slack_s = SLACK * step_s
        if at_s[0] > wanted_s[0] + slack_s or at_s[-1] < wanted_s[-1] - slack_s:
            raise InstrumentError(
                f"{where} recorded from {at_s[0]:.4g} s to {at_s[-1]:.4g} s after the trigger; {wanted_s[0]:.4g} s to "
                f"{wanted_s[-1]:.4g} s was asked for. Its time base must begin at the left and hold that long."
            )
        volts = (words - y_reference) * y_step_V + y_origin_V
        return np.asarray(one.per_V * CubicSpline(at_s, volts)(wanted_s), dtype=np.float64)
