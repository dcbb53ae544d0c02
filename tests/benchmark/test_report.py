"""The tables of a comparison for machines."""

import json

from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.report import ranking_csv, ranking_json


def test_tables_for_machines_agree_with_each_other(finished):
    compared = Comparison(finished)
    lines = ranking_csv(compared).splitlines()
    found = ranking_json(compared)
    assert found["format"] == "ranking/1"
    assert len(lines) == 1 + 2 * 1
    best = dict(zip(lines[0].split(","), lines[1].split(","), strict=True))
    first = found["ranking"][0]
    assert best["optimizer"] == first["optimizer"] == compared.ranking.optimizers[0]
    assert float(best["median_regret_V"]) == first["problems"]["nominal"]["median_regret_V"]
    json.dumps(found, allow_nan=False)
