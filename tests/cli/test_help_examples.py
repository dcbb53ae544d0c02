"""What ``inkjet`` and ``inkjet COMMAND --help`` print: examples that paste, that the commands understand, that run."""

import json
import re
import shlex
from pathlib import Path

import pytest
import typer

from inkjet_env.cli.app import FIRST_STEPS
from inkjet_env.experiments.cli import app
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Printhead

ROOT = Path(__file__).parents[2]
COMMANDS = typer.main.get_command(app).commands
EXAMPLE = re.compile(r"^ *(?:\$ )?inkjet (?:.*\\\n)*.*", re.MULTILINE)
SHELL = re.compile(r"^```(?:console|\{code-cell\} ipython3\n%%bash|bash|)\n(.*?)^```", re.DOTALL | re.MULTILINE)
PAGES = [ROOT / "README.md", *(page for page in sorted(ROOT.glob("docs/**/*.md")) if "\ninkjet " in page.read_text())]
SLOW = ("--report", "--robust", "tune", "bench", "prove", "diagnose")
"""Words of the examples that take longer than a test may; they are only parsed."""


def examples_in(text):
    """The command lines in a text, each as its words; a backslash at a line's end continues it."""
    lines = (found.group().replace("\\\n", "").strip().removeprefix("$ ") for found in EXAMPLE.finditer(text))
    return [shlex.split(line, comments=True) for line in lines]


def parsed(words):
    """Parse the words of a command line with the command's own parser."""
    program, command, *arguments = words
    assert program == "inkjet"
    return COMMANDS[command].make_context(command, arguments).params


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("columns", [60, 80])
def test_every_command_has_examples_that_paste_and_that_it_understands(inkjet, monkeypatch, command, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    status, out, _ = inkjet(command, "--help")
    assert status == 0
    found = examples_in(out[out.index("\n\n") : out.index("Options:")])
    assert found
    for words in found:
        assert words[1] == command
        assert any(value is not None for value in parsed(words).values())
    assert max(map(len, out.splitlines())) <= 80


def test_an_example_with_an_unknown_option_is_not_understood():
    with pytest.raises(Exception, match="No such option: --colour"):
        parsed(shlex.split("inkjet scan --colour red"))


def test_inkjet_alone_shows_four_commands_that_paste(inkjet):
    status, out, err = inkjet()
    assert (status, err) == (2, "")
    assert out.strip() == FIRST_STEPS
    assert max(map(len, out.splitlines())) <= 80
    found = examples_in(out[: out.index("All commands:")])
    assert [words[1] for words in found] == ["simulate", "record", "diagnose", "optimize"]
    for words in found:
        parsed(words)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pages_show_command_lines_that_the_commands_understand(page):
    for block in SHELL.findall(page.read_text(encoding="utf-8")):
        for words in examples_in(block):
            ends = [k for k, word in enumerate(words) if word in ("|", ">", "2>", "||", "&&")]
            parsed(words[: min(ends, default=len(words))])


def test_quick_examples_run_one_after_another_in_a_folder(inkjet, tmp_path):
    tutorial = (ROOT / "docs" / "tutorials" / "write-your-own-effect.md").read_text(encoding="utf-8")
    own = re.search(r"%%writefile my_effects.py\n(.*?)^```", tutorial, re.DOTALL | re.MULTILINE)
    (tmp_path / "my_effects.py").write_text(own[1], encoding="utf-8")
    head, mode = Printhead.published(), next(e for e in catalogue() if e.id == "second_mode")
    AugmentedPrinthead(head, ((mode, mode.example_values(head)),)).to_json(tmp_path / "corrected.json")
    head.to_json(tmp_path / "printhead.json")
    inkjet("optimize", "--budget", "200", "--out", "waveform.csv", "--json", "optimum.json")
    ran = []
    for command in ("record", "simulate", "evaluate", "scan", "optimize"):
        help_text = inkjet(command, "--help")[1]
        for words in examples_in(help_text[: help_text.index("Options:")]):
            if not any(word in SLOW for word in words):
                status, _, err = inkjet(*words[1:], *(("--points", "5") if command == "scan" else ()))
                assert status == 0, (words, err)
                ran.append(command)
    assert len(ran) >= 12
    assert json.loads((tmp_path / "scan.json").read_text())["format"] == "scan/1"
