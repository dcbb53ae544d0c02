"""What is written reads as a campaign of the contract, without a warning."""

import json
import warnings

import numpy as np
import pytest

from experiments.concealed_rig import Case, build
from inkjet_env.recordings import read_campaign

CASES = [
    Case(0, 60),
    Case(1, 60, "effect", ("crosstalk",), "strong"),
    Case(2, 60, "effect", ("thermal_drift",), "strong", meagre=True),
    Case(3, 60, displacement=True),
]


@pytest.mark.parametrize("case", CASES, ids=["null", "crosstalk", "meagre", "displacement"])
def test_a_written_campaign_is_read_without_a_warning(case, tmp_path, caplog):
    built = build(case)
    built.write(tmp_path / "campaign", "head-17")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        campaign = read_campaign(tmp_path / "campaign")
    assert not caplog.records
    assert len(campaign.recordings) == len(built.setup.rows)
    for recording, row in zip(campaign.recordings, built.setup.rows, strict=True):
        assert recording.name == row.name
        np.testing.assert_allclose(recording.drive_V, row.drive_V, rtol=0, atol=1e-9)
    descriptor = json.loads((tmp_path / "campaign" / "datapackage.json").read_text())
    assert descriptor["name"] == "head-17"
    assert descriptor["inkjet"] == {"format": "campaign/1"}
