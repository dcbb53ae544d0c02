"""Figures of a tuning session: its waveforms, the drives that were asked for, and the checks on the head."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from inkjet_env.experiments.tuning.check import Measured
from inkjet_env.experiments.tuning.session import Tuned, TuneSettings
from inkjet_env.identification import ModelledRecording
from inkjet_env.plant.wording import CHANNEL_WORDS
from inkjet_env.recordings import Recording
from inkjet_env.reporting.diagnosis_figures import view_figure, view_picture
from inkjet_env.reporting.formatting import number, unit_text
from inkjet_env.reporting.plotting import AFTER, COLOURS, draw_line, new_figure, time_scale
from inkjet_env.reporting.zoomable import Picture
from inkjet_env.rig import Request
from inkjet_env.typing import Real

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 3.9
"""Width of a drive's figure in inches: three fit side by side on a desktop."""
TITLES = {"robust": "robust", "fit": "corrected head", "base": "base model", "refined": "after a check"}
"""Short titles of the proposals."""


def waveforms_figure(tuned: Tuned, settings: TuneSettings) -> Figure:
    """Drives (left) and predicted responses to a single drop (right), the others' over the chosen waveform's."""
    figure, (drive, response) = new_figure(10.4, 3.6, ncols=2, width_ratios=[2, 3])
    last_s = max(one.as_waveform.duration_s for one in tuned.proposals)
    time_s = np.linspace(0.0, settings.window_s, 2001)
    for k, one in enumerate(tuned.proposals):
        chosen = k == tuned.best
        label = f"{'chosen: ' if chosen else ''}{TITLES[one.name]}, {number(tuned.checks[k].cost_V)} V on the head"
        style: Any = {
            "color": COLOURS[k % len(COLOURS)],
            "lw": 2.2 if chosen else 1.0,
            "zorder": 2 if chosen else 3,
            "label": label,
        }
        knots_s, knots_V = one.as_waveform.knots()
        drive.plot(1e6 * np.append(knots_s, 1.05 * last_s), np.append(knots_V, 0.0), **style)
        predicted = tuned.head.respond(one.as_waveform, window_s=settings.window_s)
        response.plot(1e6 * time_s, predicted.sensor_V(time_s), **style)
    drive.set_ylabel("drive (V)")
    response.set_ylabel("predicted response (V)")
    for panel in (drive, response):
        panel.set_xlabel("time (µs)")
    handles, labels = drive.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 3), frameon=False)
    return figure


def request_figure(request: Request, recordings: Sequence[Recording] = ()) -> Figure:
    """The drive that was asked for, and below it what came back, each recording a line."""
    rows = 2 if recordings else 1
    figure, axes = new_figure(WIDTH, 0.5 + 1.2 * rows, nrows=rows, sharex=True, squeeze=False)
    seconds, unit = time_scale(float(request.time_s[-1]))
    draw_line(axes[0, 0], request.time_s / seconds, request.drive_V, color=AFTER, lw=1.1)
    axes[0, 0].set_ylabel("drive (V)")
    for recording, colour in zip(recordings, COLOURS[1:] * len(recordings), strict=False):
        time_s = recording.time_s - recording.time_s[0]
        draw_line(axes[1, 0], time_s / seconds, recording.sensor, color=colour, lw=0.8)
        axes[1, 0].set_ylabel(f"{CHANNEL_WORDS[recording.channel]} ({unit_text(recording.unit)})")
    axes[-1, 0].set_xlabel(f"time ({unit})")
    figure.align_ylabels()
    return figure


def check_figure(recording: Recording, predicted_V: Real, check: Measured, window_s: float) -> Figure:
    """Recorded check without its offset, the prediction, and their difference, within the window of the peaks.

    Parameters
    ----------
    recording : Recording
        The check, of n samples.
    predicted_V : ndarray, shape (n,)
        Predicted signal, in volts.
    check : Measured
        What was made of it.
    window_s : float
        Time after the start within which peaks count, in seconds.
    """
    drawn = _drawn(recording, {"augmented": predicted_V}, check)
    return view_figure(drawn, drawn.modelled, slice(0, int(window_s / recording.step_s) + 1))


def check_picture(recording: Recording, predicted_V: Mapping[str, Real], check: Measured, window_s: float) -> Picture:
    """A recorded check without its offset beside what each head predicts, to zoom.

    Parameters
    ----------
    recording : Recording
        The check, of n samples.
    predicted_V : mapping of str to ndarray, shape (n,)
        Predicted signals in volts, by "base" and "augmented"; the last is the head that predicted.
    check : Measured
        What was made of the check.
    window_s : float
        Time after the start that is seen first, in seconds.
    """
    drawn = _drawn(recording, predicted_V, check)
    return view_picture("check", drawn, drawn.modelled, slice(0, int(window_s / recording.step_s) + 1))


def _drawn(recording: Recording, predicted_V: Mapping[str, Real], check: Measured) -> ModelledRecording:
    """A check as a recording with models: without the offset that is left beside the last of them."""
    seen_V = recording.sensor - np.median(recording.sensor - list(predicted_V.values())[-1])
    return ModelledRecording(
        recording.name, recording.channel, recording.unit, recording.order, recording.step_s, recording.drive_V,
        seen_V, dict(predicted_V), recording.sensor.size, check.noise_V,
    )  # fmt: skip
