"""The page of a session: what it says of a session at its end and of one that waits, and that it stands alone."""

import base64
import html
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.experiments.tuning import session as session_module
from inkjet_env.experiments.tuning.check import Measured, averaged, expected_V
from inkjet_env.experiments.tuning.exchange import Exchange, WaitingError
from inkjet_env.experiments.tuning.figures import check_figure, request_figure, waveforms_figure
from inkjet_env.experiments.tuning.report import distinct, effects_of, headline, page_html, sentences, write_page
from inkjet_env.experiments.tuning.session import Session, TuneSettings, requests_of_round
from inkjet_env.printhead import DriverLimits
from inkjet_env.recordings.drive import read_drive
from inkjet_env.rig import VirtualRig
from tests.tuning.two_rounds import PULSE_V, TRUE, put_in_place

SETTINGS = TuneSettings(budget=60, searches=1, limits=DriverLimits(-80, 80, 20, 20, 0.1))


class UpTo(VirtualRig):
    """A rig that is switched off when it is asked for a recording whose name begins with ``last``."""

    def __init__(self, last):
        super().__init__(TRUE, 1)
        self.last = last

    def record(self, request, order):
        if request.name.startswith(self.last):
            raise KeyboardInterrupt
        return super().record(request, order)


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """A session at its end, and its result."""
    folder = tmp_path_factory.mktemp("ended")
    with pytest.MonkeyPatch.context() as patched:
        put_in_place(patched)
        session = Session(folder, SETTINGS, Exchange(folder, VirtualRig(TRUE, 1)))
        return session, session.run()


@pytest.fixture(scope="module")
def page(ended):
    session, tuned = ended
    path = session.folder / "report.html"
    write_page(path, session, "head 17", tuned)
    return path.read_text(encoding="utf-8")


@pytest.fixture
def diagnoses(monkeypatch):
    return put_in_place(monkeypatch)


def waiting(folder, asked, settings=SETTINGS):
    """A session that waits for the recordings whose names begin with ``asked``, and its requests."""
    with pytest.raises(KeyboardInterrupt):
        Session(folder, settings, Exchange(folder, UpTo(asked))).run()
    session = Session(folder, settings, Exchange(folder))
    with pytest.raises(WaitingError) as found:
        session.run()
    return session, found.value.requests


def rows_of(page, heading):
    """Cells of the first table below a heading, row by row, as text."""
    table = re.search(rf"<h2>{heading}.*?<tbody>(.*?)</tbody>", page, re.DOTALL).group(1)
    rows = re.findall(r"<tr.*?</tr>", table, re.DOTALL)
    return [
        [html.unescape(re.sub("<[^>]*>", "", cell)) for cell in re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL)]
        for row in rows
    ]


def text_of(page):
    """What a reader reads, without pictures."""
    without = re.sub(r"<(svg|style|script).*?</\1>", "", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub("<[^>]*>", " ", without)).split())


def without_code(page):
    """The page without what draws its picture."""
    return re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def volts(value):
    return f"{value:.3f}".replace("-", "−")


def test_the_page_tells_the_result_in_its_headline_and_every_number_in_its_table(ended, page):
    written = json.loads((ended[0].folder / "tune.json").read_text())
    (title,) = re.findall("<h1>(.*?)</h1>", page, re.DOTALL)
    assert f"it costs {volts(written['measured_V'])} ± {volts(written['error_V'])} V on the head" in title
    rows = rows_of(page, "Waveforms that were proposed")
    assert len(rows) == len(written["tried"]) > 1
    for row, one in zip(rows, written["tried"], strict=True):
        assert row[0].startswith("→") == (one["waveform"] == written["waveform"])
        shown = np.array([float(cell.replace("−", "-")) for cell in row[1:8]])
        np.testing.assert_allclose(shown, np.array(one["waveform"]) * [1, 1, *[1e6] * 5], rtol=1e-3)
        assert row[8:] == [
            volts(one["predicted_V"]),
            f"{volts(one['low_V'])} … {volts(one['high_V'])}",
            f"{volts(one['measured_V'])} ± {volts(one['error_V'])} at worst {volts(one['worst_V'])}",
        ]


def test_the_page_tells_of_every_diagnosis_request_recording_and_sentence_of_the_log(ended, page):
    session, tuned = ended
    text = text_of(page)
    first, second = rows_of(page, "Diagnoses")
    assert first[:4] == ["1", "38", "one of several", "one of second_mode, wave_echo"]
    assert second[:4] == ["2", "40", "named", "–"]
    before, asked, after = (text.index(words) for words in ("38 recordings A second mode or an echo.",
                            "Asked for: Record a pulse.", "40 recordings A second mode."))  # fmt: skip
    assert before < asked < after
    assert "request-1, request-1-2 (2 of 2)" in text
    counts = {tuple(row[:2]): int(row[2]) for row in rows_of(page, "What was recorded")}
    assert counts["first campaign", "strain gauge"] + counts["first campaign", "self-sensing"] == 38
    assert counts["asked for by a diagnosis", "self-sensing"] == 2
    assert counts["checks of waveforms", "self-sensing"] == len(tuned.proposals)
    assert counts["in all", ""] == tuned.recordings
    log = (session.folder / "log.md").read_text().splitlines()[2:]
    assert [f"* {time} {said}".replace("−", "-") for time, said in rows_of(page, "The session’s log")] == log
    assert without_code(page).count("<svg") == 2 + len(tuned.checks) + 1
    assert re.search('<h1>.*?class="zoomable".*?What to do next.*?In numbers.*?<details>', page, re.DOTALL)


def test_the_files_on_the_page_are_the_waveform(ended, page, tmp_path):
    _, tuned = ended
    held = dict(re.findall(r'download="([^"]*)" href="data:text/[a-z]*;base64,([^"]*)"', page))
    assert sorted(held) == ["waveform.csv", "waveform.ini"]
    chosen = tuned.proposals[tuned.best].as_waveform
    for name, content in held.items():
        (tmp_path / name).write_bytes(base64.b64decode(content))
        drive = read_drive(tmp_path / name)
        np.testing.assert_allclose(drive.drive_V, chosen.drive_V(drive.time_s), atol=1e-6)
        assert drive.time_s[-1] == pytest.approx(chosen.duration_s, abs=1.1e-8)


@pytest.mark.parametrize("elsewhere", [".", "pages of/mine"])
def test_the_page_needs_nothing_but_the_reports_of_its_own_session(ended, tmp_path, elsewhere):
    session, tuned = ended
    place = session.folder / elsewhere if elsewhere == "." else tmp_path / elsewhere
    place.mkdir(parents=True, exist_ok=True)
    write_page(place / "page.html", session, "head 17", tuned)
    page = without_code((place / "page.html").read_text(encoding="utf-8"))
    assert not re.search(r"https?:|url\((?!#)|<script[^>]* src|<link|@import|<img", page)
    targets = [t for t in re.findall(r'(?:src|href)="([^"]*)"', page) if not t.startswith(("#", "data:"))]
    assert len(targets) == 2
    for target in targets:
        assert (place / target).samefile(session.folder / target.rpartition("/")[2])


def test_a_waiting_session_names_each_request_and_draws_each_drive(tmp_path, diagnoses):
    session = Session(tmp_path, SETTINGS, Exchange(tmp_path))
    with pytest.raises(WaitingError) as found:
        session.run()
    requests = found.value.requests
    page = page_html(session, "bench", requests=requests)
    assert "the session waits for 38 recordings." in page
    rows = rows_of(page, "What to record")
    assert [row[0] for row in rows] == [request.name for request in requests]
    assert [int(row[4]) for row in rows] == [request.drive_V.size for request in requests]
    drives = {(request.step_s, request.drive_V.tobytes()) for request in requests}
    assert page.count("<svg") == len(drives) < 38
    assert sum(len(names.split(", ")) for names, _ in distinct(requests)) == 38
    text = text_of(page)
    assert all(request.purpose in text for request in requests)
    assert f"{tmp_path}/answers under the same name" in text


def test_a_session_that_waits_for_a_request_tells_which_diagnosis_asked(tmp_path, diagnoses):
    session, requests = waiting(tmp_path, "request")
    text = text_of(page_html(session, "bench", requests=requests))
    assert "the session waits for 2 recordings." in text
    assert "Asked for, and still to be recorded: Record a pulse." in text
    assert "Waveforms that were proposed" not in text


def test_a_session_that_waits_for_checks_shows_what_is_predicted(tmp_path, diagnoses):
    session, requests = waiting(tmp_path, "check")
    page = page_html(session, "bench", requests=requests)
    rows = rows_of(page, "Waveforms that were proposed")
    assert [row[8] for row in rows] == [volts(one.predicted_V) for one in session.waveforms]
    assert [row[10] for row in rows] == ["to be recorded"] * len(requests)
    assert "Checks on the head" not in page


def test_a_request_that_is_one_too_many_is_told_and_not_drawn(tmp_path, diagnoses):
    settings = replace(SETTINGS, most_requests=0)
    session = Session(tmp_path, settings, Exchange(tmp_path, VirtualRig(TRUE, 1)))
    page = page_html(session, "bench", session.run())
    text = text_of(page)
    assert "It would ask for another recording, but 0 were allowed: Record a pulse." in text
    assert "The diagnosis is not settled: A second mode or an echo." in text


def test_names_and_words_of_others_are_escaped(tmp_path, diagnoses, monkeypatch):
    hostile = "<script>alert('1')</script> & <i>"
    diagnose = session_module.diagnose

    def said(*arguments, **options):
        return SimpleNamespace(**vars(diagnose(*arguments, **options)) | {"headline": hostile})

    monkeypatch.setattr(session_module, "diagnose", said)
    folder = tmp_path / "<i>&"
    session, requests = waiting(folder, "request")
    requests = [replace(request, purpose=hostile) for request in requests]
    page = page_html(session, hostile, requests=requests)
    assert "<script" not in page
    assert "<i>" not in page
    escaped = html.escape(hostile).replace("&#x27;", "&#39;")
    assert page.count(escaped) == 2 + 2 + 1  # title and headline; diagnosis and its line of the log; the request


def test_the_headline_compares_with_the_base_models_waveform_and_keeps_to_the_error(ended):
    _, tuned = ended
    first = tuned.proposals[0]
    base = replace(first, name="base")
    clear, close = Measured(-12.0, 0.3, -11.0, 0.1, 0.1), Measured(-11.5, 0.3, -10.5, 0.1, 0.1)

    def said(proposals, checks):
        best = min(range(len(checks)), key=lambda k: checks[k].cost_V)
        return headline(replace(tuned, proposals=proposals, checks=checks, best=best))

    much = said((first, base), (clear, replace(close, cost_V=-9.0)))
    assert much.endswith("-12.000 ± 0.300 V on the head, 3.000 ± 0.424 V less than the base model's waveform")
    assert said((first, base), (clear, close)).endswith("0.500 ± 0.424 V less than the base model's waveform, a "
                                                        "difference that may be noise")  # fmt: skip
    assert "this one, the base model's" in said((first, base), (close, clear))
    assert "practically the same" in said((first,), (clear,))


def test_an_effect_is_told_once_whether_it_is_sure_or_a_candidate():
    told = {"effects": ["creep", "second_mode"], "candidates": [["second_mode", "air_bubble"]]}
    assert effects_of(told) == ["creep", "one of second_mode, air_bubble"]


def test_a_check_far_from_its_prediction_is_warned_of(ended):
    _, tuned = ended
    assert not any("wrong" in sentence for sentence in sentences(tuned))
    checks = tuple(replace(check, residual_V=10 * check.noise_V) for check in tuned.checks)
    assert any(
        "by 10.0 times the noise (RMS): the prediction is wrong" in s for s in sentences(replace(tuned, checks=checks))
    )


def test_pictures_show_what_was_recorded_beside_what_was_predicted(ended):
    session, tuned = ended
    by_name = {recording.name: recording for recording in session.exchange.recorded}
    proposal, check = tuned.proposals[0], tuned.checks[0]
    taken = by_name["check-1-robust"]
    taken = averaged(taken, proposal.as_waveform, tuned.head.frequency_Hz, SETTINGS.window_s)
    foretold_V = expected_V(taken, proposal.as_waveform, tuned.head, tuned.head.frequency_Hz, SETTINGS.window_s)
    _, signals, residual = check_figure(taken, foretold_V, check, SETTINGS.window_s).axes
    seen, modelled = (line.get_ydata() for line in signals.lines)
    np.testing.assert_array_equal(modelled, foretold_V[: modelled.size])
    np.testing.assert_allclose(residual.lines[0].get_ydata(), seen - modelled)
    assert np.std(seen - modelled) == pytest.approx(check.residual_V, rel=0.05)
    np.testing.assert_allclose(np.diff(seen), np.diff(taken.sensor[: seen.size]), atol=1e-12)  # all but the offset


def test_pictures_show_every_waveform_and_every_answer(ended):
    session, tuned = ended
    drive, response = waveforms_figure(tuned, SETTINGS).axes
    widths = [line.get_linewidth() for line in drive.lines]
    assert widths.index(max(widths)) == tuned.best
    for line, shown, proposal in zip(drive.lines, response.lines, tuned.proposals, strict=True):
        at_s = line.get_xdata() * 1e-6
        np.testing.assert_allclose(line.get_ydata(), proposal.as_waveform.drive_V(at_s), atol=1e-6)
        peaks_V = tuned.head.respond(proposal.as_waveform, window_s=SETTINGS.window_s).peaks_V
        assert np.abs(shown.get_ydata()).max() == pytest.approx(np.abs(peaks_V).max(), rel=1e-2)
    asked = requests_of_round(session.rounds[0]["requests"], 0)
    answers = [recording for recording in session.exchange.recorded if recording.name.startswith("request")]
    upper, lower = request_figure(asked[0], answers).axes
    np.testing.assert_array_equal(upper.lines[0].get_ydata(), PULSE_V)
    for line, answer in zip(lower.lines, answers, strict=True):
        np.testing.assert_array_equal(line.get_ydata(), answer.sensor)
