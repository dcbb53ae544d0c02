"""The frame of all pages in a real browser: pictures are drawn without a network, and nothing is wider than a phone."""

from dataclasses import dataclass

import numpy as np
import pytest

from inkjet_env.reporting.page import page_environment
from inkjet_env.reporting.plotting import new_figure
from inkjet_env.reporting.zoomable import Line, Panel, stacked_picture
from tests.browser import load, opened_page

PAGE = """{% extends "page.html" %}{% block title %}A page{% endblock %}{% block verdict %}It rings{% endblock %}
{% block picture %}{{ zoomable(pictures[0]) }}{% endblock %}"""
TIME_us = np.linspace(0.0, 99.0, 100)
RINGING_V = np.exp(-TIME_us / 30) * np.cos(TIME_us / 5)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page with one picture, of which samples 20 to 39 are seen first."""
    still, axes = new_figure(5.4, 3.0)
    axes.plot(TIME_us, RINGING_V)
    lines = [Line("measured </script>", RINGING_V, "#9a9a9a", 4.0), Line("model", 0.9 * RINGING_V, "#d55e00")]
    residual = [Line("r", 0.1 * RINGING_V, "#000")]
    panels = [Panel("self-sensing (V)", "V", lines), Panel("residual (V)", "V", residual, band=0.02)]
    picture = stacked_picture("shows", TIME_us, "time", "µs", panels, still, view=slice(20, 40))
    file = tmp_path_factory.mktemp("page") / "page.html"
    file.write_text(page_environment().from_string(PAGE).render(pictures=[picture]), encoding="utf-8")
    return file


@dataclass
class Seen:
    """Sizes and colours on a page."""

    drawn: bool
    still: bool
    paths: int
    paper: str
    fits: bool


LOOK = """(() => {
    const hosts = (node) => [...node.querySelectorAll('*')].filter((n) => n.shadowRoot);
    const trees = (node) => [node, ...hosts(node).flatMap((n) => trees(n.shadowRoot))];
    const shown = (name) => getComputedStyle(document.querySelector(name)).display !== 'none';
    const counts = trees(document.querySelector('.live')).map((tree) => tree.querySelectorAll('svg path').length);
    const paths = counts.reduce((sum, count) => sum + count, 0);
    const root = document.documentElement;
    return {drawn: shown('.live'), still: shown('.still'), paths,
        paper: getComputedStyle(document.body).backgroundColor, fits: root.scrollWidth <= root.clientWidth};
})()"""


@pytest.fixture(scope="module")
def faults():
    """What was wrong in the tab."""
    return []


@pytest.fixture(scope="module")
def tab(browser, faults):
    return opened_page(browser, faults)


def look(tab, page, media="screen", scheme="light", width=1280):
    tab.emulate_media(media=media, color_scheme=scheme)
    tab.set_viewport_size({"width": width, "height": 900})
    load(tab, page)
    return Seen(**tab.evaluate(LOOK))


@pytest.mark.parametrize("width", [1280, 390])
def test_the_picture_is_drawn_as_vectors_and_fits(tab, faults, page, width):
    seen = look(tab, page, width=width)
    assert faults == []
    assert seen.drawn
    assert not seen.still
    assert seen.paths >= 3
    assert seen.fits


def test_the_page_follows_the_dark_mode_but_not_on_paper(tab, page):
    assert look(tab, page).paper == "rgb(255, 255, 255)"
    assert look(tab, page, scheme="dark").paper == "rgb(31, 31, 31)"
    printed = look(tab, page, media="print", scheme="dark")
    assert printed.paper == "rgb(255, 255, 255)"
    assert printed.still
    assert not printed.drawn


def test_what_is_seen_first_is_the_view_and_a_reset_shows_all(tab, page):
    look(tab, page)
    seen = tab.evaluate(
        "(() => { const views = [...Bokeh.index.query((v) => v.model.type === 'Figure')];"
        " const range = views[0].model.x_range, first = [range.start, range.end];"
        " views[0].reset(); return [...first, range.start, range.end]; })()"
    )
    assert seen == [TIME_us[20], TIME_us[39], TIME_us[0], TIME_us[-1]]


def test_without_code_the_still_picture_is_there(tab, page, tmp_path):
    file = tmp_path / "quiet.html"
    file.write_text(page.read_text(encoding="utf-8").replace("<script>", '<script type="text/none">'), encoding="utf-8")
    tab.emulate_media(media="screen", color_scheme="light")
    tab.goto(file.as_uri())
    tab.locator(".still").first.wait_for()
    seen = Seen(**tab.evaluate(LOOK))
    assert seen.still
    assert not seen.drawn


def test_what_goes_wrong_in_a_page_is_seen(browser, tmp_path):
    told = []
    tab = opened_page(browser, told)
    file = tmp_path / "wrong.html"
    script = "console.error('said'); alert('asked'); setTimeout(() => { throw Error('thrown'); })"
    images = "<img src='http://127.0.0.1:9/x.png'><img src='lacking.png'>"
    file.write_text(f"<body data-ready=yes><script>{script}</script>{images}")
    load(tab, file)
    tab.close()
    for fault in ("said", "dialog asked", "thrown", "http://127.0.0.1:9/x.png", "ERR_FILE_NOT_FOUND"):
        assert [one for one in told if fault in one] != [], told
