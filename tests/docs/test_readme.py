"""README: short enough to read, and its examples print what it shows."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

README = Path(__file__).parents[2] / "README.md"
TEXT = README.read_text(encoding="utf-8")
PYTHON = re.findall(r"^```python\n(.*?)^```\n\s*```text\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
CONSOLE = re.findall(r"^```console\n\$ (.*?)\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)


def printed(command, folder):
    """Standard output of a shell command in an empty folder, this environment's programs found first."""
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    plain = os.environ | {"PATH": path, "NO_COLOR": "1", "TERM": "dumb", "COLUMNS": "100"}
    run = subprocess.run(["bash", "-ec", command], cwd=folder, env=plain, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_it_is_at_most_150_lines_long():
    assert len(TEXT.splitlines()) <= 150


def test_it_has_three_examples_and_every_python_one_shows_its_output():
    assert len(PYTHON) + len(CONSOLE) == 3
    assert len(PYTHON) == TEXT.count("```python")


@pytest.mark.parametrize(("code", "shown"), PYTHON, ids=[f"example {n}" for n in range(1, len(PYTHON) + 1)])
def test_python_examples_print_what_is_shown(code, shown, tmp_path):
    (tmp_path / "example.py").write_text(code, encoding="utf-8")
    assert printed("python example.py", tmp_path) == shown


@pytest.mark.parametrize(("command", "shown"), CONSOLE, ids=[command.split()[1] for command, _ in CONSOLE])
def test_commands_print_what_is_shown(command, shown, tmp_path):
    assert printed(command, tmp_path) == shown
