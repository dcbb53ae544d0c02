"""An effect is one file: what the rest of the code must know of it, the effect declares."""

import ast
from pathlib import Path

import pytest

from inkjet_env.plant import catalogue

ROOT = Path(__file__).parents[2]
IDS = {effect.id for effect in catalogue()}
OUTSIDE = [
    path
    for top in ("inkjet_env", "optimizers", "experiments")
    for path in sorted((ROOT / top).rglob("*.py"))
    if not path.is_relative_to(ROOT / "inkjet_env/plant/effects")
    and not path.is_relative_to(ROOT / "experiments/concealed_rig")  # an independent plant with the same ids
    and path != ROOT / "experiments/proof/corpus.py"  # draws from that plant
]
DATA = {
    "experiments/benchmark/augmented_heads.py": "which effect each head of the suite was drawn with",
    "experiments/proof/adaptive.py": "which cases are counted as lags",
    "experiments/proof/judge.py": "which parameters catalogue and concealed plant have in common",
    "experiments/publish/figures.py": "which effect the head of a picture has",
    "experiments/validation/baselines/sindy.py": "what a sparse regression's terms stand for, as the baseline has it",
    "experiments/validation/diagnosis_study.py": "which pairs the study plants together",
    "experiments/validation/resonance_study.py": "what a system without a resonance may do instead",
    "experiments/robustness/mutated_inputs.py": "which effects the head has whose file is damaged",
}
"""Files that may name effects, and what their lists are: choices of a study, which a new effect need not enter."""


def ids_in(path):
    """Ids of the catalogue that stand as strings of their own in a source."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return sorted({n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and n.value in IDS})


@pytest.mark.parametrize("path", OUTSIDE, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_effect_is_named_outside_its_file(path):
    name = path.relative_to(ROOT).as_posix()
    found = ids_in(path)
    if name in DATA:
        assert found, f"{name} names no effect any more; take it off the list."
    else:
        assert not found, f"{name} names {', '.join(found)}. Let the effect declare what is asked of it there."


def test_an_id_in_a_source_is_seen(tmp_path):
    source = tmp_path / "special.py"
    source.write_text('"""On creep."""\nSLOW = {"creep": 1}\nif effect.id == "mains_hum": pass\n')
    assert ids_in(source) == ["creep", "mains_hum"]
