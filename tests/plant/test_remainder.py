"""The remainder of a head: what it adds, its limits, its file."""

import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import chosen_head, read_printhead, remainder_sentence
from inkjet_env.plant.remainder import ChannelRemainder, RefittedBase, Remainder, Term, remainder_of
from inkjet_env.plant.remainder_features import feature, push_names, shown_names
from inkjet_env.printhead import Printhead, Waveform

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
CUBIC = ((EFFECTS["cubic_stiffness"], {"stiffening_per_V2": 1e-5}),)
STEP_S = 2e-7
WAVEFORM = Waveform(90.0, -70.0, 3e-6, 9e-6, 5e-6, 8e-6, 7e-6)
DRIVE_V = WAVEFORM.drive_V(STEP_S * np.arange(1500))
TIMES = {"drive_delays_s": (2e-7, 1e-6), "motion_delays_s": (4e-6,), "lags_s": (2e-6,), "plays": (0.2,)}
SCALES_V = {"drive": 100.0, "hysteretic": 100.0, "deflection": 150.0, "speed": 150.0}


def excitation(initial_state="demagnetised", channel="self_sensing", drive_V=DRIVE_V, step_s=STEP_S):
    return Excitation(channel, initial_state, step_s, drive_V)


def plant(push=None, shown=None, channel="self_sensing", effects=CUBIC, **limits):
    terms = [{name: Term(*numbers) for name, numbers in (of or {}).items()} for of in (push, shown)]
    scales_V = SCALES_V if channel != "strain_gauge" else {k: SCALES_V[k] for k in ("drive", "hysteretic")}
    own = ChannelRemainder(scales_V, *terms, TIMES, **limits)
    return Plant(HEAD, {"strain_gauge": 0.02}, {}, effects, Remainder({channel: own}))


def without(one):
    return replace(one, remainder=None)


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic", "free"])
@pytest.mark.parametrize("channel", ["self_sensing", "displacement", "strain_gauge"])
def test_zero_weights_change_no_bit(initial_state, channel):
    fast = channel != "strain_gauge"
    nothing = plant(
        dict.fromkeys(push_names(TIMES), (0.0, 1.0)) if fast else None,
        dict.fromkeys(shown_names(TIMES, fast), (0.0, 1.0)),
        channel,
    )
    shot = excitation(initial_state, channel)
    assert np.array_equal(nothing.signal(shot), without(nothing).signal(shot))


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic"])
def test_a_head_with_zero_weights_responds_bit_for_bit(initial_state):
    plain = AugmentedPrinthead(HEAD, CUBIC)
    head = replace(plain, remainder=plant({"drive": (0.0, 1.0)}).remainder)
    assert np.array_equal(
        head.respond(WAVEFORM, initial_state).sensor_at_steps_V,
        plain.respond(WAVEFORM, initial_state).sensor_at_steps_V,
    )
    assert head.without_remainder().remainder is None


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic"])
def test_a_pushed_drive_is_a_larger_drive_of_the_resonator(initial_state):
    pushed, shot = plant({"hysteretic": (5.0, 1.0)}, effects=()), excitation(initial_state)
    linear = without(pushed).signal(shot)
    assert pushed.signal(shot) == pytest.approx(1.05 * linear, abs=1e-9 * np.abs(linear).max())


def test_a_push_by_the_squared_speed_is_the_quadratic_damping_of_the_catalogue():
    damping = EFFECTS["quadratic_damping"]
    values = {p.name: 0.0 for p in damping.parameters} | {damping.strengths[0]: 1e-5}
    effect = ((damping, values),)
    head, shot = plant(effects=effect), excitation("periodic")
    base = without(plant(effects=())).signal(shot)
    wanted = without(head).signal(shot) - base
    unit = plant({"speed*|speed|": (1e-3, 1.0)}, effects=()).signal(shot) - base
    cosine = abs(unit @ wanted) / np.linalg.norm(unit) / np.linalg.norm(wanted)
    assert cosine > 0.99


def test_a_shown_speed_is_the_signal_of_self_sensing_itself():
    shown, shot = plant(None, {"speed": (1.0, 1.0)}, effects=()), excitation()
    signal = without(shown).signal(shot)
    speed = signal / HEAD.b1 * np.sqrt(HEAD.a0) / SCALES_V["speed"]
    assert shown.signal(shot) - signal == pytest.approx(np.clip(speed, -1, 1), abs=1e-4)


def test_a_delayed_drive_is_the_drive_some_samples_later():
    later, shot = plant(None, {"delayed drive@1": (1.0, 1.0)}), excitation("periodic")
    added = later.signal(shot) - without(later).signal(shot)
    assert added == pytest.approx(np.roll(DRIVE_V, 5) / 100.0, abs=1e-9)


@pytest.mark.parametrize("name", sorted({*push_names(TIMES), *shown_names(TIMES, True)}))
def test_every_feature_is_bounded_and_has_a_periodic_steady_state(name):
    """Under a repeated drive a feature is that of the drive's last repetition from the demagnetised state."""
    head = without(plant())
    many = np.tile(DRIVE_V, 3)
    found = []
    for shot in (excitation("periodic"), excitation(drive_V=many)):
        drive_V = head.at_ceramic_V(shot)
        motion = head.head_motion(drive_V, head.hysteretic_V(drive_V, shot), shot)
        assert np.abs(feature(name, motion.scaled(dict.fromkeys(SCALES_V, 1.0)), TIMES)).max() <= 1 + 1e-12
        found.append(shot.sampled(feature(name, motion.scaled(SCALES_V), TIMES)))
    start = 20 if name.startswith(("delayed", "change", "squared")) else 0
    stop = DRIVE_V.size - start  # a copy of the last samples looks ahead of the end
    assert found[0][start:stop] == pytest.approx(found[1][-DRIVE_V.size :][start:stop], abs=2e-3)


def test_beyond_the_fitted_drives_the_sums_do_not_grow():
    head = plant({"drive^3": (1.0, 0.1)}, {"drive": (0.4, 0.5)}, effects=(), most_push_V=2.0, most_shown=0.3)
    shot = excitation(drive_V=50 * DRIVE_V)
    drive_V = head.at_ceramic_V(shot)
    motion = head.head_motion(drive_V, head.hysteretic_V(drive_V, shot), shot)
    own = head.remainder.of("self_sensing")
    assert np.abs(own.pushes_V(motion)).max() == 1.0  # its weight: the feature's largest contribution
    assert np.abs(own.shown_at_samples(motion)).max() == 0.3  # the limit of the sum


def test_a_head_with_a_remainder_responds_as_its_plant_does():
    remainder = plant({"speed*|speed|": (-3.0, 1.0)}, {"drive": (0.05, 1.0)}).remainder
    head = AugmentedPrinthead(HEAD, CUBIC, remainder=remainder)
    time_s = STEP_S * np.arange(DRIVE_V.size)
    found = head.respond_sampled(time_s, DRIVE_V, "demagnetised").sensor_V
    expected = head.plant.signal(replace(excitation(), substeps=8))
    plain = head.without_remainder().plant.signal(replace(excitation(), substeps=8))
    largest = np.abs(plain).max()
    assert np.abs(expected - plain).max() > 0.01 * largest
    assert found == pytest.approx(expected, abs=2e-3 * largest)


def test_the_costs_of_a_head_include_its_remainder():
    remainder = plant(None, {"drive": (0.5, 1.0)}).remainder
    head = AugmentedPrinthead(HEAD, (), remainder=remainder)
    rows = [WAVEFORM.to_array()]
    assert head.costs(rows)[0] == head.respond(WAVEFORM).cost()
    assert head.costs(rows)[0] != head.without_remainder().costs(rows)[0]


DATA = plant({"drive": (0.1, 0.5), "play@0": (0.2, 1.0)}, {"speed": (1e-3, 0.9)}, most_push_V=1.0, most_shown=2.0)
DATA = DATA.remainder.as_json()


def test_a_remainder_with_its_own_base_comes_back_from_its_own_json():
    base = RefittedBase(HEAD.a0, HEAD.a1, HEAD.b1, HEAD.coefficients, 0.02, 0.001)
    whole = plant({"drive": (0.1, 0.5)}, base=base).remainder.as_json()
    assert remainder_of(whole).as_json() == whole == json.loads(json.dumps(whole))
    assert remainder_of(whole).channels["self_sensing"].base == base


@pytest.mark.parametrize("effects", [CUBIC, ()])
def test_a_remainder_comes_back_from_its_file(tmp_path, effects):
    head = AugmentedPrinthead(HEAD, effects, remainder=remainder_of(DATA))
    head.to_json(tmp_path / "head.json")
    again = read_printhead(tmp_path / "head.json")
    assert again.remainder.as_json() == head.remainder.as_json() == DATA
    assert np.array_equal(again.respond(WAVEFORM).peaks_V, head.respond(WAVEFORM).peaks_V)
    left_away = chosen_head(tmp_path / "head.json", remainder=False)
    assert getattr(left_away, "remainder", None) is None
    with pytest.raises(ValueError, match="an unexplained remainder"):
        Printhead.from_json(tmp_path / "head.json")


def changed(*path, to):
    data = deepcopy(DATA)
    at = data
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = to
    return data


OWN = ("channels", "self_sensing")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (7, '"format" must be "remainder/1"'),
        (changed("format", to="remainder/9"), "got 'remainder/9'"),
        (changed("channels", to=[]), 'must have "channels"'),
        (changed("channels", to={"smell": {}}), "'smell' is not a channel"),
        (changed(*OWN, to=3), "remainder of self_sensing: must be an object"),
        (changed(*OWN, "scales_V", to={"drive": 1.0}), "scales_V must give drive, hysteretic; got drive"),
        (changed(*OWN, "scales_V", "speed", to=0), "the scale of speed must be above 0 V"),
        (changed(*OWN, "lags_s", to=[-1.0]), "lags_s must not be negative"),
        (changed(*OWN, "plays", to="all"), "plays: must be a list"),
        (changed(*OWN, "plays", to=[]), "'play@0' is not a known name"),
        (changed(*OWN, "push", to={"weather": {"weight": 1, "largest": 1}}), "'weather' is not a known name"),
        (changed(*OWN, "push", "drive", "weight", to="heavy"), "weight: must be a finite number; got heavy"),
        (changed(*OWN, "push", "drive", "largest", to=0), 'a "largest" above 0'),
        (changed(*OWN, "shown", "speed", to={"weight": 1.0}), 'needs a "weight"'),
        (changed(*OWN, "most_shown", to="all"), "most_shown: must be a finite number; got all"),
        (changed(*OWN, "most_push_V", to=-1), "must not be negative"),
    ],
)
def test_a_malformed_remainder_is_refused_in_a_sentence(tmp_path, data, message):
    whole = AugmentedPrinthead(HEAD, CUBIC).as_json() | {"remainder": data}
    (tmp_path / "head.json").write_text(json.dumps(whole))
    with pytest.raises(ValueError) as refused:
        read_printhead(tmp_path / "head.json")
    assert message in str(refused.value)
    assert str(refused.value).startswith(f"{tmp_path / 'head.json'}: remainder")
    assert "\n" not in str(refused.value)


def test_a_user_is_told_of_a_remainder_in_one_line():
    head = AugmentedPrinthead(HEAD, (), remainder=remainder_of(DATA))
    assert "no longer grows" not in remainder_sentence(head, ("self_sensing",), 90.0)
    assert "up to 100 V and no longer grows" in remainder_sentence(head, ("self_sensing",), 120.0)
    assert "changes nothing here" in remainder_sentence(head, ("displacement",), 90.0)
    assert remainder_sentence(head.without_remainder(), ("self_sensing",), 90.0) is None
    assert remainder_sentence(HEAD, ("self_sensing",), 90.0) is None
