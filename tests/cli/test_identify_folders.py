"""Several campaigns that are identified in parallel."""

import signal
import subprocess
import sys
import time

import pytest

from inkjet_env.printhead import Printhead
from inkjet_env.recordings import write_campaign
from inkjet_env.rig import record_campaign


@pytest.mark.parametrize("ended_by", [signal.SIGKILL, signal.SIGTERM])
def test_processes_end_with_the_command(ended_by, tmp_path):
    campaign = record_campaign(Printhead.published(), seed=1)
    names = [f"c{k}" for k in range(6)]
    for name in names:
        write_campaign(tmp_path / name, campaign)
    command = [sys.executable, "-m", "inkjet_env.experiments.cli", "identify", *names, "--out", "heads"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        end_s = time.monotonic() + 120
        while not list(tmp_path.glob("heads/*.json")):
            assert process.poll() is None
            assert time.monotonic() < end_s
            time.sleep(0.05)
        process.send_signal(ended_by)
        process.communicate(timeout=60)  # returns once no process holds the output any more
    assert len(list(tmp_path.glob("heads/*.json"))) < len(names)
