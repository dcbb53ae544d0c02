"""A diagnosis that was interrupted goes on where it was, to the same end."""

import importlib
import json
from dataclasses import replace

import pytest

from inkjet_env.mismatch import diagnose
from inkjet_env.mismatch.fitting.checkpoint import Kept

attribute = importlib.import_module("inkjet_env.mismatch.selection.hypotheses")
LOOKED_FOR = ("cubic_stiffness", "quadratic_damping", "feedthrough", "mains_hum")


class Stopped(Exception):
    """Instead of Ctrl-C."""


@pytest.fixture
def run(recorded, head, effects):
    """A function: the verdict, with finished fits kept in a folder; stopped at a step of that name."""

    def run(keep, stop_at=None, name="cubic_stiffness", free=False):
        steps = []

        def progress(step):
            steps.append(step)
            if stop_at is not None and stop_at in step:
                raise Stopped

        campaign = recorded(name)
        if free:  # ringing from an earlier pulse
            chosen = [replace(r, initial_state="free") if r.name == "r002" else r for r in campaign.recordings]
            campaign = replace(campaign, recordings=tuple(chosen))
        found = diagnose(
            campaign, head, [effects[e] for e in LOOKED_FOR], 0, workers=1, progress=progress, keep=keep
        ).as_json()
        found.pop("seconds", None)
        found.pop("stages", None)
        return found, steps

    return run


def timeless(found):
    return json.dumps({key: value for key, value in found.items() if key not in ("seconds", "stages", "timing")})


def test_an_interrupted_diagnosis_ends_as_if_it_had_not_been(run, tmp_path, monkeypatch):
    whole, _ = run(None)
    with pytest.raises(Stopped):
        run(tmp_path / "fits", "to the end")
    kept = sorted((tmp_path / "fits").iterdir())
    assert len(kept) >= 4
    assert {file.suffix for file in kept} == {".json"}
    again = []
    tried = attribute._tried

    def noted(*question, **how):
        again.append(question)
        return tried(*question, **how)

    monkeypatch.setattr(attribute, "_tried", noted)
    resumed, _ = run(tmp_path / "fits")
    assert timeless(resumed) == timeless(whole)
    assert all(len(question) < 5 for question in again)  # none of the first steps was done twice
    assert not (tmp_path / "fits").exists()  # complete


def test_free_initial_states_go_on_too(run, tmp_path):
    whole, _ = run(None, free=True)
    with pytest.raises(Stopped):
        run(tmp_path / "fits", "to the end (1", free=True)
    assert timeless(run(tmp_path / "fits", free=True)[0]) == timeless(whole)


def test_other_recordings_find_no_fits_of_these(run, tmp_path):
    whole, _ = run(None, name="feedthrough")
    with pytest.raises(Stopped):
        run(tmp_path / "fits", "to the end")
    assert timeless(run(tmp_path / "fits", name="feedthrough")[0]) == timeless(whole)


def test_a_damaged_fit_is_refused_by_name(run, tmp_path):
    with pytest.raises(Stopped):
        run(tmp_path / "fits", "to the end")
    for file in (tmp_path / "fits").iterdir():
        file.write_text('{"fit": {"end": 3}}')
    with pytest.raises(ValueError, match=r"\.fit\.json is damaged.*Delete it"):
        run(tmp_path / "fits")


def test_only_fits_are_cleared_away(tmp_path):
    kept = Kept(tmp_path)
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "0.fit.json").write_text("{}")
    kept.clear()
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]
