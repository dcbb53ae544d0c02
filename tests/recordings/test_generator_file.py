"""Waveforms written for arbitrary waveform generators are played back to the same volts and microseconds."""

import numpy as np
import pytest

from inkjet_env.printhead import Waveform
from inkjet_env.recordings.generator_file import MAKERS, POINTS, generator_text

CORNERS = Waveform(40.0, -25.0, 2e-6, 8e-6, 3e-6, 9e-6, 2.5e-6).knots()


def played(maker, text):
    """Times in seconds and volts that a generator makes of a file, read by its own rules."""
    lines = text.split("\r\n")
    if maker == "siglent":
        head = dict(line.split(",") for line in lines[:5])
        volts = np.array([float(line.split(",")[1]) for line in lines[13:-1]])
        assert lines[5:13] == [""] * 7 + ["xpos,value"]
        assert len(volts) == int(head["data length"]) == POINTS
        assert float(head["amp"]) == pytest.approx(np.ptp(volts))
        assert float(head["offset"]) == pytest.approx((volts.max() + volts.min()) / 2)
        return np.arange(POINTS) / POINTS / float(head["frequency"]), volts
    if maker == "rigol":
        head = dict(line.split(":", 1) for line in lines[1:8])
        volts = np.array([float(line[1:]) for line in lines[9:] if line])
        assert int(head["DOTS"]) == len(volts)
        return np.arange(len(volts)) / len(volts) * float(head["PERIOD"].removesuffix(" S")), volts
    if maker == "keysight":
        head = dict(line.split(":", 1) for line in lines[:9])
        levels = np.array([int(line) for line in lines[10:-1]])
        high, low = float(head["High Level"]), float(head["Low Level"])
        assert int(head["Data Points"]) == len(levels)
        volts = low + (levels / 32767 + 1) / 2 * (high - low)
        return np.arange(len(levels)) / float(head["Sample Rate"]), volts
    rate = float(lines[0].removeprefix("Rate = "))
    volts = np.array([float(line) for line in lines[1:-1]])
    return np.arange(len(volts)) / rate, volts


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("gain", [1.0, 20.0])
def test_a_file_plays_the_waveform(maker, gain):
    text, note = generator_text(maker, *CORNERS, 100e6, gain)
    time_s, volts = played(maker, text)
    np.testing.assert_allclose(volts * gain, np.interp(time_s, *CORNERS), atol=2e-3)
    assert (note is None) == (gain == 20.0)


@pytest.mark.parametrize(
    ("maker", "rate", "gain"), [("tektronix", 1e8, 1.0), ("rigol", 1e8, 0.0), ("rigol", np.nan, 1.0)]
)
def test_what_cannot_be_is_refused(maker, rate, gain):
    with pytest.raises(ValueError, match="must be"):
        generator_text(maker, *CORNERS, rate, gain)
