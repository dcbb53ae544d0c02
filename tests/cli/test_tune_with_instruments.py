"""``inkjet tune --rig module:Class`` with instruments over VISA, simulated by PyVISA-sim."""

import re
import sys

import numpy as np
import pytest

from inkjet_env.experiments.commands.tune import _rig
from inkjet_env.experiments.tuning.exchange import Exchange
from inkjet_env.printhead import DriverLimits
from inkjet_env.rig import Request

pytest.importorskip("pyvisa", reason="the extra visa is not installed")
pytest.importorskip("pyvisa_sim", reason="the extra visa is not installed")

from tests.modules import ROOT
from tests.rig.simulated_bench import CODE_V, GENERATOR, SCOPE, bench, samples_of

BENCH = """
from inkjet_env.printhead import DriverLimits
from inkjet_env.rig.visa import Demagnetisation, Generator, Oscilloscope, ScopeInput, VisaRig

class Bench(VisaRig):
    def __init__(self):
        super().__init__(
            Generator({generator!r}, gain=20.0),
            Oscilloscope({scope!r}, {{"self_sensing": ScopeInput(1, range_V=4.0)}}),
            limits=DriverLimits(-80, 80, 20, 20, 0.1),
            demagnetisation=Demagnetisation(80.0, cycles=4, rest_s=0.0),
            settling_s=0.0, timeout_s=0.3, arming_s=0.0, library={library!r},
        )
"""
TIME_S = 2e-7 * np.arange(500)
SENSOR_V = np.sin(2 * np.pi * 5e4 * TIME_S)


@pytest.fixture
def my_bench(tmp_path, monkeypatch, request):
    """Write the user's module, with a name of its own in each test; its place and the folder."""
    monkeypatch.chdir(tmp_path)
    library = bench(tmp_path, 2e-7, samples_of(SENSOR_V))
    name = f"bench_of_{request.node.name}"

    def write(generator=GENERATOR):
        text = BENCH.format(generator=generator, scope=SCOPE, library=library)
        (tmp_path / f"{name}.py").write_text(text)
        return f"{name}:Bench"

    return write


def test_the_rig_of_a_users_module_states_its_limits_and_takes_the_recordings_of_a_session(my_bench, tmp_path):
    rig = _rig(my_bench(), 0, 45.0, DriverLimits())
    assert rig.limits() == DriverLimits(-80, 80, 20, 20, 0.1)
    drive_V = 40 * np.sin(2 * np.pi * 1e4 * TIME_S)
    requests = [Request(f"q{k}", "self_sensing", state, 2e-7, drive_V) for k, state in enumerate(STATES)]
    Exchange(tmp_path / "session", rig).obtain(requests, 5, lambda _: None)
    kept = Exchange(tmp_path / "session").recorded
    assert [(one.name, one.order, one.initial_state) for one in kept] == [("q0", 5, STATES[0]), ("q1", 6, STATES[1])]
    for one in kept:
        np.testing.assert_allclose(one.drive_V, drive_V, atol=1e-9)
        assert np.abs(one.sensor - SENSOR_V).max() <= 0.501 * 256 * CODE_V


STATES = ("periodic", "demagnetised")


def test_a_sensor_that_is_not_connected_is_one_sentence_and_status_2(inkjet, my_bench):
    """The default battery begins with the strain gauge."""
    status, out, err = inkjet("tune", "bench", "--rig", my_bench())
    assert (status, out) == (2, "")
    (told,) = [line for line in err.splitlines() if "tune bench" not in line]
    assert "a recording of strain_gauge is asked for, and the oscilloscope has inputs for self_sensing only" in told


def test_an_instrument_that_is_not_there_is_told_before_any_work(inkjet, my_bench, tmp_path):
    place = my_bench(generator="not an address")
    status, out, err = inkjet("tune", "bench", "--rig", place)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert f"--rig {place}: the generator not an address takes no commands" in err
    assert not (tmp_path / "bench-tuning").exists()


def test_the_bench_of_the_documentation_makes_its_trial_recording(tmp_path, monkeypatch, capsys):
    page = (ROOT / "docs" / "how-to" / "tune-a-head.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    (module,) = [block for block in blocks if "class Bench(VisaRig)" in block]
    (trial,) = [block for block in blocks if "from my_bench import Bench" in block]
    drive_V = 5 * np.sin(2 * np.pi * np.arange(500) / 500)
    library = bench(tmp_path, 2e-7, samples_of(drive_V / 100))
    addresses = re.findall(r'"((?:TCPIP|USB)\S*::INSTR)"', module)
    for address, simulated in zip(addresses, (GENERATOR, SCOPE), strict=True):
        module = module.replace(address, simulated)
    last = "demagnetisation=Demagnetisation(peak_V=100.0),"
    (tmp_path / "my_bench.py").write_text(module.replace(last, f"{last} library={library!r},"))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_bench", raising=False)
    exec(compile(trial, "trial", "exec"), {})
    sys.modules.pop("my_bench")
    assert 0 < float(capsys.readouterr().out) <= 0.501 * 256 * CODE_V * 100
