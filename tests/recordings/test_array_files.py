"""Recordings in arrays: NumPy, MATLAB, HDF5 and Parquet give the numbers that were saved."""

import numpy as np
import pytest
import scipy.io

from inkjet_env.recordings import CampaignError, read_campaign

COUNT = 300
TIME_S = np.arange(COUNT) * 1e-6
DRIVE_V = 40 * np.interp(np.arange(COUNT), [20, 25, 80, 85], [0.0, 1.0, 1.0, 0.0])
SENSOR_V = np.sin(0.3 * np.arange(COUNT)) * np.exp(-0.02 * np.arange(COUNT))
ARRAYS = {"time_ms": TIME_S * 1e3, "drive": DRIVE_V, "sensor_mV": SENSOR_V * 1e3}


def npz(file):
    np.savez(file, **ARRAYS)


def npz_with_rate(file):
    np.savez(file, drive=DRIVE_V, sensor_mV=SENSOR_V * 1e3, fs=1e6)


def npy(file):
    table = np.zeros(COUNT, dtype=[("time_ms", float), ("drive", float), ("sensor_mV", float)])
    for name, values in ARRAYS.items():
        table[name] = values
    np.save(file, table)


def mat(file):
    scipy.io.savemat(file, {name: values[:, None] for name, values in ARRAYS.items()} | {"comment": "head 17"})


def hdf5(file):
    h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")
    with h5py.File(file, "w") as opened:
        group = opened.create_group("shot")
        for name, values in ARRAYS.items():
            group[name] = values


def mat_7_3(file):
    """A file of MATLAB's version 7.3: HDF5 behind 512 bytes that say so."""
    h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")
    with h5py.File(file, "w", userblock_size=512) as opened:
        for name, values in ARRAYS.items():
            opened[name] = values[None, :]
    with open(file, "r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def parquet(file):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pa.table(ARRAYS), file)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("r.npz", npz), ("r.npz", npz_with_rate), ("r.npy", npy), ("r.mat", mat), ("r.mat", mat_7_3), ("r.h5", hdf5),
        ("r.hdf5", hdf5), ("r.parquet", parquet),
    ],
)  # fmt: skip
def test_arrays_are_read_in_their_units(tmp_path, name, write):
    write(tmp_path / name)
    (recording,) = read_campaign(tmp_path, channel="self_sensing").recordings
    np.testing.assert_allclose(recording.drive_V, DRIVE_V)
    np.testing.assert_allclose(recording.sensor, SENSOR_V, atol=1e-15)
    assert recording.unit == "V"
    assert recording.step_s == pytest.approx(1e-6)


def objects(file):
    np.savez(file, drive=np.array([None, 1], dtype=object), sensor=np.zeros(2))


def unequal(file):
    np.savez(file, time_s=TIME_S, drive=DRIVE_V, sensor=SENSOR_V[:-1])


def not_finite(file):
    np.savez(file, **{**ARRAYS, "drive": np.where(np.arange(COUNT) == 7, np.nan, DRIVE_V)})


def damaged(file):
    npz(file)
    file.write_bytes(file.read_bytes()[:-400])


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (objects, r"r\.npz: cannot be read as \.npz"),
        (unequal, r"its arrays must have one length; they have time_s 300, drive 300, sensor 299"),
        (not_finite, r"r\.npz, sample 8: drive must be finite"),
        (damaged, r"r\.npz: cannot be read as \.npz"),
    ],
)
def test_arrays_that_are_no_recording_are_refused(tmp_path, write, said):
    write(tmp_path / "r.npz")
    with pytest.raises(CampaignError, match=said):
        read_campaign(tmp_path, channel="self_sensing")
