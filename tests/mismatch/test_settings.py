"""Settings of a diagnosis: each says what it is, where it comes from, and is used."""

import ast
import functools
import re
from dataclasses import FrozenInstanceError, fields, is_dataclass
from pathlib import Path

import pytest

from inkjet_env.mismatch import DiagnosisSettings, SelectionSettings, diagnose, settings
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from tests.mismatch.diagnoses import LOOKED_FOR, ids

FOLDER = Path(settings.__file__).parent
GROUPS = [type(getattr(DiagnosisSettings(), one.name)) for one in fields(DiagnosisSettings)]
SETTINGS = [(group, one) for group in GROUPS for one in fields(group)]


@functools.cache
def described():
    """Docstring of each field, by the names of its class and its own."""
    found = {}
    for node in ast.parse(Path(settings.__file__).read_text()).body:
        if isinstance(node, ast.ClassDef):
            for field, text in zip(node.body, node.body[1:], strict=False):
                if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                    found[node.name, field.target.id] = " ".join(ast.literal_eval(text.value).split())
    return found


@pytest.mark.parametrize(("group", "one"), SETTINGS, ids=lambda x: getattr(x, "name", ""))
def test_each_has_a_meaning_a_unit_and_a_source(group, one):
    assert re.fullmatch(r"[A-Z].{20,}\. Unit: \S.*\. Source: \S.*\.", described()[group.__name__, one.name])


@functools.cache
def names_used():
    """Every name that follows a dot in the code of the diagnosis."""
    code = "".join(path.read_text() for path in FOLDER.rglob("*.py") if path.name != "settings.py")
    return set(re.findall(r"\.(\w+)", code))


@pytest.mark.parametrize(("group", "one"), SETTINGS, ids=lambda x: getattr(x, "name", ""))
def test_each_is_used_by_the_diagnosis(group, one):
    assert one.name in names_used()


def test_no_file_of_the_diagnosis_keeps_a_threshold_of_its_own():
    guards = {"DIFFERENCE", "WORST", "LARGEST", "SMALL", "SINGULAR", "STILL", "EMPTY", "PROFILE_90", "BISECTIONS",
              "NODES", "LEAST_SINE", "LEAST_OWN_POWER", "ROUNDS", "MOST_RECENT"}  # fmt: skip
    found = set()
    for path in FOLDER.rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant | ast.UnaryOp):
                found |= {t.id for t in node.targets if isinstance(getattr(node.value, "value", 0), int | float)}
    assert found <= guards | {"MOST_BANDS", "MOST_NAMED"}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"significance_level": 0.0}, "a finite number above 0; got 0.0. Its default is 0.001"),
        ({"significance_level": float("nan")}, "a finite number above 0; got nan"),
        ({"beam_width": 0}, "a whole number of at least 1; got 0. Its default is 3"),
        ({"beam_width": 2.5}, "a whole number of at least 1; got 2.5"),
        ({"delays": (1.0, -1.0)}, "a finite number above 0; got -1.0"),
        ({"beam_width": True}, "a whole number of at least 1; got True"),
    ],
)
def test_what_is_no_setting_is_refused_by_name(changed, said):
    with pytest.raises(ValueError, match=re.escape(f"SelectionSettings.{next(iter(changed))} must be {said}")):
        SelectionSettings(**changed)


def test_they_are_frozen_and_all_of_one_class():
    with pytest.raises(FrozenInstanceError):
        DiagnosisSettings().verdict.left_over = 1.0
    assert all(is_dataclass(group) for group in GROUPS)


def test_a_diagnosis_follows_its_settings_and_carries_them(recorded, head, effects):
    campaign, looked_for = recorded("feedthrough"), [effects[name] for name in LOOKED_FOR]
    usual = diagnose(campaign, head, looked_for, workers=1)
    assert (usual.verdict, ids(usual), usual.settings) == ("named", ["feedthrough"], DiagnosisSettings())
    blind = DiagnosisSettings(selection=SelectionSettings(significance_level=1e-300, random_effect_gain=1e300))
    found = diagnose(campaign, head, looked_for, workers=1, settings=blind)
    assert (found.verdict, ids(found), found.settings) == ("unknown", [], blind)  # it looks for none, but there is one
    assert found.headline.startswith("Unknown: the residuals have structure that noise has not")


def test_every_fit_has_the_settings_of_its_diagnosis(recorded, head, effects, monkeypatch):
    from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit

    seen, begin = set(), OutputErrorFit.__init__

    def noted(self, observed, noise, start, given, *others, **named):
        seen.add(given)
        begin(self, observed, noise, start, given, *others, **named)

    monkeypatch.setattr(OutputErrorFit, "__init__", noted)
    monkeypatch.setattr(ProcessPool, "map", lambda self, function, tasks: map(function, tasks))
    own = DiagnosisSettings(selection=SelectionSettings(starts=2))
    diagnose(recorded("feedthrough"), head, [effects["feedthrough"]], workers=1, settings=own)
    assert seen == {own}


def test_a_kept_fit_is_not_taken_for_one_with_other_settings(recorded, head, effects, tmp_path):
    class Stop(Exception):
        pass

    def stop(step):
        if step == "designing the next experiment":
            raise Stop

    folder, names = tmp_path / "fits", []
    for own in (DiagnosisSettings(), DiagnosisSettings(selection=SelectionSettings(starts=2))):
        with pytest.raises(Stop):
            diagnose(
                recorded("feedthrough"), head, [effects["feedthrough"]], workers=1, checkpoint=folder, progress=stop,
                settings=own,
            )  # fmt: skip
        names.append({path.name for path in folder.iterdir()})
    assert names[0]
    assert len(names[1]) == 2 * len(names[0])
