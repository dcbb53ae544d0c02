"""Every oscilloscope style is read to the same numbers."""

import random

import numpy as np
import pytest

from inkjet_env.recordings import CampaignError, read_campaign

STEP_S = 1e-6
TIME_S = np.arange(-20, 180) * STEP_S
DRIVE_V = np.round(90 * np.clip(np.sin(TIME_S * 2e4), 0, None), 2)
SENSOR_V = np.round(0.4 * np.sin(TIME_S * 1.1e5), 4)
SAMPLES = list(zip(TIME_S.tolist(), DRIVE_V.tolist(), SENSOR_V.tolist(), strict=True))


def tektronix():
    header = [
        "Model,MSO46",
        "Firmware Version,1.20.4.5",
        "",
        "Waveform Type,ANALOG,,",
        "Point Format,Y,,",
        "Horizontal Units,s,,",
        "Horizontal Scale,2e-05,,",
        "Sample Interval,1e-06,,",
        "Record Length,200,,",
        "Gating,0.0% to 100.0%,,",
        "Probe Attenuation,100,1,",
        "Vertical Units,V,V,",
        "Vertical Offset,0,0,",
        "Label,,,",
        "TIME,CH1,CH2",
    ]
    return header + [f"{t:.9e},{d},{s}" for t, d, s in SAMPLES]


def keysight():
    return ["x-axis,1,2", "second,Volt,Volt"] + [f"{t:+.6E},{d:+.4E},{s:+.6E}" for t, d, s in SAMPLES]


def rigol_start_and_increment():
    header = ["X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-2.000000e-05,1.000000e-06"]
    return header + [f"{k},{d:.3e},{s:.4e}," for k, (_, d, s) in enumerate(SAMPLES)]


def rigol_start_in_names():
    return ["CH1V,CH2V,t0 =-2.0e-05, tInc = 1.0e-06,"] + [f"{d},{s},," for _, d, s in SAMPLES]


def rigol_times():
    return ["Time(s),CH1V,CH2V"] + [f"{t:.7e},{d},{s}" for t, d, s in SAMPLES]


def rigol_old():
    return ["Time,X(CH1),X(CH2),", "Second,Volt,Volt,"] + [f"{t:.6f},{d},{s}," for t, d, s in SAMPLES]


def picoscope():
    header = ["Time,Channel A,Channel B", "(ms),(V),(mV)", ""]
    return header + [f"{t * 1e3:.8f},{d:.8f},{s * 1e3:.8f}" for t, d, s in SAMPLES]


def picoscope_german():
    header = ["Zeit;Kanal A;Kanal B", "(µs);(V);(mV)", ""]
    return header + [f"{t * 1e6:.8f};{d:.8f};{s * 1e3:.8f}".replace(".", ",") for t, d, s in SAMPLES]


def plain():
    return ["time,drive,sensor"] + [f"{t:.6f},{d},{s}" for t, d, s in SAMPLES]


def plain_with_units_in_names():
    return ["sensor (mV)\ttime [us]\tdrive_V"] + [f"{s * 1e3:.6f}\t{t * 1e6:.1f}\t{d}" for t, d, s in SAMPLES]


def no_header():
    return [f"{t:.6f},{d},{s}" for t, d, s in SAMPLES]


STYLES = (
    tektronix,
    keysight,
    rigol_start_and_increment,
    rigol_start_in_names,
    rigol_times,
    rigol_old,
    picoscope,
    picoscope_german,
    plain,
    plain_with_units_in_names,
    no_header,
)
DAMAGE = (
    b"",
    b"\0",
    b"\xff",
    b"\r",
    b"\n",
    b'"',
    b",",
    b";",
    b"\t",
    b"nan",
    b"1e999",
    b"-",
    b"\xe2\x80\xa8",
    b"9" * 400,
    b"t0 =",
)
ENDINGS = {
    "unix": ("\n", "utf-8"),
    "windows": ("\r\n", "utf-8-sig"),
    "latin": ("\r\n", "latin-1"),
    "two bytes": ("\r\n", "utf-16"),
    "two bytes without a mark": ("\n", "utf-16-le"),
    "old macintosh": ("\r", "utf-8"),
}


def older_tektronix(channel, values):
    about = ["Record Length,200", "Sample Interval,1e-06", "Trigger Point,20", "", "Source," + channel]
    about += ["Vertical Units,V", "Horizontal Units,s", "Pt Fmt,Y"]
    about += [","] * (len(SAMPLES) - len(about))
    return [
        f"{cells or ','},,{t:.12f},{value:.6f},"
        for cells, t, value in zip(about, TIME_S.tolist(), values.tolist(), strict=True)
    ]


def read_lines(folder, lines, ending="\n", encoding="utf-8", **given):
    (folder / "scope.csv").write_bytes((ending.join(lines) + ending).encode(encoding))
    return read_campaign(folder, **{"channel": "self_sensing"} | given)


def assert_read(recording):
    assert np.allclose(recording.time_s, TIME_S, rtol=0, atol=1e-6 * STEP_S)
    assert np.allclose(recording.drive_V, DRIVE_V, rtol=1e-12, atol=1e-12)
    assert np.allclose(recording.sensor, SENSOR_V, rtol=1e-12, atol=1e-12)
    assert recording.unit == "V"


RIGOLS = (rigol_start_and_increment, rigol_start_in_names, rigol_times, rigol_old)
TOLD_STYLES = {tektronix: "Tektronix", keysight: "Keysight", picoscope: "PicoScope", **dict.fromkeys(RIGOLS, "Rigol")}
"""A table with a header that no maker's is known by is plain: a German PicoScope's too."""


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("style", STYLES)
def test_every_style_is_read_to_the_same_numbers(tmp_path, style, ending):
    campaign = read_lines(tmp_path, style(), *ENDINGS[ending])
    assert_read(campaign["scope"])
    assert f"scope.csv: {TOLD_STYLES.get(style, 'plain')} style;" in campaign.notes[0]


def test_two_files_of_one_channel_each_are_one_recording(tmp_path):
    for channel, values in (("CH1", SENSOR_V), ("CH2", DRIVE_V)):
        lines = older_tektronix(channel, values)
        (tmp_path / f"F0001{channel}.CSV").write_bytes("\r\n".join(lines).encode())
    assert_read(read_campaign(tmp_path, channel="self_sensing")["F0001"])
    assert_read(read_campaign(tmp_path, channel="self_sensing", columns={"drive": "CH2"})["F0001"])


def test_the_guess_is_told_and_can_be_overruled(tmp_path):
    campaign = read_lines(tmp_path, tektronix())
    assert "drive = CH1 (guessed: the larger range" in campaign.notes[0]
    for told in ({"drive": "CH2"}, {"sensor": "CH1"}, {"drive": 3, "sensor": 2}, {"drive": "3"}):
        swapped = read_lines(tmp_path, tektronix(), columns=told)["scope"]
        assert np.array_equal(swapped.drive_V, campaign["scope"].sensor)


def test_a_column_called_1_is_meant_by_its_name(tmp_path):
    assert_read(read_lines(tmp_path, keysight(), columns={"drive": "1", "sensor": "2"})["scope"])
    assert_read(read_lines(tmp_path, keysight(), columns={"drive": 2, "sensor": 3})["scope"])


def test_monitor_and_neighbour_are_found_by_name(tmp_path):
    lines = ["time_s,drive_V,drive monitor (kV),neighbour,sensor_V,spare"]
    lines += [f"{t:.6f},{d},{d / 1000},{d / 2},{s},0" for t, d, s in SAMPLES]
    campaign = read_lines(tmp_path, lines)
    assert_read(campaign["scope"])
    assert np.allclose(campaign["scope"].drive_monitor_V, DRIVE_V)
    assert np.allclose(campaign["scope"].neighbour_V, DRIVE_V / 2)
    assert any("spare was not read" in note for note in campaign.notes)


def test_a_length_is_a_displacement(tmp_path):
    lines = ["time,CH1,CH2", "s,V,mm"] + [f"{t:.6f},{d / 1000},{s}" for t, d, s in SAMPLES]
    recording = read_lines(tmp_path, lines, channel=None)["scope"]
    assert (recording.channel, recording.unit) == ("displacement", "um")
    assert np.allclose(recording.sensor, SENSOR_V * 1000)


def test_files_come_in_the_order_of_their_names(tmp_path):
    for name in ("b.csv", "a.TXT", ".hidden.csv", "c.log"):
        (tmp_path / name).write_text("\n".join(plain()))
    campaign = read_campaign(tmp_path, channel="strain_gauge")
    assert [(r.name, r.order) for r in campaign.recordings] == [("a", 1), ("b", 2)]


@pytest.mark.parametrize(
    ("lines", "given", "message"),
    [
        (plain(), {"channel": None}, "the sensor is unknown"),
        (plain(), {"channel": "selfsensing"}, "Did you mean 'self_sensing'"),
        (plain(), {"columns": {"driver": "drive"}}, "Did you mean 'drive'"),
        (plain(), {"columns": {"drive": "drove"}}, "Did you mean 'drive'"),
        (plain(), {"columns": {"drive": "1", "time": "time"}}, "two roles"),
        (plain(), {"columns": {"drive": True}}, "no column True"),
        ([], {}, "no row of numbers, at least two"),
        (["time,drive,sensor"], {}, "no row of numbers, at least two"),
        (plain()[:2], {}, "at least 2 samples; got 1"),
        ([line.rsplit(",", 1)[0] for line in plain()], {}, "sensor is unknown; the remaining columns are: none"),
        (["t,a,b,c"] + [f"{line},1" for line in no_header()], {}, "the remaining columns are: a, b, c"),
        (["time,sensor 1,sensor 2", *no_header()], {}, "could each be the sensor"),
        (["time,CH1,CH2", "s,V,A", *no_header()], {}, "unit 'A' of column CH2 is not known"),
        (["time,drive,sensor", "s,s,V", *no_header()], {}, "the drive must be in V; column drive is in s"),
        ([*plain()[:9], "0.1,oops,1"], {}, "row 10: drive must be a number; got 'oops'"),
        ([*plain()[:9], "0.1,nan,1"], {}, "row 10: drive must be finite"),
        ([*plain()[:9], "0.1,1"], {}, "row 10: must have 3 columns as the rows before; got 2"),
        ([*plain()[:9], "", "", *plain()[8:]], {}, "row 12: time must increase"),
        (plain()[:90] + plain()[95:], {}, "row 91: sampling must be uniform; .* is 5 steps off"),
        (
            ["X,CH1,CH2,Start,Increment", "Sequence,Volt,Volt,0,0", "0,1,2", "1,2,3"],
            {},
            "sample interval must be above 0 s",
        ),
        (["X,CH1,CH2,Start,Increment", "Sequence,Volt,Volt,0,1", "0,1,2", "2,2,3"], {}, "must count up by one"),
    ],
)
def test_what_cannot_be_told_is_refused_in_one_sentence(tmp_path, lines, given, message):
    with pytest.raises(CampaignError, match=message):
        read_lines(tmp_path, lines, **given)


def test_binary_files_are_refused(tmp_path):
    (tmp_path / "scope.csv").write_bytes(bytes(range(256)) * 20)
    with pytest.raises(CampaignError, match="is binary, not text"):
        read_campaign(tmp_path, channel="self_sensing")


def test_a_folder_of_nothing_is_refused(tmp_path):
    with pytest.raises(CampaignError, match="holds no campaign"):
        read_campaign(tmp_path)
    with pytest.raises(CampaignError, match="must be a folder"):
        read_campaign(tmp_path / "missing")


@pytest.mark.parametrize("style", STYLES)
def test_a_damaged_file_is_read_or_refused(tmp_path, style):
    rng = random.Random(style.__name__)
    good = "\n".join(style()[:40]).encode()
    for _ in range(30):
        a = rng.randrange(rng.choice([60, len(good)]))
        bad = good[:a] + rng.choice(DAMAGE) + good[a + rng.choice([0, 1, 7]) :]
        (tmp_path / "scope.csv").write_bytes(bad)
        try:
            recording = read_campaign(tmp_path, channel="self_sensing")["scope"]
        except CampaignError as error:
            message = str(error)
            assert message.startswith(f"{tmp_path}/scope.csv"), bad
            assert "\n" not in message, bad
        else:
            assert len(recording.time_s) <= 40


def test_the_initial_state_is_unknown_unless_it_is_told(tmp_path):
    assert read_lines(tmp_path, tektronix())["scope"].initial_state == "free"
    assert read_lines(tmp_path, tektronix(), initial_state="periodic")["scope"].initial_state == "periodic"
    with pytest.raises(CampaignError, match="initial_state"):
        read_lines(tmp_path, tektronix(), initial_state="periodical")
