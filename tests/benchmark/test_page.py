"""The comparison's page in a real browser: it needs nothing but itself, and its filters do what they say."""

import base64
import io
import json
import re

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.entrants import entrant
from inkjet_env.experiments.benchmark.report import write_report
from inkjet_env.experiments.benchmark.runner import run_bench
from inkjet_env.experiments.benchmark.settings import BenchSettings
from tests.browser import load, opened_page

PROBLEMS = ("nominal", "stiff-head", "reading-200mV")
OPTIMIZERS = ("pso", "pso-tuned", "cma-es", "lbfgsb-multistart", "random")


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The page of a small comparison."""
    folder = tmp_path_factory.mktemp("bench") / "results"
    outcome = run_bench(BenchSettings(PROBLEMS, OPTIMIZERS, repeats=3, budget=200), folder, workers=1)
    return write_report(Comparison(outcome))[0]


def test_the_page_loads_nothing_and_holds_what_it_shows(report):
    text = report.read_text()
    own = re.sub(r"<script.*?</script>", "", text, flags=re.S)
    for loading in ("src=", "@import", "<link", "url(http", 'href="http'):
        assert loading not in own
    assert not re.search(r"<script[^>]* src", text)
    data = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S)[1])
    assert {problem["name"] for problem in data["problems"]} == set(PROBLEMS)
    assert set(data["optimizers"]) == set(OPTIMIZERS)
    assert data["budgets"] == [50, 150, 200]
    assert data["families"] == ["all", "cost", "head", "reading"]


@pytest.fixture(scope="module")
def faults():
    """What was wrong in the page."""
    return []


@pytest.fixture(scope="module")
def tab(report, browser, faults):
    """The page in a browser."""
    tab = opened_page(browser, faults, viewport={"width": 1250, "height": 900})
    load(tab, report)
    tab.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    return tab


def rows(tab, table="standings"):
    """Names in a table's first column: what stands between the colour and any small print."""
    return tab.evaluate(
        f"[...document.querySelectorAll('#{table} tbody tr')].map((r) => r.cells[0].childNodes[1].textContent.trim())"
    )


def traces(tab, plot):
    """Names of what a plot shows."""
    return tab.evaluate(f"visibleLines('{plot}')")


def test_it_loads_without_an_error_and_without_the_network(tab, faults):
    assert faults == []
    assert set(rows(tab)) == set(OPTIMIZERS)
    assert tab.evaluate("document.getElementById('standings').textContent").count("on 2 of 3") == 1  # L-BFGS-B
    assert set(traces(tab, "ecdf")) == set(OPTIMIZERS)


def test_it_tells_who_took_part_and_what_tuning_took(tab):
    told = tab.evaluate(
        "[...document.querySelectorAll('#entrants tbody tr')].map((r) => [...r.cells].map((c) => c.textContent))"
    )
    by_name = {name: rest for name, *rest in told}
    assert set(by_name) == set(OPTIMIZERS)
    assert by_name["pso"][1:3] == ["–", "defaults"]
    assert by_name["pso-tuned"][1] == f"{entrant('pso-tuned').tuning_evaluations:,}"
    assert f"particles {entrant('pso-tuned').options['particles']}" in by_name["pso-tuned"][2]
    assert "gradient" in by_name["lbfgsb-multistart"][3]


def test_families_change_tables_and_plots(tab, faults):
    tab.select_option("#family", "reading")
    assert set(rows(tab)) == set(OPTIMIZERS) - {"lbfgsb-multistart"}  # it cannot be used there
    assert set(traces(tab, "profile")) == set(OPTIMIZERS) - {"lbfgsb-multistart"}
    tab.select_option("#family", "head")
    assert set(rows(tab)) == set(OPTIMIZERS)
    tab.select_option("#family", "all")
    assert faults == []


def test_budgets_change_the_standings(tab):
    texts = {}
    for budget in ("50", "200"):
        tab.select_option("#budget", budget)
        texts[budget] = tab.evaluate("document.getElementById('standings').textContent")
        assert tab.evaluate("document.querySelector('#said li').textContent").startswith(f"After {budget} evaluations")
    assert texts["50"] != texts["200"]


def test_optimisers_can_be_hidden_and_shown(tab, faults):
    box = tab.locator('#optimizers input[value="pso"]')
    box.click()
    assert "pso" not in rows(tab) + rows(tab, "physical") + traces(tab, "ecdf") + traces(tab, "curves")
    box.click()
    assert "pso" in rows(tab)
    assert faults == []


def test_a_problem_can_be_looked_at(tab):
    tab.select_option("#problem", "reading-200mV")
    assert set(traces(tab, "curves")) == set(OPTIMIZERS) - {"lbfgsb-multistart"}
    tab.select_option("#problem", "nominal")
    assert set(rows(tab, "physical")) == set(OPTIMIZERS)


def test_a_curve_tells_its_numbers_where_the_pointer_is(tab):
    """The pointer at a point of the winner's curve."""
    place = tab.evaluate("""(() => {
        const view = Bokeh.index.find_one_by_id(model('ecdf:plot').id);
        const source = model(`ecdf:${data.optimizers[0]}`).data_source.data;
        view.el.scrollIntoView({block: 'center'});
        const box = view.el.getBoundingClientRect(), frame = view.frame, last = source.x.length - 1;
        const [x, y] = [frame.x_scale.compute(source.x[last]), frame.y_scale.compute(source.y[last])];
        return [box.x + x, box.y + y, source.x[last]];
    })()""")
    for x in (place[0] - 3, place[0]):
        tab.mouse.move(x, place[1])
    tooltip = tab.locator(".bk-Tooltip", has_text=f"{place[2]} evaluations")
    tooltip.filter(has_text="of targets met").first.wait_for()


def test_it_opens_with_the_winner_its_picture_and_its_waveform(tab, report):
    text = report.read_text()
    assert re.search(
        '<h1>.*? is ahead with 200 evaluations.*?class="zoomable".*?The winning waveform.*?<details>', text, re.S
    )
    winner = tab.evaluate("document.querySelector('h1').textContent.split(' ')[0]")
    assert winner == tab.evaluate("data.optimizers[0]")
    row = tab.evaluate("[...document.querySelector('.seven tbody tr').cells].map((c) => c.textContent)")
    seven = [float(cell.replace("−", "-")) for cell in row[:7]]
    held = dict(re.findall(r'download="([^"]*)" href="data:[^;]*;base64,([^"]*)"', text))
    assert set(held) == {"waveform.csv", "waveform.ini"}
    drive = np.genfromtxt(io.StringIO(base64.b64decode(held["waveform.csv"]).decode()), delimiter=",", names=True)
    assert drive["drive_V"].max() == pytest.approx(seven[0], abs=0.06)
    assert drive["drive_V"].min() == pytest.approx(seven[1], abs=0.06)
    assert 1e6 * drive["time_s"][-1] == pytest.approx(sum(seven[2:]), abs=0.05)


def test_nothing_is_wider_than_the_page(tab, tmp_path):
    assert tab.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    tab.screenshot(path=tmp_path / "page.png", full_page=True)
    assert (tmp_path / "page.png").stat().st_size > 50_000


def test_a_sheet_of_paper_holds_every_table(tab):
    """A4 less its margins is 703 pixels wide."""
    tab.emulate_media(media="print")
    tab.set_viewport_size({"width": 703, "height": 1000})
    widths = tab.evaluate("[...document.querySelectorAll('table')].map((t) => t.getBoundingClientRect().right)")
    assert len(widths) >= 5
    assert max(widths) <= 703
