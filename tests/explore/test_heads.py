"""Heads side by side: their names, intervals, frequency response and best waveforms."""

import json

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.augmented_heads import augmented_head
from inkjet_env.experiments.explore import heads_state
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.heads import MOST_HEADS, HeadShelf
from inkjet_env.experiments.explore.heads_state import frequency_response
from inkjet_env.experiments.explore.search_plan import SearchSettings, command_text
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import DriverLimits, PeakCost, Printhead, QuasiStaticPrinthead

PUBLISHED = Printhead.published()


def test_kinds_names_and_intervals(tmp_path):
    shelf = HeadShelf()
    file, mode = tmp_path / "head.json", tmp_path / "other" / "head.json"
    mode.parent.mkdir()
    PUBLISHED.to_json(file, {"a1": (3.0e4, 3.1e4)})
    augmented_head("augmented-mode").to_json(mode)
    first, second, again = shelf.add(file), shelf.add(mode), shelf.add(file)
    assert [first.name, second.name, again.name] == ["head", "head 2", "head"]
    assert [one.kind for one in shelf.heads.values()] == ["published", "identified", "corrected"]
    told = {name: (low, high) for name, _, low, high, _ in again.rows()}
    assert told == {"a0": (None, None), "a1": (3.0e4, 3.1e4), "b1": (None, None)}
    assert "second mode: frequency" in [name for name, *_ in second.rows()]


def test_heads_that_cannot_be_shown_are_refused(tmp_path):
    shelf = HeadShelf()
    QuasiStaticPrinthead((0.2, 0.8, 0.0)).to_json(tmp_path / "slow.json")
    with pytest.raises(ValueError, match=r"slow\.json: nothing is known of this head's resonance"):
        shelf.add(tmp_path / "slow.json")
    for k in range(MOST_HEADS):
        PUBLISHED.to_json(tmp_path / f"{k}.json")
    for k in range(MOST_HEADS - 1):
        shelf.add(tmp_path / f"{k}.json")
    with pytest.raises(ValueError, match="there are 8 heads already"):
        shelf.add(tmp_path / f"{MOST_HEADS - 1}.json")


def test_the_measured_frequency_response_of_the_base_model_is_its_formula():
    frequency_Hz, exact = frequency_response(PUBLISHED)
    _, measured = frequency_response(AugmentedPrinthead(PUBLISHED, ()))
    assert measured == pytest.approx(exact, rel=2e-3)
    assert frequency_Hz[int(exact.argmax())] == pytest.approx(PUBLISHED.frequency_Hz, rel=0.01)


def test_a_second_mode_is_seen_in_the_frequency_response():
    head = augmented_head("augmented-mode")
    frequency_Hz, magnitude = frequency_response(head)
    base = frequency_response(head.printhead)[1]
    (values,) = [values for effect, values in head.effects if effect.id == "second_mode"]
    largest = frequency_Hz[int(np.abs(magnitude - base).argmax())]
    assert largest == pytest.approx(values["frequency_Hz"], rel=0.05)


def test_the_best_waveform_is_that_of_the_command(tmp_path, monkeypatch, inkjet):
    monkeypatch.setattr(heads_state, "SEARCH", SearchSettings("cma-es", budget=150, seed=0))
    exploration = Exploration(tmp_path / "session.json")
    content = json.dumps(PUBLISHED.varied(frequency_Hz=60e3).as_json()).encode()
    exploration.heads.drop("../fast.json", content)
    exploration.heads.find()
    exploration.heads.join()
    assert set(exploration.heads.best) == {"published", "fast"}
    command = command_text(heads_state.SEARCH, exploration.shelf.heads["fast"], PeakCost(), DriverLimits()).split()
    _, out, _ = inkjet(*command[1:], "--json", "-")
    waveform, cost = exploration.heads.best["fast"]
    assert (waveform.to_array().tolist(), cost) == (json.loads(out)["waveform"], json.loads(out)["cost"])
    exploration.heads.take("fast")
    assert (exploration.waveform.drive, exploration.shelf.chosen) == (waveform, "fast")
    exploration.save()
    assert Exploration.restored(exploration.file).heads.best == exploration.heads.best
    with pytest.raises(ValueError, match="the best waveform of 'nobody' is not known yet"):
        exploration.heads.take("nobody")
