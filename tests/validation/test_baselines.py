from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.validation.baselines.base_fit import base_fit, over_noise, put_aside
from inkjet_env.experiments.validation.baselines.compare import METHODS, main, summary, verdict_on
from inkjet_env.experiments.validation.baselines.narx import with_network
from inkjet_env.experiments.validation.baselines.sindy import said, sparse_force
from inkjet_env.experiments.validation.diagnosis_study import head_of
from inkjet_env.experiments.validation.synthetic_campaigns import GAUGE_GAIN, LINES, effect_named, record_synthetic
from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.rig.battery import default_battery

SETTINGS = DiagnosisSettings()

HEAD = head_of(0)
SHORT = [line for line in LINES if not line.startswith(("multisine", "staircase", "minor", "first"))]


def campaign_with(**values):
    lines = [line for line in default_battery(HEAD.frequency_Hz) if line.label in SHORT]
    return record_synthetic(HEAD, [(effect_named(name), value) for name, value in values.items()], 3, lines=lines)


def fitted(campaign, gauge_gain=GAUGE_GAIN):
    gains = {"strain_gauge": gauge_gain, "self_sensing": HEAD.b1}
    return base_fit(campaign, Head(HEAD, gains, {"strain_gauge": 0.05, "self_sensing": -0.1}))


@pytest.fixture(scope="module")
def with_spring():
    return campaign_with(cubic_stiffness={"stiffening_per_V2": 1.2e-6})


@pytest.fixture(scope="module")
def cubic(with_spring):
    return fitted(with_spring)


@pytest.fixture(scope="module")
def force(cubic):
    return sparse_force(cubic, "self_sensing")


def test_the_base_model_settles_wherever_it_begins(cubic, with_spring):
    again = fitted(with_spring, 1.01 * GAUGE_GAIN)
    assert again.base.nll == pytest.approx(cubic.base.nll, rel=1e-3)


def test_a_voltage_measured_at_the_head_is_none_of_the_peers_business(cubic, with_spring):
    measured = [replace(r, drive_monitor_V=1.001 * r.drive_V) for r in with_spring.recordings]
    again = fitted(replace(with_spring, recordings=tuple(measured)))
    assert [o.name for o in again.observed] == [o.name for o in cubic.observed]
    assert again.base.nll == cubic.base.nll


def signals_of(joint, force):
    return joint.modelled(joint.base) | {o.name: force.signal(o) for o in joint.observed if o.channel == "self_sensing"}


def test_a_cubic_spring_is_found_as_one_and_predicts_held_out_recordings_better(cubic, force):
    assert ("cubic_stiffness",) in said(force.active)
    before = over_noise(cubic, cubic.modelled(cubic.base))
    assert over_noise(cubic, signals_of(cubic, force)) < 0.7 * before


def test_without_a_force_the_free_run_is_the_base_model(cubic, force):
    none = replace(force, coefficients=0 * force.coefficients)
    base = cubic.modelled(cubic.base)
    for o in cubic.observed:
        if o.channel == "self_sensing":
            np.testing.assert_allclose(none.signal(o), base[o.name], rtol=0, atol=1e-6 * np.abs(base[o.name]).max())


def test_a_force_runs_as_the_effect_that_it_is(cubic, force):
    """x³ alone against the plant's own cubic spring, on the same head."""
    k, at = 1e-6, 10  # after 1, x, p, v and six squares
    coefficients = 0 * force.coefficients
    coefficients[at] = k * force.sizes[0] ** 3
    force = replace(force, coefficients=coefficients)
    assert force.active == ("x^3",)
    plant = cubic.base.head.plant([(effect_named("cubic_stiffness"), {"stiffening_per_V2": k})])
    for o in cubic.observed:
        if o.channel == "self_sensing" and not o.still:
            theirs, without = plant.signal(o.excitation), cubic.base.head.plant().signal(o.excitation)
            assert np.abs(force.signal(o) - theirs).max() < 0.01 * np.abs(theirs - without).max()


def test_a_force_that_grows_without_bound_has_no_signal(cubic, force):
    wild = replace(force, coefficients=np.full(force.coefficients.size, 1e4))
    loudest = max((o for o in cubic.observed if o.channel == "self_sensing"), key=lambda o: np.ptp(o.measured))
    assert np.isnan(wild.signal(loudest)).all()


def test_where_nothing_is_left_out_nothing_is_added():
    plain = fitted(campaign_with())
    assert over_noise(plain, plain.modelled(plain.base)) == pytest.approx(1, abs=0.03)
    assert sparse_force(plain, "self_sensing").active == ()


def test_the_network_learns_what_the_base_model_leaves(cubic, monkeypatch):
    monkeypatch.setattr("inkjet_env.experiments.validation.baselines.narx.MOST_EPOCHS", 30)
    base, found = cubic.modelled(cubic.base), with_network(cubic, "self_sensing", 0)
    fit, aside = put_aside(cubic, "self_sensing")
    assert set(found) == {o.name for o in cubic.observed if o.channel == "self_sensing"}
    assert over_noise(cubic, found, fit) < 0.9 * over_noise(cubic, base, fit)
    assert over_noise(cubic, found, aside) < over_noise(cubic, base, aside)


def test_no_peer_sees_what_is_held_out(cubic, force, monkeypatch):
    monkeypatch.setattr("inkjet_env.experiments.validation.baselines.narx.MOST_EPOCHS", 3)
    changed = [o if o.fitted else replace(o, measured=o.measured + 1) for o in cubic.observed]
    other = OutputErrorFit(changed, cubic.noise, cubic.start, SETTINGS, base=cubic.base)
    np.testing.assert_array_equal(sparse_force(other, "self_sensing").coefficients, force.coefficients)
    found, again = with_network(cubic, "self_sensing", 0), with_network(other, "self_sensing", 0)
    for name, signal in found.items():
        np.testing.assert_array_equal(again[name], signal)


def test_conditions_are_put_aside_whole_and_held_out_ones_never_seen(cubic):
    seen = []
    for fold in range(4):
        fit, aside = put_aside(cubic, "self_sensing", fold)
        assert not {o.condition for o in fit} & {o.condition for o in aside}
        assert all(o.fitted for o in (*fit, *aside))
        seen += [o.name for o in aside]
    assert sorted(seen) == sorted(o.name for o in (*fit, *aside))


@pytest.mark.parametrize(
    ("groups", "truth", "verdict"),
    [
        ((), (), "right"),
        ((), ("creep",), "nothing"),
        ((("creep",),), (), "wrong"),
        ((("creep",),), ("creep",), "right"),
        ((("creep", "crosstalk"),), ("creep",), "in the set"),
        ((("creep",), ("crosstalk",)), ("creep",), "among others"),
        ((("crosstalk",),), ("creep",), "wrong"),
    ],
)
def test_names_are_judged(groups, truth, verdict):
    assert verdict_on(groups, truth) == verdict


def test_medians_leave_out_measured_recordings_and_what_has_nothing_planted():
    def row(name, rms, **judged):
        return {"name": name, "over_noise": dict.fromkeys(METHODS, rms)} | judged

    right = {"judged": dict.fromkeys(METHODS, "right")}
    found = summary([row("silverbox", 90.0), row("nothing", 1.0, **right), row("creep", 3.0, **right)])
    assert found["cases"] == 1
    assert set(found["median"].values()) == {3.0}
    assert found["judged"]["pysindy"] == {"right": 1}
    assert summary([]) == {"cases": 0, "median": {}, "judged": {}}


def test_an_effect_that_nothing_predicts_is_refused_in_one_sentence(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["mains_hum"])
    assert stopped.value.code == 2
    assert "EFFECT must be one of nothing, amplifier_bandwidth" in capsys.readouterr().err
