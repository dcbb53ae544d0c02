"""What is no printhead file is refused before it is read."""

import json
import os

import pytest

from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.effect import complete
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.printhead import Printhead, printhead_json
from inkjet_env.printhead.printhead_json import printhead_data


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="this system has no endless device")
def test_a_device_or_a_pipe_is_not_read(tmp_path):
    (tmp_path / "head.json").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe.json")
    for name in ("head.json", "pipe.json"):
        with pytest.raises(ValueError, match="must be a file; it is a folder, a pipe or a device"):
            printhead_data(tmp_path / name)


def test_a_file_that_is_too_large_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(printhead_json, "LARGEST_FILE", 10)
    (tmp_path / "head.json").write_text(" " * 11)
    with pytest.raises(ValueError, match="holds 11 bytes, more than any printhead"):
        printhead_data(tmp_path / "head.json")


def test_a_whole_number_that_no_float_holds_is_refused(tmp_path):
    effect = next(effect for effect in catalogue() if effect.id == "feedthrough")
    AugmentedPrinthead(Printhead.published(), ((effect, complete(effect, lossy=1e-3)),)).to_json(tmp_path / "head.json")
    content = json.loads((tmp_path / "head.json").read_text())
    next(iter(content["effects"][0]["parameters"].values()))["value"] = 10**400
    (tmp_path / "head.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match="must be a number; got 1000"):
        read_printhead(tmp_path / "head.json")
