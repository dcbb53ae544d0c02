"""A drive as the files and the command line that give the same elsewhere."""

from __future__ import annotations

import io
import math
import shlex
from pathlib import Path
from typing import Any

from inkjet_env.cli.drive_csv import columns_text, sampled_waveform
from inkjet_env.experiments.explore.curves import Conditions, Head, curves
from inkjet_env.experiments.explore.drives import Corners, Drive
from inkjet_env.experiments.explore.heads import NamedHead
from inkjet_env.jetting.figures_of_merit import figures_json
from inkjet_env.printhead import PeakCost
from inkjet_env.recordings.segment_file import segments_text
from inkjet_env.storage import json_text

SAMPLE_RATE_HZ = 100e6


def csv_text(drive: Drive) -> str:
    """The drive as ``time_s, drive_V``: a waveform sampled for a generator, segments by their corners."""
    if isinstance(drive, Corners):
        time_s, drive_V = drive.knots()
    else:
        time_s, drive_V = sampled_waveform(drive, SAMPLE_RATE_HZ)
    return columns_text({"time_s": time_s, "drive_V": drive_V})


def ini_text(drive: Drive) -> str:
    """The drive as segments of a print controller; ``ValueError`` if it jumps."""
    return segments_text(*drive.knots())


def simulation_text(head: Head, drive: Drive, conditions: Conditions) -> str:
    """JSON of what ``inkjet simulate --json`` tells, and the waveform that ``inkjet scan --optimum`` reads."""
    found = curves(head, drive, conditions)
    told: dict[str, Any] = {
        "format": "simulation/1",
        "peaks_V": found.peaks_V.tolist(),
        "peak_times_s": found.peak_times_s.tolist(),
        "effective_peak": found.effective,
        "cost": found.terms.total,
    } | figures_json(found.figures)
    if not isinstance(drive, Corners):
        told["waveform"] = drive.to_array().tolist()
    return json_text(told)


def picture(head: Head, drive: Drive, conditions: Conditions) -> bytes:
    """PNG of drive and response with its peaks."""
    from inkjet_env.printhead import SampledResponse
    from inkjet_env.reporting.waveform_figures import draw_response

    found = curves(head, drive, conditions)
    shown = SampledResponse(found.time_s, found.drive_V, found.sensor_V, found.peak_times_s, found.peaks_V)
    buffer = io.BytesIO()
    draw_response(shown, conditions.cost).savefig(buffer, format="png", dpi=160)
    return buffer.getvalue()


def cost_options(cost: PeakCost) -> list[str]:
    """Options of a cost, where they are not the command's own."""
    plain, options = PeakCost(), []
    if cost.A != plain.A:
        options += ["--cost-a", f"{cost.A!r}"]
    if cost.B != plain.B:
        options += ["--cost-b", f"{cost.B!r}"]
    if cost.effective != plain.effective:
        options += ["--effective", f"{cost.effective}"]
    if not math.isinf(cost.target_height_V):
        options += ["--target-height", f"{cost.target_height_V!r}"]
    return options


def head_options(head: NamedHead) -> list[str]:
    """The option that names a head's file; none for the published head."""
    return [] if head.path is None else ["--printhead", str(head.path)]


def command_text(head: NamedHead, drive: Drive, conditions: Conditions, drive_file: Path = Path("drive.csv")) -> str:
    """The command line that gives the same peaks and cost; of segments, after their export as ``drive_file``."""
    command = ["inkjet", "simulate"]
    if isinstance(drive, Corners):
        command += ["--drive", str(drive_file)]
    else:
        command += ["--waveform", *(f"{float(v)!r}" for v in drive.to_array())]
    command += [*head_options(head), *cost_options(conditions.cost)]
    if conditions.drop_frequency_Hz:
        command += ["--drop-frequency", f"{conditions.drop_frequency_Hz!r}"]
    if conditions.window_s != Conditions().window_s:
        command += ["--window", f"{conditions.window_s!r}"]
    return shlex.join(command)
