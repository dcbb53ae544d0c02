"""Settings of a bench that takes seconds, and the bytes of its runs."""

from inkjet_env.experiments.benchmark.settings import BenchSettings


def small_settings(**changes):
    return BenchSettings(
        **{"problems": ("nominal",), "optimizers": ("pso", "random"), "repeats": 2, "budget": 90} | changes
    )


def contents(folder):
    return {file.name: file.read_bytes() for file in folder.glob("runs/*.parquet")}
