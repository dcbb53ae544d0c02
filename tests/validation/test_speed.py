"""The record of the speed, and its page."""

import json

import numpy as np
import pytest

from inkjet_env.experiments.publish import speed_tables
from inkjet_env.experiments.validation import arithmetic
from inkjet_env.experiments.validation.speed import FORMAT
from inkjet_env.printhead import Bounds, Printhead
from tests.modules import ROOT

HEAD = Printhead.published()


def record(date, ratio):
    return {
        "format": FORMAT,
        "date": date,
        "processor": "a core",
        "versions": {},
        "tables": [{"title": "Cost of a waveform", "unit": "µs", "rows": [["lanes", 0.5, ratio], ["new", 5.0, 3.0]]}],
        "arithmetic": {"operations": 5000.0, "operations_a_second": 5e10, "floor_us": 0.1, "taken_us": 0.5},
    }


def test_records_stand_side_by_side_by_date(tmp_path, capsys):
    (tmp_path / "a.json").write_text(json.dumps(record("2026-12-01", 0.25)))
    early = record("2026-11-01", 1234.5)
    del early["tables"][0]["rows"][1]
    (tmp_path / "b.json").write_text(json.dumps(early))
    speed_tables.main([str(tmp_path)])
    lines = capsys.readouterr().out.splitlines()
    assert "| ratio | 2026-11-01 | 2026-12-01 |" in lines
    assert "| lanes | 1,234 | 0.25 |" in lines
    assert "| new | – | 3 |" in lines
    assert "| share of the core's arithmetic that lanes reach | 20 % | 20 % |" in lines


def test_an_empty_folder_and_another_file_are_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        speed_tables.main([str(tmp_path)])
    (tmp_path / "a.json").write_text('{"format": "other/1"}')
    with pytest.raises(SystemExit):
        speed_tables.main([str(tmp_path)])
    assert "is not a speed/1" in capsys.readouterr().err


def test_longer_edges_and_a_higher_law_need_more_operations():
    short, long = (Bounds(upper=(80, 0, *[upper] * 5)).from_unit(np.zeros((1, 7))) for upper in (4e-6, 20e-6))
    straight = Printhead(HEAD.a0, HEAD.a1, HEAD.b1, (0.8, 0.0))
    assert arithmetic.operations(short, HEAD) < arithmetic.operations(long, HEAD)
    assert arithmetic.operations(long, straight) < arithmetic.operations(long, HEAD)
    assert arithmetic.operations_a_second() > 0


def test_the_page_shows_the_records_in_docs(capsys):
    speed_tables.main([str(ROOT / "docs" / "speed")])
    page = (ROOT / "docs" / "results" / "accuracy-and-speed.md").read_text(encoding="utf-8")
    for line in capsys.readouterr().out.splitlines():
        assert line.replace("## ", "### ") in page
