"""A search from the page finds what the command finds, whether it is paused, or its server started again."""

import json
import shlex
import threading

import numpy as np
import pytest

from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.search import DONE, FAILED, PAUSED, RUNNING, STOPPED, Search
from inkjet_env.experiments.explore.search_plan import SearchSettings, planned
from inkjet_env.printhead import DriverLimits, PeakCost, Printhead


@pytest.fixture
def exploration(tmp_path):
    made = Exploration(tmp_path / "session.json")
    yield made
    made.optimise.stop()
    if made.optimise.search is not None:
        made.optimise.search.join()


def finished(exploration):
    exploration.optimise.start(exploration.shelf, exploration.waveform)
    exploration.optimise.search.join()
    return exploration.optimise.progress


def command_finds(inkjet, exploration):
    command = shlex.split(exploration.optimise.command_text(exploration.shelf, exploration.waveform))
    status, out, err = inkjet(*command[1:], "--json", "-")
    assert status == 0, err
    return json.loads(out)


@pytest.mark.parametrize(
    ("optimizer", "problem", "seed"),
    [("pso", "nominal", 0), ("cma-es", "nominal", 3), ("scipy-direct", "train-10kHz", 1)],
)
def test_the_best_is_that_of_the_command_for_the_seed(inkjet, exploration, optimizer, problem, seed):
    exploration.optimise.change(optimizer=optimizer, problem=problem, budget=200, seed=seed)
    progress, told = finished(exploration), command_finds(inkjet, exploration)
    assert progress.state == DONE
    assert (progress.best_cost, progress.evaluations) == (told["cost"], told["evaluations"])
    assert progress.best.to_array().tolist() == told["waveform"]
    assert progress.history == told["history"]


def test_head_cost_and_limits_of_the_page_are_those_of_the_command(inkjet, exploration, tmp_path):
    Printhead.published().varied(frequency_Hz=60e3).to_json(tmp_path / "mine.json")
    exploration.optimise.change(head=exploration.shelf.add(tmp_path / "mine.json").name, budget=120, optimizer="random")
    exploration.waveform.set_cost(PeakCost(-4, 3, "first", 5))
    exploration.waveform.limits = DriverLimits(lowest_V=-30, highest_V=48, rise_V_per_us=20)
    progress, told = finished(exploration), command_finds(inkjet, exploration)
    assert progress.best_cost == told["cost"]
    assert progress.best.to_array().tolist() == told["waveform"]


def test_a_search_that_is_paused_waits_and_finds_the_same(tmp_path):
    shelf = Exploration(tmp_path / "x.json").shelf
    plan = planned(SearchSettings("cma-es", budget=2000, seed=5), shelf.head, PeakCost(), DriverLimits())
    whole = Search(plan, tmp_path / "whole.npz", lambda: None)
    whole.start()
    whole.join()
    paused = threading.Event()
    search = Search(plan, tmp_path / "record.npz", lambda: paused.set() if search.progress.state == PAUSED else None)
    search.start()
    while search.progress.evaluations < 20:
        search.join(0.01)
    search.pause()
    assert paused.wait(60)
    made = search.run.evaluations
    search.join(0.1)
    assert search.run.evaluations == made < 2000
    search.start()
    search.join()
    assert search.progress.state == DONE
    assert np.array_equal(search.run.costs, whole.run.costs)


def test_a_search_goes_on_after_the_server_is_started_again(tmp_path):
    session = tmp_path / "session.json"
    exploration = Exploration(session)
    exploration.optimise.change(optimizer="cma-es", budget=3000, seed=2)
    exploration.optimise.start(exploration.shelf, exploration.waveform)
    search = exploration.optimise.search
    while search.progress.evaluations < 50:
        search.join(0.01)
    exploration.close()
    assert search.progress.state == PAUSED
    again = Exploration.restored(session)
    assert again.optimise.settings.budget == 3000
    assert again.optimise.progress.state == PAUSED
    assert again.optimise.progress.evaluations >= 50
    again.optimise.resume()
    again.optimise.search.join()
    search.start()
    search.join()
    assert again.optimise.progress.state == search.progress.state == DONE
    assert np.array_equal(again.optimise.search.run.costs, search.run.costs)
    assert not list(tmp_path.glob("*.npz"))


def test_a_search_that_is_stopped_keeps_what_it_has_found(exploration, tmp_path):
    exploration.optimise.change(optimizer="cma-es", budget=100_000)
    exploration.optimise.start(exploration.shelf, exploration.waveform)
    with pytest.raises(ValueError, match="a search is under way"):
        exploration.optimise.start(exploration.shelf, exploration.waveform)
    search = exploration.optimise.search
    while search.progress.evaluations < 50:
        search.join(0.01)
        assert search.progress.state == RUNNING
    exploration.optimise.stop()
    search.join()
    assert search.progress.state == STOPPED
    assert not list(tmp_path.glob("*.npz"))
    exploration.optimise.take_over(exploration.shelf, exploration.waveform)
    cost_V = float(search.plan.problem.evaluate(search.run.best_point)[0])
    assert search.progress.best_cost == cost_V
    assert exploration.waveform.drive == search.progress.best
    exploration.save()
    again = Exploration.restored(exploration.file)
    assert again.optimise.progress == search.progress


def test_what_cannot_be_searched_is_refused_in_a_sentence(exploration):
    for settings, sentence in (
        ({"optimizer": "psoo"}, "psoo"),
        ({"problem": "nominl"}, "nominl"),
        ({"budget": 0}, "the budget must be 1 to 10,000,000"),
        ({"robust": "cvar"}, "does not say which heads the recordings leave possible"),
    ):
        exploration.optimise.settings = SearchSettings(**settings)
        if "optimizer" in settings:
            assert finished(exploration).state == FAILED
            assert sentence in exploration.optimise.progress.failure
        else:
            with pytest.raises(ValueError, match=sentence):
                exploration.optimise.start(exploration.shelf, exploration.waveform)


def test_there_is_nothing_to_take_over_before_a_search(exploration):
    with pytest.raises(ValueError, match="there is no best waveform yet"):
        exploration.optimise.take_over(exploration.shelf, exploration.waveform)
