"""A campaign written is the campaign read; a damaged one is refused in one sentence."""

import json
import os

import numpy as np
import pytest

from inkjet_env.recordings import Campaign, CampaignError, Recording, read_campaign, write_campaign


def campaign(samples=400):
    rng = np.random.default_rng(5)

    def recording(name, **fields):
        time_s = (np.arange(samples) - 17) / 3e6
        drive_V, sensor = rng.normal(0, 30, samples), rng.normal(0, 1e-7, samples)
        return Recording(name, time_s, drive_V, sensor, **{"unit": "V", "channel": "self_sensing"} | fields)

    return Campaign(
        "head-17",
        (
            recording("r001", excitation="bipolar", initial_state="periodic", condition={"temperature_C": 25.1}),
            recording("r002 again", order=2, repeat_of="r001", neighbour_V=rng.normal(0, 1e300, samples)),
            recording("r003", order=3, unit="nm", channel="displacement", drive_monitor_V=np.zeros(samples)),
        ),
        title="A head",
        description="Größe µ",
    )


def written(folder, changed=lambda package: None):
    """A good campaign in the folder, its descriptor changed."""
    write_campaign(folder, campaign())
    package = json.loads((folder / "datapackage.json").read_text())
    changed(package)
    (folder / "datapackage.json").write_text(json.dumps(package))
    return folder


def test_a_round_trip_keeps_every_number_and_label(tmp_path):
    one = campaign()
    write_campaign(tmp_path / "head", one)
    two = read_campaign(tmp_path / "head")
    assert (two.name, two.title, two.description, two.notes) == (one.name, one.title, one.description, ())
    for a, b in zip(one.recordings, two.recordings, strict=True):
        for label, value in vars(a).items():
            if isinstance(value, np.ndarray):
                assert np.array_equal(value, getattr(b, label)), label
            else:
                assert value == getattr(b, label), label


@pytest.mark.parametrize("rate_Hz", [7e5, 1e6, 3e6, 48e3, 1e8 / 3])
@pytest.mark.parametrize("start", [0, -1000, 123456])
def test_times_come_back_bit_for_bit(tmp_path, rate_Hz, start):
    n = 2000
    for time_s in (
        (start + np.arange(n)) / rate_Hz,
        (start + np.arange(n)) * (1 / rate_Hz),
        start / rate_Hz + np.linspace(0, 1e-3, n),
    ):
        r = Recording("r", time_s, np.zeros(n), np.zeros(n), "V", "self_sensing")
        write_campaign(tmp_path / "c", Campaign("c", (r,)))
        assert np.array_equal(read_campaign(tmp_path / "c")["r"].time_s, time_s)


def test_the_descriptor_is_the_contracts(tmp_path):
    write_campaign(tmp_path / "c", campaign())
    package = json.loads((tmp_path / "c" / "datapackage.json").read_text(encoding="utf-8"))
    assert package["inkjet"] == {"format": "campaign/1"}
    assert package["resources"][0] == {
        "name": "r001",
        "path": "r001.csv",
        "format": "csv",
        "schema": {"fields": [{"name": n, "type": "number"} for n in ("time_s", "drive_V", "sensor_V")]},
        "inkjet": {
            "channel": "self_sensing",
            "excitation": "bipolar",
            "initial_state": "periodic",
            "order": 1,
            "repeat_of": None,
            "condition": {"temperature_C": 25.1},
        },
    }
    assert (tmp_path / "c" / "r001.csv").read_text().startswith("time_s,drive_V,sensor_V\n-5.666666666666667e-06,")


def test_a_campaign_is_replaced_and_nothing_else_is(tmp_path):
    target = tmp_path / "c"
    write_campaign(target, campaign())
    write_campaign(target, Campaign("one", campaign().recordings[:1]))
    assert sorted(os.listdir(target)) == ["datapackage.json", "r001.csv"]
    (target / "notes.txt").write_text("mine")
    with pytest.raises(CampaignError, match=r"holds 'notes.txt', which is not part"):
        write_campaign(target, campaign())
    assert read_campaign(target).name == "one"
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "x").write_text("mine")
    with pytest.raises(CampaignError, match="holds files and no campaign"):
        write_campaign(tmp_path / "other", campaign())
    with pytest.raises(CampaignError, match="is not a folder"):
        write_campaign(tmp_path / "other" / "x", campaign())
    assert sorted(os.listdir(tmp_path)) == ["c", "other"]


def test_a_failure_half_way_leaves_the_old_campaign_and_no_more(tmp_path, monkeypatch):
    write_campaign(tmp_path / "c", Campaign("old", campaign().recordings[:1]))
    files = []

    def full_disk(path, content):
        files.append(path)
        if len(files) == 3:
            raise OSError(28, "No space left on device", str(path))
        path.write_bytes(content)

    monkeypatch.setattr("inkjet_env.recordings.writing.write_atomically", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_campaign(tmp_path / "c", campaign())
    assert read_campaign(tmp_path / "c").name == "old"
    assert os.listdir(tmp_path) == ["c"]


def test_unknown_keys_and_columns_are_passed_over_and_told(tmp_path):
    folder = written(tmp_path / "c", lambda p: p.update(licenses=[], x=1) or p["resources"][0].update(bytes=3))
    lines = (folder / "r001.csv").read_text().splitlines()
    (folder / "r001.csv").write_text("\r\n".join([lines[0] + ",remark", *(line + ",warm" for line in lines[1:])]))
    read = read_campaign(folder)
    assert np.array_equal(read["r001"].sensor, campaign()["r001"].sensor)
    assert read.notes == (f"{folder}/r001.csv: column remark was not read.",)


def test_a_file_may_lie_in_a_folder_below(tmp_path):
    folder = written(tmp_path / "c", lambda p: p["resources"][0].update(path="raw/one.csv"))
    (folder / "raw").mkdir()
    (folder / "r001.csv").rename(folder / "raw" / "one.csv")
    assert np.array_equal(read_campaign(folder)["r001"].sensor, campaign()["r001"].sensor)


def test_a_missing_channel_can_be_given_and_a_stated_one_stays(tmp_path):
    folder = written(tmp_path / "c", lambda p: p["resources"][0].pop("inkjet"))
    with pytest.raises(CampaignError, match=r"resource 'r001': inkjet.channel is missing.*or give channel="):
        read_campaign(folder)
    read = read_campaign(folder, channel="self_sensing")
    assert read["r001"].channel == "self_sensing"
    assert read["r003"].channel == "displacement"
    assert any("self_sensing was not applied" in note for note in read.notes)


def test_columns_of_other_names_can_be_told(tmp_path):
    folder = written(tmp_path / "c", lambda p: p["resources"].__delitem__(slice(1, None)))
    text = (folder / "r001.csv").read_text()
    (folder / "r001.csv").write_text(text.replace("time_s,drive_V,sensor_V", "zeit,ansteuerung,fühler"))
    with pytest.raises(CampaignError, match=r"r001.csv, row 1: the header must name time_s"):
        read_campaign(folder)
    read = read_campaign(folder, columns={"time": 1, "drive": "ansteuerung", "sensor": "fühler"})
    assert np.array_equal(read["r001"].sensor, campaign()["r001"].sensor)


def set_label(key, value):
    return lambda p: p["resources"][1]["inkjet"].update({key: value})


def set_resource(key, value):
    return lambda p: p["resources"][1].update({key: value})


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (lambda p: p.pop("resources"), "resources is missing"),
        (lambda p: p.update(resources={}), "resources must be a list"),
        (lambda p: p.update(resources=[]), "at least one recording"),
        (lambda p: p.update(resources=["r001"]), "resource 1: must be an object"),
        (lambda p: p.update(inkjet={"format": "campaign/2"}), "inkjet.format must be 'campaign/1'"),
        (lambda p: p.update(inkjet=7), "inkjet must be an object"),
        (lambda p: p.update(name=7), "name must be a string"),
        (set_resource("name", "r001"), "2 resources have the name 'r001'"),
        (set_resource("name", "a/b"), "a recording's name must be fit for a file"),
        (set_resource("format", "xlsx"), "format must be 'csv'"),
        (set_resource("path", ["a.csv", "b.csv"]), "path must be a string"),
        (set_resource("path", "../c/r001.csv"), "is outside it"),
        (set_resource("path", "/etc/passwd"), "is outside it"),
        (set_resource("path", "r009.csv"), "there is no such file"),
        (set_resource("path", "."), "there is no such file"),
        (set_resource("path", "r\0.csv"), "is not a file name"),
        (set_resource("schema", []), "schema must be an object"),
        (set_resource("schema", {"fields": [3]}), "must be objects with a name"),
        (set_resource("schema", {"fields": [{"name": "sensor"}]}), "Did you mean 'sensor_V'"),
        (set_label("channel", "selfsensing"), r"datapackage.json: resource 'r002 again'.*Did you mean 'self_sensing'"),
        (set_label("channel", ["self_sensing"]), "channel must be one of"),
        (set_label("initial_state", "demagnetized"), "Did you mean 'demagnetised'"),
        (set_label("order", "2"), "order must be a whole number"),
        (set_label("repeat_of", "r01"), "Did you mean 'r001'"),
        (set_label("condition", {"temperature_C": None}), "condition must map names to finite numbers"),
        (set_label("condition", None), "condition must map"),
    ],
)
def test_a_wrong_descriptor_is_refused(tmp_path, changed, message):
    folder = written(tmp_path / "c", changed)
    with pytest.raises(CampaignError, match=message) as caught:
        read_campaign(folder)
    assert str(caught.value).startswith(str(folder / "datapackage.json"))
    assert len(str(caught.value).removeprefix(str(folder))) < 400


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not JSON"),
        (b"{", "row 1: is not JSON"),
        (b'{\n"a": 1,}', "row 2: is not JSON"),
        (b"\xff\xfe{", "is not text in UTF-8 at byte 1"),
        (b"[" * 100_000, "nested too deeply"),
        (b"[1]", "must hold a JSON object"),
        (b'{"resources": ' + b"9" * 5000 + b"}", "JSON|resources"),
    ],
)
def test_damaged_json_is_refused(tmp_path, content, message):
    (tmp_path / "datapackage.json").write_bytes(content)
    with pytest.raises(CampaignError, match=message):
        read_campaign(tmp_path)


def test_a_link_that_leads_out_is_refused(tmp_path):
    folder = written(tmp_path / "c")
    (folder / "r001.csv").rename(tmp_path / "elsewhere.csv")
    (folder / "r001.csv").symlink_to(tmp_path / "elsewhere.csv")
    with pytest.raises(CampaignError, match="is outside it"):
        read_campaign(folder)
    os.remove(folder / "r001.csv")
    os.mkfifo(folder / "r001.csv")
    with pytest.raises(CampaignError, match="no such file"):
        read_campaign(folder)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "row 1: the header must name time_s"),
        (["time_s,drive_V"], "must name one of sensor_V, displacement_um, displacement_nm"),
        (["time_s,drive_v,sensor_V"], "Did you mean 'drive_v'"),
        (["time_s,drive_V,drive_V,sensor_V"], "names drive_V 2 times"),
        (["time_s,drive_V,sensor_V,displacement_um"], "must hold one sensor"),
        (["time_s,drive_V,sensor_V"], "at least 2 samples; got 0"),
        (["time_s,drive_V,sensor_V", "0,0,0"], "at least 2 samples; got 1"),
        (["time_s,drive_V,sensor_V", "0,0,0", "1,,0"], "row 3: drive_V is empty"),
        (["time_s,drive_V,sensor_V", "0,0,0", "1;0;0"], "row 3: must have 3 columns"),
        (["time_s,drive_V,sensor_V", "0,0,0", "1,0,0,0"], "row 3: must have 3 columns"),
        (["time_s,drive_V,sensor_V", "0,0,0", "1,0,inf"], "row 3: sensor_V must be finite"),
        (["time_s,drive_V,sensor_V", "0,0,0", "1,0,0", "1,0,0"], "row 4: time must increase"),
        (["time_s,drive_V,sensor_V", "0,0,0", "", "1,0,0", "2,0,0", "4,0,0"], "row 6: sampling must be uniform"),
    ],
)
def test_a_bad_file_is_refused_by_its_row(tmp_path, lines, message):
    folder = written(tmp_path / "c", lambda p: [r.pop("schema") for r in p["resources"]])
    (folder / "r001.csv").write_text("\n".join(lines))
    with pytest.raises(CampaignError, match=rf"r001\.csv.*{message}"):
        read_campaign(folder)


@pytest.mark.parametrize("form", ["%.8f", "%.4e", "%.6g"])
def test_times_rounded_by_printing_are_taken_as_uniform(tmp_path, form):
    folder = written(tmp_path / "c", lambda p: p["resources"].__delitem__(slice(1, None)))
    times = np.arange(300) * 3.337e-7 + 1e-5
    rows = [f"{form % t},0,0" for t in times.tolist()]
    (folder / "r001.csv").write_text("\n".join(["time_s,drive_V,sensor_V", *rows]))
    read = read_campaign(folder)
    assert read["r001"].step_s == pytest.approx(3.337e-7, rel=1e-3)
    assert np.allclose(read["r001"].time_s, times, rtol=0, atol=1e-8)
    assert np.ptp(np.diff(read["r001"].time_s)) < 1e-9 * 3.337e-7 + 1e-19
    assert "off a uniform grid" in read.notes[0]


def test_times_printed_so_coarsely_that_they_repeat_are_taken_as_uniform(tmp_path):
    folder = written(tmp_path / "c", lambda p: p["resources"].__delitem__(slice(1, None)))
    times = np.arange(5000) * 4e-10 - 2e-6
    rows = [f"{t:.3e},0,0" for t in times.tolist()]
    assert len(set(rows)) < len(rows)
    (folder / "r001.csv").write_text("\n".join(["time_s,drive_V,sensor_V", *rows]))
    assert np.allclose(read_campaign(folder)["r001"].time_s, times, rtol=0, atol=4e-10)
    (folder / "r001.csv").write_text("\n".join(["time_s,drive_V,sensor_V", *rows[:1000], *rows[1050:]]))
    with pytest.raises(CampaignError, match="time must increase"):
        read_campaign(folder)


def test_two_hundred_thousand_rows_come_back_as_they_went(tmp_path):
    large = Campaign("large", campaign(200_000).recordings[:1])
    write_campaign(tmp_path / "c", large)
    read = read_campaign(tmp_path / "c")
    assert np.array_equal(read["r001"].sensor, large["r001"].sensor)
