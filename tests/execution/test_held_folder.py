"""One process at a time works in a results folder."""

import subprocess
import sys

import pytest

from inkjet_env.experiments.execution.held_folder import held

TRY = """
import sys
from pathlib import Path
from inkjet_env.experiments.execution.held_folder import held
try:
    with held(Path(sys.argv[1]), "bench"):
        print("held")
except ValueError as error:
    print(error)
"""


def tried_elsewhere(folder):
    """What another process is told that tries to hold the folder."""
    done = subprocess.run([sys.executable, "-c", TRY, folder], capture_output=True, text=True, check=True, timeout=60)
    return done.stdout.strip()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot lock a folder")
def test_a_folder_is_held_until_the_block_ends_and_nothing_is_left_in_it(tmp_path):
    folder = tmp_path / "new" / "results"
    with held(folder, "bench"):
        assert "another bench is working in this folder" in tried_elsewhere(folder)
    assert tried_elsewhere(folder) == "held"
    assert not list(folder.iterdir())
