"""Several campaigns that are identified in parallel."""

import shutil
import signal
import subprocess
import sys
import time

import pytest

from inkjet_env.printhead import Printhead
from inkjet_env.recordings import write_campaign
from inkjet_env.rig import record_campaign, strain_gauge_battery


@pytest.mark.parametrize("ended_by", [signal.SIGKILL, signal.SIGTERM])
def test_processes_end_with_the_command(ended_by, tmp_path):
    head, names = Printhead.published(), [f"c{k}" for k in range(4)]
    write_campaign(tmp_path / names[0], record_campaign(head, seed=1, battery=strain_gauge_battery()))  # soon done
    write_campaign(tmp_path / names[1], record_campaign(head, seed=1))
    for name in names[2:]:
        shutil.copytree(tmp_path / names[1], tmp_path / name)
    command = [
        sys.executable,
        "-m",
        "inkjet_env.experiments.cli",
        "identify",
        *names,
        "--out",
        "heads",
        "--workers",
        "2",
    ]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        end_s = time.monotonic() + 120
        while not list(tmp_path.glob("heads/*.json")):
            assert process.poll() is None
            assert time.monotonic() < end_s
            time.sleep(0.05)
        process.send_signal(ended_by)
        process.communicate(timeout=60)  # returns once no process holds the output any more
    assert len(list(tmp_path.glob("heads/*.json"))) < len(names)
