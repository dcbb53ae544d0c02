"""Printed tables: as wide as the terminal at most, with every number and heading whole."""

import re

import pytest

from inkjet_env.reporting.tables import blocks, print_table

HEADINGS = ("optimiser", "mean rank", "nominal", "literal-5-1", "literal-10-5", "stiff-head", "soft-head")
NAMES = ("pso", "scipy-differential-evolution", "scipy-differential-evolution-tuned", "lbfgsb-multistart (on 21)")
ROWS = [(name, f"{k}.25", *(f"0.{n}3{k}" for n in range(5))) for k, name in enumerate(NAMES, start=10)]


def printed(capsys, headings=HEADINGS, rows=ROWS):
    print_table(headings, rows)
    return capsys.readouterr().out


@pytest.mark.parametrize("columns", [40, 60, 80, 200])
def test_every_number_is_whole_and_no_line_is_wider_than_the_terminal(capsys, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    shown = printed(capsys)
    assert max(map(len, shown.splitlines())) <= columns
    assert "…" not in shown
    for row in ROWS:
        for number in row[1:]:
            assert re.search(rf"(?<!\S){re.escape(number)}(?!\S)", shown)
    assert not re.search(r" $", shown, re.MULTILINE)


def test_a_table_that_fits_is_one_block_and_one_that_does_not_repeats_its_first_column(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert printed(capsys).count("optimiser") == 1
    monkeypatch.setenv("COLUMNS", "60")
    narrow = printed(capsys)
    assert narrow.count("optimiser") == narrow.count("pso") == 2


def test_a_pipe_is_80_characters_wide(capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    assert max(map(len, printed(capsys).splitlines())) == 80


def test_headings_break_after_hyphens_and_long_texts_between_words(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "50")
    sentence = "at least nine of ten heads keep their cost within one volt of it"
    shown = printed(capsys, ("figure", "criterion", "literal-10-5"), [("closure", sentence, "12.5 V")])
    assert max(map(len, shown.splitlines())) <= 50
    assert all(word in shown.split() for word in sentence.split())
    assert "12.5 V" in shown


def test_no_column_is_lost_however_narrow_the_terminal():
    for width in range(40, 120):
        columns = [number for block in blocks(HEADINGS, ROWS, width) for number, _ in block if number]
        assert columns == list(range(1, len(HEADINGS)))
