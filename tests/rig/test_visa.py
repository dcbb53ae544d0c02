"""A generator and an oscilloscope over VISA, simulated by PyVISA-sim."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.printhead import DriverLimits, Printhead
from inkjet_env.rig import Request, self_sensing_battery
from inkjet_env.rig.answer import answer_V
from inkjet_env.rig.visa import (
    Demagnetisation,
    Generator,
    GeneratorCommands,
    InstrumentError,
    Oscilloscope,
    OscilloscopeCommands,
    ScopeInput,
)

pytest.importorskip("pyvisa", reason="the extra visa is not installed")
pytest.importorskip("pyvisa_sim", reason="the extra visa is not installed")

from tests.rig.simulated_bench import CODE_V, GENERATOR, MIDDLE, SCOPE, SOCKET, bench, rig, samples_of

HEAD = Printhead.published()
LINES = {line.label: line for line in self_sensing_battery(HEAD.frequency_Hz)}
PULSE, STEP = LINES["trapezoid-60V"], LINES["step"]
SIGNAL_V = answer_V(HEAD, PULSE)
SCALE = 1.0 / np.abs(SIGNAL_V).max()
STEP_V = 256 * CODE_V
QUICK = Demagnetisation(100.0, cycles=4, frequency_Hz=1000.0, rest_s=0.0)


def asked(line=PULSE, **options):
    return Request("q1", line.channel, line.initial_state, line.step_s, line.drive_V, **options)


@pytest.fixture
def sent(monkeypatch):
    """Commands and questions that reach the simulated instruments, in order."""
    from pyvisa_sim.devices import Device

    told, write = [], Device.write

    def logged(self, data):
        text = data.decode()
        if "ERR?" not in text:
            told.append((self.name, text.strip()))
        write(self, data)

    monkeypatch.setattr(Device, "write", logged)
    return told


def to(sent, name):
    return [command for device, command in sent if device == name]


def held(library, question):
    """What the simulated generator holds."""
    import pyvisa

    resource = pyvisa.ResourceManager(library).open_resource(GENERATOR, write_termination="\n")
    try:
        return resource.query(question).strip()
    finally:
        resource.close()


def test_a_repeated_drive_is_recorded_in_volts_on_the_samples_of_the_request(tmp_path):
    library = bench(tmp_path, PULSE.step_s, samples_of(SCALE * SIGNAL_V))
    recording = rig(library, one=ScopeInput(1, range_V=4.0, per_V=1 / SCALE)).record(asked(repeat_of="q0"), 7)
    assert np.abs(recording.sensor - SIGNAL_V).max() <= 0.501 * STEP_V / SCALE
    np.testing.assert_array_equal(recording.drive_V, PULSE.drive_V)
    np.testing.assert_array_equal(recording.time_s, PULSE.time_s)
    assert (recording.name, recording.order, recording.unit, recording.repeat_of) == ("q1", 7, "V", "q0")


def test_a_record_that_begins_before_the_trigger_and_is_finer_is_aligned_to_the_drive(tmp_path):
    """Four samples a step from a tenth of the screen before the trigger on, and a cable of 0.3 µs."""
    period_s, delay_s, fine_s = 1 / HEAD.frequency_Hz, 0.3e-6, PULSE.step_s / 4
    at_s = np.arange(-700, 4 * PULSE.drive_V.size + 40) * fine_s
    samples = samples_of(1.5 * np.sin(2 * np.pi * (at_s - delay_s) / period_s))
    library = bench(tmp_path, fine_s, samples, origin_s=float(at_s[0]))
    scope = Oscilloscope(SCOPE, {"self_sensing": ScopeInput(1, range_V=4.0)}, delay_s=delay_s)
    recording = rig(library, scope=scope).record(asked(), 1)
    assert np.abs(recording.sensor - 1.5 * np.sin(2 * np.pi * PULSE.time_s / period_s)).max() < 1.5 * STEP_V
    late = rig(library).record(asked(), 1)
    assert np.abs(late.sensor - recording.sensor).max() > 3 * STEP_V


def test_the_generator_gets_the_drive_over_the_gain_in_small_steps_centred_on_it(tmp_path):
    library = bench(tmp_path, PULSE.step_s, samples_of(0 * SIGNAL_V))
    mine = rig(library, generator=Generator(GENERATOR, gain=-20.0, points_per_step=10))
    mine.record(asked(), 1)
    values, volts = np.array(held(library, "drive?").split(","), float), float(held(library, "voltage?"))
    assert volts == pytest.approx(2 * 60 / 20)
    assert float(held(library, "rate?")) == pytest.approx(10 / PULSE.step_s)
    at_head_V = -20.0 * volts / 2 * values
    middle_s = (np.arange(values.size) + 0.5) * PULSE.step_s / 10
    asked_V = np.interp(middle_s, PULSE.time_s, PULSE.drive_V)
    assert np.abs(at_head_V - asked_V).max() < 1e-4


@pytest.mark.parametrize(("periodic", "last_V"), [(True, 2.5), (False, 10.0)])
def test_after_the_last_sample_a_drive_returns_to_its_first_one_only_if_it_repeats(periodic, last_V):
    points_V = Generator(GENERATOR, gain=1.0, points_per_step=2).held_V(np.array([0.0, 10.0]), 1e-6, periodic)
    assert points_V.tolist() == [2.5, 7.5, 7.5 if periodic else 10.0, last_V]


def test_a_repeated_drive_runs_before_it_is_recorded_and_the_output_is_off_at_the_end(tmp_path, sent):
    library = bench(tmp_path, PULSE.step_s, samples_of(0 * SIGNAL_V))
    mine = rig(library, one=ScopeInput(1, range_V=2.0, offset_V=0.5, probe=10.0, averages=16))
    assert mine.identities == ("Simulated,Generator,1,1", "Simulated,Oscilloscope,1,1")
    assert "OUTP1 ON" not in to(sent, "generator")
    sent.clear()
    mine.record(asked(), 1)
    order = [command for _, command in sent]
    events = ["SOUR1:BURS:STAT OFF", "OUTP1 ON", ":DIG CHAN1", "*OPC?", ":WAV:DATA?"]
    assert [event for event in order if event in events] == events
    assert order[-1] == "OUTP1 OFF"
    assert "*TRG" not in order
    told = to(sent, "scope")
    for expected in (":ACQ:TYPE AVER", ":ACQ:COUN 16", ":CHAN1:RANG 2", ":CHAN1:OFFS 0.5", ":CHAN1:PROB 10"):
        assert expected in told
    assert f":TIM:RANG {1.25 * PULSE.step_s * PULSE.drive_V.size:.6g}" in told


def test_a_repeated_drive_settles_for_its_time_and_its_repetitions(tmp_path, monkeypatch):
    waited_s = []
    monkeypatch.setattr("inkjet_env.rig.visa.visa_rig.time.sleep", waited_s.append)
    library = bench(tmp_path, PULSE.step_s, samples_of(0 * SIGNAL_V))
    rig(library, settling_s=0.25).record(asked(), 1)
    rig(library, settling_repetitions=9000).record(asked(), 1)
    assert waited_s == pytest.approx([0.25, 9000 * PULSE.step_s * PULSE.drive_V.size])


def test_a_demagnetised_head_sees_a_decaying_sine_a_rest_and_the_drive_once(tmp_path, sent, monkeypatch):
    waited_s = []
    monkeypatch.setattr("inkjet_env.rig.visa.visa_rig.time.sleep", waited_s.append)
    signal_V = answer_V(HEAD, STEP)
    scale = 1.0 / np.abs(signal_V).max()
    library = bench(tmp_path, STEP.step_s, samples_of(scale * signal_V))
    mine = rig(
        library, one=ScopeInput(1, range_V=4.0, per_V=1 / scale), demagnetisation=replace(QUICK, rest_s=0.2),
        arming_s=0.1,
    )  # fmt: skip
    sent.clear()
    recording = mine.record(asked(STEP), 1)
    assert np.abs(recording.sensor - signal_V).max() <= 0.501 * STEP_V / scale
    order = [command for _, command in sent]
    events = ["SOUR1:FUNC:ARB demag", "OUTP1 ON", "*TRG", "SOUR1:FUNC:ARB drive", ":DIG CHAN1", "*TRG", ":WAV:DATA?"]
    assert [event for event in order if event in events] == events
    assert order.count("SOUR1:BURS:STAT ON") == 2
    assert order[-1] == "OUTP1 OFF"
    span_s = 1.25 * STEP.step_s * STEP.drive_V.size
    assert f":TIM:RANG {span_s:.6g}" in order
    assert waited_s == pytest.approx([5 / 1000 + 0.2, 0.1 + 0.1 * span_s], rel=1e-9)  # a division before the trigger
    voltages = {command for command in order if command.startswith("SOUR1:VOLT ")}
    assert voltages == {"SOUR1:VOLT 10"}  # 100 V over the gain of 20, peak to peak, for both: no range is switched
    demag_V = 100.0 * np.array(held(library, "demag?").split(","), float)
    half_cycles_V = demag_V[:-1].reshape(10, -1)
    assert np.sign(half_cycles_V.sum(axis=1)).tolist() == [1, -1] * 5
    peaks_V = np.abs(half_cycles_V).max(axis=1)
    assert peaks_V[:2].tolist() == [100.0, 100.0]
    assert np.all(np.diff(peaks_V[1:]) < 0)
    assert peaks_V[-1] < 100 / 4 / 2
    assert (demag_V[0], demag_V[-1]) == (0.0, 0.0)


def test_averages_of_a_demagnetised_head_are_each_taken_after_a_demagnetisation_of_their_own(tmp_path, sent):
    library = bench(tmp_path, STEP.step_s, samples_of(0 * STEP.drive_V))
    mine = rig(library, one=ScopeInput(1, range_V=4.0, averages=3), demagnetisation=QUICK)
    sent.clear()
    mine.record(asked(STEP), 1)
    order = [command for _, command in sent]
    assert (order.count("SOUR1:FUNC:ARB demag"), order.count("*TRG"), order.count(":DIG CHAN1")) == (3, 6, 3)
    assert ":ACQ:TYPE AVER" not in order


def test_the_voltage_at_the_head_is_recorded_with_the_ratio_of_the_monitor(tmp_path):
    """On an oscilloscope of another maker, whose question for samples names the input."""
    library = bench(tmp_path, PULSE.step_s, samples_of(SCALE * SIGNAL_V), monitor=samples_of(PULSE.drive_V / 100))
    commands = replace(OscilloscopeCommands(), samples=":WAV:DATA? {input}")
    inputs = {"self_sensing": ScopeInput(1, range_V=4.0)}
    scope = Oscilloscope(SCOPE, inputs, monitor=ScopeInput(2, range_V=4.0, per_V=100.0), commands=commands)
    recording = rig(library, scope=scope).record(asked(drive_monitor=True), 1)
    assert np.abs(recording.drive_monitor_V - PULSE.drive_V).max() <= 0.501 * 100 * STEP_V
    assert np.abs(recording.sensor - SCALE * SIGNAL_V).max() <= 0.501 * STEP_V
    assert rig(library, scope=scope).record(asked(), 1).drive_monitor_V is None


def test_a_sensor_of_displacement_is_recorded_in_its_unit(tmp_path):
    volts = np.linspace(-1, 1, PULSE.drive_V.size)
    library = bench(tmp_path, PULSE.step_s, samples_of(volts))
    scope = Oscilloscope(SCOPE, {"displacement": ScopeInput(1, range_V=4.0, per_V=0.05, unit="um")})
    recording = rig(library, scope=scope).record(replace(asked(), channel="displacement"), 1)
    assert recording.sensor_column == "displacement_um"
    assert np.abs(recording.sensor - 0.05 * volts).max() <= 0.501 * 0.05 * STEP_V


def test_a_block_of_samples_that_holds_line_feeds_is_read_from_a_raw_socket(tmp_path):
    """There, a line feed is all that ends an answer of text."""
    volts = np.where(np.arange(PULSE.drive_V.size) % 7 < 3, CODE_V * (0x0A00 - MIDDLE), 0.5)
    library = bench(tmp_path, PULSE.step_s, samples_of(volts))
    scope = Oscilloscope(SOCKET, {"self_sensing": ScopeInput(1, range_V=4.0)})
    assert np.abs(rig(library, scope=scope).record(asked(), 1).sensor - volts).max() <= 0.501 * STEP_V


LOW = Generator(GENERATOR, gain=2.0)
FLAT = samples_of(0 * SIGNAL_V)
CLIPPED = np.where(np.arange(FLAT.size) < 17, 0x0100, FLAT)


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        ({}, {"generator": LOW}, r"the generator TCPIP0.* reports after 'SOUR1:VOLT 60': -222,\"Data out of range\"\."),
        ({"triggered": False}, {}, r"no complete recording after 0\.30\d s\. Is the generator's sync output connected"),
        ({"samples": CLIPPED}, {}, r"its input 1 clips 17 of 1600 samples: .* screen of 4 V around 0 V\. Raise its"),
        ({"stated": 1700}, {}, "stated 1700 samples and sent 1600"),
        ({"samples": FLAT[:1500]}, {}, r"recorded from 0 s to \S+ s after the trigger; 0 s to \S+ s was asked for"),
        ({"origin_s": 1e-6}, {}, "recorded from 1e-06 s"),
        ({"step_s": 2 * PULSE.step_s}, {}, f"every {2 * PULSE.step_s:.4g} s; one every {PULSE.step_s:.4g} s was asked"),
        ({"step_s": 0.0}, {}, "stated 0 s between its samples"),
    ],
)  # fmt: skip
def test_a_bad_answer_of_an_instrument_is_one_sentence_and_the_output_is_off(tmp_path, sent, change, options, said):
    library = bench(tmp_path, **({"step_s": PULSE.step_s, "samples": FLAT} | change))
    mine = rig(library, **options)
    with pytest.raises(InstrumentError, match=said) as caught:
        mine.record(asked(), 1)
    assert "\n" not in str(caught.value)
    assert to(sent, "generator")[-1] == "OUTP1 OFF"


def commands_of(field, value):
    return Oscilloscope(
        SCOPE, {"self_sensing": ScopeInput(1, range_V=4.0)}, commands=replace(OscilloscopeCommands(), **{field: value})
    )


@pytest.mark.parametrize(
    ("scope", "said"),
    [
        (commands_of("scaling", "*IDN?"), "answers '\\*IDN\\?' with 'Simulated,Oscilloscope,1,1', not with 10 numbers"),
        (commands_of("samples", "*IDN?"), "does not answer '\\*IDN\\?' with samples: Could not find hash sign"),
        (commands_of("samples", ":WAV:NONE?"), "does not answer ':WAV:NONE\\?' with samples within 0.3 s"),
        (commands_of("single", (":ACQ:MODE NORM",)), "reports after ':ACQ:MODE NORM': -222"),
        (commands_of("finished_answer", "STOP"), "no complete recording after 0.30"),
    ],
)
def test_commands_that_do_not_fit_the_instrument_are_told(tmp_path, scope, said):
    library = bench(tmp_path, PULSE.step_s, FLAT)
    with pytest.raises(InstrumentError, match=said):
        rig(library, scope=scope).record(asked(), 1)


def test_an_oscilloscope_is_asked_until_it_has_finished(tmp_path, monkeypatch):
    from inkjet_env.rig.visa import Instrument

    answers, ask = iter(["RUN", "RUN", "STOP"]), Instrument.ask
    monkeypatch.setattr(
        Instrument, "ask", lambda self, text, *a, **b: next(answers) if text == "STAT?" else ask(self, text, *a, **b)
    )
    commands = replace(OscilloscopeCommands(), finished="STAT?", finished_answer="STOP")
    scope = Oscilloscope(SCOPE, {"self_sensing": ScopeInput(1, range_V=4.0)}, commands=commands)
    rig(bench(tmp_path, PULSE.step_s, FLAT), scope=scope).record(asked(), 1)
    assert list(answers) == []


def test_ctrl_c_while_the_drive_repeats_leaves_the_output_off(tmp_path, sent, monkeypatch):
    def interrupt(_):
        raise KeyboardInterrupt

    library = bench(tmp_path, PULSE.step_s, FLAT)
    mine = rig(library)
    monkeypatch.setattr("inkjet_env.rig.visa.visa_rig.time.sleep", interrupt)
    with pytest.raises(KeyboardInterrupt):
        mine.record(asked(), 1)
    assert to(sent, "generator")[-2:] == ["OUTP1 ON", "OUTP1 OFF"]


@pytest.mark.parametrize(
    ("options", "request_", "said"),
    [
        ({"limits": DriverLimits(-40, 40)}, asked(), "q1 goes to 60 V; the driver's highest voltage is 40 V"),
        ({}, asked(drive_monitor=True), "q1: the voltage at the head is asked for too"),
        ({}, asked(STEP), "q1: a demagnetised head is asked for, and the rig has no demagnetisation"),
        ({}, replace(asked(), channel="strain_gauge"), "q1: a recording of strain_gauge is asked for, and the osc"),
    ],
)
def test_what_the_rig_cannot_record_is_refused_before_anything_is_driven(tmp_path, sent, options, request_, said):
    mine = rig(bench(tmp_path, PULSE.step_s, FLAT), **options)
    sent.clear()
    with pytest.raises(ValueError, match=said):
        mine.record(request_, 1)
    assert "OUTP1 ON" not in to(sent, "generator")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda library: rig("nowhere.yaml@sim"),
            "nowhere.yaml@sim cannot be used: FileNotFoundError: .* 'nowhere.yaml'\\.",
        ),
        (lambda library: rig("@nix"), "the VISA library @nix cannot be used: .*pyvisa_nix.* PyVISA-py"),
        (lambda library: rig(library, generator=Generator("GPIB0::7::INSTR", gain=1.0)), "the generator GPIB0::7"),
        (lambda library: rig(library, generator=Generator("my generator", gain=1.0)), "the generator my generator"),
        (
            lambda library: rig(library, limits=DriverLimits(0, 100), demagnetisation=QUICK),
            "the demagnetising drive goes to -100 V; the driver's lowest voltage is 0 V",
        ),
        (lambda library: Generator(GENERATOR, gain=0.0), "gain must be finite and not 0"),
        (lambda library: Generator(GENERATOR, gain=1.0, points_per_step=0), "points_per_step must be at least 1"),
        (lambda library: ScopeInput(1, range_V=0.0), "range_V of input 1 must be finite and above 0"),
        (lambda library: ScopeInput(1, range_V=1.0, per_V=0.0), "per_V of input 1 must be finite and not 0"),
        (lambda library: ScopeInput(1, range_V=1.0, averages=0), "averages of input 1 must be at least 1"),
        (lambda library: ScopeInput(1, range_V=1.0, unit="mm"), "unit must be one of V, um, nm"),
        (lambda library: Oscilloscope(SCOPE, {}), "inputs must name the input of at least one sensor"),
        (
            lambda library: Oscilloscope(SCOPE, {"self_sense": ScopeInput(1, range_V=1.0)}),
            "Did you mean 'self_sensing'",
        ),
        (lambda library: Demagnetisation(-5.0), "peak_V of a demagnetisation must be finite and above 0"),
        (lambda library: Demagnetisation(5.0, cycles=0), "at least 1 cycle"),
    ],
)
def test_a_rig_that_cannot_work_is_refused_when_it_is_made(tmp_path, make, said):
    with pytest.raises(ValueError, match=said) as caught:
        make(bench(tmp_path, PULSE.step_s, FLAT))
    assert "\n" not in str(caught.value)


def test_a_command_that_the_simulated_bench_does_not_know_is_an_error_there(tmp_path):
    """Otherwise the tests above would show less than they say."""
    library = bench(tmp_path, PULSE.step_s, FLAT)
    set_up = ("OUTP{channel}:LOADS INF", *GeneratorCommands().set_up)
    other = Generator(GENERATOR, gain=20.0, commands=replace(GeneratorCommands(), set_up=set_up))
    mine = rig(library, generator=other)
    with pytest.raises(InstrumentError, match="after 'OUTP1:LOADS INF': -222"):
        mine.record(asked(), 1)
