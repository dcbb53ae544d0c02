"""The complete command ``inkjet``: the printhead's commands plus optimize, tune, explore, bench and prove."""

from __future__ import annotations

from inkjet_env.cli.app import app, main
from inkjet_env.experiments.commands.bench import bench
from inkjet_env.experiments.commands.optimize import optimize
from inkjet_env.experiments.commands.prove import prove
from inkjet_env.experiments.commands.tune import tune
from inkjet_env.experiments.explore.command import explore

for command, summary in (
    (optimize, "Search for the waveform with the lowest cost."),
    (tune, "Diagnose a head, ask for recordings, optimise, and check waveforms on it."),
    (explore, "Drag waveforms and see what the head does, in the browser."),
    (bench, "Compare the optimisers on the problem suite."),
    (prove, "Prove the diagnosis on concealed effects, blind."),
):
    app.command(short_help=summary)(command)

if __name__ == "__main__":
    main()
