"""Headers that people and programs write: every unit in them is used, or the file is refused; none is dropped."""

import numpy as np
import pytest

from inkjet_env.recordings import CampaignError, read_campaign
from inkjet_env.recordings.drive import read_drive
from inkjet_env.recordings.generator_file import generator_text

STEP_S = 2e-6
TIME_S = STEP_S * np.arange(60)
DRIVE_V = 40 * np.clip(np.minimum(np.arange(60) - 10, 40 - np.arange(60)) / 5, 0, 1)
SENSOR = np.round(0.9 * np.sin(np.arange(60) / 3), 3)
US, MS, S = 1e6, 1e3, 1.0


def rows(*columns, sep=",", decimal="."):
    return [sep.join(f"{x:.9g}".replace(".", decimal) for x in row) for row in zip(*columns, strict=True)]


def written(tmp_path, header, factors=(S, 1, 1), sep=",", decimal=".", name="r1.csv", encoding="utf-8", columns=None):
    """A folder with one file: header lines, then times, drive and sensor multiplied by these factors."""
    columns = columns or [v * f for v, f in zip((TIME_S, DRIVE_V, SENSOR), factors, strict=True)]
    text = "".join(line + "\r\n" for line in [*header, *rows(*columns, sep=sep, decimal=decimal)])
    (tmp_path / name).write_bytes(text.encode(encoding))
    return tmp_path


def check(folder, unit="V", given=None, channel="self_sensing", **options):
    (recording,) = read_campaign(folder, channel=channel, columns=given, **options).recordings
    assert recording.step_s == pytest.approx(STEP_S, rel=1e-9)
    scale = {"um": 1.0, "nm": 1e-3, "V": 1.0}[recording.unit]
    assert (recording.unit == "V") == (unit == "V")
    np.testing.assert_allclose(recording.drive_V, DRIVE_V, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(recording.sensor * scale, SENSOR, rtol=1e-8, atol=1e-12)
    return recording


@pytest.mark.parametrize(
    ("header", "factors"),
    [
        (["t/ms,U_drive/V,U_sensor/mV"], (MS, 1, 1e3)),
        (["Time ms,Drive V,Sensor mV"], (MS, 1, 1e3)),
        (['"Time, ms","Drive, V","Sensor, mV"'], (MS, 1, 1e3)),
        (['"Time [ms]", "Drive [V]", "Sensor [mV]"'], (MS, 1, 1e3)),
        (["Time-ms,Drive-V,Sensor-mV"], (MS, 1, 1e3)),
        (["Time: ms,Drive: V,Sensor: mV"], (MS, 1, 1e3)),
        (["Time <ms>,Drive {V},Sensor [mV]"], (MS, 1, 1e3)),
        (["Time (ms) rel.,Drive (V) A,Sensor (mV) B"], (MS, 1, 1e3)),
        (["(ms) Time,(V) Drive,(mV) Sensor"], (MS, 1, 1e3)),
        (["timeMs,driveV,sensorMv"], (MS, 1, 1e3)),
        (["timeInMs,driveInV,sensorInMv"], (MS, 1, 1e3)),
        (["tms,drive_V,sensor_mV"], (MS, 1, 1e3)),
        (["time_micros,drive_volts,sensor_millivolts"], (US, 1, 1e3)),
        (["millis,drive,sensor"], (MS, 1, 1)),
        (["Time (milli-seconds),Drive (KV),Sensor (mVolts)"], (MS, 1e-3, 1e3)),
        (["Time (\u00c2\u00b5s),Drive (V DC),Sensor (mV DC)"], (US, 1, 1e3)),
        (["Time (min),Drive (V),Sensor (V)"], (1 / 60, 1, 1)),
        (["Time (ps),Drive (V),Sensor (V)"], (1e12, 1, 1)),
        (["Time,Drive,Sensor", "ms,Volts DC,mV"], (MS, 1, 1e3)),
        (["Time,Drive,Sensor", "ms,V,mV", "float,float,float"], (MS, 1, 1e3)),
        (["Time,Drive,Sensor", "ms,V,mV", "-----,-----,-----"], (MS, 1, 1e3)),
        (["ms,V,mV", "Time,Drive,Sensor"], (MS, 1, 1e3)),
        (["Time (ms),Drive (V),Sensor (mV)", "raw,x10 probe,filtered"], (MS, 1, 1e3)),
        (["Time (ms),Drive (V),Sensor (mV)", "CH0,CH1,CH2"], (MS, 1, 1e3)),
        (["Time (ms),Drive (V),Sensor (mV)", "Record Length,60"], (MS, 1, 1e3)),
        (["Time (ms),Drive (V),Sensor (mV)", "Offset,0,0"], (MS, 1, 1e3)),
        (["Units,ms,V,mV", "Time,Drive,Sensor"], (MS, 1, 1e3)),
        (["# units: ms, V, mV", "Time,Drive,Sensor"], (MS, 1, 1e3)),
        (["Time Unit,us", "Time,Drive,Sensor"], (US, 1, 1)),
        (["X Unit,us", "Y Unit,V", "Time,Drive,Sensor"], (US, 1, 1)),
        (["Vertical Unit,mV,mV", "Time (us),Drive,Sensor"], (US, 1e3, 1e3)),
        (["Drive Unit,V", "Sensor Unit,mV", "Time (us),Drive,Sensor"], (US, 1, 1e3)),
        (["Time (ms),CH:1 drive (V),CH:2 (mV)"], (MS, 1, 1e3)),
        (["time,V(drive),V(sensor)"], (S, 1, 1)),
        (["Time_ms_,Drive_V_,Sensor_mV_"], (MS, 1, 1e3)),
        (["Time..ms.,Drive..V.,Sensor..mV."], (MS, 1, 1e3)),
        (["Time.ms,Drive.V,SensorMillivolts"], (MS, 1, 1e3)),
        (["ms_time,V drive,mV sensor"], (MS, 1, 1e3)),
        (["Zeit (Millisekunden),Drive (V),Sensor \uff08mV\uff09"], (MS, 1, 1e3)),
        (["\u0412\u0440\u0435\u043c\u044f \u043c\u0441,drive \u0412,sensor \u043c\u0412"], (MS, 1, 1e3)),
        (["Time (us),U (drive) [V],U (sensor) [mV]"], (US, 1, 1e3)),
        (["Unit,ms,V,mV", "Name,Time,Drive,Sensor"], (MS, 1, 1e3)),
        (["Vertical Units,mV", "Time (us),Drive,Sensor"], (US, 1e3, 1e3)),
        (["Unnamed: 1,drive_V,sensor_mV", "time_ms,drive_V,sensor_mV"], (MS, 1, 1e3)),
    ],
)  # fmt: skip
def test_a_unit_is_used_wherever_it_stands(tmp_path, header, factors):
    check(written(tmp_path, header, factors))


@pytest.mark.parametrize(
    ("header", "told"),
    [
        (["Time (?s),Drive (V),Sensor (V)"], "'?s'"),
        (["Time (1e-6 s),Drive (V),Sensor (V)"], "'1e-6 s'"),
        (["Time (us),Drive (x10 V),Sensor (V)"], "'x10 V'"),
        (["Time (us),Drive (MV),Sensor (V)"], "'MV'"),
        (["Time (us),Drive (V),Sensor (mVpp)"], "'mVpp'"),
        (["Time,Drive,Sensor", "MS,V,MV"], "'MS'"),
        (["Time (ms),Drive (V),Sensor (V)", "s,V,V"], "gives column Time (ms) two units"),
        (["Time (ms),Drive (V),Sensor (V) [mV]"], "'V and mV'"),
        (["x-axis,1,2", "second,Volt,Ampere"], "'Ampere'"),
        (["Time(s),CH1V,CH2A"], "'A'"),
        (["Time (us),Drive (V),Sensor (strain)"], "'strain'"),
        (["Time,Drive,Sensor", "ms,V,"], "column Sensor has no unit, though others have one"),
        (["# sensor in mV", "Time (ms),Drive (V),Sensor"], "'mV'"),
        (["Time (ms),Drive (V),Sensor (V),rest,more"], "names 5 columns"),
        (["fs_kHz,500", "fs_kHz,400", "Index,Drive (V),Sensor (V)"], "states fs_khz twice, 500 and 400"),
        (["Time (s),CH1 low (V),CH1 high (V)"], "are the envelope of one channel"),
        (["Time (s),CH1 Min (V),CH1 Max (V)"], "are the envelope of one channel"),
        (["Time (s),Drive"], "names 2 columns, Time (s), Drive, above 3 columns of numbers"),
        (["Sample Interval,1000", "Index,Drive (V),Sensor (V)"], "sample interval 1000 is not understood"),
        (["Scale Factor,100,1", "Time (s),Drive (V),Sensor (V)"], "a factor for each column in its header"),
        (["Time (s),Drive (V),Sensor (V)", "Scale,100,1"], "a factor for each column in its header"),
        (["ticks,drive,sensor"], "its first column, ticks, is no time in a unit that is read"),
        (["h,drive,sensor"], "its first column, h, is no time in a unit that is read"),
    ],
)
def test_what_is_not_understood_is_refused(tmp_path, header, told):
    with pytest.raises(CampaignError) as refusal:
        read_campaign(written(tmp_path, header), channel="self_sensing")
    assert told in str(refusal.value)


@pytest.mark.parametrize("mark", ["****", "1.#INF", "OVERFLOW", "#N/A", "Over Range", "null", "*"])
def test_any_mark_of_a_first_sample_without_a_value_keeps_the_header(tmp_path, mark):
    folder = written(tmp_path, ["Time (us),Drive (V),Sensor (mV)", f"-4,0,{mark}", f"-2,0,{mark}"], (US, 1, 1e3))
    assert check(folder).time_s[0] == pytest.approx(0, abs=1e-12)


def test_names_over_other_places_than_the_samples_are_put_in_order(tmp_path):
    empty = [[f"{a:.9g}", "", f"{b:.9g}", "", f"{c:.9g}"] for a, b, c in zip(TIME_S, SENSOR, DRIVE_V, strict=True)]
    lines = ["time_s;sensor;drive;;", *(";".join(row) for row in empty)]
    (tmp_path / "r1.csv").write_text("\n".join(lines))
    check(tmp_path)


def test_rows_that_are_numbered_without_a_name(tmp_path):
    folder = written(tmp_path, ["time_us,drive,sensor"], columns=[np.arange(1, 61), TIME_S * US, DRIVE_V, SENSOR])
    check(folder)


@pytest.mark.parametrize("header", ["Index,Time (s),CH1 (V),CH2 (V)", ",Time (s),CH1 (V),CH2 (V)"])
def test_numbers_of_rows_beside_times_are_no_channel(tmp_path, header):
    check(written(tmp_path, [header], columns=[np.arange(60), TIME_S, DRIVE_V, SENSOR]))


def test_names_that_blanks_align(tmp_path):
    header = ["# Time (ms)   Drive (V)   Sensor (mV)"]
    check(written(tmp_path, header, (MS, 1, 1e3), sep="   ", name="r1.dat"))


@pytest.mark.parametrize(("rate", "decimal"), [("500,000", "."), ("500.000 Hz", ",")])
def test_a_mark_that_may_separate_thousands_is_asked_about(tmp_path, rate, decimal):
    columns = (DRIVE_V + 0.5, SENSOR)
    folder = written(tmp_path, [f"Sample Rate\t{rate}", "Drive (V)\tSensor (V)"], sep="\t", decimal=decimal,
                     name="r1.txt", columns=columns)  # fmt: skip
    with pytest.raises(CampaignError, match="may stand for thousands"):
        read_campaign(folder, channel="self_sensing")


def test_whole_numbers_with_marks_for_thousands_are_refused(tmp_path):
    lines = ["Time (us)\tDrive (V)\tSensor (mV)", *(f"{2 * k}\t{k}\t{999 + k:,}" for k in range(60))]
    (tmp_path / "r1.txt").write_text("\n".join(lines))
    with pytest.raises(CampaignError, match="row 3: 1,000 among whole numbers may be 1000 with a mark"):
        read_campaign(tmp_path, channel="self_sensing")


def test_a_data_acquisition_cards_output_drives_the_head(tmp_path):
    check(written(tmp_path, ["Time (s),Analog Output 0 (V),Analog Input 0 (V)"]))


def test_input_and_output_are_asked_about_where_the_ranges_contradict_them(tmp_path):
    folder = written(tmp_path, ["Time (s),Output voltage (V),Input voltage (V)"])
    with pytest.raises(CampaignError, match="an amplifier's input and output\\? Specify them"):
        read_campaign(folder, channel="self_sensing")
    check(folder, given={"drive": 2, "sensor": 3})


def test_counts_with_a_factor_beside_them_are_refused(tmp_path):
    columns = [np.arange(60), np.round(DRIVE_V * 100), np.round(SENSOR * 100)]
    folder = written(tmp_path, ["Sample Interval,2e-6", "YMULT,0.01,0.01", "X,CH1,CH2"], columns=columns)
    with pytest.raises(CampaignError, match="holds whole numbers and, in its header, 'ymult', a factor to volts"):
        read_campaign(folder, channel="self_sensing")


def test_whole_numbers_that_are_counts_by_their_name_are_refused(tmp_path):
    columns = [TIME_S * US, np.round(DRIVE_V * 100), np.round(SENSOR * 100)]
    folder = written(tmp_path, ["Time (us),drive_raw,ADC 2"], columns=columns)
    with pytest.raises(CampaignError, match="whole numbers in column drive_raw, by its name a converter's counts"):
        read_campaign(folder, channel="self_sensing", columns={"drive": 2, "sensor": 3})
    check(written(tmp_path, ["Time (us),Drive,sensor_raw"], (US, 1, 1)))


@pytest.mark.parametrize("resolution", ["Resolution,12", "X Resolution,25", "Delta_X,1"])
def test_the_resolution_of_a_converter_is_no_interval(tmp_path, resolution):
    check(written(tmp_path, [resolution, "Time (us),Drive,Sensor"], (US, 1, 1)))


def test_unnamed_times_must_agree_with_the_interval_that_is_stated(tmp_path):
    folder = written(tmp_path, ["dt: 1 ms"], sep="\t", name="r1.txt")
    with pytest.raises(CampaignError, match="its first column rises by 2e-06 from row to row, yet the header states"):
        read_campaign(folder, channel="self_sensing", columns={"drive": 2, "sensor": 3})


def test_a_bare_rate_does_not_stretch_times(tmp_path):
    folder = written(tmp_path, ["Rate,1", "Time,CH1 drive,CH2"], (500, 1, 1))
    with pytest.raises(CampaignError, match=r"the times are 0\.001 s apart, the header states a sample every 1 s"):
        read_campaign(folder, channel="self_sensing")


@pytest.mark.parametrize("origin", [1718109296000.0, 45454.5])
def test_stamps_of_a_calendar_need_a_unit(tmp_path, origin):
    columns = [origin + np.arange(60) * (2 if origin > 1e6 else 1e-5), DRIVE_V, SENSOR]
    text = "".join(f"{float(t)!r},{d},{s}\n" for t, d, s in zip(*columns, strict=True))
    (tmp_path / "r1.csv").write_text("timestamp,drive,sensor\n" + text)
    with pytest.raises(CampaignError, match="stamps of a calendar"):
        read_campaign(tmp_path, channel="self_sensing")


def test_two_files_that_would_be_one_recording_are_refused_and_unread_ones_told(tmp_path):
    written(tmp_path, ["Time (s),Drive (V),Sensor (V)"])
    (tmp_path / "r2.prn").write_text("1 2 3")
    (note,) = (n for n in read_campaign(tmp_path, channel="self_sensing").notes if "not read" in n)
    assert "r2.prn" in note
    written(tmp_path, ["Time (s),Drive (V),Sensor (V)"], name="r1.txt")
    with pytest.raises(CampaignError, match=r"r1.txt: it and r1.csv would be one recording, r1"):
        read_campaign(tmp_path, channel="self_sensing")


def test_units_of_arrays(tmp_path):
    np.savez(
        tmp_path / "r1.npz", time=TIME_S * US, drive=DRIVE_V, sensor=SENSOR * 1e3, time_unit="us", sensor_unit="mV"
    )
    check(tmp_path)
    np.savez(tmp_path / "r1.npz", t=TIME_S * US, drive=DRIVE_V, sensor=SENSOR * 1e3, unit_t="us", unit_sensor="mV")
    check(tmp_path)
    np.savez(tmp_path / "r1.npz", dt_us=2.0, drive=DRIVE_V, sensor=SENSOR)
    check(tmp_path)
    np.savez(tmp_path / "r1.npz", dt=2e-6, drive=DRIVE_V, sensor=SENSOR, y_unit="mV")
    with pytest.raises(CampaignError, match="the unit in y_unit = 'mV' belongs to no array"):
        read_campaign(tmp_path, channel="self_sensing")
    counts = np.round(DRIVE_V * 10).astype(np.int16)
    np.savez(tmp_path / "r1.npz", dt=2e-6, drive=counts, sensor=counts, scale=0.1)
    with pytest.raises(CampaignError, match="holds whole numbers and 'scale', a factor"):
        read_campaign(tmp_path, channel="self_sensing")


def test_units_of_a_parquet_file(tmp_path):
    pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    from pyarrow import parquet

    table = pa.table({"time": TIME_S * US, "drive": DRIVE_V, "sensor": SENSOR * 1e3})
    parquet.write_table(
        table.replace_schema_metadata({"time_unit": "us", "sensor_unit": "mV"}), tmp_path / "r1.parquet"
    )
    check(tmp_path)


def test_units_and_interval_among_the_attributes_of_an_hdf5_file(tmp_path):
    h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")
    with h5py.File(tmp_path / "r1.h5", "w") as opened:
        for name, values, unit in (
            ("time", TIME_S * US, "us"),
            ("drive", DRIVE_V, "V"),
            ("sensor", SENSOR * 1e3, "mV"),
        ):
            opened.create_dataset(name, data=values).attrs["unit"] = unit
    check(tmp_path)
    for factor in (1.0, 0.01):
        with h5py.File(tmp_path / "r1.h5", "w") as opened:
            for name, values in (("Channel 1", DRIVE_V), ("Channel 2", SENSOR)):
                group = opened.create_group(f"Waveforms/{name}")
                group.attrs.update({"XInc": STEP_S, "YInc": 0.01, "YUnits": "Volt"})
                group.create_dataset(
                    f"{name} Data", data=values if factor == 1 else np.int16(np.round(values / factor))
                )
        if factor == 1:
            check(tmp_path)
        else:
            with pytest.raises(CampaignError, match=r"holds whole numbers and 'Waveforms/Channel 1\.YInc', a factor"):
                read_campaign(tmp_path, channel="self_sensing")


def test_a_drive_has_the_times_of_its_header_and_not_its_sample_numbers(tmp_path):
    file = (
        written(tmp_path, ["X,CH1,Start,Increment", "Sequence,Volt,-1e-6,2e-6"], columns=[np.arange(60), DRIVE_V])
        / "r1.csv"
    )
    drive = read_drive(file)
    np.testing.assert_allclose(drive.time_s, -1e-6 + TIME_S, atol=1e-18)
    np.testing.assert_allclose(drive.drive_V, DRIVE_V)


def test_a_drive_that_only_counts_its_samples_is_refused(tmp_path):
    file = written(tmp_path, [], columns=[np.arange(60), DRIVE_V]) / "r1.csv"
    with pytest.raises(CampaignError, match="counts the samples; it is no time"):
        read_drive(file)
    np.testing.assert_allclose(
        read_drive(written(tmp_path, ["i,drive_V"], columns=[np.arange(60), DRIVE_V]) / "r1.csv", 2e-6).time_s, TIME_S
    )


def test_a_drive_whose_interval_is_contradicted_is_refused(tmp_path):
    file = written(tmp_path, ["time_s,drive_V"], columns=[TIME_S, DRIVE_V]) / "r1.csv"
    with pytest.raises(CampaignError, match="the times are 2e-06 s apart, the user states a sample every 1e-05 s"):
        read_drive(file, 1e-5)


@pytest.mark.parametrize("maker", ["siglent", "rigol", "keysight", "rohde-schwarz"])
def test_what_is_written_for_a_generator_is_read_at_its_rate_or_refused(tmp_path, maker):
    text, _ = generator_text(maker, TIME_S, DRIVE_V, 1 / STEP_S)
    (tmp_path / "w.csv").write_text(text)
    try:
        drive = read_drive(tmp_path / "w.csv")
    except CampaignError:
        return
    assert np.diff(drive.time_s) == pytest.approx(STEP_S)


def test_numbers_beside_units_in_names_are_settings(tmp_path):
    check(written(tmp_path, ["Time (s),Drive 50 V/div,Sensor at 200 mV"]))


def test_counts_are_told_by_the_divisions_that_they_exceed(tmp_path):
    columns = [np.arange(60), np.round(DRIVE_V), np.round(SENSOR * 100)]
    header = ["Vertical Scale,1.0,0.5", "Sampling Period,2e-6", "Index,CH1 drive,CH2"]
    with pytest.raises(CampaignError, match="the converter's counts, not volts"):
        read_campaign(written(tmp_path, header, columns=columns), channel="self_sensing")


@pytest.mark.parametrize(
    ("line", "told"), [("Sge1 = 42, 0, -14, 4", "is no segment"), ("Seg1 42, 0, -14, 4", "is no segment"),
                       ("VoltageScale = 0.5", "may change the waveform"), ("[Puls1]", "is not understood: [Pulse0]?")],
)  # fmt: skip
def test_a_line_that_may_be_a_segment_is_not_passed_over(tmp_path, line, told):
    (tmp_path / "w.ini").write_text(f"[Pulse0]\nSeg0 = 0, 42, 21, 3.5\n{line}\n")
    with pytest.raises(CampaignError) as refusal:
        read_drive(tmp_path / "w.ini")
    assert told in str(refusal.value)
    (tmp_path / "w.ini").write_text("[Pulse0]\nSeg0 = 0, 0, 0, 0\n")
    with pytest.raises(CampaignError, match="take no time at all"):
        read_drive(tmp_path / "w.ini")


def test_a_closing_comment_is_no_sample(tmp_path):
    folder = written(tmp_path, ["time_s,drive_V,sensor_V"])
    with (folder / "r1.csv").open("a") as file:
        file.write("# end\n")
    check(folder)
