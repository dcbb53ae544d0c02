"""A small bench, done once for each file of tests that looks at it."""

import pytest

from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.report import write_report
from inkjet_env.experiments.benchmark.runner import run_bench
from tests.benchmark.small_bench import small_settings


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A small bench, done."""
    folder = tmp_path_factory.mktemp("bench") / "results"
    outcome = run_bench(small_settings(), folder, workers=1)
    write_report(Comparison(outcome))
    return outcome
