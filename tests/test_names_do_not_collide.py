"""A user's own folders ``experiments`` and ``optimizers`` stay theirs, and do not disturb us."""

import subprocess
import sys

import pytest


@pytest.fixture
def beside_their_own(tmp_path):
    """Run Python in a folder that holds packages of a user's own, with our usual names."""
    for name in ("experiments", "optimizers"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"whose = 'the user: {name}'\n")

    def run(*arguments):
        done = subprocess.run([sys.executable, *arguments], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def test_their_packages_are_imported_whatever_of_ours_is(beside_their_own):
    script = """if True:
        from inkjet_env.experiments.concealed_plant import Case, build
        import inkjet_env.experiments.cli, inkjet_env.optimizers
        import experiments, optimizers
        print(experiments.whose, optimizers.whose, Case.__module__, sep="; ")
    """
    ours_too = "the user: experiments; the user: optimizers; experiments.concealed_rig.case"
    assert beside_their_own("-c", script).strip() == ours_too


def test_the_concealed_plant_comes_after_their_package_too(beside_their_own):
    script = """if True:
        import experiments
        from inkjet_env.experiments.concealed_plant import Case
        import experiments.concealed_rig.case, sys
        print(experiments.whose, sys.modules["experiments"].whose, Case(1, 2, "null").number, sep="; ")
    """
    assert beside_their_own("-c", script).strip() == "the user: experiments; the user: experiments; 1"


def test_the_command_runs_beside_their_packages(beside_their_own):
    bench = ("bench", "--optimizers", "random", "--problems", "nominal", "--repeats", "1", "--budget", "20")
    beside_their_own("-m", "inkjet_env.experiments.cli", *bench, "--workers", "2", "--results", "results")
    assert "random" in beside_their_own("-c", "print(open('results/ranking.json').read())")
