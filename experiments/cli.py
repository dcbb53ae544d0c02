"""The complete command ``inkjet``: the printhead's commands plus optimize, bench and prove."""

from __future__ import annotations

from experiments.commands.bench import bench
from experiments.commands.optimize import optimize
from experiments.commands.prove import prove
from inkjet_env.cli.app import app, main

for command in (optimize, bench, prove):
    app.command()(command)

if __name__ == "__main__":
    main()
