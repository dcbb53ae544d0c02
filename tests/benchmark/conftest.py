"""A small bench, done once for each file of tests that looks at it; and COCO's own post-processing."""

import urllib.request
import warnings

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


@pytest.fixture(scope="module")
def cocopp():
    """COCO's own post-processing, which would look for its archives on the network as it is imported."""

    def offline(*_, **__):
        raise OSError("no network in tests")

    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.setattr(urllib.request, "urlopen", offline)
        patch.setattr(urllib.request, "urlretrieve", offline)
        warnings.simplefilter("ignore")
        import cocopp
        import cocopp.pproc
        import cocopp.toolsstats

        yield cocopp
