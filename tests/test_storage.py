import io
import json
import os
import sys

import numpy as np
import pytest

from inkjet_env.storage import archive_bytes, json_text, remove_unfinished, write_atomically, write_json


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    file = tmp_path / "a.txt"
    write_atomically(file, "old")

    def full_disk(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="No space left") as error:
        write_atomically(file, "new")
    assert error.value.filename == str(file)
    assert file.read_text() == "old"
    assert [f.name for f in tmp_path.iterdir()] == ["a.txt"]


def test_a_reader_sees_only_whole_files(tmp_path, monkeypatch):
    file, seen = tmp_path / "a.txt", []
    write_atomically(file, "old")
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda a, b: (seen.append(file.read_text()), replace(a, b)))
    write_atomically(file, "new")
    assert (seen, file.read_text()) == (["old"], "new")


def test_leftovers_of_a_killed_process_are_removed_and_nothing_else(tmp_path):
    (tmp_path / "a.npz.4711.unfinished").write_text("half")
    (tmp_path / "a.npz").write_text("whole")
    remove_unfinished(tmp_path)
    assert [f.name for f in tmp_path.iterdir()] == ["a.npz"]


def test_json_has_no_nan():
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_text({"cost": float("nan")})


def test_a_dash_means_standard_output(monkeypatch):
    out = io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    write_json("-", {"µ": 1})
    assert json.loads(out.getvalue()) == {"µ": 1}


def test_same_arrays_same_bytes_and_read_back_exactly():
    arrays = {"x": np.random.default_rng(0).random((5, 7)), "label": np.array("µ")}
    content = archive_bytes(arrays)
    assert content == archive_bytes(arrays)
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        assert (archive["x"] == arrays["x"]).all()
        assert str(archive["label"]) == "µ"
