"""Files in the style of many instruments and programs are read to the right numbers, or refused with a sentence."""

import math

import numpy as np
import pytest

from inkjet_env.recordings import CampaignError, read_campaign
from tests.recordings.vendor_files import vendor_files

REFUSED_HERE = {
    "saleae_logic2": "digital.csv",
    "pi_gcs_voltage": "Actual Position of Axis  AXIS:1 has no unit. Write it behind the name",
    "campbell_toa5": "numbers the samples, and no sample interval is stated. Give interval_s=",
    "octave_text": "Most rows hold one number: write time, drive and sensor beside each other, one column each",
}
"""Files whose numbers are known and that cannot be read as they are, with what is said."""
IN_UM = {"V": 1.0, "um": 1.0, "nm": 1e-3}
FILES = {file.name: file for file in vendor_files()}


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_read_right_or_refused(tmp_path, name):
    vendor = FILES[name]
    for file, content in vendor.files.items():
        (tmp_path / file).write_bytes(content)
    channel = "self_sensing" if vendor.sensor_unit == "V" else "displacement"
    given = {"columns": vendor.columns, "channel": channel, "interval_s": vendor.interval_s}
    if vendor.refused or name in REFUSED_HERE:
        with pytest.raises(CampaignError) as refusal:
            read_campaign(tmp_path, **given)
        assert REFUSED_HERE.get(name, "") in str(refusal.value)
        assert len(str(refusal.value).replace(str(tmp_path), "").splitlines()) == 1
        return
    (recording,) = read_campaign(tmp_path, **given).recordings
    assert recording.step_s == pytest.approx(vendor.step_s, rel=1e-6)
    if not math.isnan(vendor.start_s):
        assert abs(recording.time_s[0] - vendor.start_s) <= 0.51 * vendor.step_s
    scale = IN_UM[recording.unit] / IN_UM[vendor.sensor_unit]
    assert (recording.unit == "V") == (vendor.sensor_unit == "V")
    np.testing.assert_allclose(
        recording.sensor * scale, vendor.sensor, rtol=1e-9, atol=1e-12 * np.abs(vendor.sensor).max()
    )
    if vendor.drive_V is not None:
        np.testing.assert_allclose(recording.drive_V, vendor.drive_V, rtol=1e-9, atol=1e-9)
