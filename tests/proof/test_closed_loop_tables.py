"""The tables of the closed loop: each head once, with what it began and ended with."""

import json
from pathlib import Path

import pytest

from inkjet_env.experiments.proof.adaptive import ADAPTIVE_FORMAT
from inkjet_env.experiments.proof.tuning_study import FORMAT
from inkjet_env.experiments.publish import closed_loop_tables

SET = {"verdict": "set", "judged": "set", "effects": ["trigger_delay"], "size": 3}
NAMED = {"verdict": "named", "judged": "right", "effects": ["trigger_delay"], "size": 1}
HEAD = {"base": -10.0, "augmented": -14.0, "robust": -13.0, "loop": -15.0, "oracle": -15.0}


def figure(hits):
    return {"name": "left as a set", "value": hits / 4, "low": 0.0, "high": 1.0, "kind": "share", "hits": hits, "of": 4}


@pytest.fixture
def folder(tmp_path):
    case = {"name": "head-1", "way": "designed", "number": 1, "effects": ["trigger_delay"], "strength": "medium"}
    rounds = [{"asked": ["Record."], "recordings": 2, "said": NAMED}]
    adaptive = {
        "format": ADAPTIVE_FORMAT,
        "figures": {"lags": {way: [figure(hits)] for way, hits in (("before", 3), ("designed", 1), ("random", 2))}},
        "cases": [case | {"before": SET, "rounds": rounds}, case | {"way": "random", "before": SET, "rounds": []}],
        "waveforms": {"heads": [HEAD | {"effects": ["creep"], "verdict": "right"}]},
    }
    (tmp_path / "requests.json").write_text(json.dumps(adaptive))
    result = {
        "draw": {"effects": ["echo"]}, "verdict": "named", "effects": ["echo"], "recordings": 41, "seconds": 228.0,
        "costs": {"base": -10.0, "fit": -14.0}, "chosen": "fit", "oracle": -15.0,
    }  # fmt: skip
    (tmp_path / "study.json").write_text(json.dumps({"format": FORMAT, "heads": [result]}))
    return tmp_path


def test_every_head_is_told_with_what_it_began_and_ended_with(folder, capsys):
    closed_loop_tables.main([str(folder)])
    lines = capsys.readouterr().out.splitlines()
    assert "| left as a set | 4 | 75.0 % (3) | 25.0 % (1) | 50.0 % (2) |" in lines
    said = "set trigger_delay or 2 more"
    assert f"| trigger_delay, medium | designed | {said} | 2 | named trigger_delay |" in lines
    assert f"| trigger_delay, medium | random | {said} | 0 | – |" in lines
    assert "| closed loop | 100.0 % | 100.0 % | 0 | 0.0 % |" in lines
    assert "| corrected head | 80.0 % | 80.0 % | 0 | 0.0 % |" in lines
    assert "| echo | named | 41 | 3.8 | -10.00 | -14.00 | -15.00 |" in lines


def test_a_folder_of_something_else_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        closed_loop_tables.main([str(tmp_path)])
    assert "holds none of requests.json, waveforms.json and study.json" in capsys.readouterr().err


def test_the_record_in_docs_says_what_its_files_say():
    docs = Path(__file__).parents[2] / "docs"
    lines = (docs / "results" / "closed-loop.md").read_text(encoding="utf-8").splitlines()
    told = dict(closed_loop_tables.sections(docs / "closed-loop"))
    assert {"requests: lags", "requests: concealed"} <= told.keys()
    for heading, text in told.items():
        if heading != "requests: strong and medium":  # the page shows the lags alone
            missing = [line for line in text.splitlines() if line not in lines]
            assert not missing, f"docs/results/closed-loop.md, {heading}: print its tables anew"
