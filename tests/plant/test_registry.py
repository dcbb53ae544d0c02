"""A user's own effects: registered by class, named in a file, read only where they are registered."""

import json
import subprocess
import sys

import numpy as np
import pytest

from inkjet_env.plant import Effect, Excitation, Parameter, Plant, register, registry
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.effects.feedthrough import Feedthrough
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.plant.registry import UnregisteredEffectError, known_effects
from inkjet_env.printhead import Printhead, Waveform

HEAD = Printhead.published()
WAVEFORM = Waveform(90.0, -70.0, 3e-6, 9e-6, 5e-6, 8e-6, 7e-6)


class Leak(Effect):
    """The smallest effect of one's own: the sensor shows a little less."""

    id = "leak"
    stage = "sensing"
    sentence = "The sensor loses a part of its signal."
    parameters = (Parameter("lost", "1", -0.5, 0.5, meaning="share of the signal that is lost"),)
    strengths = ("lost",)

    def starts(self, printhead, excitations):
        return [{"lost": 0.05}]

    def sensing(self, values, signal, drive_V, printhead, excitation):
        return (1 - values["lost"]) * signal


NAME = f"{__name__}:Leak"
AUGMENTED = AugmentedPrinthead(HEAD, ((Leak(), {"lost": 0.1}), (Feedthrough(), {"lossy": 1e-3})))


def another(**changes):
    """A class like `Leak`, otherwise in these points."""
    return type("Another", (Leak,), {"__module__": "elsewhere", **changes})


@pytest.fixture(autouse=True)
def nothing_registered(monkeypatch):
    monkeypatch.setattr(registry, "_registered", {})


@pytest.fixture
def file(tmp_path):
    AUGMENTED.to_json(tmp_path / "h.json")
    return tmp_path / "h.json"


def test_a_file_names_the_class_of_an_effect_of_ones_own_and_of_no_other(file):
    own, catalogued = json.loads(file.read_text())["effects"]
    assert (own["id"], own["class"]) == ("leak", NAME)
    assert "class" not in catalogued


def test_what_is_registered_is_read_again_and_answers_as_before(file):
    assert register(Leak) is Leak
    head = read_printhead(file)
    (effect, values), (catalogued, _) = head.effects
    assert (type(effect), values, type(catalogued)) == (Leak, {"lost": 0.1}, Feedthrough)
    assert head.respond(WAVEFORM).peaks_V.tolist() == AUGMENTED.respond(WAVEFORM).peaks_V.tolist()


def test_a_class_that_is_not_registered_is_named_with_what_to_do(file):
    with pytest.raises(UnregisteredEffectError) as caught:
        read_printhead(file)
    told = str(caught.value)
    assert told.startswith(f"{file}: effect 'leak' is of the class {NAME}, which is not registered here")
    assert f'"from {__name__} import Leak; inkjet_env.plant.register(Leak)"' in told
    assert f'"--effect {NAME}"' in told


def test_reading_a_file_never_imports_the_module_that_it_names(tmp_path, file, monkeypatch):
    (tmp_path / "trap.py").write_text("raise SystemExit('imported')\n")
    monkeypatch.syspath_prepend(tmp_path)
    file.write_text(file.read_text().replace(NAME, "trap:Leak"))
    with pytest.raises(UnregisteredEffectError, match="trap:Leak"):
        read_printhead(file)
    assert "trap" not in sys.modules


def test_another_class_under_the_same_id_is_refused(file):
    register(another())
    with pytest.raises(UnregisteredEffectError, match=f"class {NAME}, but the class .* is elsewhere:Another"):
        read_printhead(file)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"class": "os.system"}, "must read module:Class; got 'os.system'"),
        ({"class": ["a:B"]}, "must read module:Class"),
        ({"class": "a:B\nC"}, "must read module:Class"),
        ({"id": 3}, "id of an effect must be a string; got '3'"),
        ({"id": "feedthrough"}, f"'feedthrough' is in the catalogue, but the class {NAME} is named"),
        ({"parameters": {}}, "effect leak, parameter lost: is missing"),
    ],
)
def test_a_damaged_entry_is_refused_by_name_and_rule(file, change, message):
    register(Leak)
    data = json.loads(file.read_text())
    data["effects"][0].update(change)
    file.write_text(json.dumps(data))
    with pytest.raises(ValueError, match=message) as caught:
        read_printhead(file)
    assert str(caught.value).startswith(str(file))


def test_an_entry_without_a_class_is_told_which_it_needs(file):
    register(Leak)
    data = json.loads(file.read_text())
    del data["effects"][0]["class"]
    file.write_text(json.dumps(data))
    with pytest.raises(ValueError, match=f"""'leak' is not in the catalogue, so it needs "class": "{NAME}"."""):
        read_printhead(file)


def missing_sentence():
    """A class that does not say what it is."""
    return type("Mute", (Effect,), {"id": "mute", "stage": "sensing", "__module__": "elsewhere"})


def failing(self):
    raise KeyError("bore")


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (lambda: Effect, "must be a subclass of inkjet_env.plant.Effect"),
        (lambda: Leak(), "must be a subclass of inkjet_env.plant.Effect; got <.*Leak object"),
        (lambda: int, "must be a subclass of inkjet_env.plant.Effect; got <class 'int'>"),
        (missing_sentence, "elsewhere:Mute must declare sentence, parameters, strengths, as"),
        (lambda: another(stage="resonance"), "stage of elsewhere:Another must be one of .*Did you mean 'resonator'"),
        (lambda: another(id="feedthrough"), "has the id 'feedthrough' of an effect in the catalogue"),
        (lambda: another(), f"has the id 'leak', under which {NAME} is registered"),
        (lambda: another(id="b", __init__=failing), "cannot be made without arguments: KeyError: 'bore'"),
    ],
)
def test_what_cannot_be_registered_is_refused_in_one_sentence(kind, message):
    register(Leak)
    with pytest.raises(ValueError, match=message):
        register(kind())
    assert [effect.id for effect in known_effects()][-1] == "leak"


def test_a_class_that_is_defined_again_takes_the_place_of_the_former(file):
    register(Leak)
    again = type("Leak", (Leak,), {"__module__": __name__, "__qualname__": "Leak"})
    register(again)
    assert type(read_printhead(file).effects[0][0]) is again


def test_an_effect_that_declares_nothing_more_has_sensible_defaults():
    effect = Leak()
    assert (effect.random, effect.predictable) == (False, True)
    assert (effect.depends_on_order, effect.needs_neighbour) == (False, False)
    assert effect.example_values(HEAD) == {"lost": 0.05}
    assert (effect.equation, effect.source, effect.signature) == ("", "", "")


def test_an_effect_with_columns_of_its_own_is_random_unless_it_says_otherwise():
    def columns(self, values, excitation):
        return np.ones((excitation.samples, 1))

    assert another(random_effect_basis=columns)().random
    assert not another(random_effect_basis=columns)().predictable
    assert not another(random_effect_basis=columns, random=False)().random
    assert not another(needs_neighbour=True)().predictable


def test_a_head_that_follows_the_order_needs_one_for_an_effect_of_ones_own_too(file, monkeypatch):
    monkeypatch.setattr(Leak, "depends_on_order", True)
    register(Leak)
    data = json.loads(file.read_text())
    del data["order"]
    file.write_text(json.dumps(data))
    with pytest.raises(ValueError, match="Give that of the last recording"):
        read_printhead(file)


CONSOLE = """
import sys
import numpy as np
from inkjet_env.mismatch import diagnose
from inkjet_env.plant import Effect, Parameter, register
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.recordings import read_campaign
from inkjet_env.storage import write_json

class Squared(Effect):
    id, stage, sentence = "squared", "sensing", "The sensor is curved."
    parameters = (Parameter("curvature_per_V", "1/V", -1.0, 1.0),)
    strengths = ("curvature_per_V",)

    def starts(self, printhead, shots):
        return [{"curvature_per_V": 1e-3}]

    def sensing(self, values, signal, drive_V, printhead, shot):
        return signal + values["curvature_per_V"] * signal**2

found = diagnose(read_campaign("campaign"), effects=[Squared()], workers=1)
write_json("head.json", found.augmented_json())
try:
    read_printhead("head.json")
except ValueError as error:
    print(error)
register(Squared)
head = read_printhead("head.json")
print(found.verdict, *(f"{name} {v['curvature_per_V']:.4f}" for name, v in [(e.id, v) for e, v in head.effects]))
"""


def test_a_class_of_a_console_is_diagnosed_written_and_read_again(tmp_path):
    from inkjet_env.recordings import Campaign, Recording, write_campaign

    recordings, rng = [], np.random.default_rng(1)
    corners = np.array([0, 20, 70, 100, 160, 190, 400])
    for order, level_V in enumerate((40.0, 70.0, 100.0, -60.0, 70.0, -90.0, 0.0, 0.0), start=1):
        drive_V = np.interp(np.arange(400), corners, level_V * np.array([0, 1, 1, -0.6, -0.6, 0, 0]))
        excitation = Excitation("self_sensing", "demagnetised", 2e-7, drive_V, order)
        shown = Plant(HEAD).signal(excitation)
        noise = 0.01 * rng.standard_normal(400)
        recordings.append(
            Recording(
                f"r{order}", 2e-7 * np.arange(400), drive_V, shown + 4e-3 * shown**2 + noise, "V", "self_sensing",
                initial_state="demagnetised", order=order,
            )
        )  # fmt: skip
    write_campaign(tmp_path / "campaign", Campaign("c", tuple(recordings)))
    ran = subprocess.run(
        [sys.executable, "-"], input=CONSOLE, cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert ran.returncode == 0, ran.stderr
    refused, found = ran.stdout.strip().splitlines()
    assert refused.startswith("head.json: effect 'squared' is of the class __main__:Squared, which is not registered")
    assert "define it there again and call inkjet_env.plant.register(Squared)" in refused
    assert found == "named squared 0.0040"
