"""The page without a browser: every view draws every state, and names are never markup."""

import threading
from types import SimpleNamespace

import pytest

from inkjet_env.experiments.benchmark.augmented_heads import augmented_head
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.printhead import DriverLimits, Printhead

pytest.importorskip("panel", reason="panel is not installed")

HOSTILE = "<img src=x onerror=alert(1)>"


@pytest.fixture
def page(tmp_path):
    from inkjet_env.experiments.explore import style
    from inkjet_env.experiments.explore.page import Page

    style.use()
    exploration = Exploration(tmp_path / "session.json")
    yield Page(exploration)
    exploration.close()


def shown(page):
    """All HTML of the page."""
    import panel as pn

    return "".join(pane.object or "" for pane in page.layout.select(pn.pane.HTML))


def test_a_slider_changes_what_is_drawn(page):
    view = page.views["waveform"]
    before = view.plots.sources["sensor"].data["y"].copy()
    view.sliders[3].value = 12.5
    state = page.exploration.waveform
    assert state.drive.t2 == pytest.approx(12.5e-6)
    assert (view.plots.sources["sensor"].data["y"] != before).any()
    exact_V = Printhead.published().respond(state.drive).cost()
    assert f"data-cost='{exact_V!r}'"[:20] in view.terms.object
    view.undo.clicks += 1
    assert view.sliders[3].value == pytest.approx(10.481)


def test_a_refusal_is_told_and_nothing_changes(page):
    view = page.views["waveform"]
    drive = page.exploration.waveform.drive
    view.limits.value = "highest=48"
    assert "a driver has no limit" in page.message.object
    view.sliders[6].value = 18.0
    assert page.message.object == ""
    assert page.exploration.waveform.drive != drive


def test_what_the_driver_cannot_do_is_drawn_and_told(page):
    page.exploration.waveform.limits = DriverLimits(lowest_V=-120, highest_V=48, rise_V_per_us=20)
    page.redraw()
    page.exploration.changed("waveform")
    view = page.views["waveform"]
    assert "goes to 100 V" in view.excesses.object
    assert len(view.plots.sources["steep"].data["xs"]) == 1
    assert [span.location for span in view.plots.limit_spans if span.visible] == [-120, 48]


def test_every_view_draws_heads_with_effects_trains_pins_and_segments(page, tmp_path):
    exploration = page.exploration
    augmented_head("augmented-mode").to_json(tmp_path / "mode.json")
    exploration.shelf.choose(exploration.shelf.add(tmp_path / "mode.json").name)
    exploration.waveform.pin()
    exploration.waveform.set_drop_frequency(10e3)
    for view in page.views:
        exploration.changed(view)
    assert "pin 1" in page.views["waveform"].compared.object
    exploration.waveform.set_drop_frequency(0.0)
    exploration.open_drive("two.ini", b"[Pulse0]\nSeg0 = 0, 40, 20, 3\nSeg1 = 40, 0, -20, 3\n")
    for view in page.views:
        exploration.changed(view)
    assert page.message.object == ""
    assert page.views["waveform"].sliders[0].disabled
    assert "--drive drive.csv" in page.views["waveform"].command.value


def test_names_are_never_markup(page, tmp_path):
    exploration = page.exploration
    Printhead.published().to_json(tmp_path / f"{HOSTILE}.json")
    exploration.shelf.choose(exploration.shelf.add(tmp_path / f"{HOSTILE}.json").name)
    exploration.recordings.drop({f"{HOSTILE}.csv": b"nothing"})
    exploration.recordings.join()
    for view in page.views:
        exploration.changed(view)
    page.guarded("", lambda: exploration.shelf.choose(f"{HOSTILE} 2"))
    assert HOSTILE not in shown(page)
    assert shown(page).count("&lt;img") >= 3


def test_another_thread_never_draws_and_is_never_forgotten(page, monkeypatch):
    from bokeh.document import Document
    from bokeh.io.doc import patch_curdoc

    document, later, asked, drawn = Document(), [], [], []
    monkeypatch.setattr(Document, "session_context", True)
    document.add_next_tick_callback = asked.append
    page._document, page._loop = document, SimpleNamespace(add_callback=later.append)
    page.views["optimise"].draw = lambda: drawn.append(threading.current_thread())

    def tell_from_another_thread():
        thread = threading.Thread(target=lambda: page.exploration.changed("optimise"))
        thread.start()
        thread.join()

    with patch_curdoc(document):  # this tab is being served, in this thread
        tell_from_another_thread()
        tell_from_another_thread()
        assert drawn == []
        assert len(later) == 1
        page.views["heads"].draw = tell_from_another_thread  # told while the page is being drawn
        page.exploration.changed("heads")
    assert drawn == [threading.current_thread()]
    assert len(later) == 2
    assert asked == []  # a document that is being drawn can lose what another thread asks of it
    later[0]()
    assert asked == [page.redraw]
