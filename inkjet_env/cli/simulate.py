"""``inkjet simulate``: the printhead's response to one waveform or to any sampled drive."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from inkjet_env.cli.arguments import check_outputs, chosen_cost, chosen_limits, drop_period_s, warn_of_limits
from inkjet_env.cli.campaign_reading import Interval, warn
from inkjet_env.cli.options import (
    CostA,
    CostB,
    DropFrequency,
    Effective,
    InitialState,
    JsonFile,
    Limits,
    OwnEffects,
    PlotFile,
    PrintheadFile,
    TargetHeight,
    Window,
    WithRemainder,
)

if TYPE_CHECKING:
    from inkjet_env.typing import Real

DRAWN_A_PERIOD = 50
"""Fewest samples in a period of the resonance from which a response is drawn."""


def simulate(
    waveform: Annotated[
        tuple[float, float, float, float, float, float, float] | None,
        typer.Option(help="U1 U2 t1 t2 t3 t4 t5: two voltages and five durations", metavar="U1 U2 t1 t2 t3 t4 t5"),
    ] = None,
    drive: Annotated[
        Path | None,
        typer.Option(help="file of times and drive, or a print controller's segments, in place of --waveform"),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="with --drive: write time_s, drive_V, sensor_V as CSV")] = None,
    plot: PlotFile = None,
    json: JsonFile = None,
    printhead: PrintheadFile = None,
    remainder: WithRemainder = True,
    effect: OwnEffects = None,
    cost_a: CostA = None,
    cost_b: CostB = None,
    effective: Effective = None,
    target_height: TargetHeight = None,
    drop_frequency: DropFrequency = None,
    window: Window = None,
    initial_state: InitialState = None,
    interval: Interval = None,
    limits: Limits = None,
    implausible: Annotated[bool, typer.Option("--implausible", help="a drive beyond 1 kV is meant")] = False,
    hysteresis: Annotated[
        str,
        typer.Option(
            help="hysteresis model: full_memory, one_point (the paper's formula) or, with --waveform, play_operators"
        ),
    ] = "full_memory",
) -> None:
    """Simulate the printhead's response to one waveform or to any sampled drive: peaks, cost, settling.

    \b
    inkjet simulate \\
        --waveform 100 -100 1e-6 10.49e-6 13.74e-6 9.81e-6 19.96e-6 \\
        --plot response.png

    \b
    inkjet simulate \\
        --waveform 100 -100 1e-6 10.49e-6 13.74e-6 9.81e-6 19.96e-6 \\
        --drop-frequency 15e3

    \b
    inkjet simulate --drive waveform.csv --out response.csv

    \b
    inkjet simulate --drive waveform.csv --drop-frequency 15e3

    \b
    inkjet simulate --drive waveform.csv --printhead corrected.json \\
        --effect my_effects:QuadraticStiffness
    """
    from inkjet_env.cli.drive_csv import write_columns
    from inkjet_env.cli.own_effects import register_own
    from inkjet_env.jetting.figures_of_merit import figures_json, jetting
    from inkjet_env.plant.augmented import AugmentedPrinthead
    from inkjet_env.plant.printhead_file import chosen_head, remainder_sentence
    from inkjet_env.printhead import SampledResponse, Waveform, respond_sampled
    from inkjet_env.printhead.sampled import shortest_period_s
    from inkjet_env.printhead.window import DEFAULT_WINDOW_S
    from inkjet_env.recordings.drive import read_drive
    from inkjet_env.storage import write_json

    check_outputs((drive, printhead), out=out, plot=plot, json=json)
    if waveform is not None and drive is not None:
        raise ValueError("give --waveform or --drive, not both.")
    driver = chosen_limits(limits)
    register_own(effect)
    head, cost = chosen_head(printhead, remainder), chosen_cost((cost_a, cost_b, effective, target_height))
    state, window_s = initial_state or "periodic", DEFAULT_WINDOW_S if window is None else window
    response: Any  # of a head with or without effects, to a waveform or to samples
    alone: Any
    drawn: Any
    if waveform is not None:
        if out is not None:
            raise ValueError("--out needs --drive. To sample a waveform's response, give the waveform as a CSV file.")
        fired = Waveform.from_array(waveform)
        warn_of_limits(driver, "the waveform", *fired.knots())
        response = alone = drawn = head.respond(fired, state, window_s, hysteresis)
        if drop_frequency:
            period_s = drop_period_s(drop_frequency, fired.knots()[0][-1])
            response = drawn = head.respond(fired, state, window_s, hysteresis, period_s)
    elif drive is not None:
        read = read_drive(drive, interval, implausible)
        warn(read.notes)
        samples = read.time_s, read.drive_V
        warn_of_limits(driver, drive, *samples)
        shortest_s = shortest_period_s(*samples)
        period_s = drop_period_s(drop_frequency, shortest_s, str(drive)) if drop_frequency else math.inf

        def answered(period_s: float, time_s: Real, drive_V: Real) -> SampledResponse:
            try:
                if isinstance(head, AugmentedPrinthead):
                    return head.respond_sampled(time_s, drive_V, state, hysteresis, window_s, period_s)
                return respond_sampled(head, time_s, drive_V, state, hysteresis, window_s=window_s, period_s=period_s)
            except ValueError as error:
                raise ValueError(f"{drive}: {error}") from None

        alone = answered(math.inf, *samples)
        response = drawn = answered(period_s, *samples) if drop_frequency else alone
        if plot is not None and (fine := _drawn_samples(*samples, head.frequency_Hz, window_s, period_s)) is not None:
            drawn = answered(period_s, *fine)
    else:
        raise ValueError("give --waveform U1 U2 t1 t2 t3 t4 t5 or --drive FILE.csv.")
    largest_V = max(abs(v) for v in waveform[:2]) if waveform is not None else float(abs(response.drive_V).max())
    if (said := remainder_sentence(head, ("self_sensing",), largest_V)) is not None:
        print(said, file=sys.stderr)
    found = {
        "format": "simulation/1",
        "peaks_V": [float(v) for v in response.peaks_V],
        "peak_times_s": [float(t) for t in response.peak_times_s],
        "effective_peak": cost.effective_index(response.peaks_V),
        "cost": response.cost(cost),
    } | figures_json(jetting(alone, cost))
    if plot is not None:
        from inkjet_env.reporting.plotting import write_picture
        from inkjet_env.reporting.waveform_figures import draw_response

        write_picture(plot, draw_response(drawn, cost))
    if out is not None:
        write_columns(out, {name: getattr(response, name) for name in ("time_s", "drive_V", "sensor_V")})
    if json is not None:
        write_json(json, found)
    if str(json) != "-":
        from inkjet_env.cli.printing import print_figures, print_peaks

        print_peaks(found)
        print_figures(jetting(alone, cost))


def _drawn_samples(
    time_s: Real, drive_V: Real, frequency_Hz: float, window_s: float, period_s: float
) -> tuple[Real, Real] | None:
    """More samples of the same drive, so that its response can be drawn up to the last peak; None if they are enough.

    A file of corners has few, and the response between them is no straight line. Nothing else changes: it is exact for
    a drive that is linear between samples, and a single drop's last voltage is held until the window ends.
    """
    import numpy as np

    step_s, end_s = 1 / (DRAWN_A_PERIOD * frequency_Hz), float(time_s[-1])
    if math.isinf(period_s) and not math.isinf(window_s):
        end_s = max(end_s, float(time_s[0]) + window_s)
    if end_s == time_s[-1] and float(np.median(np.diff(time_s))) <= 1.001 * step_s:
        return None
    merged_s = np.union1d(time_s, np.append(np.arange(time_s[0], end_s, step_s), end_s))
    merged_s = merged_s[np.append(True, np.diff(merged_s) > 1e-6 * step_s)]
    return merged_s, np.interp(merged_s, time_s, drive_V)
