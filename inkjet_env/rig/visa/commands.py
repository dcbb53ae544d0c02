"""Commands of generators and oscilloscopes: what differs between makers, and nothing else.

A command is a template; names in braces stand for values, as in `str.format`. Every instrument must know ``*CLS`` and
``*IDN?``. For instruments of another maker, replace what differs::

    from dataclasses import replace

    mine = replace(OscilloscopeCommands(), arm=":SING", finished=":TRIG:STAT?", finished_answer="STOP")
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class GeneratorCommands:
    """Commands of an arbitrary waveform generator, by default those of Keysight's 33500B and 33600A series.

    Values: ``{channel}``, the output; ``{name}`` of a waveform; ``{values}``, numbers from −1 to 1 with commas between
    them; ``{rate_Hz}``, points per second; ``{peak_to_peak_V}``, voltage between the values −1 and 1.

    Attributes
    ----------
    set_up : tuple of str
        Sent first; the output is off afterwards, and the memory for waveforms is empty.
    upload : str
        Stores a waveform under a name.
    select : tuple of str
        Choose the waveform that is put out, its rate and its voltage; point by point, without smoothing.
    once, repeat : tuple of str
        Put the selected waveform out once at each `fire`; repeat it without a gap.
    fire : str
        Triggers a waveform that is put out once.
    output_on, output_off : str
        Connect and disconnect the output.
    error : str
        Asks for the oldest error: a number, 0 for none, a comma, and words.
    """

    set_up: tuple[str, ...] = (
        "OUTP{channel} OFF",
        "SOUR{channel}:DATA:VOL:CLE",
        "OUTP{channel}:LOAD INF",
        "OUTP:SYNC:SOUR CH{channel}",
        "OUTP:SYNC ON",
        "TRIG{channel}:SOUR BUS",
        "SOUR{channel}:BURS:MODE TRIG",
        "SOUR{channel}:BURS:NCYC 1",
    )
    upload: str = "SOUR{channel}:DATA:ARB {name},{values}"
    select: tuple[str, ...] = (
        "SOUR{channel}:FUNC:ARB {name}",
        "SOUR{channel}:FUNC ARB",
        "SOUR{channel}:FUNC:ARB:FILT OFF",
        "SOUR{channel}:FUNC:ARB:SRAT {rate_Hz:.12g}",
        "SOUR{channel}:VOLT {peak_to_peak_V:.6g}",
        "SOUR{channel}:VOLT:OFFS 0",
    )
    once: tuple[str, ...] = ("SOUR{channel}:BURS:STAT ON",)
    repeat: tuple[str, ...] = ("SOUR{channel}:BURS:STAT OFF",)
    fire: str = "*TRG"
    output_on: str = "OUTP{channel} ON"
    output_off: str = "OUTP{channel} OFF"
    error: str = "SYST:ERR?"


@dataclass(frozen=True)
class OscilloscopeCommands:
    """Commands of an oscilloscope, by default those of Keysight's InfiniiVision series.

    Values: ``{span_s}``, time across the screen; ``{trigger}``, source of the trigger, and ``{level_V}``, its level;
    ``{averages}``, number of triggers that are averaged; ``{input}``, number of an input, with its ``{range_V}``,
    ``{offset_V}`` and ``{probe}``; ``{inputs}``, numbers of all inputs that are recorded.

    Attributes
    ----------
    set_up : tuple of str
        Time base, with the trigger at most a tenth of the screen from its left edge, and trigger.
    single, average : tuple of str
        Record one trigger; average several.
    input_set_up : tuple of str
        Set up an input; its range is from the bottom to the top of the screen.
    arm : str
        Begins a recording, which waits for the trigger.
    input_name, input_separator : str
        How `arm` names its ``{inputs}``.
    finished, finished_answer : str
        A question, and the answer to it once the recording is complete; it is repeated until then, and may itself
        wait for the end of the recording.
    read : tuple of str
        Choose the input that is read, as unsigned 16-bit numbers.
    scaling : str
        Asks for format, type, number of points, averages, then increment, origin and reference of time and of voltage,
        with commas between them. A sample is ``(number − reference) · increment + origin``.
    samples : str
        Asks for the samples, a block of binary data with a header as in IEEE 488.2.
    big_endian : bool
        Whether the upper byte of a sample comes first.
    lowest, highest : int
        Numbers up to the lowest and from the highest on stand for clipped or missing samples.
    error : str
        As in `GeneratorCommands`.
    """

    set_up: tuple[str, ...] = (
        ":TIM:MODE MAIN",
        ":TIM:REF LEFT",
        ":TIM:RANG {span_s:.6g}",
        ":TIM:POS 0",
        ":TRIG:MODE EDGE",
        ":TRIG:SWE NORM",
        ":TRIG:EDGE:SOUR {trigger}",
        ":TRIG:EDGE:SLOP POS",
        ":TRIG:EDGE:LEV {level_V:.6g}",
    )
    single: tuple[str, ...] = (":ACQ:TYPE NORM",)
    average: tuple[str, ...] = (":ACQ:TYPE AVER", ":ACQ:COUN {averages}")
    input_set_up: tuple[str, ...] = (
        ":CHAN{input}:DISP ON",
        ":CHAN{input}:COUP DC",
        ":CHAN{input}:PROB {probe:.6g}",
        ":CHAN{input}:RANG {range_V:.6g}",
        ":CHAN{input}:OFFS {offset_V:.6g}",
    )
    arm: str = ":DIG {inputs}"
    input_name: str = "CHAN{input}"
    input_separator: str = ","
    finished: str = "*OPC?"
    finished_answer: str = "1"
    read: tuple[str, ...] = (
        ":WAV:SOUR CHAN{input}",
        ":WAV:FORM WORD",
        ":WAV:BYT MSBF",
        ":WAV:UNS ON",
        ":WAV:POIN:MODE MAX",
        ":WAV:POIN MAX",
    )
    scaling: str = ":WAV:PRE?"
    samples: str = ":WAV:DATA?"
    big_endian: bool = True
    lowest: int = 0x0100
    highest: int = 0xFF00
    error: str = "SYST:ERR?"
