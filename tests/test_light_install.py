"""What a core install can do, and the sentences where a package of an extra is missing."""

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import distribution
from shutil import copytree

import pytest

from inkjet_env.extras import PACKAGES
from tests.modules import FOLDERS, ROOT

CORE = (
    "numpy", "scipy", "numba", "llvmlite", "gymnasium", "cloudpickle", "typing_extensions", "Farama-Notifications",
    "threadpoolctl",
)  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A site-packages with the core's packages alone."""
    folder = tmp_path_factory.mktemp("site-packages")
    for name in CORE:
        found = distribution(name)
        for top in {file.parts[0] for file in found.files if file.parts[0] != ".." and file.parts[0] != "__pycache__"}:
            (folder / top).symlink_to(found.locate_file(top))
    (folder / "inkjet_env").mkdir()
    for path in [*(ROOT / "inkjet_env").iterdir(), ROOT / "optimizers", ROOT / "experiments"]:
        if path.name != "__pycache__":
            (folder / "inkjet_env" / path.name).symlink_to(path)
    return folder


@pytest.fixture
def light(site, tmp_path):
    """Run a script, in an empty folder, with the core's packages alone: exit status, standard output and error."""

    def run(script, **environment):
        script = f"import sys; sys.path.append({str(site)!r})\n{script}"
        command = [sys.executable, "-S", "-s", "-c", script]
        clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        done = subprocess.run(
            command, cwd=tmp_path, env=clean | environment, capture_output=True, text=True, timeout=300, check=False
        )
        return done.returncode, done.stdout, done.stderr

    return run


def test_the_extras_are_absent_here(light):
    script = "\n".join(
        f"try: import {name}; print({name!r})\nexcept ImportError: pass"
        for name in ("typer", "rich", "matplotlib", "jinja2", "pyarrow", "joblib", "cma", "pandas", "torch", "pygame")
    )
    assert light(script) == (0, "", "")


def test_the_core_is_enough_for_environment_simulator_recordings_identification_and_diagnosis(light):
    status, out, err = light("""
import gymnasium, inkjet_env, numpy as np
env = gymnasium.make("inkjet_env/BipolarWaveform-v0")
env.reset(seed=0)
print(env.step(np.zeros(7, np.float32))[1] < 0)
from inkjet_env.printhead import Printhead, batch
print(batch.costs(np.array([[50.0, -50, 5e-6, 5e-6, 5e-6, 5e-6, 5e-6]]), Printhead.published()).shape)
from inkjet_env.recordings import read_campaign, write_campaign
from inkjet_env.rig import default_battery, record_campaign
from dataclasses import replace
labels = ("trapezoid-60V", "trapezoid-100V", "bipolar-full", "zero")
lines = [line for line in default_battery() if line.label in labels and line.channel == "self_sensing"]
lines = [replace(line, drive_V=line.drive_V[:400], repeats=1) for line in lines]
write_campaign("campaign", record_campaign(Printhead.published(), seed=1, battery=lines, snr_dB=40))
campaign = read_campaign("campaign")
from inkjet_env.identification import identify
found, true = identify(campaign).printhead.frequency_Hz, Printhead.published().frequency_Hz
print(abs(found / true - 1) < 1e-3)
from inkjet_env.mismatch import diagnose
print(diagnose(campaign).verdict)
""")
    assert (status, out.split("\n")) == (0, ["True", "(1,)", "True", "none", ""]), err


MISSING = (
    (
        "from inkjet_env.reporting.plotting import new_figure; new_figure(1, 1)",
        "a figure needs matplotlib, which is not installed: pip install 'inkjet-env[cli]'",
    ),
    (
        "from inkjet_env.reporting.tables import print_table; print_table((), ())",
        "a printed table needs rich, which is not installed: pip install 'inkjet-env[cli]'",
    ),
    (
        "from inkjet_env.reporting.identification_report import identification_html; identification_html('', None)",
        "a report needs jinja2, which is not installed: pip install 'inkjet-env[cli]'",
    ),
    (
        "from inkjet_env.reporting.diagnosis_report import diagnosis_html; diagnosis_html(None)",
        "a report needs jinja2, which is not installed: pip install 'inkjet-env[cli]'",
    ),
    (
        "import gymnasium, inkjet_env; e = gymnasium.make(inkjet_env.ENV_ID, render_mode='rgb_array')\n"
        "e.reset(); e.render()",
        "a picture needs matplotlib, which is not installed: pip install 'inkjet-env[cli]'",
    ),
    (
        "from inkjet_env.experiments.learning.learners import by_gradient; by_gradient(1, 0)",
        "learning needs torch, which is not installed: pip install 'inkjet-env[rl]'",
    ),
    (
        "import inkjet_env.envs.sb3",
        "inkjet_env.envs.sb3 needs stable_baselines3, which is not installed: pip install 'inkjet-env[rl]'",
    ),
    (
        "from inkjet_env.experiments.benchmark.run_files import runs_table; runs_table('results')",
        "a table of runs needs pyarrow, which is not installed: pip install 'inkjet-env[cli]'",
    ),
    (
        "from inkjet_env.experiments.execution.cluster import workers_of\n"
        "with workers_of('tcp://localhost:1', None): pass",
        "a Dask cluster needs dask, which is not installed: pip install 'inkjet-env[cluster]'",
    ),
    (
        "from inkjet_env.printhead import DriverLimits\n"
        "from inkjet_env.rig.visa import Generator, Oscilloscope, ScopeInput, VisaRig\n"
        "scope = Oscilloscope('TCPIP::2::INSTR', {'self_sensing': ScopeInput(1, range_V=1)})\n"
        "VisaRig(Generator('TCPIP::1::INSTR', gain=20), scope, limits=DriverLimits())",
        "a rig over VISA needs pyvisa, which is not installed: pip install 'inkjet-env[visa]'",
    ),
    (
        "from inkjet_env.extras import check_installed; check_installed('inkjet bench', 'bench')",
        "inkjet bench needs cma, which is not installed: pip install 'inkjet-env[bench]'",
    ),
)
"""What is done without a package, and the sentence that then names its extra."""


def test_a_missing_package_is_named_with_its_extra(light):
    status, out, err = light(f"""
import json
from inkjet_env.extras import MissingExtraError
said = []
for use in {[use for use, _ in MISSING]!r}:
    try:
        exec(use, {{}})
    except MissingExtraError as error:
        said.append(str(error))
    else:
        said.append("nothing")
print(json.dumps(said))
""")
    assert status == 0, err
    assert dict(zip(MISSING, json.loads(out), strict=True)) == {one: one[1] for one in MISSING}


def test_an_optimiser_without_its_package_names_the_extra(light):
    status, out, err = light("""
from inkjet_env import optimizers
print(optimizers.availability(["pso", "cma-es", "sb3-ppo"]))
""")
    assert (status, err) == (0, "")
    assert out == (
        "{'pso': None, "
        "'cma-es': \"cma-es needs cma, which is not installed: pip install 'inkjet-env[bench]'.\", "
        "'sb3-ppo': \"sb3-ppo needs torch, which is not installed: pip install 'inkjet-env[rl]'.\"}\n"
    )


def test_every_package_of_an_extra_is_known(site):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for name, packages in PACKAGES.items():
        declared = {re.split("[><=\\[]", line)[0].replace("-", "_") for line in project[name]}
        assert set(packages) - {"dask"} <= declared
        if name != "dev":
            assert declared - {"inkjet_env", "numpy"} <= set(packages)


def test_the_command_without_typer_is_refused_in_one_sentence(light):
    sentence = "inkjet needs typer, which is not installed: pip install 'inkjet-env[cli]'\n"
    assert light("from inkjet_env.experiments.entry import main; main()") == (2, "", sentence)


def test_a_command_that_lacks_a_package_ends_with_the_sentence(inkjet, monkeypatch):
    monkeypatch.setitem(sys.modules, "nevergrad", None)
    monkeypatch.setattr("inkjet_env.extras.find_spec", lambda name: None if name == "nevergrad" else name)
    status, out, err = inkjet("bench")
    assert (status, out) == (2, "")
    assert err == "inkjet bench needs nevergrad, which is not installed: pip install 'inkjet-env[bench]'\n"


def test_progress_needs_no_rich(light):
    status, _, err = light("""
import sys
sys.stderr.isatty = lambda: True
from inkjet_env.progress import shown_progress, shown_steps
with shown_progress("heads", 2) as progress:
    progress(2)
with shown_steps("identify"):
    pass
""")
    assert (status, err) == (0, "heads: 2 of 2\n")


FIRST_KERNEL = """
import numpy as np
from inkjet_env.printhead import compiled
compiled.play_operators(np.zeros(2), np.zeros(1), np.ones(1), np.zeros(1), np.empty(2))
"""


def test_compiling_is_announced_when_it_happens_and_only_then(light, tmp_path):
    cache = str(tmp_path / "cache")
    assert light(FIRST_KERNEL, NUMBA_CACHE_DIR=cache) == (0, "", "compiling the simulator once …\n")
    assert light(FIRST_KERNEL, NUMBA_CACHE_DIR=cache) == (0, "", "")


def test_without_a_folder_for_compiled_code_everything_runs_and_says_so(light):
    nowhere = "import numba.core.caching as c; c.CacheImpl._locator_classes = []\n"
    status, _, err = light(f"{nowhere}{FIRST_KERNEL}")
    assert status == 0
    said, compiling = err.splitlines()
    assert re.fullmatch("Compiled code cannot be kept, .* Set NUMBA_CACHE_DIR to a folder that you can write.", said)
    assert compiling == "compiling the simulator once …"


def test_the_wheel_holds_every_module_template_and_data_file(tmp_path):
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    for folder in FOLDERS.values():
        copytree(ROOT / folder, tmp_path / folder, ignore=lambda *_: {"__pycache__"})
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", "made", "."]
    subprocess.run(pip, cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = (tmp_path / "made").iterdir()
    held = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        "/".join((*package.split("."), *file.relative_to(ROOT / folder).parts))
        for package, folder in FOLDERS.items()
        for file in (ROOT / folder).rglob("*")
        if file.suffix in (".py", ".html", ".json", ".typed")
    }
    assert expected - held == set()
