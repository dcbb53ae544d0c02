"""Numbers of equations in the code are those of docs/explanation/model.md, where their symbols are."""

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = "docs/explanation/model.md"
OF_THE_MODEL = ("inkjet_env/printhead", "inkjet_env/plant", "optimizers")
"""Packages in which every equation is one of the model's."""
OTHERS = ("inkjet_env", "experiments")
"""Packages in which those are whose number is said, in the same file, to be the model's."""
LABELLED = re.compile(r"^\$\$ \(([\w-]+)\)$", re.MULTILINE)
REFERENCE = re.compile(r"\bEq(?:uation|\.)\s\((\d+)([a-z]?)\)(?:\s+and\s+\((\d+)([a-z]?)\))?(?:\s+of\s+([\w./`]+))?")
DEFINITION = re.compile(r"^ +\S.* {2,}\((\d+)([a-z]?)\)$", re.MULTILINE)
"""An equation in a docstring, its number at the end of its line."""
SYMBOLS = {
    "play": r"max\(|maximum\(",
    "superposition": r"weight|∫ p\(r\)|PI integral",
    "branch": r"branch (law|that)|\bdQ|Q\(\|u|self\.Q\(x|Q' at x|origin|swing",
    "density": r"Q''\(2r\)|curvature\(2",
    "polynomial": r"``Q``|\bQ\(x\)|Q' at x|polyval",
    "lumped": r"mass_kg \*|capacitance_F|m x''",
    "resonator": r"b1 (s|v')|b1 \* s|/ self\.mass_kg|coefficients? of (Eq|τ)|power series",
    "response": r"amplitude|λ|pole|moments|decay|∂|``c``|m_k",
    "peak-cost": r"cost|peaks|y_e\||magnitude|e >= 0",
    "swarm": r"\bc1\b|update|_v\b",
    "remainder": r"push|weights|Σ_i p_i|refitted",
    "forces": r"[Ff]orce|stiffness|F\(|λ|decay",
}
"""What stands beside each equation of the page wherever the code refers to it, and never beside its neighbours."""


@dataclass(frozen=True)
class Reference:
    """A place in the code that names an equation."""

    file: str
    line: int
    number: int
    letter: str
    of: str
    """Page or module that it is said to be of; empty if not said."""
    text: str
    """The line, those around it in a docstring, the next one below a comment."""


@cache
def numbers():
    """Number of each equation of the page, by its label."""
    labels = LABELLED.findall((ROOT / PAGE).read_text(encoding="utf-8"))
    return {label: number for number, label in enumerate(labels, start=1)}


def label_of(number):
    """Label of an equation of the page; None if it has none of that number."""
    return next((label for label, its in numbers().items() if its == number), None)


def beside(lines, k):
    """Text in which the symbols of an equation named in line k are looked for."""
    before, _, comment = lines[k].partition("#")
    if comment and before.strip():  # beside the line that computes it
        return lines[k]
    if comment:
        return " ".join(lines[k : k + 2])
    return " ".join(line.strip() for line in lines[max(k - 1, 0) : k + 2])


def references_in(file):
    text = (ROOT / file).read_text(encoding="utf-8")
    lines = text.splitlines()
    found = []
    for match in REFERENCE.finditer(text):
        k = text.count("\n", 0, match.start())
        first, first_letter, second, second_letter, of = match.groups(default="")
        for number, letter in ((first, first_letter), (second, second_letter)):
            if number:
                found.append(Reference(file, k + 1, int(number), letter, of.strip("`."), beside(lines, k)))
    return found


def files_of(package):
    return sorted(str(file.relative_to(ROOT)) for file in (ROOT / package).rglob("*.py"))


def of_the_model(reference):
    """Whether a reference is said to be to an equation of the page, or of a module that takes its numbers from it."""
    return reference.of == PAGE or module_of(reference).startswith(OF_THE_MODEL)


def module_of(reference):
    """File of the module that a reference names: whole, or by its last part from its own package; empty if none."""
    if not reference.of or "/" in reference.of:
        return ""
    whole = reference.of.replace(".", "/") + ".py"
    beside_it = str(Path(reference.file).parent / whole)
    return next((file for file in (whole, beside_it) if (ROOT / file).is_file()), "")


@cache
def references():
    """References of the code to equations of the page."""
    found = [reference for package in OF_THE_MODEL for file in files_of(package) for reference in references_in(file)]
    for file in (f for package in OTHERS for f in files_of(package) if not f.startswith(OF_THE_MODEL)):
        here = references_in(file)
        told = {reference.number for reference in here if of_the_model(reference)}
        found += [r for r in here if r.number in told and (of_the_model(r) or not r.of)]
    return found


@cache
def definitions():
    """Equations that docstrings write out with their number: file, number, letter, the line."""
    found = []
    for package in OF_THE_MODEL:
        for file in files_of(package):
            for match in DEFINITION.finditer((ROOT / file).read_text(encoding="utf-8")):
                found.append((file, int(match[1]), match[2], match[0]))
    return found


def named(reference):
    return f"{reference.file}:{reference.line} ({reference.number}{reference.letter})"


def assert_is_that_number(number, text):
    label = label_of(number)
    assert label is not None, f"{PAGE} has no equation ({number})"
    assert re.search(SYMBOLS[label], text), f"no symbols of the equation {label!r}"
    for other in (number - 1, number + 1):
        if label_of(other) and f"({other})" not in text:  # which the text does not name as well
            assert not re.search(SYMBOLS[label_of(other)], text), f"symbols of the equation {label_of(other)!r}"


def test_every_equation_of_the_page_has_its_symbols_here():
    assert numbers().keys() == SYMBOLS.keys()


@pytest.mark.parametrize("reference", references(), ids=named)
def test_a_number_in_the_code_is_that_of_the_equation_whose_symbols_stand_beside_it(reference):
    """And not of the one before it or after it, whose symbols do not: a number that is one off is noticed."""
    assert_is_that_number(reference.number, reference.text)


@pytest.mark.parametrize("definition", definitions(), ids=lambda d: f"{d[0]} ({d[1]}{d[2]})")
def test_an_equation_written_out_in_a_docstring_has_the_number_of_the_page(definition):
    _, number, _, line = definition
    assert_is_that_number(number, line)


def test_every_equation_of_the_page_is_named_where_it_is_computed():
    computed = {reference.number for reference in references()}
    assert [label for label, number in numbers().items() if number not in computed] == []


def test_a_step_towards_an_equation_is_written_out_in_one_module():
    """As (8a) is; and a reference to it, or to any equation of a module, leads there."""
    steps = {(number, letter): file for file, number, letter, _ in definitions() if letter}
    assert len(steps) == sum(1 for _, _, letter, _ in definitions() if letter)
    written = {(file, number, letter) for file, number, letter, _ in definitions()}
    for reference in references():
        if reference.letter:
            assert (reference.number, reference.letter) in steps, named(reference)
        if reference.of and reference.of != PAGE:
            place = (module_of(reference), reference.number, reference.letter)
            assert place in written, f"{named(reference)} of {reference.of}"
