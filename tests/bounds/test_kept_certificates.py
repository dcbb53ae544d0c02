"""The certificates that docs/comparison/bounds keeps are of the suite's problems, and the table tells what they say."""

import json
from pathlib import Path

import pytest

from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.experiments.bounds.summary import summary
from inkjet_env.experiments.bounds.verification.reading import read_certificate

DOCS = Path(__file__).parents[2] / "docs" / "comparison"
FOLDERS = sorted((DOCS / "bounds").iterdir())
TOLD = json.loads((DOCS / "bounds.json").read_text(encoding="utf-8"))["bounds"]


def test_every_bound_has_its_certificate_and_every_certificate_its_bound():
    assert {one["problem"] for one in TOLD} == {folder.name for folder in FOLDERS}
    assert len(TOLD) == len(FOLDERS) > 0


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_certificate_is_of_the_problem_as_it_is_now_and_says_what_the_table_tells(folder):
    """Checked without its proof: ``inkjet_env.experiments.bounds.verification`` takes longer than all tests."""
    held = json.loads((folder / "certificate.json").read_text(encoding="utf-8"))
    assert held["problem"] == {"name": folder.name, **problem(folder.name).settings()}
    certificate = read_certificate(folder)
    assert len(list(folder.glob("part-*.xz"))) == len(certificate.parts)
    (told,) = (one for one in TOLD if one["problem"] == folder.name)
    assert told == summary(folder)
