import json
import math
import re
import shutil

import numpy as np
import pytest

from inkjet_env.experiments.proof.corpus import IDS, STAGES, corpus
from inkjet_env.experiments.proof.criteria import Figure, counted, estimated
from inkjet_env.experiments.proof.fresh_drive_error import LEAST_CLOSURE
from inkjet_env.experiments.proof.printing import print_score
from inkjet_env.experiments.proof.protocol import Outcome, as_judged
from inkjet_env.experiments.proof.report import headline, page_html, sentences
from inkjet_env.experiments.proof.score import score, verdict_record
from inkjet_env.experiments.publish.proof_tables import document
from inkjet_env.storage import json_text

OUTSIDE, BASES, NOISES = ("stop", "agc"), ("bouc_wen",), ("white", "flicker")
PLACES = dict.fromkeys(("recordings", "time", "frequency", "drive"), True)


def verdict(word, *ids, candidates=(), closure=0.97):
    effects = [{"id": one, "parameters": {}} for one in ids]
    groups = [list(group) for group in candidates]
    fit = {"closure": closure}
    return {"verdict": word, "headline": "In words.", "effects": effects, "candidates": groups, "fit": fit}


def perfect(draw):
    if draw.family == "null":
        return verdict("none")
    if draw.family in ("outside", "base"):
        return verdict("unknown")
    return verdict("named", *draw.effects)


def case_of(draw, said, **judged):
    hidden = draw.family in ("effect", "pair")
    answer = {"status": "diagnosed" if said else "refused", "sentence": "Too short.", "verdict": said}
    found = {
        "closure": 0.995 if hidden else None,
        "fresh": None,
        "parameters": [],
        "location": PLACES if hidden else {},
    }
    rho = {"strong": 2.0, "medium": 0.5, "faint": 0.1}.get(draw.strength, 0.0)
    run = {"seconds": 1.0, "cpu_seconds": 1.0, "seen": []}
    return {
        "name": f"head-{draw.number}",
        "draw": draw.as_json(),
        "truth": {"rho": rho},
        "answer": answer,
        "run": run,
        "judged": found | judged,
    }


def scored(cases, version=2):
    manifest = {"version": version, "seed": 1, "profile": "quick", "published": False, "truth_sha256": "ab" * 32}
    manifest |= {"code": {"rig": "1", "finder": "2"}, "versions": {"python": "3"}}
    return score(Outcome(None, manifest, {"answers_sha256": "cd" * 32}, cases))


def figure(found, name):
    return next(f for f in found["figures"] if f["name"] == name)


@pytest.fixture(scope="module")
def draws():
    return corpus(1, "quick", OUTSIDE, BASES, NOISES)


@pytest.fixture(scope="module")
def flawless(draws):
    return [case_of(d, perfect(d)) for d in draws]


def with_answer(cases, which, said):
    return [case | {"answer": case["answer"] | {"verdict": said}} if which(case["draw"]) else case for case in cases]


def test_flawless_answers_reach_every_figure(flawless):
    found = scored(flawless)
    assert found["short"] == []
    assert figure(found, "false alarms where nothing is concealed")["hits"] == 0
    assert figure(found, "right name or right set")["value"] == 1
    assert figure(found, "F1 of two effects at once")["value"] == 1
    assert found["misses"] == []


def test_an_answer_that_is_always_none_detects_nothing_and_is_not_confidently_wrong(flawless):
    found = scored(with_answer(flawless, lambda draw: True, verdict("none")))
    assert figure(found, "detected, strong and medium")["hits"] == 0
    assert figure(found, "confidently wrong, inside the catalogue")["hits"] == 0
    assert "detected, strong and medium" in found["short"]


def test_an_answer_that_is_always_unknown_raises_false_alarms_and_names_nothing(flawless):
    found = scored(with_answer(flawless, lambda draw: True, verdict("unknown")))
    assert figure(found, "false alarms where nothing is concealed")["value"] == 1
    assert figure(found, "right name or right set")["value"] == 0
    assert figure(found, "outside the catalogue, reported as unknown")["value"] == 1


def test_a_wrong_name_is_confidently_wrong_inside_and_outside(flawless):
    found = scored(with_answer(flawless, lambda draw: draw["family"] == "outside", verdict("named", "creep")))
    assert figure(found, "confidently wrong, outside the catalogue")["value"] == 1
    wrong = with_answer(flawless, lambda draw: draw["effects"] == ["slew_limit"], verdict("named", "creep"))
    assert figure(scored(wrong), "confidently wrong, inside the catalogue")["hits"] >= 1
    assert scored(wrong)["confusion"]["slew_limit"]["creep"] >= 1


def test_a_set_that_holds_the_truth_counts_with_its_size(flawless):
    said = verdict("set", "sensor_bandwidth", candidates=[("sensor_bandwidth", "amplifier_bandwidth", "trigger_delay")])
    answers = with_answer(flawless, lambda draw: draw["effects"] == ["amplifier_bandwidth"], said)
    found = scored(answers)
    assert figure(found, "right name or right set")["value"] == 1
    assert figure(found, "mean size of a set")["value"] > 1
    assert found["confusion"]["amplifier_bandwidth"]["set"] >= 1


def test_a_refusal_is_neither_an_alarm_nor_right(flawless):
    found = scored(with_answer(flawless, lambda draw: draw["family"] == "null", None))
    assert figure(found, "false alarms where nothing is concealed")["hits"] == 0
    assert figure(found, "refused or failed")["hits"] == 13
    assert [m["verdict"] for m in found["misses"]] == ["refused"] * 13
    assert verdict_record(with_answer(flawless, lambda draw: True, None)[0]).verdict == "refused"


def test_meagre_campaigns_are_counted_apart(flawless):
    found = scored(with_answer(flawless, lambda draw: draw["meagre"], verdict("named", "creep")))
    assert figure(found, "false alarms where nothing is concealed")["hits"] == 0
    assert (
        figure(found, "meagre campaigns: false alarms")["hits"]
        == sum(c["draw"]["family"] == "null" and c["draw"]["meagre"] for c in flawless)
        > 0
    )


def test_intervals_that_hold_the_truth_are_counted_open_ends_too(draws):
    rows = [
        {
            "effect": "trigger_delay",
            "parameter": "delay_s",
            "truth": 1.0,
            "value": v,
            "low": low,
            "high": high,
            "unit": "s",
        }
        for v, low, high in ((1.1, 0.9, 1.2), (2.0, 1.5, None), (0.9, None, 1.0))
    ]
    draw = next(d for d in draws if d.effects == ("trigger_delay",))
    found = scored([case_of(draw, perfect(draw), parameters=rows)])
    covered = figure(found, "90 % intervals that contain the truth")
    assert (covered["hits"], covered["of"]) == (2, 3)
    assert figure(found, "median error of a parameter")["value"] == pytest.approx(0.1)


def test_the_share_of_the_oracles_gain_is_of_all_heads_together(draws):
    draw = next(d for d in draws if d.family == "effect")
    # of the first head the search on the plant itself found less than its augmented model did
    heads = [(-20.0, -25.0, -20.1), (-22.0, -21.0, -22.0), (-10.0, -10.2, -10.4)]
    cases = [
        case_of(
            draw, perfect(draw), reoptimised={"base": b, "augmented": a, "oracle": o, "waveforms": {}, "foretold": {}}
        )
        for b, a, o in heads
    ]
    found = scored(cases)
    assert found["waveform_gain"]["share"] == pytest.approx(4.2 / 5.4)
    median = figure(found, "median fraction of the oracle's gain achieved, per head")
    assert median["of"] == 2  # a head without any possible gain has no fraction
    assert median["value"] == pytest.approx((1.0 + 0.5) / 2)
    assert median["low"] < median["value"] < median["high"]
    alone = figure(scored(cases[:1]), "median fraction of the oracle's gain achieved, per head")
    assert (alone["value"], alone["low"], alone["high"]) == (pytest.approx(1.0), None, None)  # one tells of no spread


def test_peers_are_compared_by_their_median(draws):
    draw = next(d for d in draws if d.family == "effect")
    rows = [
        {
            "over_noise": {"base": 3.0, "diagnosis": 1.0},
            "judged": {"base": "nothing", "diagnosis": "right"},
            "same": True,
        },
        {
            "over_noise": {"base": None, "diagnosis": 1.2},
            "judged": {"base": "nothing", "diagnosis": "right"},
            "same": True,
        },
    ]
    baselines_tried = scored([case_of(draw, perfect(draw), baselines=row) for row in rows])["baselines"]
    assert baselines_tried["median_over_noise"] == {"base": None, "diagnosis": 1.1}
    assert baselines_tried["judged"]["diagnosis"] == {"right": 2}


def test_the_order_of_the_cases_does_not_change_the_score(flawless):
    spoilt = with_answer(flawless, lambda draw: draw["number"] % 7 == 0, verdict("unknown"))
    values = [[figure["value"] for figure in scored(cases)["figures"]] for cases in (spoilt, spoilt[::-1])]
    assert values[0] == values[1]
    assert json_text(scored(spoilt)) == json_text(scored(list(spoilt)))
    assert scored(spoilt)["curve"] == scored(spoilt[::-1])["curve"]


def test_a_head_without_a_usable_fresh_drive_is_not_counted_and_one_without_a_bounded_answer_is_the_worst(flawless):
    names = ("median closure on fresh drives", "10th percentile of that closure")
    clear = [c["name"] for c in flawless if c["judged"]["closure"] and c["draw"]["family"] == "effect"]

    def with_closures(values):
        return [c | {"judged": c["judged"] | {"closure": values.get(c["name"], 0.995)}} for c in flawless]

    every = [figure(scored(flawless), name) for name in names]
    unjudged = [figure(scored(with_closures(dict.fromkeys(clear[:5]))), name) for name in names]
    assert [f["of"] for f in unjudged] == [f["of"] - 5 for f in every]
    assert [f["value"] for f in unjudged] == [0.995, 0.995]
    worst = [figure(scored(with_closures(dict.fromkeys(clear[:5], LEAST_CLOSURE))), name) for name in names]
    assert [f["of"] for f in worst] == [f["of"] for f in every]
    assert worst[0]["value"] == 0.995
    assert worst[1]["value"] < -100


def test_the_curve_begins_where_nothing_is_concealed(flawless):
    curve = scored(flawless)["curve"]
    assert [row["strength"] for row in curve] == ["nothing", "medium", "strong"]
    assert [row["rho"] for row in curve] == [0.0, 0.5, 2.0]


def test_eight_false_alarms_in_300_are_enough_and_nine_too_many():
    assert counted("", [True] * 8 + [False] * 292, most=8 / 300).met
    assert counted("", [True] * 9 + [False] * 291, most=8 / 300).met is False


def test_nothing_counted_is_neither_met_nor_short():
    assert counted("", [], least=0.9).met is None
    assert estimated("", [], np.mean, least=0.9).met is None


def test_a_range_is_asked_of_coverage():
    for value, met in ((0.84, False), (0.9, True), (0.96, False)):
        assert Figure("", value, 0, 1, 10, "share", least=0.85, most=0.95).met is met


def test_a_bootstrap_gives_the_same_interval_at_every_call():
    sample = [float(v) for v in np.random.default_rng(3).normal(size=40)]
    first, second = (estimated("", sample, lambda s: float(np.mean(s))) for _ in range(2))
    assert (first.low, first.high) == (second.low, second.high)
    assert first.high - first.low == pytest.approx(2 * 1.645 * np.std(sample) / math.sqrt(40), rel=0.15)


def test_the_page_stands_alone_and_begins_with_what_was_proven(flawless):
    spoilt = with_answer(flawless, lambda draw: draw["family"] == "outside", verdict("named", "creep"))
    found = scored(spoilt)
    page = page_html(json.loads(json_text(found)))
    assert "misses 2 of the 12 criteria" in headline(found)
    few = {**found, "short": [], "figures": [{**figure, "met": None} for figure in found["figures"]]}
    assert "too few of each kind for any criterion" in headline(few)
    nulls = sum(
        case["draw"]["family"] == "null" and not (case["draw"]["meagre"] or case["draw"]["slow_only"])
        for case in flawless
    )
    assert page.index(f"Nothing was concealed in {nulls} heads; 0 of them") < page.index("<table>")
    page = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"https?://|<link|src=", page)
    assert re.search('<h1>.*?class="zoomable".*?In words.*?<details>', page, re.DOTALL)
    assert page.count("<svg") >= 3
    assert found["truth_sha256"] in page
    assert found["noise"]
    for noise, alarms in found["noise"].items():
        assert f"<td>{noise.replace('_', ' ')}</td><td>{len(alarms)}</td><td>0</td>" in page


def test_the_page_tells_how_often_probabilities_are_right(flawless):
    found = scored(flawless)
    assert "<h2>Probabilities</h2>" not in page_html(found)  # these answers have none
    page = page_html(found | {"calibration": [{"mean": 0.951, "right": 0.902, "of": 17}]})
    assert "<tr><td>95.1 %</td><td>90.2 %</td><td>17</td></tr>" in page[page.index("<h2>Probabilities</h2>") :]


def test_a_page_of_nulls_alone_is_a_page(flawless):
    nulls = [case for case in flawless if case["draw"]["family"] == "null"]
    assert "<svg" in page_html(scored(nulls))


def test_what_falls_short_is_said_in_words(flawless):
    spoilt = with_answer(flawless, lambda draw: draw["family"] == "outside", verdict("none"))
    assert any("Criteria not met: outside the catalogue, reported as unknown" in s for s in sentences(scored(spoilt)))


def test_the_table_is_printed_with_what_is_asked(flawless, capsys):
    print_score(scored(with_answer(flawless, lambda draw: draw["family"] == "pair", verdict("unknown"))))
    out = capsys.readouterr().out
    assert re.search(r"F1 of two effects at once\s+0\s.*≥ 0.93\s+NO", out)
    assert "criteria of a first-rate diagnosis are met" in out


def test_the_record_in_markdown_says_what_was_said_of_each(flawless, draws):
    drawn = next(d for d in draws if d.family == "effect" and d.strength == "strong" and not d.meagre)
    spoilt = with_answer(flawless, lambda draw: draw["number"] == drawn.number, verdict("named", "feedthrough"))
    won = {"base": -20.0, "augmented": -24.0, "oracle": -25.0, "waveforms": {}, "foretold": {}}
    baselines_tried = {"over_noise": {"refit": 3.0}, "judged": {"refit": "nothing"}, "same": True}
    spoilt = [*spoilt, case_of(drawn, perfect(drawn), reoptimised=won, baselines=baselines_tried)]
    text = document(json.loads(json_text(scored(spoilt))))
    assert f"| {drawn.effects[0]} | strong | named | feedthrough | 1 |" in text
    assert f"| {drawn.effects[0]} | 2 | 1 | feedthrough 1 |" in text
    assert f"| {drawn.effects[0]} | 1 | -20.00 | -24.00 | -25.00 | 80 % |" in text
    assert "| refit | 3 | nothing 1 |" in text
    for table in text.split("\n\n"):
        widths = {row.count("|") for row in table.splitlines() if row.startswith("|")}
        assert len(widths) <= 1


def sure(case, p=1.0):
    """The case with probabilities of which the largest, p, is of a true label."""
    label = (case["draw"]["effects"] or ["nothing"])[0]
    label = label if label in (*STAGES, "nothing") else "none of these"
    other = "nothing" if label != "nothing" else "creep"
    said = case["answer"]["verdict"] | {"probabilities": {label: p, other: 1 - p}}
    return case | {"answer": case["answer"] | {"verdict": said}}


def test_a_diagnosis_that_is_sure_and_right_is_calibrated_and_one_that_doubts_too_much_is_not(flawless):
    name = "expected calibration error"
    assert figure(scored(flawless), name)["of"] == 0  # no probabilities, no figure
    perfect_ones = scored([sure(c) for c in flawless])
    assert figure(perfect_ones, name)["value"] == 0
    bases = sum(c["draw"]["family"] == "base" for c in flawless)
    assert figure(perfect_ones, name)["of"] == len(flawless) - bases
    timid = scored([sure(c, 0.7) for c in flawless])
    assert figure(timid, name)["value"] == pytest.approx(0.3)
    assert name in timid["short"]
    assert [row["of"] for row in timid["calibration"]] == [len(flawless) - bases]


def test_false_alarms_are_counted_by_the_kind_of_noise(flawless):
    def loud(draw):
        return draw["family"] == "null" and draw["noise"] == "flicker"

    found = scored(with_answer(flawless, loud, verdict("unknown")))
    worst = figure(found, "false alarms, worst kind of noise")
    assert worst["value"] == 1
    assert not any(found["noise"]["white"])
    assert worst["hits"] == len(found["noise"]["flicker"])


def test_the_worst_covered_effect_is_found_among_those_with_enough_intervals(draws):
    def with_intervals(effect, inside):
        row = {"effect": effect, "parameter": "p", "truth": 1.0, "value": 1.0, "unit": "s"}
        rows = [row | {"low": 0.9 if good else 1.1, "high": 1.2} for good in inside]
        draw = next(d for d in draws if d.effects == (effect,) and not (d.meagre or d.slow_only))
        return case_of(draw, perfect(draw), parameters=rows)

    found = scored(
        [
            with_intervals("creep", [True] * 9 + [False]),
            with_intervals("slew_limit", [True] * 3 + [False] * 2),
            with_intervals("wave_echo", [False] * 2),
        ]
    )
    worst = figure(found, "90 % intervals that contain the truth, worst effect")
    assert (worst["hits"], worst["of"], worst["met"]) == (3, 5, False)
    assert found["coverage"]["wave_echo"] == [False, False]


def test_version_one_is_counted_with_its_own_criteria_and_ids(flawless):
    old = [c for c in flawless if not c["draw"]["slow_only"]]
    old = [c for c in old if c["draw"]["family"] != "effect" or c["draw"]["effects"][0] in IDS[1]]
    old = [c for c in old if c["draw"]["family"] != "pair"]
    draw = next(c for c in old if c["draw"]["family"] == "outside")
    draw = draw | {"draw": draw["draw"] | {"effects": ["coulomb_friction"]}}
    found = scored([*old, draw], version=1)
    assert figure(found, "false alarms where nothing is concealed")["asked"] == "≤ 2.67 %"
    assert "expected calibration error" not in [f["name"] for f in found["figures"]]
    assert found["confusion"]["coulomb_friction"]["unknown"] == 1
    assert "coulomb_friction" not in found["confusion"]["creep"]
    assert "| coulomb_friction | 1 | 1 |" in document(json.loads(json_text(found)))


def test_every_id_has_a_row_in_the_confusion_matrix(flawless):
    assert set(STAGES) | {"nothing", *OUTSIDE, *BASES} == set(scored(flawless)["confusion"])


def test_a_judged_proof_is_counted_again_from_what_is_kept_of_it(finished, tmp_path):
    folder = tmp_path / "kept"
    shutil.copytree(finished[0], folder, ignore=shutil.ignore_patterns("campaigns"))
    judge = {"code": "another", "versions": {}}
    (folder / "score.json").write_text(json_text({"judge": judge}))
    again = as_judged(folder)
    assert again.judge == judge
    assert [case["judged"] for case in again.cases] == [
        json.loads((folder / "judged" / f"{case['name']}.json").read_text())["judged"] for case in again.cases
    ]
    assert again.answers == json.loads((folder / "answers.json").read_text())
    assert [case["draw"]["number"] for case in again.cases] == list(range(len(again.cases)))
