"""The house's arrows: which package may import which, and no circle of files anywhere."""

import ast
import functools

import pytest

from tests.modules import MODULES

GROUND = (
    *("inkjet_env.storage", "inkjet_env.naming", "inkjet_env.typing", "inkjet_env.estimate"),
    *("inkjet_env.installation", "inkjet_env.plugins", "inkjet_env.extras", "inkjet_env.processes"),
)
PRINTHEAD = (*GROUND, "inkjet_env.printhead")
PLANT = (*PRINTHEAD, "inkjet_env.plant")
RECORDINGS = (*PRINTHEAD, "inkjet_env.recordings")
IDENTIFICATION = (*PLANT, *RECORDINGS, "inkjet_env.identification")
FITTING = (*IDENTIFICATION, "inkjet_env.mismatch.settings", "inkjet_env.mismatch.fitting")
SELECTION = (*FITTING, "inkjet_env.mismatch.selection")
DESIGN = (*FITTING, "inkjet_env.mismatch.localization", "inkjet_env.mismatch.design")
MISMATCH = (*SELECTION, *DESIGN, "inkjet_env.mismatch")
JETTING = (*PLANT, "inkjet_env.jetting")
REPORTING = (*MISMATCH, *JETTING, "inkjet_env.reporting")
CLI = (
    *REPORTING,
    "inkjet_env.interruption",
    "inkjet_env.progress",
    "inkjet_env.rig",
    "inkjet_env.cli",
    "inkjet_env",
)
OPTIMIZERS = (*GROUND, "inkjet_env.optimizers")
EXECUTION = (*CLI, *OPTIMIZERS, "inkjet_env.envs", "inkjet_env.experiments.execution")
VALIDATION = (
    *EXECUTION,
    "inkjet_env",
    "inkjet_env.torch",
    "inkjet_env.experiments.validation",
    "inkjet_env.experiments.validation.baselines",
)
BENCHMARK = (*EXECUTION, "inkjet_env.experiments.benchmark", "inkjet_env.experiments.benchmark.data")
TUNING = (*BENCHMARK, "inkjet_env.experiments.tuning")
LEARNING = (*TUNING, "inkjet_env.experiments.learning")
PROOF = (*TUNING, *VALIDATION, "inkjet_env.experiments.concealed_plant", "inkjet_env.experiments.proof")
STUDIES = (*BENCHMARK, "inkjet_env.experiments.concealed_plant", "inkjet_env.experiments.benchmark.studies")
# A package, or a file that stands beside packages: itself and what else it may import.
ALLOWED = {
    "inkjet_env": (),
    "inkjet_env.storage": (),
    "inkjet_env.naming": (),
    "inkjet_env.typing": (),
    "inkjet_env.estimate": (),
    "inkjet_env.installation": (),
    "inkjet_env.plugins": ("inkjet_env.naming",),
    "inkjet_env.extras": (),
    "inkjet_env.processes": (),
    "inkjet_env.interruption": (),
    "inkjet_env.progress": (*PRINTHEAD, "inkjet_env.interruption"),
    "inkjet_env.testing": PLANT,
    "inkjet_env.torch": PRINTHEAD,
    "inkjet_env.jax": PRINTHEAD,
    "inkjet_env.printhead": GROUND,
    "inkjet_env.plant": PRINTHEAD,
    "inkjet_env.jetting": PLANT,
    "inkjet_env.recordings": PRINTHEAD,
    "inkjet_env.rig": (*PLANT, *RECORDINGS),
    "inkjet_env.rig.visa": (*RECORDINGS, "inkjet_env.rig"),
    "inkjet_env.identification": IDENTIFICATION,
    "inkjet_env.envs": PLANT,
    "inkjet_env.mismatch.settings": (),
    "inkjet_env.mismatch.fitting": FITTING,
    "inkjet_env.mismatch.selection": SELECTION,
    "inkjet_env.mismatch.localization": (*FITTING, "inkjet_env.mismatch.localization"),
    "inkjet_env.mismatch.design": DESIGN,
    "inkjet_env.mismatch": MISMATCH,
    "inkjet_env.reporting": REPORTING,
    "inkjet_env.cli": CLI,
    "inkjet_env.optimizers": OPTIMIZERS,
    "inkjet_env.experiments": (),
    "inkjet_env.experiments.concealed_plant": ("inkjet_env.experiments.concealed_rig",),
    "inkjet_env.experiments.concealed_rig": (),
    "inkjet_env.experiments.execution": EXECUTION,
    "inkjet_env.experiments.validation": VALIDATION,
    "inkjet_env.experiments.validation.baselines": VALIDATION,
    "inkjet_env.experiments.robustness": (*BENCHMARK, "inkjet_env.experiments.robustness"),
    "inkjet_env.experiments.benchmark.data": (),
    "inkjet_env.experiments.benchmark": BENCHMARK,
    "inkjet_env.experiments.benchmark.interfaces": (*BENCHMARK, "inkjet_env.experiments.benchmark.interfaces"),
    "inkjet_env.experiments.benchmark.studies": STUDIES,
    "inkjet_env.experiments.bounds": (*BENCHMARK, "inkjet_env.experiments.bounds"),
    "inkjet_env.experiments.bounds.verification": (
        "inkjet_env.experiments.bounds.verification",
        "inkjet_env.progress",
        "inkjet_env.storage",
    ),
    "inkjet_env.experiments.learning": LEARNING,
    "inkjet_env.experiments.tuning": TUNING,
    "inkjet_env.experiments.proof": PROOF,
    "inkjet_env.experiments.publish": (
        *PROOF,
        *LEARNING,
        *STUDIES,
        *TUNING,
        "inkjet_env.experiments.bounds",
        "inkjet_env.experiments.publish",
    ),
    "inkjet_env.experiments.commands": (
        *PROOF,
        *TUNING,
        "inkjet_env.experiments.benchmark.interfaces",
        "inkjet_env.experiments.commands",
    ),
    "inkjet_env.experiments.entry": ("inkjet_env.experiments.cli", *GROUND),
    "inkjet_env.experiments.explore": (
        *BENCHMARK,
        "inkjet_env.experiments.commands",
        "inkjet_env.experiments.explore",
    ),
    "inkjet_env.experiments.explore.studies": (
        *BENCHMARK,
        "inkjet_env.experiments.explore",
        "inkjet_env.experiments.explore.studies",
    ),
    "inkjet_env.experiments.cli": (
        "inkjet_env.experiments.commands",
        "inkjet_env.experiments.explore",
        "inkjet_env.cli",
    ),
}
WHOLE = {"inkjet_env.plant": "its effects are of it", "inkjet_env.experiments.concealed_rig": "its effects are of it"}
"""Packages whose folders are one room."""


def room_of(module):
    """The package, or file beside packages, that a module belongs to."""
    for package in WHOLE:
        if module == package or module.startswith(f"{package}."):
            return package
    package = module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]
    return module if module in ALLOWED else package


def imported(file):
    """Modules of ours that a file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative imports hide the arrow"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    names = {f"inkjet_env.{name}" if name.startswith("experiments.") else name for name in names}  # the frozen plant
    found = set()
    for name in names:
        while name and name not in MODULES:
            name = name.rpartition(".")[0]
        found |= {name} - {""}
    return found


@functools.cache
def graph():
    """The modules that each of ours imports."""
    return {name: imported(file) - {name} for name, file in MODULES.items()}


@pytest.mark.parametrize("room", ALLOWED)
def test_imports_point_one_way(room):
    mine = [name for name in MODULES if room_of(name) == room]
    assert mine
    wrong = {
        f"{name} imports {other}"
        for name in mine
        for other in graph()[name]
        if room_of(other) not in (room, *ALLOWED[room])
    }
    assert wrong == set()


def test_every_package_has_its_arrows_here():
    assert {room_of(name) for name in MODULES} == set(ALLOWED)


def test_no_package_stands_above_another_that_stands_above_it():
    modules = {room: [name for name in MODULES if room_of(name) == room] for room in ALLOWED}
    arrows = {room: {room_of(o) for name in modules[room] for o in graph()[name]} - {room} for room in ALLOWED}
    assert circles(arrows) == []


def test_no_files_import_each_other_in_a_circle():
    assert circles(graph()) == []


def test_a_circle_would_be_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [["b", "c"]]


def circles(graph):
    """Strongly connected components of more than one node (Tarjan 1972)."""
    number, lowest, stack, found = {}, {}, [], []

    def visit(node):
        number[node] = lowest[node] = len(number)
        stack.append(node)
        for other in sorted(graph[node]):
            if other not in number:
                visit(other)
                lowest[node] = min(lowest[node], lowest[other])
            elif other in stack:
                lowest[node] = min(lowest[node], number[other])
        if lowest[node] == number[node]:
            cut = stack.index(node)
            if len(stack) - cut > 1:
                found.append(sorted(stack[cut:]))
            del stack[cut:]

    for node in sorted(graph):
        if node not in number:
            visit(node)
    return found


def test_nothing_of_tests_is_imported():
    for file in MODULES.values():
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            module = node.module if isinstance(node, ast.ImportFrom) else None
            assert (module or "").split(".")[0] != "tests"
