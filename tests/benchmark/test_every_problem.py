"""Every problem of the suite passes the tests that one of a user's own must pass."""

import pytest

from inkjet_env.experiments.benchmark.suite import problem, suite
from inkjet_env.experiments.benchmark.testing import ProblemTests


class TestRulesOfAProblem(ProblemTests):
    @pytest.fixture(autouse=True, params=suite())
    def _one_after_another(self, request):
        self.problem = problem(request.param)
