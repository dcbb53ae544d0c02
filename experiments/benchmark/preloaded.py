"""Imported by the process of which local workers are copies: it does once what each would do before its first run."""

from inkjet_env.experiments.benchmark.runner import own_code, own_versions
from inkjet_env.experiments.benchmark.suite import problem

own_code()
own_versions()
problem("nominal").evaluate_with_gradient([[0.0] * 7])  # loads the compiled code
