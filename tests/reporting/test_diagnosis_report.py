import base64
import html
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.estimate import Estimate
from inkjet_env.identification import ModelledRecording
from inkjet_env.mismatch.design.next_experiment import NextExperiment
from inkjet_env.mismatch.diagnosis import Diagnosis, HypothesisScore, NamedEffect
from inkjet_env.mismatch.localization.location import Location
from inkjet_env.mismatch.selection.remainder_fit import FittedRemainder
from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.remainder import TIMES, ChannelRemainder, Remainder, Term
from inkjet_env.printhead import Printhead
from inkjet_env.reporting import diagnosis_figures
from inkjet_env.reporting import page as page_module
from inkjet_env.reporting.diagnosis_figures import (
    augmented,
    models_of,
    proof_recording,
    residual_densities,
    view_picture,
    zoom_of,
)
from inkjet_env.reporting.diagnosis_report import diagnosis_html, head_words, write_diagnosis_report
from inkjet_env.reporting.diagnosis_tables import (
    candidate_rows,
    channel_rows,
    condition_rows,
    parameter_rows,
    view_tables,
)
from inkjet_env.reporting.formatting import channels_in_words, engineering, quantity_text, short
from inkjet_env.reporting.zoomable import MOST_SAMPLES, kept_samples
from inkjet_env.rig import default_battery, record_campaign

HEAD = Printhead.published()
LABELS = {
    "strain_gauge": ("loop-1", "minor-loops", "zero"),
    "self_sensing": ("trapezoid-60V", "bipolar-full", "multisine-50V-a", "zero"),
}
HELD_OUT = {line.drive_V.tobytes() for line in default_battery() if line.label == "multisine-50V-a"}
EFFECTS = {effect.id: effect for effect in catalogue()}
VALUES = {"capacitive_s": 2.1e-8, "lossy": 4e-4, "lag_s": 0.0}


def shown_by_effect(recording):
    """What feedthrough adds to a recording."""
    excitation = Excitation(recording.channel, recording.initial_state, recording.step_s, recording.drive_V)
    on = Plant(HEAD, effects=((EFFECTS["feedthrough"], VALUES),)).signal(excitation)
    return on - Plant(HEAD).signal(excitation)


@pytest.fixture(scope="module")
def named():
    """Feedthrough in a small virtual campaign; the base model is the head without it."""
    battery = [line for line in default_battery() if line.label in LABELS[line.channel]]
    noisy, calm = (record_campaign(HEAD, 1, battery=battery, snr_dB=snr_dB) for snr_dB in (50, math.inf))
    recordings = []
    for recording, silent in zip(noisy.recordings, calm.recordings, strict=True):
        added = shown_by_effect(recording)
        noise = [
            r.sensor - s.sensor
            for r, s in zip(noisy.recordings, calm.recordings, strict=True)
            if r.channel == recording.channel
        ]
        recordings.append(
            ModelledRecording(
                recording.name,
                recording.channel,
                "V",
                recording.order,
                recording.time_s[1] - recording.time_s[0],
                recording.drive_V,
                recording.sensor + added,
                {"base": silent.sensor, "augmented": silent.sensor + added},
                0 if recording.drive_V.tobytes() in HELD_OUT else recording.drive_V.size,
                float(np.std(np.concatenate(noise))),
            )
        )
    effect = EFFECTS["feedthrough"]
    found = NamedEffect(
        effect,
        effect.description(VALUES),
        5312.4,
        0.005,
        {"capacitive_s": Estimate(2.1e-8, 2.07e-8, 2.13e-8), "lossy": Estimate(4e-4, 3.1e-4, 4.9e-4)},
        VALUES,
    )
    tables = {
        "time in the waveform": (("on the edges", 46.0, 210.0), ("in the dwells", 1.1, 2.3)),
        "frequency": tuple((f"{k} kHz to {k + 5} kHz", 1 + k / 10, k / 3) for k in range(5, 205, 5)),
        "sign": (("positive drives", 3.1, 14.0), ("negative drives", 2.9, 12.0)),
    }
    return Diagnosis(
        campaign="head-17",
        verdict="named",
        headline=effect.description(VALUES),
        effects=(found,),
        minor=(),
        candidates=(),
        location=Location(
            ("r005", "r007"), ((1e-6, 3e-6),), ((9e4, 1.1e5),), ((60, 100),), "On the edges of the drive.", tables
        ),
        recordings=tuple(recordings),
        closure=0.9712,
        left_over=0.0,
        held_out_left_over=0.0,
        overlap=0.0,
        p_value=1.0,
        attributions=(
            HypothesisScore(("feedthrough",), 5312.4, 1711.0, 160.0, 1.0, 1.0, effect.description(VALUES)),
            HypothesisScore(("sensor_bandwidth",), 612.0, 90.0, 130.0, 0.11, 0.21, "The sensor passes up to 900 kHz."),
            HypothesisScore(
                ("sensor_bandwidth", "sensor_saturation"), 613.0, 80.0, 130.0, 0.11, math.nan, "Both <i>together</i>."
            ),
        ),
        untestable={"crosstalk": "no recording has the neighbouring channel's drive (column neighbour_V)"},
        next_experiments=(),
        remainder=None,
        printhead=HEAD,
        gains={"self_sensing": HEAD.b1, "strain_gauge": 0.01},
        offsets={"self_sensing": 0.0, "strain_gauge": 0.1},
        base_printhead=HEAD.varied(damping_ratio=0.05),
        dynamics={name: Estimate(v, 0.9 * v, 1.1 * v) for name in ("a0", "a1", "b1") for v in (getattr(HEAD, name),)},
        probabilities={"feedthrough": 0.94, "none of these": 0.05, "nothing": 0.01},
        notes=("self_sensing: noise from recordings at rest and repeats.",),
        seconds=61.2,
        stages={"base model": 8.1, "bootstrap": 40.2, "attribution": 12.9},
    )


@pytest.fixture(scope="module")
def one(named):
    """The same with a single recording, held out."""
    return replace(named, recordings=tuple(r for r in named.recordings if r.held_out))


@pytest.fixture(scope="module")
def diagnoses(named):
    """One of each verdict."""
    same = tuple(replace(r, modelled=dict.fromkeys(r.modelled, r.modelled["base"])) for r in named.recordings)
    calm = tuple(
        replace(alike, measured=r.residual("augmented") + r.modelled["base"])
        for alike, r in zip(same, named.recordings, strict=True)
    )
    drive = tuple(np.repeat([0.0, 80.0, 0.0], (40, 200, 400)))
    experiment = NextExperiment(
        "Record the voltage at the head along with the drive.", "self_sensing", "periodic", 1e-7, drive, 84.0
    )
    corrected = tuple(
        replace(r, modelled={**r.modelled, "with_remainder": r.modelled["base"] + 0.6 * r.residual("base")})
        for r in same
    )
    terms = {"drive": Term(0.2, 1.0)}
    remainder = Remainder({"self_sensing": ChannelRemainder({"drive": 100.0}, terms, {}, dict.fromkeys(TIMES, ()))})
    nothing = {"effects": (), "closure": math.nan, "attributions": ()}
    return {
        "named": named,
        "set": replace(
            named,
            verdict="set",
            headline="One of two: the capacitance compensation or the sensing amplifier's bandwidth",
            candidates=(("feedthrough", "sensor_bandwidth"),),
            next_experiments=(experiment,),
        ),
        "unknown": replace(
            named,
            verdict="unknown",
            headline="Structure is left that no effect of the catalogue explains.",
            effects=(),
            recordings=corrected,
            closure=0.0,
            remainder=FittedRemainder(remainder, 410.0, 30.0, 0.84, {}, ()),
        ),
        "none": replace(
            named,
            verdict="none",
            headline="The base model explains the recordings to their noise",
            recordings=calm,
            location=Location(),
            **nothing,
        ),
    }


@pytest.fixture(scope="module")
def pages(diagnoses):
    return {verdict: diagnosis_html(found) for verdict, found in diagnoses.items()}


@pytest.fixture(params=["named", "set", "unknown", "none"])
def any_of_them(request, diagnoses, pages):
    return diagnoses[request.param], pages[request.param]


@pytest.fixture
def undrawn(named, monkeypatch):
    """Pages whose sentences alone are looked at: their pictures, which take the time, are not drawn."""
    recording = proof_recording(named)
    picture = view_picture("shows", recording, {"base": recording.modelled["base"]}, slice(0, 100))
    monkeypatch.setattr(diagnosis_figures, "view_picture", lambda *_, **__: picture)
    monkeypatch.setattr(page_module, "svg_text", lambda _: "<svg></svg>")


def text_of(page):
    """What a reader reads: no pictures, no tags."""
    without = re.sub(r"<(style|svg|script).*?</\1>", " ", page, flags=re.DOTALL)
    plain = re.sub(r"<[^>]*>", " ", without)
    return re.sub(r"\s+", " ", html.unescape(plain))


def test_the_page_stands_alone(any_of_them):
    page = any_of_them[1]
    own = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"https?:|url\((?!#)|<link|@import|<script[^>]* src", own)
    assert all(target.startswith(("#", "data:")) for target in re.findall(r'(?:src|href)="([^"]*)"', own))
    assert len(page) < 3e6
    assert page.endswith("</html>")


def test_the_verdict_comes_first_in_plain_words(any_of_them):
    diagnosis, page = any_of_them
    told = text_of(re.search(r"<h1>.*?</h1>", page, re.DOTALL).group())
    assert re.search('<h1>.*?class="zoomable".*?What to do next.*?In numbers.*?<details>', page, re.DOTALL)
    assert told.strip() == f"Head ‘head-17’: {diagnosis.headline.rstrip('.')}."


def test_every_recording_hypothesis_and_note_is_on_the_page(any_of_them):
    diagnosis, page = any_of_them
    text = text_of(page)
    assert all(re.search(rf"\b{r.name}\b", text) for r in diagnosis.recordings)
    assert all(" + ".join(a.ids) in text and a.description in text for a in diagnosis.attributions)
    assert all(channels_in_words(note) in text for note in diagnosis.notes)
    assert all(stage in text for stage in diagnosis.stages)
    assert all(f"{effect_id} {reason}" in text for effect_id, reason in diagnosis.untestable.items())
    assert "nan" not in text.lower().split()


def test_each_verdict_shows_what_belongs_to_it_alone(pages):
    belongs = {
        "named": "Optimise a waveform on the corrected head",
        "set": "Candidates that these recordings cannot distinguish",
        "unknown": "corrects without explaining",
        "none": "This does not state the smallest effect",
    }
    for verdict, page in pages.items():
        shown = {other for other, words in belongs.items() if words in text_of(page)}
        assert shown == {verdict}


def test_what_only_held_out_recordings_speak_against_is_told_as_that(named, undrawn):
    refused = replace(named, verdict="unknown", effects=(), closure=-1.64)
    alone, beside_more = (text_of(diagnosis_html(replace(refused, left_over=left))) for left in (0.02, 0.2))
    for text in (alone, beside_more):
        assert "the closest hypothesis does worse than the base model, so it is rejected" in text
        assert "corrected" not in text
        assert "or choice" not in text
    told = ("makes the fit of the held-out ones worse, so it is not named", "has structure that", "too large for it")
    assert [words in alone for words in told] == [True, False, False]
    assert [words in beside_more for words in told] == [False, True, True]


def test_an_unknown_cause_names_the_recordings_to_hold_out_instead(named, undrawn):
    mine = [r for r in named.recordings if r.channel == named.main_channel]
    fitted, held_out = ([r.name for r in mine if r.held_out is which] for which in (False, True))
    text = text_of(diagnosis_html(replace(named, verdict="unknown", effects=())))
    told = re.search(r"let the fits see them: inkjet diagnose DIR --hold-out (\S+)", text)
    assert told is not None
    assert set(told[1].split(",")) <= set(fitted)
    assert len(told[1].split(",")) == min(len(held_out), len(fitted))
    assert "--hold-out" not in text_of(diagnosis_html(named))


def test_a_page_does_not_doubt_what_its_verdict_names(named, undrawn):
    explains_held_out_after_refit = text_of(diagnosis_html(replace(named, closure=-1.64)))
    assert "but it explains them once it is fitted to them as well" in explains_held_out_after_refit
    assert "rejected" not in explains_held_out_after_refit
    refused = replace(named, verdict="unknown", effects=(), left_over=0.0)
    poorly, alike = (text_of(diagnosis_html(replace(refused, closure=closure))) for closure in (0.3, 0.9))
    assert "does not explain the held-out ones, so it is not named" in poorly
    assert "too many effects explain equally well" in alike
    doubted = replace(refused, closure=0.9, probabilities={"none of these": 0.3, "creep": 0.7})
    doubted = text_of(diagnosis_html(doubted))
    assert "but so may physics that it lacks, so none is named" in doubted
    for text in (poorly, alike, doubted):
        assert "has structure that" not in text
        assert "damping ratio" not in text  # the head of a model that has no name


def test_a_page_of_an_unknown_verdict_in_which_nothing_was_found_speaks_of_no_effect(diagnoses, undrawn):
    said = "The residuals have structure that noise has not, but no effect of the catalogue explains it."
    found = replace(diagnoses["none"], verdict="unknown", headline=said, left_over=0.0)
    page = text_of(diagnosis_html(found))
    assert f"None. {said}" in page
    assert "The effect that explains" not in page
    assert "equally well" not in page


def test_candidates_are_told_as_the_whole_model_that_has_them(named):
    """A fit of a candidate alone has other values than the verdict, which comes from a joint fit."""
    beside = replace(named.effects[0], effect=EFFECTS["creep"], sentence="It creeps.")
    joint = [
        HypothesisScore(ids, gain, 0.0, 1.0, 1.0, 1.0, words)
        for ids, gain, words in (
            (("second_mode",), 10.0, "A mode at 75.1 kHz."),
            (("creep", "second_mode"), 40.0, "A mode at 87.9 kHz, and creep."),
            (("air_bubble", "creep"), 39.0, "A bubble, and creep."),
        )
    ]
    effects = (replace(named.effects[0], effect=EFFECTS["second_mode"], sentence="A mode at 87.9 kHz."), beside)
    groups = (("second_mode", "air_bubble", "wave_echo"),)
    found = replace(named, verdict="set", effects=effects, candidates=groups, attributions=tuple(joint))
    (rows,) = candidate_rows(found)
    assert rows[0] == ("second_mode", "A mode at 87.9 kHz. It creeps.", 40.0)  # as the effects found are told
    assert rows[1] == ("air_bubble", "A bubble, and creep.", 39.0)
    assert rows[2][1] == EFFECTS["wave_echo"].sentence
    assert math.isnan(rows[2][2])


def test_a_set_shows_its_candidates_before_the_one_that_is_in_the_figures(pages):
    text = text_of(pages["set"])
    assert "Effects found" not in text
    table, values = (
        text.rindex("Candidates that these recordings cannot"),
        text.rindex("feedthrough , one of the candid"),
    )
    assert text.index("What is missing: one of several") < table < values


def files_of(page):
    """Texts of the files that a page holds in itself, by name."""
    held = re.findall(r'download="([^"]*)" href="data:[^;]*;base64,([^"]*)"', page)
    return {name: base64.b64decode(content).decode() for name, content in held}


def test_files_of_a_page_are_the_head_and_what_to_record(diagnoses, pages):
    for verdict, found in diagnoses.items():
        files = files_of(pages[verdict])
        corrected = verdict in ("named", "set")
        assert set(files) == {"corrected.json" if corrected else "printhead.json", "fit.csv"} | (
            {"next.csv"} if verdict == "set" else set()
        )
        head = json.loads(files["corrected.json" if corrected else "printhead.json"])
        assert ("effects" in head) == corrected
        assert len(files["fit.csv"].splitlines()) == 1 + len(channel_rows(found))
        last = {"none": "base_rms", "unknown": "closest_rms"}.get(verdict, "corrected_rms")
        assert files["fit.csv"].splitlines()[0].endswith(f",{last}")
    lines = files_of(pages["set"])["next.csv"].splitlines()
    assert lines[0] == "time_s,drive_V"
    assert [float(line.split(",")[1]) for line in lines[1:]] == list(diagnoses["set"].next_experiments[0].drive_V)


def test_only_a_head_with_effects_is_offered_as_corrected(diagnoses, pages):
    assert head_words(diagnoses["named"]) == "the corrected printhead"
    assert head_words(diagnoses["set"]) == "the corrected printhead, with feedthrough"
    assert head_words(diagnoses["none"]) == "the base printhead: no effect was found"
    told = "the base printhead with the unexplained remainder: no effect was named"
    assert head_words(diagnoses["unknown"]) == told
    for verdict, page in pages.items():
        assert ("the corrected printhead" in text_of(page)) == (verdict in ("named", "set"))


def test_no_more_than_everything_is_explained(named, undrawn):
    text = text_of(diagnosis_html(replace(named, closure=1.012)))
    assert "101 %" not in text
    assert "removes 100 % of the base model’s residual power" in text


def test_readers_meet_one_word_for_the_corrected_model(pages):
    assert not any("augmented" in text_of(page) for page in pages.values())


def test_the_picture_tells_what_was_measured_and_modelled(named):
    recording = proof_recording(named)
    models = models_of(recording, named)
    zoom = zoom_of(recording, models, HEAD.frequency_Hz)
    picture = view_picture("shows", recording, models, zoom)
    assert [label for label, *_ in picture.legend] == ["measured", "base model", "corrected model", "± 2 × noise"]
    text = json.dumps(picture.item)
    assert text == json.dumps(view_picture("shows", recording, models, zoom).item)
    assert not re.search(r'"id": "p\d+"', text)
    for label in ("measured", "base model", "corrected model"):
        assert f'["{label}", "@y' in text


def test_thinned_lines_keep_every_peak_and_all_that_is_seen_first():
    signal = np.random.default_rng(0).normal(size=1_000_003)
    signal[[70, 500_001, 999_999]] = 30.0, -40.0, 50.0
    view = slice(400_000, 401_500)
    kept = kept_samples([signal, -signal], view)
    assert {0, 70, 500_001, 999_999, signal.size - 1} <= set(kept)
    assert set(range(view.start, view.stop)) <= set(kept)
    assert kept.size < 3 * MOST_SAMPLES
    assert np.all(np.diff(kept) > 0)
    np.testing.assert_array_equal(kept_samples([signal[:50]], None), np.arange(50))


def test_candidates_are_told_with_what_sets_them_apart(diagnoses, pages):
    text = text_of(pages["set"])
    for candidate in diagnoses["set"].candidates[0]:
        assert EFFECTS[candidate].signature in text
    table = text[text.index("Candidates that these") : text.index("Each row describes")]
    assert all(a.description in table for a in diagnoses["set"].attributions if len(a.ids) == 1)
    assert "Expected difference of the candidates’ log-likelihoods: 84.0; 21.5 settle it" in text


def test_only_a_model_with_effects_is_called_corrected(diagnoses, pages):
    for verdict, found in diagnoses.items():
        assert augmented(found.recordings) == (verdict in ("named", "set"))
        assert ("Fit before and after" in pages[verdict]) == augmented(found.recordings)


def test_the_same_diagnosis_gives_the_same_page(one):
    assert diagnosis_html(one) == diagnosis_html(one)


def test_special_characters_are_escaped_and_harm_no_picture(tmp_path, one):
    strange = tuple(replace(r, name=f"{r.name}$\\frac$<i>&") for r in one.recordings)
    path = tmp_path / "page.html"
    write_diagnosis_report(path, replace(one, campaign="<script>alert(1)</script>", recordings=strange))
    page = path.read_text(encoding="utf-8")
    assert list(tmp_path.iterdir()) == [path]
    assert "<script>alert" not in page
    assert "<i>&" not in page
    assert "$\\frac$&lt;i&gt;&amp;" in page


def test_the_proof_is_the_held_out_recording_that_gains_most(named):
    proof = proof_recording(named)
    assert proof.held_out

    def gain(r):
        return np.sum(r.residual("base") ** 2 - r.residual("augmented") ** 2) / r.noise_rms**2

    assert gain(proof) == max(gain(r) for r in named.recordings if r.held_out)


def test_without_held_out_recordings_the_page_says_so(one, undrawn):
    seen = tuple(replace(r, fitted=r.measured.size) for r in one.recordings)
    text = text_of(diagnosis_html(replace(one, recordings=seen)))
    assert "No recording was held out" in text
    assert "fitted (none was held out)" in text


def test_the_zoom_holds_the_largest_difference_and_six_periods(named):
    recording = proof_recording(named)
    for where in (0, 700, recording.measured.size - 1):
        after = recording.modelled["base"].copy()
        after[where] += 1.0
        models = {"base": recording.modelled["base"], "augmented": after}
        zoom = zoom_of(recording, models, HEAD.frequency_Hz)
        assert zoom.start <= where < zoom.stop
        assert zoom.start >= 0
        assert zoom.stop <= recording.measured.size
        assert (zoom.stop - zoom.start) * recording.step_s == pytest.approx(6 / HEAD.frequency_Hz, rel=0.01)


def test_a_remainder_is_drawn_upon_the_model_that_carries_it(diagnoses):
    found = diagnoses["unknown"]
    recording = proof_recording(found)
    models = models_of(recording, found)
    assert list(models) == ["base", "with remainder"]
    left = np.std(recording.measured - models["with remainder"])
    assert left == pytest.approx(0.4 * np.std(recording.residual("base")), rel=1e-6)


def test_rows_of_a_channel_pool_its_recordings(named):
    for row in channel_rows(named):
        mine = [r for r in named.recordings if r.channel == row.channel and r.held_out == row.held_out]
        assert row.names == tuple(r.name for r in mine)
        every = np.concatenate([r.residual("base") for r in mine])
        assert row.base == pytest.approx(np.sqrt(np.mean(every**2)))
    row = next(r for r in channel_rows(named) if r.held_out)
    assert row.base == pytest.approx(named.heldout_rms("base"))
    expected = (row.base**2 - row.augmented**2) / (row.base**2 - row.noise**2)
    assert row.closure == pytest.approx(expected)


def test_the_first_line_says_what_is_left_in_the_channels_unit(named, undrawn):
    """As the table below it does; not in the volts of a displacement's gain."""
    moved = [
        replace(r, channel="displacement", unit="um") if r.channel == "self_sensing" else r for r in named.recordings
    ]
    found = replace(named, recordings=tuple(moved), gains={"displacement": 0.02, "strain_gauge": 0.01})
    row = next(r for r in channel_rows(found) if r.held_out and r.channel == "displacement")
    base, augmented, noise = (quantity_text(rms, "um") for rms in (row.base, row.augmented, row.noise))
    assert base == f"{short(1e3 * row.base)} nm"
    said = f"{base} (RMS) before, {augmented} after, noise {noise}."
    assert said in diagnosis_html(found)


def test_a_recording_that_leaves_noise_alone_has_no_closure(diagnoses):
    assert all(math.isnan(row.closure) for row in channel_rows(diagnoses["none"]))


def test_repeats_share_a_condition_and_every_sample_is_in_one(named):
    conditions = condition_rows(named)
    assert sorted(name for row, _ in conditions for name in row.names) == sorted(r.name for r in named.recordings)
    drives = {r.name: r.drive_V.tobytes() for r in named.recordings}
    for row, each in conditions:
        assert len({drives[name] for name in row.names}) == 1
        assert len(each) == (len(row.names) if len(row.names) > 1 else 0)
    assert any(each for _, each in conditions)


def test_a_recording_whose_end_is_held_out_is_shown_in_both_parts(one):
    (recording,) = one.recordings
    half = replace(one, recordings=(replace(recording, fitted=recording.measured.size // 2),))
    (first, _), (second, _) = condition_rows(half)
    assert (first.role, second.role) == ("held out", "fitted")
    assert first.base**2 + second.base**2 == pytest.approx(2 * np.mean((recording.residual("base")) ** 2))
    assert "held out from sample" in diagnosis_html(half)


def test_densities_hold_the_power_that_is_left(one):
    (recording,) = one.recordings
    white = np.random.default_rng(3).normal(0, recording.noise_rms, recording.measured.size)
    after = recording.modelled["augmented"]
    loud = replace(recording, measured=after + white, modelled={"base": after + 3 * white, "augmented": after})
    frequency, base, after, noise = residual_densities([loud, loud])
    assert np.all(np.diff(frequency) > 0)
    high = frequency > 0.2 * frequency[-1]  # many lines a stretch
    assert np.mean(after[high]) == pytest.approx(np.mean(noise[high]), rel=0.05)
    assert base[high] == pytest.approx(2 * after[high])


def test_views_keep_their_strongest_cells_in_order(named):
    views = {title: (cells, rows) for title, cells, rows in view_tables(named)}
    assert list(views) == ["Time in the waveform", "Frequency", "Polarity"]
    cells, rows = views["Frequency"]
    assert cells == 40
    assert [label for label, *_ in rows] == [f"{k} kHz to {k + 5} kHz" for k in range(165, 205, 5)]
    assert max(bar for _, _, bar, _ in rows) == 100


def test_parameters_are_told_with_prefixes(named):
    rows = {name: (value, interval, unit) for name, value, interval, unit, _ in parameter_rows(named.effects[0])}
    assert rows["capacitive"] == ("21.00", "20.70 … 21.30", "nV s/V")
    assert rows["lossy"] == ("400", "310 … 490", "10⁻⁶")
    assert engineering(Estimate(0.0, -2e-4, 2e-4), "1") == ("0", "−200 … 200", "10⁻⁶")
    assert engineering(Estimate(math.inf, 2e5, math.inf), "Hz") == ("∞", "200 … ∞", "kHz")
    assert engineering(Estimate(0.21, 0.2, 0.22), "um") == ("0.210", "0.200 … 0.220", "µm")
    assert engineering(Estimate(0.0, 0.0, 0.0), "s")[2] == "s"


def test_a_page_that_cannot_be_made_leaves_the_old_one(tmp_path, named):
    path = tmp_path / "page.html"
    path.write_text("before")
    with pytest.raises(KeyError):
        write_diagnosis_report(path, replace(named, verdict="perhaps"))
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]
