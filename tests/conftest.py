import sys

import pytest

from inkjet_env.experiments import cli
from inkjet_env.plant import registry
from tests.browser import launched
from tests.processes import started, wait_until, written_json


@pytest.fixture
def start():
    """Start processes; what is left of them ends with the test."""
    processes = []

    def begin(*command, **environment):
        processes.append(started(*command, **environment))
        return processes[-1]

    yield begin
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture
def scheduler(start, tmp_path):
    """Address of a Dask scheduler in a process of its own."""
    file = tmp_path / "scheduler.json"
    local = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    start("-m", "distributed.cli.dask_scheduler", *local, "--scheduler-file", file)
    return wait_until(lambda: written_json(file))["address"]


@pytest.fixture
def inkjet(capsys, tmp_path, monkeypatch):
    """Run the command in an empty folder: exit status, standard output, standard error.

    Modules that it imports from the folder, and effects that it registers, are forgotten afterwards.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_registered", dict(registry._registered))
    monkeypatch.setattr(sys, "path", list(sys.path))

    def run(*arguments):
        with pytest.raises(SystemExit) as exit_:
            cli.main([str(a) for a in arguments])
        out, err = capsys.readouterr()
        return exit_.value.code, out, err

    yield run
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None)).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.fixture(scope="module")
def browser():
    """A Chromium for the tests of one file: while it is there, so is Playwright's event loop."""
    with launched() as opened:
        yield opened
