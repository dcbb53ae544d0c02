"""An optimiser, a problem and an effect of a package outside this project: tested, benched and optimised."""

import json
import os
import subprocess
import sys
import textwrap

import pytest

from inkjet_env.plugins import EFFECTS, OPTIMIZERS, PROBLEMS, plugin
from inkjet_env.recordings import Campaign, write_campaign
from tests.cli.test_own_effects import SOURCE as EFFECT
from tests.cli.test_own_effects import recorded

SEARCH = '''
import numpy as np

from inkjet_env.optimizers import Optimizer


class Shrinking(Optimizer):
    """Gaussian steps about the best point so far, shrinking geometrically."""

    name = "shrinking"

    def __init__(self, dimension, budget, seed, *, offspring=20, last_step=1e-3):
        super().__init__(dimension, budget, seed)
        self.offspring, self.rate = offspring, last_step ** (offspring / budget)
        self.step, self.centre, self.best = 1.0, np.zeros(dimension), np.inf

    def propose(self):
        steps = self.step * self.rng.standard_normal((self.offspring, self.dimension))
        return np.clip(self.centre + steps, -1.0, 1.0)

    def learn(self, points, costs, gradients):
        least = int(np.argmin(costs))
        if costs[least] < self.best:
            self.centre, self.best = points[least], costs[least]
        self.step *= self.rate


class Forgetful(Shrinking):
    """Draws from a generator that it does not own."""

    def propose(self):
        return np.random.default_rng().uniform(-1, 1, (7, self.dimension))


class Flat(Shrinking):
    def propose(self):
        return np.zeros(self.dimension)


class Failing(Shrinking):
    def learn(self, points, costs, gradients):
        raise RuntimeError("the pump is off")


class Unmade(Shrinking):
    def __init__(self, dimension):
        super().__init__(dimension, 1, 0)


class Idle(Optimizer):
    name = "idle"

    def propose(self):
        return np.zeros((1, self.dimension))
'''
HEADS = '''
from inkjet_env.experiments.benchmark.problem import BestKnown, Problem
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.printhead import PeakCost

published = problem("drop-6V")
tall_drop = Problem("tall", cost=PeakCost(-50.0, 5.0, target_height_V=6.0), known=published.best_known)


class Doubled(Problem):
    """A cost with code of its own."""

    def __init__(self):
        nominal = problem("nominal").best_known
        super().__init__("doubled", known=BestKnown(2 * nominal.cost, nominal.waveform, "as nominal", 1, 1))

    def evaluate(self, points):
        return 2 * super().evaluate(points)

    def evaluate_with_gradient(self, points):
        costs, gradients = super().evaluate_with_gradient(points)
        return 2 * costs, 2 * gradients


unmeasured = Problem("unmeasured", cost=PeakCost(-7.0, 5.0))
mistaken = Problem("mistaken", known=published.best_known)
'''
PROOF = """
from inkjet_env.experiments.benchmark.testing import ProblemTests
from inkjet_env.optimizers.testing import OptimizerTests
from inkjet_env.testing import EffectTests
from inkjet_lab.heads import tall_drop
from inkjet_lab.physics import QuadraticStiffness
from inkjet_lab.search import Forgetful, Shrinking


class TestShrinking(OptimizerTests):
    optimizer = Shrinking


class TestForgetful(OptimizerTests):
    optimizer = Forgetful


class TestTallDrop(ProblemTests):
    problem = tall_drop


class TestQuadraticStiffness(EffectTests):
    effect = QuadraticStiffness()
"""
POINTS = {
    OPTIMIZERS: "shrinking = inkjet_lab.search:Shrinking",
    PROBLEMS: "tall-drop = inkjet_lab.heads:tall_drop\ndoubled = inkjet_lab.heads:Doubled\nunmeasured = "
    "inkjet_lab.heads:unmeasured",
    EFFECTS: "quadratic_stiffness = inkjet_lab.physics:QuadraticStiffness",
}


@pytest.fixture
def lab(tmp_path):
    """Run Python in a user's folder, where the package inkjet-lab is installed; it returns status and output."""
    site, work = tmp_path / "site", tmp_path / "work"
    package, info = site / "inkjet_lab", site / "inkjet_lab-0.3.1.dist-info"
    for folder in (package, info, work):
        folder.mkdir(parents=True)
    for name, text in {"__init__": "", "search": SEARCH, "heads": HEADS, "physics": EFFECT}.items():
        (package / f"{name}.py").write_text(text)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: inkjet-lab\nVersion: 0.3.1\n")
    (info / "top_level.txt").write_text("inkjet_lab\n")
    (info / "entry_points.txt").write_text("".join(f"[{group}]\n{points}\n" for group, points in POINTS.items()))
    (work / "mine.py").write_text("from inkjet_lab.search import Shrinking as Mine\n")

    def run(*arguments):
        return subprocess.run(
            [sys.executable, "-P", *map(str, arguments)],
            cwd=work,
            env=os.environ | {"PYTHONPATH": str(site)},
            capture_output=True,
            text=True,
        )

    run.folder, run.package = work, package
    return run


def inkjet(lab, *arguments):
    return lab("-c", "from inkjet_env.experiments.cli import main; main()", *arguments)


TOGETHER = """
import contextlib, io, json, sys
from inkjet_env.experiments.cli import main
told = []
for arguments in json.loads(sys.argv[1]):
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            main(arguments)
        except SystemExit as end:
            told.append([end.code, said.getvalue()])
print(json.dumps(told))
"""


def inkjet_together(lab, *commands):
    """Exit status and standard error of each of several commands, one after another in one process."""
    done = lab("-c", TOGETHER, json.dumps([list(map(str, arguments)) for arguments in commands]))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_optimiser_problem_and_effect_prove_themselves_and_one_that_breaks_a_rule_does_not(lab):
    (lab.folder / "test_proof.py").write_text(PROOF)
    done = lab("-m", "pytest", "-q", "-p", "no:cacheprovider", "test_proof.py")
    failed = [line for line in done.stdout.splitlines() if line.startswith("FAILED")]
    assert failed, done.stdout + done.stderr
    assert all("TestForgetful" in line for line in failed), done.stdout
    assert any("test_the_same_seed_gives_the_same_run" in line for line in failed)


BENCH = (
    "bench",
    "--optimizers",
    "random,shrinking,mine:Mine",
    "--problems",
    "nominal,tall-drop,inkjet_lab.heads:Doubled",
)
SMALL = ("--repeats", 1, "--budget", 60, "--results", "results")


def test_a_bench_runs_them_on_two_workers_and_labels_the_runs_with_their_code(lab):
    done = inkjet(lab, *BENCH, *SMALL, "--workers", 2)
    assert done.returncode == 0, done.stderr
    assert "inkjet_lab.heads:Doubled" in done.stdout
    settings = json.loads((lab.folder / "results" / "bench.json").read_text())
    assert set(settings["plugins"]) == {
        "optimizer shrinking",
        "optimizer mine:Mine",
        "problem tall-drop",
        "problem inkjet_lab.heads:Doubled",
    }
    assert settings["plugins"]["optimizer shrinking"]["place"] == "inkjet_lab.search:Shrinking"
    assert {entry["package"] for entry in settings["plugins"].values()} == {"inkjet-lab 0.3.1"}
    assert len(list((lab.folder / "results" / "runs").iterdir())) == 9

    search = lab.package / "search.py"
    search.write_text(search.read_text().replace("1e-3", "1e-4"))
    again = inkjet(lab, *BENCH, *SMALL)
    assert again.returncode == 2
    assert "holds a bench with other settings: plugins " in again.stderr
    assert len(again.stderr.splitlines()) == 1


def test_an_optimisation_resumes_only_where_its_code_is_named(lab):
    script = """if True:
        from pathlib import Path
        from inkjet_env.experiments.benchmark.single_run import Optimisation, write_record
        from inkjet_env.experiments.benchmark.suite import problem
        plan = Optimisation(problem("doubled"), "shrinking", 60, 3)
        write_record(Path("record.npz"), plan, plan.carry_out())
    """
    made = lab("-c", script)
    assert made.returncode == 0, made.stderr
    named = ("--optimizer", "shrinking", "--problem", "doubled")
    refused, resumed, afresh = inkjet_together(
        lab,
        ("optimize", "--resume", "record.npz"),
        ("optimize", "--resume", "record.npz", *named, "--json", "found.json"),
        ("optimize", *named, "--budget", 60, "--seed", 3, "--json", "again.json"),
    )
    assert refused[0] == 2
    assert "it is of doubled, whose code is run only if you name it: add --problem doubled" in refused[1]
    assert (resumed[0], afresh[0]) == (0, 0), (resumed, afresh)
    found, again = (json.loads((lab.folder / name).read_text()) for name in ("found.json", "again.json"))
    assert found["cost"] == again["cost"]


def test_a_diagnosis_finds_an_effect_by_the_name_of_its_entry_point_and_says_whose_it_is(lab, monkeypatch):
    monkeypatch.syspath_prepend(lab.package.parent)
    from inkjet_lab.physics import QuadraticStiffness

    write_campaign(lab.folder / "campaign", Campaign("lab", tuple(recorded(QuadraticStiffness()))))
    done = inkjet(lab, "diagnose", "campaign", "--effect", "quadratic_stiffness", "--json", "found.json")
    assert done.returncode == 0, done.stderr
    found = json.loads((lab.folder / "found.json").read_text())
    assert (found["verdict"], [effect["id"] for effect in found["effects"]]) == ("named", ["quadratic_stiffness"])
    own = found["plugins"]["effect quadratic_stiffness"]
    assert (own["place"], own["package"]) == ("inkjet_lab.physics:QuadraticStiffness", "inkjet-lab 0.3.1")
    assert len(own["code"]) == 64


REFUSED = (
    (("bench", "--optimizers", "shrinkin"), "there is no optimiser 'shrinkin'. Did you mean 'shrinking'?"),
    (("bench", "--problems", "tall-dro"), "got 'tall-dro'. Did you mean 'tall-drop'?"),
    (("bench", "--problems", "unmeasured"), "problem 'unmeasured' has no best known cost on record"),
    (("bench", "--problems", "inkjet_lab.heads:mistaken"), "its best known waveform costs -22.03"),
    (("bench", "--problems", "inkjet_lab.heads:tall_dro"), "Did you mean 'tall_drop'?"),
    (
        ("optimize", "--optimizer", "inkjet_lab.search:Flat"),
        "points of 7 numbers; it asked for an array of shape (7,)",
    ),
    (("optimize", "--optimizer", "inkjet_lab.search:Unmade"), "it must be made from dimension, budget and seed ("),
    (("optimize", "--optimizer", "inkjet_lab.search:Idle"), "it must define learn, see "),
    (("bench", "--problems", "inkjet_lab.search:Shrinking"), "problem inkjet_lab.search:Shrinking: TypeError: "),
    (("bench", "--problems", "inkjet_lab.heads:PeakCost"), "it must be an inkjet_env.experiments.benchmark.prob"),
    (("optimize", "--optimizer", "inkjet_lab.heads:Doubled"), "must be a subclass of inkjet_env.optimizers.Optim"),
    (("optimize", "--optimizer", "mine:Min"), "there is no Min in "),
    (("optimize", "--optimizer", "nowhere:Mine"), "there is no module nowhere in "),
    (("optimize", "--problem", "doubled", "--cost-a", "-3"), "options cannot change it"),
    (("simulate", "--waveform", *[1] * 7, "--effect", "quadratic"), "Did you mean 'quadratic_stiffness'?"),
)
"""Commands that ask for what cannot be had, and a part of the one line that refuses it."""


def test_what_cannot_be_had_is_refused_in_one_sentence(lab):
    for (arguments, message), (status, said) in zip(
        REFUSED, inkjet_together(lab, *(arguments for arguments, _ in REFUSED)), strict=True
    ):
        assert status == 2, arguments
        (line,) = said.strip().splitlines()
        assert message in line


def test_a_bench_says_where_an_optimiser_of_ones_own_fails(lab):
    done = inkjet(
        lab,
        "bench",
        "--optimizers",
        "random,inkjet_lab.search:Failing",
        "--problems",
        "nominal",
        *SMALL,
        "--workers",
        1,
    )
    assert done.returncode == 0, done.stderr
    told = " ".join(done.stdout.split())
    assert "inkjet_lab.search:Failing: its code fails: RuntimeError: the pump is off (" in told
    assert "search.py, line " in told


def test_a_file_that_another_module_hides_is_told(lab):
    (lab.folder / "calendar.py").write_text("from inkjet_lab.search import Shrinking\n")
    done = inkjet(lab, "optimize", "--optimizer", "calendar:Shrinking")
    assert done.returncode == 2
    assert "calendar.py, which hides your calendar.py. Rename your file." in done.stderr


def test_a_package_cannot_take_a_name_of_ours(lab):
    info = lab.package.parent / "inkjet_lab-0.3.1.dist-info" / "entry_points.txt"
    info.write_text(f"[{OPTIMIZERS}]\npso = inkjet_lab.search:Shrinking\n")
    done = inkjet(lab, "bench", "--optimizers", "all")
    assert done.returncode == 2
    assert "the package inkjet-lab offers 'pso' in the group inkjet_env.optimizers, but this package" in done.stderr


def test_the_example_of_entry_points_is_what_a_package_would_write():
    import tomllib

    from inkjet_env import plugins

    text = textwrap.dedent(plugins.__doc__.split("::\n")[1].split("``module")[0])
    groups = tomllib.loads(text)["project"]["entry-points"]
    assert set(groups) == {OPTIMIZERS, PROBLEMS, EFFECTS}
    assert plugin(OPTIMIZERS, "my_lab.search:Annealing").place == groups[OPTIMIZERS]["annealing"]
