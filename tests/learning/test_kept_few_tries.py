"""What docs/comparison/few_tries.tar.xz keeps is the comparison of which docs/comparison/few_tries.json tells."""

import json
import tarfile
from pathlib import Path

import numpy as np
import pytest

from inkjet_env.experiments.learning import few_shot, repeated_training
from inkjet_env.experiments.learning.benches import BENCHES

DOCS = Path(__file__).parents[2] / "docs" / "comparison"
TOLD = json.loads((DOCS / "few_tries.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """The folder with what the archive holds, and only files."""
    folder = tmp_path_factory.mktemp("few-tries")
    with tarfile.open(DOCS / "few_tries.tar.xz") as archive:
        for member in archive:
            if member.isfile():
                path = folder / member.name
                path.parent.mkdir(exist_ok=True)
                path.write_bytes(archive.extractfile(member).read())
    return folder


def values_of(row):
    """Medians and counts of a row, without the intervals."""
    after = {bench: told["after"] for bench, told in {"": row, **row["elsewhere"]}.items()}
    medians = [[[told["value"], *told["each"]] for told in of.values()] for of in after.values()]
    return row["name"], row["learning"], row["trainings"], list(after), medians


def test_the_told_medians_are_those_of_the_kept_tests(kept, monkeypatch):
    """No training or test is missing, all were made with the same code, and the study makes of them what it tells."""
    learnt = {f"{way}-{k}" for way in few_shot.LEARNT for k in range(1, TOLD["trainings"] + 1)}
    tested = learnt | {f"{way}-1" for way in (few_shot.MODEL_BASED, *few_shot.SCRATCH)}
    found = {path.relative_to(kept).as_posix() for path in kept.rglob("*.npz")}
    files = {f"{name}-tested.npz" for name in tested} | {f"{bench}/best-known.npz" for bench in BENCHES}
    assert found == {name.replace(" ", "-") for name in files}

    with np.load(kept / "tune-1-tested.npz", allow_pickle=False) as archive:
        asked = json.loads(str(archive["asked"]))
    made_by = {name: asked[name] for name in ("code", "versions")}
    monkeypatch.setattr(repeated_training, "circumstances", lambda: made_by)
    monkeypatch.setattr(repeated_training, "RESAMPLES", 5)
    settings = ("evaluations", "heads", "labelling", "seed", "trainings", "tries")
    again = few_shot.study(kept, **{name: TOLD[name] for name in settings})
    assert again["nothing_V"] == TOLD["nothing_V"]
    assert [values_of(row) for row in again["rows"]] == [values_of(row) for row in TOLD["rows"]]
