import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.estimate import Estimate
from inkjet_env.identification import identify
from inkjet_env.identification.fit import RESIDUAL
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.reporting import identification_report
from inkjet_env.reporting.formatting import channels_in_words, interval_text
from inkjet_env.reporting.identification_figures import amplitude_densities, degree_figure, terms_of
from inkjet_env.reporting.identification_report import (
    branches,
    broadest_recording,
    explains,
    has_unexplained_residual,
    headline,
    identification_html,
    loop_recordings,
    measured_branches,
    noise_of,
    parameter_rows,
    ringing_views,
    write_identification_report,
)
from inkjet_env.rig import default_battery, record_campaign

HEAD = Printhead.published()
GAUGE = ("loop-1", "minor-loops", "zero")
FAST = ("trapezoid-60V", "trapezoid-100V", "bipolar-full", "multisine-50V-a", "step", "zero")


def line(label, channel="self_sensing"):
    (found,) = (one for one in default_battery() if (one.label, one.channel) == (label, channel))
    return found


@pytest.fixture(scope="module")
def everything():
    """Strain gauge and self-sensing."""
    battery = [line(label, "strain_gauge") for label in GAUGE] + [line(label) for label in FAST]
    return identify(record_campaign(HEAD, 0, battery=battery, snr_dB=40))


@pytest.fixture(scope="module")
def self_sensing_only():
    lines = [line(label) for label in ("trapezoid-60V", "bipolar-full", "zero")]
    return identify(record_campaign(HEAD, 0, battery=lines, snr_dB=40), degree=4)


@pytest.fixture(scope="module")
def one_displacement():
    """A single recording, its end held out, of a head that rings at two frequencies."""
    pulse = line("first-bipolar")
    moves = replace(pulse, channel="displacement", drive_V=np.concatenate([np.zeros(200), pulse.drive_V]))
    heads = (HEAD, HEAD.varied(frequency_Hz=1.3 * HEAD.frequency_Hz))
    first, second = (record_campaign(head, 0, battery=[moves], snr_dB=50).recordings[0] for head in heads)
    both = first.sensor + 0.3 * second.sensor
    recording = Recording("only", first.time_s, first.drive_V, both, "um", "displacement", initial_state="demagnetised")
    return identify(Campaign("pair", (recording,)), degree=4)


@pytest.fixture(scope="module")
def pages(everything, self_sensing_only, one_displacement):
    """The three pages by what they show, each with its identification."""
    shown = {"everything": everything, "self_sensing_only": self_sensing_only, "one_displacement": one_displacement}
    return {name: (found, identification_html("head-17", found)) for name, found in shown.items()}


@pytest.fixture(params=["everything", "self_sensing_only", "one_displacement"])
def any_of_them(request, pages):
    return pages[request.param]


@pytest.fixture
def undrawn(monkeypatch):
    """Pages whose sentences alone are looked at: their pictures, which take the time, are not drawn."""
    monkeypatch.setattr(identification_report, "svg_text", lambda _: "<svg></svg>")


def without_code(page):
    """The page without what draws its picture."""
    return re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def test_the_page_stands_alone(any_of_them):
    page = any_of_them[1]
    own = without_code(page)
    assert not re.search(r"https?:|url\((?!#)|<link|@import|<script[^>]* src", own)
    assert all(target.startswith(("#", "data:")) for target in re.findall(r'(?:src|href)="([^"]*)"', own))
    assert re.search('<h1>.*?class="zoomable".*?What to do next.*?<h2>Parameters.*?<details>', page, re.DOTALL)
    assert len(page) < 3e6


def test_the_page_names_every_recording_every_note_and_every_number(any_of_them):
    identification, page = any_of_them
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", page)
    for recording in identification.recordings:
        assert cells.count(recording.name) == 2 if 0 < recording.fitted < recording.measured.size else 1
    for _, value, interval, *_ in parameter_rows(identification):
        assert value in cells
        assert interval in cells
    text = page.replace("&#39;", "'").replace("&gt;", ">")
    assert all(channels_in_words(note) in text for note in identification.notes)
    assert all(model.source in cells for model in identification.noise.values())
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL).lower().split()


def test_a_head_that_leaves_a_residual_is_diagnosed_before_it_is_used(everything, undrawn):
    loud = tuple(replace(r, measured=r.modelled["base"] + 3 * r.residual()) for r in everything.recordings)
    poor = replace(everything, recordings=loud)
    assert explains(everything)
    assert not explains(poor)
    well, badly = (identification_html("head", found) for found in (everything, poor))
    diagnose, optimize = "inkjet diagnose DIR", "inkjet optimize --printhead"
    assert well.index(optimize) < well.index(diagnose)
    assert badly.index(diagnose) < badly.index(optimize)
    assert "The model does not explain these recordings yet." in badly
    assert "does not explain" in headline(poor)


def test_every_picture_is_on_the_page(pages):
    pictures = {name: without_code(page).count("<svg") for name, (_, page) in pages.items()}
    assert pictures == {"everything": 2 + 6, "self_sensing_only": 6, "one_displacement": 1 + 6}
    assert "is not a hysteresis loop" in pages["self_sensing_only"][1]


def test_parameters_show_what_was_identified(everything):
    rows = {(symbol, unit): float(value.replace("−", "-")) for symbol, value, _, unit, _ in parameter_rows(everything)}
    head = everything.printhead
    assert rows["f0", "kHz"] == pytest.approx(head.frequency_Hz / 1e3, rel=1e-4)
    assert rows["ζ", ""] == pytest.approx(head.damping_ratio, rel=1e-3)
    assert rows["b1", "1/s"] == pytest.approx(head.b1, rel=1e-3)
    assert rows["gain", "V/V"] == pytest.approx(everything.gains["strain_gauge"].value, rel=1e-3)


def test_the_interval_of_the_damping_ratio_follows_those_of_a0_and_a1(everything):
    known = {"a0": Estimate(4.0, 4.0, 4.0), "a1": Estimate(1.0, 0.9, 1 / 0.9), "b1": Estimate(1.0, 1.0, 1.0)}
    changed = replace(everything, dynamics=known)
    zeta, frequency = everything.printhead.damping_ratio, 1 / math.pi
    rows = {symbol: interval for symbol, _, interval, *_ in parameter_rows(changed)}
    low, high = (float(v) for v in rows["ζ"].split(" … "))
    assert (low / zeta, high / zeta) == pytest.approx((0.9, 1 / 0.9), rel=0.01)
    assert rows["f0"] == f"{frequency:.6f} … {frequency:.6f}"


def test_a_good_fit_is_called_good_and_a_bad_one_bad(everything, one_displacement):
    assert re.search(
        r"the model explains the held-out recordings to (0\.9\d|1\.0\d) times their noise$", headline(everything)
    )
    assert re.match(r"resonance 51\.\d+ kHz, damping ratio 0\.04\d+; ", headline(everything))
    bad = headline(one_displacement)
    assert bad.startswith("do not use this head: on held-out recordings of displacement its residual is")
    ratio = float(re.search(r"is ([\d.]+) times", bad).group(1))
    (recording,) = one_displacement.recordings
    assert ratio == pytest.approx(recording.rms() / recording.noise_rms, rel=0.01)


def test_a_residual_that_has_the_noises_size_but_not_its_spectrum_is_told(everything):
    note = "self_sensing: the residual is 1.31 times the noise, so the model leaves something out."
    misfit = {"strain_gauge": 1.0, "self_sensing": 1.31}
    told = headline(replace(everything, misfit=misfit, notes=(note,)))
    assert "it has structure in the fitted ones: whitened, it is 1.31 times that of self-sensing" in told


def test_headline_and_notes_agree_on_what_is_not_explained(everything, one_displacement):
    assert not any(has_unexplained_residual(everything, channel) for channel in everything.gains)
    assert has_unexplained_residual(one_displacement, "displacement")
    assert not has_unexplained_residual(replace(one_displacement, notes=()), "displacement")


def test_noise_that_only_the_fit_shows_proves_nothing(everything):
    noise = {key: replace(model, source=RESIDUAL) for key, model in everything.noise.items()}
    assert "cannot be decided" in headline(replace(everything, noise=noise))


def test_unknown_noise_is_a_dash_and_no_crash(one_displacement, undrawn):
    silent = tuple(replace(recording, noise_rms=math.nan) for recording in one_displacement.recordings)
    changed = replace(one_displacement, recordings=silent, noise={})
    assert "their noise is unknown" in headline(changed)
    assert "<td>–</td>" in identification_html("x", changed)


def test_without_held_out_recordings_the_headline_says_so(everything):
    seen = tuple(replace(recording, fitted=recording.measured.size) for recording in everything.recordings)
    assert "the fitted recordings (none was held out)" in headline(replace(everything, recordings=seen))


def test_special_characters_are_escaped_and_harm_no_picture(tmp_path, one_displacement):
    (recording,) = one_displacement.recordings
    strange = replace(one_displacement, recordings=(replace(recording, name="a$\\frac$<i>&"),))
    path = tmp_path / "page.html"
    write_identification_report(path, "<script>alert(1)</script> & 'Söhne'", strange)
    assert list(tmp_path.iterdir()) == [path]
    page = path.read_text(encoding="utf-8")
    assert "<script>alert" not in page
    page = without_code(page)
    assert page.count("&lt;script&gt;alert(1)&lt;/script&gt; &amp; &#39;Söhne&#39;") == 2
    assert "a$\\frac$&lt;i&gt;&amp;" in page
    assert "<i>" not in page
    assert page.endswith("</html>")


def test_a_page_that_cannot_be_made_leaves_the_old_one(tmp_path, one_displacement):
    path = tmp_path / "page.html"
    path.write_text("before")
    with pytest.raises(ValueError):
        write_identification_report(path, "x", replace(one_displacement, recordings=()))
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_the_same_identification_gives_the_same_page(pages):
    identification, page = pages["one_displacement"]
    assert identification_html("head-17", identification) == page


def test_branches_follow_the_branch_law_whatever_came_before():
    law = HEAD.branch_law
    for label in ("minor-loops", "loop-1", "staircase"):
        drive = line(label, "strain_gauge").drive_V
        followed = law.hysteretic_V(drive, line(label, "strain_gauge").initial_state)
        found = branches(drive)
        assert found
        for start, end in found:
            x = np.abs(drive[start : end + 1] - drive[start]) / law.full_scale_V
            moved = np.abs(followed[start : end + 1] - followed[start]) / law.full_scale_V
            np.testing.assert_allclose(moved, law.Q(x), atol=1e-9)


def test_a_drive_that_never_turns_back_has_no_branch():
    assert branches(np.array([0.0, 0.0, 10.0, 60.0, 60.0])) == []


def test_measured_branches_lie_off_the_law_by_noise_alone(everything):
    for heading in (1, -1):
        x, off = measured_branches(everything, heading)
        assert x.size > 300
        assert x.min() > 0
        assert x.max() == pytest.approx(1, abs=0.01)
        noise = max(model.rms for (channel, _), model in everything.noise.items() if channel == "strain_gauge")
        scale = everything.gains["strain_gauge"].value * everything.printhead.full_scale_V
        assert off.std() == pytest.approx(noise / scale, rel=0.15)
        assert abs(off.mean()) < 5 * off.std() / math.sqrt(off.size)


def test_loops_are_the_plain_one_and_the_nested_ones(everything, self_sensing_only):
    plain, nested = loop_recordings(everything)
    assert {plain.channel, nested.channel} == {"strain_gauge"}
    assert np.ptp(plain.drive_V) == pytest.approx(180)
    assert nested.measured.size == line("minor-loops", "strain_gauge").drive_V.size
    assert loop_recordings(self_sensing_only) == []


def test_ringing_shows_held_out_first_and_no_drive_twice(everything):
    fast = [r for r in everything.recordings if r.channel == "self_sensing" and np.ptp(r.drive_V) > 0]
    views = ringing_views(fast, HEAD.frequency_Hz)
    assert len(views) == 3
    assert views[0].held_out
    assert len({view.recording.drive_V.tobytes() for view in views}) == 3
    assert [view.held_out for view in views] == sorted((view.held_out for view in views), reverse=True)


def test_error_against_degree_is_of_the_strain_gauge_and_of_everything(everything, self_sensing_only):
    def curves(identification):
        lines = [panel.lines for panel in degree_figure(identification).axes[::2]]
        return [{one.get_label(): tuple(one.get_ydata()) for one in panel} for panel in lines]

    alone, joint = curves(everything)
    assert alone["fit"] == everything.degree.rms_error
    assert joint["fit"] == everything.joint_degree.rms_error
    assert f"used: {len(everything.printhead.coefficients) - 1}" in joint
    (only,) = curves(self_sensing_only)
    assert only["fit"] == self_sensing_only.joint_degree.rms_error
    assert "used: 4" in only


def test_settings_tell_the_degree_by_every_rule(pages):
    identification, page = pages["everything"]
    fit = identification.fit_json()
    told = dict(re.findall(r"<td>(degree [^<]*)</td><td[^>]*>(\d+)</td>", page))
    assert told.pop("degree used") == str(len(identification.printhead.coefficients) - 1)
    by = {"all recordings": "flattening", "strain gauge’s error": "strain_gauge", "in turn": "held_out"}
    for ending, rule in by.items():
        degree = fit[f"degree_by_{rule}"]
        assert [value for words, value in told.items() if words.endswith(ending)] == [str(degree)] * (
            degree is not None
        )


def test_a_partly_held_out_recording_is_shown_in_both_parts(one_displacement):
    (recording,) = one_displacement.recordings
    fitted, held_out = terms_of(recording)
    assert (fitted.role, held_out.role) == ("fitted", "held out")
    assert fitted.samples.stop == held_out.samples.start == recording.fitted
    assert held_out.rms == pytest.approx(recording.rms())
    views = ringing_views([recording], HEAD.frequency_Hz)
    assert [view.held_out for view in views] == [False, True]
    edge = int(np.argmax(np.abs(np.diff(recording.drive_V))))
    assert views[0].samples.start <= edge < views[0].samples.stop


def test_a_spectrum_holds_the_signals_power(everything):
    recording = next(r for r in everything.recordings if np.ptp(r.drive_V) == 100 and r.measured.size == 4000)
    frequency, density = amplitude_densities(recording, recording.measured)
    assert np.sum(density[:-1] ** 2) * frequency[1] == pytest.approx(np.var(recording.measured), rel=1e-3)


def test_the_broadest_recording_is_no_step(everything):
    fast = [r for r in everything.recordings if r.channel == "self_sensing" and np.ptp(r.drive_V) > 0]
    assert broadest_recording(fast).measured.size == 4000  # the multisine


def test_the_noise_model_is_drawn_as_loud_as_the_noise(one_displacement):
    (recording,) = one_displacement.recordings
    frequency = np.linspace(0, 0.5 / recording.step_s, 4001)[1:]
    density = noise_of(recording, one_displacement).spectrum(frequency, recording.step_s)
    assert one_displacement.misfit["displacement"] > 2
    assert math.sqrt(density.mean() * frequency[-1]) == pytest.approx(recording.noise_rms, rel=0.2)
    assert noise_of(SimpleNamespace(channel="strain_gauge", step_s=1.0), one_displacement) is None


def test_an_interval_decides_how_many_digits_are_shown():
    assert interval_text(Estimate(0.04691, 0.04571, 0.04811)) == ("0.0469", "0.0457 … 0.0481")
    assert interval_text(Estimate(123456.0, 120000.0, 126912.0)) == ("123500", "120000 … 126900")
