"""Options shared by several commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

PrintheadFile = Annotated[
    Path | None,
    typer.Option("--printhead", help="printhead.json from identify or diagnose; the published head unless given"),
]
WithRemainder = Annotated[
    bool,
    typer.Option(
        "--remainder/--no-remainder", help="whether to use the unexplained remainder that the printhead file may have"
    ),
]
OwnEffects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="MODULE:CLASS",
        help="an effect of your own, such as my_effects:QuadraticStiffness for a class in my_effects.py in the current "
        "folder, or the name of an effect that an installed package offers; its code is run; may be repeated",
    ),
]
CostA = Annotated[float | None, typer.Option("--cost-a", help="weight of the effective peak (-5)")]
CostB = Annotated[float | None, typer.Option("--cost-b", help="weight of the peak after it (5)")]
Effective = Annotated[
    str | None, typer.Option(help='which peak ejects: "largest", "first" or a threshold in volts (largest)')
]
TargetHeight = Annotated[
    float | None,
    typer.Option(help="height of the effective peak in volts that the drop needs: it counts no further (none)"),
]
DropFrequency = Annotated[
    float | None,
    typer.Option(help="drops per second: each starts in the ringing of those before it (0: drops are far apart)"),
]
Window = Annotated[
    float | None,
    typer.Option(
        help="end of the window in which peaks count, in seconds after the start, or inf (350e-6); a sampled drive "
        "counts at least to its end"
    ),
]
InitialState = Annotated[
    str | None,
    typer.Option(help="initial state of the hysteresis: periodic (the waveform repeats) or demagnetised (periodic)"),
]
Limits = Annotated[
    str | None,
    typer.Option(
        help="what the driver can do, as lowest_V=0,highest_V=48,rise_V_per_us=20,fall_V_per_us=20,step_us=0.1,"
        "shortest_us=1,longest_us=50,bits=12 (any of them)"
    ),
]
JsonFile = Annotated[Path | None, typer.Option("--json", help='write the result as JSON; "-" is standard output')]
PlotFile = Annotated[Path | None, typer.Option("--plot", help="plot of drive and response: .png, .svg or .pdf")]
