"""The cells of the page on other libraries run wherever the library is installed."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "clients.md"
CELL = re.compile(r"^```\{code-cell\} ipython3\n(?P<code>.*?)^```$", re.DOTALL | re.MULTILINE)
CELLS = [match["code"] for match in CELL.finditer(PAGE.read_text(encoding="utf-8")) if ":tags:" not in match["code"]]


def needed(cell):
    """Packages that the cell's first line asks for, and the cell without it."""
    first, _, rest = cell.partition("\n")
    return (first.split()[1:], rest) if first.startswith("%%if_installed") else ([], cell)


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: " ".join(needed(cell)[0]) or "always")
def test_a_cell_of_the_page_runs_by_itself(cell, tmp_path):
    packages, code = needed(cell)
    for package in packages:
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"{package} is not installed")
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr[-3000:]


def test_every_library_has_a_cell():
    asked = {package for cell in CELLS for package in needed(cell)[0]}
    assert asked == {"sb3_contrib", "moviepy", "torchrl", "skrl", "ray", "tianshou"}
