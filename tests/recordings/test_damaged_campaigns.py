"""Whatever happens to a campaign's files: it is read as a campaign, or refused as one; nothing else."""

import json
import os
import random

import numpy as np
import pytest

from inkjet_env.recordings import Campaign, CampaignError, Recording, check_campaign, read_campaign, write_campaign

VALUES = [None, True, -1, 0, 1.5, 10**400, float("nan"), "", "r001", "r002", "../r001.csv", "\0", "\ud800", "x" * 9999]
VALUES += [[], [None], {}, {"format": 1}, "self_sensing", "periodic", [["a"]], {"fields": [{"name": []}]}]
CELLS = [
    "",
    "x",
    "nan",
    "-inf",
    "1e999",
    "1e-999",
    "0x10",
    "1_0",
    "1,5",
    '"',
    '"1',
    "1;2",
    "\u2028",
    "+1",
    "--1",
    "1e5",
]
BYTES = [
    b"",
    b"\0",
    b"\xff",
    b"\r",
    b"\n",
    b'"',
    b",",
    b";",
    b"\xef\xbb\xbf",
    b"e",
    b"-",
    b"9" * 400,
    b"\t",
    b"\x0b",
    b"{",
    b"]",
]


def make(folder):
    rng = np.random.default_rng(1)
    time_s = np.arange(30) * 1e-6
    recordings = [
        Recording(f"r00{k}", time_s, rng.normal(0, 30, 30), rng.normal(0, 1, 30), "V", "self_sensing", order=k)
        for k in (1, 2)
    ]
    write_campaign(folder, Campaign("c", tuple(recordings), title="t", description="d"))


def places(value, path=()):
    """Paths of all keys and indices inside a JSON value."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, held in inside:
        yield (*path, key)
        yield from places(held, (*path, key))


def change_descriptor(folder, rng):
    path = folder / "datapackage.json"
    package = json.loads(path.read_text())
    *above, key = rng.choice(list(places(package)))
    holder = package
    for step in above:
        holder = holder[step]
    if rng.random() < 0.2:
        del holder[key]
    elif isinstance(holder, list) and rng.random() < 0.5:
        holder.append(holder[key])
    else:
        holder[key] = rng.choice(VALUES)
    path.write_text(json.dumps(package))


def change_cell(folder, rng):
    path = folder / rng.choice(["r001.csv", "r002.csv"])
    lines = path.read_text().split("\n")
    row = rng.randrange(len(lines))
    cells = lines[row].split(",")
    cells[rng.randrange(len(cells))] = rng.choice(CELLS)
    lines[row] = ",".join(cells)
    path.write_text("\n".join(lines))


def change_rows(folder, rng):
    path = folder / rng.choice(["r001.csv", "r002.csv"])
    lines = path.read_text().split("\n")
    a, b = sorted(rng.sample(range(len(lines) + 1), 2))
    path.write_text("\n".join(rng.choice([lines[:a] + lines[b:], lines[:b] + lines[a:], lines[a:b], lines[::-1]])))


def change_bytes(folder, rng):
    path = folder / rng.choice(["datapackage.json", "r001.csv", "r002.csv"])
    content = path.read_bytes()
    for _ in range(rng.choice([1, 1, 5])):
        a = rng.randrange(len(content) + 1)
        content = content[:a] + rng.choice(BYTES) + content[a + rng.choice([0, 1, 1, 7]) :]
    path.write_bytes(content)


def change_files(folder, rng):
    path = folder / rng.choice(["datapackage.json", "r001.csv", "r002.csv"])
    content = path.read_bytes()
    path.unlink()
    kind = rng.choice(["missing", "folder", "link to itself", "link", "empty", "fifo"])
    if kind == "folder":
        path.mkdir()
    elif kind == "link to itself":
        path.symlink_to(path)
    elif kind == "link":
        path.symlink_to(folder / "r001.csv")
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "fifo" and path.suffix == ".csv":
        os.mkfifo(path)
    elif kind == "fifo":
        path.write_bytes(content[: len(content) // 2])


CHANGES = (change_descriptor, change_cell, change_rows, change_bytes, change_files)


def contents(folder):
    return {p.name: p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


@pytest.mark.parametrize("change", CHANGES)
def test_a_damaged_campaign_is_read_or_refused(tmp_path, change):
    outcomes = set()
    for seed in range(80):
        rng = random.Random(seed)
        folder = tmp_path / f"c{seed}"
        make(folder)
        change(folder, rng)
        if seed % 3 == 0 and (folder / "datapackage.json").is_file():
            (folder / "datapackage.json").unlink()
        before = contents(folder)
        given = rng.choice([{}, {}, {"channel": "displacement"}, {"columns": {"drive": 2}, "channel": "self_sensing"}])
        try:
            campaign = read_campaign(folder, **given)
        except CampaignError as error:
            outcomes.add("refused")
            message = str(error)
            assert message.startswith(str(tmp_path)), (seed, message)
            assert len(message.removeprefix(str(folder))) < 600, (seed, message)
            assert "\n" not in message, (seed, message)
        else:
            outcomes.add("read")
            for recording in campaign.recordings:
                assert np.isfinite(recording.sensor).all()
                assert (np.diff(recording.time_s) > 0).all()
            for finding in check_campaign(campaign, 1e5):
                assert finding.level in ("error", "warning")
            write_campaign(tmp_path / "again", campaign)
        assert contents(folder) == before, seed
    assert outcomes == {"read", "refused"}
