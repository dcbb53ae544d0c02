"""The scan of the first dwell: what it offers is what the simulator gives, and it goes with another waveform."""

import numpy as np
import pytest

from inkjet_env.experiments.explore.drives import Corners
from inkjet_env.experiments.explore.dwell_scan import DwellScan, highest, quietest, scan_sentence
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.printhead import Printhead


@pytest.fixture
def scan(tmp_path):
    return DwellScan(Exploration(tmp_path / "session.json"), lambda view, act: act())


def test_the_highest_drop_and_the_quietest_one_are_taken(scan):
    before = scan.state.drive.t2
    scan.scan()
    curve = scan.curve
    scan.take(highest)
    taken = scan.state.drive
    reached_V = np.abs(Printhead.published().respond(taken).peaks_V).max()
    assert taken.t2 != before
    assert reached_V == pytest.approx(np.nanmax(curve.effective_V), rel=0.01)
    assert f"{1e6 * curve.values[highest(curve)]:.3g} µs" in scan_sentence(curve)
    assert scan.curve is curve  # the dwell alone has changed
    scan.take(quietest)
    assert scan.state.drive.t2 == pytest.approx(curve.values[quietest(curve)], abs=3e-8)


def test_a_scan_belongs_to_its_waveform(scan):
    scan.scan()
    scan.draw()
    assert scan.layout.visible
    scan.state.change_parameter(0, 60.0)
    scan.draw()
    assert not scan.layout.visible
    with pytest.raises(ValueError, match="the waveform is another one than was scanned"):
        scan.take(highest)
    scan.state.undo()
    assert scan.curve is not None


def test_segments_have_no_dwell(scan):
    scan.state.change(Corners((0.0, 1e-5, 2e-5), (0.0, 40.0, 0.0)))
    with pytest.raises(ValueError, match="a drive of segments has no dwell"):
        scan.scan()
