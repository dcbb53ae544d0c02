"""What README and the documentation point to is there: files, modules, commands."""

import importlib.util
import re
from pathlib import Path
from urllib.parse import unquote

import pytest
import typer

from inkjet_env.experiments.cli import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
LINK = re.compile(r"!?\[[^\]]*\]\(([^()\s]+)\)")
MODULE = re.compile(r"python3? -m ([A-Za-z_][\w.]*\w)")
FENCED = re.compile(r"^(`{3,}|:{3,}).*?^\1\s*$", re.DOTALL | re.MULTILINE)
QUOTED = re.compile(r"\$\$.*?\$\$|`[^`]*`", re.DOTALL)
"""Equations and code: brackets in them are no links."""
TARGET = re.compile(r"^([a-z]+):", re.MULTILINE)


def text_of(page):
    return page.read_text(encoding="utf-8")


def named(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_relative_link_leads_to_a_file(page):
    links = LINK.findall(QUOTED.sub("", FENCED.sub("", text_of(page))))
    files = [unquote(link.partition("#")[0]) for link in links if not re.match(r"[a-z]+:|#", link)]
    assert [file for file in files if not (page.parent / file).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_module_that_is_to_be_run_exists(page):
    modules = set(MODULE.findall(text_of(page)))
    assert [name for name in sorted(modules) if importlib.util.find_spec(name) is None] == []


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_source_file_that_is_named_with_its_folder_exists(page):
    files = set(re.findall(r"`((?:inkjet_env|optimizers|experiments|docs)/[\w./-]*\w)/?`", text_of(page)))
    files = {file for file in files if not file.endswith("-v0")}  # the environments' ids
    assert [file for file in sorted(files) if not (ROOT / file).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_make_target_that_is_named_exists(page):
    targets = set(TARGET.findall(text_of(ROOT / "Makefile")))
    within = "\n".join(match.group() for match in FENCED.finditer(text_of(page)))
    asked = set(re.findall(r"^make ([a-z]+)\b", within, re.MULTILINE))
    asked |= set(re.findall(r"`make ([a-z]+)\b", text_of(page)))
    assert asked <= targets


def test_every_command_has_its_place_in_the_reference():
    page = text_of(ROOT / "docs" / "reference" / "command-line.md")
    commands = set(typer.main.get_command(app).commands)
    assert set(re.findall(r"^## inkjet (\S+)$", page, re.MULTILINE)) == commands
    assert set(re.findall(r"^```\{command-help\} (\S+)$", page, re.MULTILINE)) == commands


def test_every_page_is_in_a_table_of_contents():
    """As the build sees it, too; here without building."""
    docs = ROOT / "docs"
    listed = {docs / "index.md"}
    for page in docs.rglob("*.md"):
        for toctree in re.findall(r"^```\{toctree\}\n(.*?)^```", text_of(page), re.DOTALL | re.MULTILINE):
            entries = [line for line in toctree.splitlines() if line and not line.startswith(":")]
            listed |= {page.parent / f"{entry}.md" for entry in entries}
    assert {named(page) for page in docs.rglob("*.md")} == {named(page) for page in listed}
