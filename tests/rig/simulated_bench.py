"""A generator and an oscilloscope as PyVISA-sim simulates them; they know the commands of `inkjet_env.rig.visa`."""

import json

import numpy as np

from inkjet_env.printhead import DriverLimits
from inkjet_env.rig.visa import Generator, Oscilloscope, ScopeInput, VisaRig

GENERATOR, SCOPE = "TCPIP0::192.168.0.10::inst0::INSTR", "USB0::0x2A8D::0x1770::MY1::0::INSTR"
SOCKET = "TCPIP0::192.168.0.11::5025::SOCKET"
"""Another way to the same oscilloscope."""
CODE_V, MIDDLE = 1e-4, 0x4000
"""Volts per unit of a sample, and the sample that stands for 0 V. Both bytes of every sample are below 128, because
PyVISA-sim's answers are text."""
LIMITS = DriverLimits(-100, 100)


def samples_of(volts):
    """Samples of the oscilloscope that stand for a signal to a step of 256 · `CODE_V`, as of an 8-bit converter."""
    upper = np.rint(np.asarray(volts) / CODE_V / 256).astype(int) + MIDDLE // 256
    assert upper.min() > 0
    assert upper.max() < 128
    return 256 * upper


def block(samples):
    """Samples as a block of IEEE 488.2, upper byte first."""
    data = "".join(chr(code // 256) + chr(code % 256) for code in np.asarray(samples).tolist())
    return f"#8{len(data):08d}{data}"


def scaling(count, step_s, origin_s=0.0):
    return f"1,0,{count},1,{step_s!r},{origin_s!r},0,{CODE_V!r},0.0,{MIDDLE}"


def silent(*commands):
    return [{"q": command} for command in commands]


def bench(folder, step_s, samples, *, origin_s=0.0, stated=None, monitor=None, triggered=True, name="bench"):
    """Write the definition of both instruments; its name as a VISA library.

    The oscilloscope's record begins ``origin_s`` seconds after the trigger; ``stated`` is the number of samples that it
    says it has, ``monitor`` are the samples of its second input.
    """
    common = {
        "eom": {kind: {"q": "\n", "r": "\n"} for kind in ("TCPIP INSTR", "USB INSTR", "TCPIP SOCKET")},
        "error": {
            "error_queue": [{"q": "SYST:ERR?", "default": '+0,"No error"', "command_error": '-222,"Data out of range"'}]
        },
    }
    waves = {
        name: {"default": "", "setter": {"q": f"SOUR1:DATA:ARB {name},{{}}"}, "getter": {"q": f"{name}?", "r": "{}"}}
        for name in ("drive", "demag")
    }
    generator = common | {
        "dialogues": [
            {"q": "*IDN?", "r": "Simulated,Generator,1,1"},
            *silent("*CLS", "*TRG", "SOUR1:DATA:VOL:CLE", "OUTP1:LOAD INF", "OUTP:SYNC:SOUR CH1", "OUTP:SYNC ON"),
            *silent("TRIG1:SOUR BUS", "SOUR1:BURS:MODE TRIG", "SOUR1:BURS:NCYC 1", "SOUR1:FUNC ARB"),
            *silent("SOUR1:FUNC:ARB:FILT OFF", "SOUR1:VOLT:OFFS 0", "SOUR1:BURS:STAT ON", "SOUR1:BURS:STAT OFF"),
        ],
        "properties": waves
        | {
            "output": {"default": "OFF", "setter": {"q": "OUTP1 {}"}, "getter": {"q": "output?", "r": "{}"}},
            "wave": {
                "default": "drive", "setter": {"q": "SOUR1:FUNC:ARB {}"}, "specs": {"type": "str", "valid": [*waves]}
            },
            "rate": {
                "default": "1e6", "setter": {"q": "SOUR1:FUNC:ARB:SRAT {}"}, "getter": {"q": "rate?", "r": "{}"},
                "specs": {"type": "float", "min": "1e-6", "max": "160e6"},
            },
            "voltage": {
                "default": "1", "setter": {"q": "SOUR1:VOLT {}"}, "getter": {"q": "voltage?", "r": "{}"},
                "specs": {"type": "float", "min": "0.002", "max": "20"},
            },
        },
    }  # fmt: skip
    count = len(samples) if stated is None else stated
    second = samples if monitor is None else monitor
    scope = common | {
        "dialogues": [
            {"q": "*IDN?", "r": "Simulated,Oscilloscope,1,1"},
            {"q": "*OPC?", "r": "1"} if triggered else {"q": "*OPC?"},
            {"q": ":WAV:PRE?", "r": scaling(count, step_s, origin_s)},
            {"q": ":WAV:DATA?", "r": block(samples)},
            {"q": ":WAV:DATA? 1", "r": block(samples)},
            {"q": ":WAV:DATA? 2", "r": block(second)},
            *silent("*CLS", ":DIG CHAN1", ":DIG CHAN1,CHAN2", ":TIM:MODE MAIN", ":TIM:REF LEFT", ":TIM:POS 0"),
            *silent(":TRIG:MODE EDGE", ":TRIG:SWE NORM", ":TRIG:EDGE:SLOP POS", ":ACQ:TYPE NORM", ":ACQ:TYPE AVER"),
            *silent(":WAV:FORM WORD", ":WAV:BYT MSBF", ":WAV:UNS ON", ":WAV:POIN:MODE MAX", ":WAV:POIN MAX"),
            *silent(*(f":CHAN{k}:{rest}" for k in (1, 2) for rest in ("DISP ON", "COUP DC"))),
            *silent(":WAV:SOUR CHAN1", ":WAV:SOUR CHAN2"),
        ],
        "properties": {
            name: {"default": "1", "setter": {"q": f"{command} {{}}"}, "getter": {"q": f"{name}?", "r": "{}"}}
            for name, command in {
                "span": ":TIM:RANG", "source": ":TRIG:EDGE:SOUR", "level": ":TRIG:EDGE:LEV", "averages": ":ACQ:COUN",
                "probe1": ":CHAN1:PROB", "range1": ":CHAN1:RANG", "offset1": ":CHAN1:OFFS",
                "probe2": ":CHAN2:PROB", "range2": ":CHAN2:RANG", "offset2": ":CHAN2:OFFS",
            }.items()
        },
    }  # fmt: skip
    definition = {
        "spec": "1.1",
        "devices": {"generator": generator, "scope": scope},
        "resources": {GENERATOR: {"device": "generator"}, SCOPE: {"device": "scope"}, SOCKET: {"device": "scope"}},
    }
    file = folder / f"{name}.yaml"
    file.write_text(json.dumps(definition), encoding="utf-8")  # JSON is YAML
    return f"{file}@sim"


def rig(library, *, one=None, scope=None, generator=None, **options):
    """A rig on a simulated bench: sensor on input 1, 20 V at the head per volt of the generator."""
    usual = {"limits": LIMITS, "settling_s": 0.0, "settling_repetitions": 1, "timeout_s": 0.3, "arming_s": 0.0}
    scope = scope or Oscilloscope(SCOPE, {"self_sensing": one or ScopeInput(1, range_V=4.0)})
    return VisaRig(generator or Generator(GENERATOR, gain=20.0), scope, library=library, **(usual | options))
