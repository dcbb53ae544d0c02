"""Run in the kernel of every tutorial before its first cell."""

import os
import subprocess

from IPython import get_ipython

for _name in ("FORCE_COLOR", "CLICOLOR", "CLICOLOR_FORCE"):
    os.environ.pop(_name, None)
os.environ.update(NO_COLOR="1", TERM="dumb")


def bash(line: str, cell: str) -> None:
    """The cell magic ``%%bash``: commands of a terminal, their standard output whole; one that fails fails the cell."""
    run = subprocess.run(["bash", "-ec", cell], capture_output=True, text=True, check=False)
    print(run.stdout, end="")
    if run.returncode:
        raise RuntimeError(f"exit status {run.returncode}\n{run.stderr}")


get_ipython().register_magic_function(bash, "cell", "bash")
