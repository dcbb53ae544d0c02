"""The house's arrows: which package may import which."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# Each may import itself and what is named after it.
ALLOWED = {
    "inkjet_env.printhead": ("inkjet_env.storage",),
    "inkjet_env.recordings": ("inkjet_env.printhead", "inkjet_env.storage"),
    "inkjet_env.plant": ("inkjet_env.printhead", "inkjet_env.storage"),
    "inkjet_env.rig": ("inkjet_env.printhead", "inkjet_env.recordings", "inkjet_env.storage"),
    "inkjet_env.identification": ("inkjet_env.printhead", "inkjet_env.plant", "inkjet_env.recordings"),
    "inkjet_env.mismatch": (
        "inkjet_env.printhead",
        "inkjet_env.plant",
        "inkjet_env.recordings",
        "inkjet_env.identification",
        "inkjet_env.storage",
    ),
    "inkjet_env.envs": ("inkjet_env.printhead", "inkjet_env.plant"),
    "optimizers": ("inkjet_env.printhead",),
    "experiments": ("inkjet_env", "optimizers"),
}


def imported_names(file: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative imports hide the arrow"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in names if name.split(".")[0] in ("inkjet_env", "optimizers", "experiments", "tests")}


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_point_one_way(package):
    files = sorted((ROOT / package.replace(".", "/")).rglob("*.py"))
    assert files
    for file in files:
        for name in imported_names(file):
            allowed = (package, *ALLOWED[package])
            assert any(name == p or name.startswith(p + ".") for p in allowed), f"{file.name} imports {name}"


def test_every_package_has_its_arrow_here():
    packages = {".".join(p.relative_to(ROOT).parts[:-1]) for p in ROOT.glob("inkjet_env/*/__init__.py")} | {
        p.parent.name for p in ROOT.glob("*/__init__.py")
    } - {"inkjet_env"}
    assert packages == set(ALLOWED)
