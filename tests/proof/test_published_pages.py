"""The pages of published proofs: their tables are those that their archives give, both commitments checked."""

import tarfile
from pathlib import Path

import pytest

from inkjet_env.experiments.proof.protocol import as_judged
from inkjet_env.experiments.proof.score import score
from inkjet_env.experiments.publish.proof_tables import document


@pytest.mark.parametrize(("archive", "page"), [("published-1", "proof-1.md"), ("published-2", "proof.md")])
def test_the_published_pages_hold_every_table_that_the_command_writes(tmp_path, archive, page):
    docs = Path(__file__).parents[2] / "docs"
    with tarfile.open(docs / "proof" / f"{archive}.tar.xz") as packed:
        packed.extractall(tmp_path, filter="data")
    shown = (docs / "results" / page).read_text(encoding="utf-8").splitlines()
    written = [line for line in document(score(as_judged(tmp_path))).splitlines() if line]
    assert len(written) > 150
    missing = [line for line in written if line not in shown]
    assert not missing, f"docs/results/{page}: print its tables anew"
