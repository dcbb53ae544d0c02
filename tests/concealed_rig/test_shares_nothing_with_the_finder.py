"""Whoever conceals and whoever finds share no equation: only NumPy, SciPy, Numba and the standard library."""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "experiments" / "concealed_rig"
FILES = sorted(PACKAGE.rglob("*.py")) + sorted(Path(__file__).parent.glob("*.py"))
# One test reads what was written with the project's own reader.
READERS = {"test_campaign_is_valid.py": {"inkjet_env.recordings"}}


def imported_modules(file: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative imports hide where they lead"
            names.add(str(node.module))
        elif isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in (
            "__import__",
            "import_module",
        ):
            names.add("a module by its name at run time")
    return names


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.name)
def test_nothing_is_imported_but_numpy_scipy_numba_and_the_standard_library(file):
    allowed = {"numpy", "scipy", "numba", *sys.stdlib_module_names}
    if PACKAGE not in file.parents:
        allowed |= {"pytest"}
    for name in imported_modules(file) - READERS.get(file.name, set()):
        own = name == "experiments.concealed_rig" or name.startswith("experiments.concealed_rig.")
        assert own or name.split(".")[0] in allowed, f"{file.name} imports {name}"


def test_no_module_of_the_finder_is_loaded():
    import subprocess

    code = "import sys, experiments.concealed_rig; print([m for m in sys.modules if m.startswith('inkjet_env')])"
    loaded = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert loaded.strip() == "[]"
