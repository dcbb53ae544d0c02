"""A concealed plant that is none: enough of the real one's interface for everything around it to be tried."""

import json
from dataclasses import dataclass

import numpy as np

OUTSIDE = ("coulomb_friction", "clock_jitter")
BASES = ("bouc_wen",)


@dataclass(frozen=True)
class Case:
    number: int
    seed: int
    family: str
    effects: tuple
    strength: str
    meagre: bool


class Plant:
    def __init__(self, case):
        self.case = case
        self.rng_seed = case.seed

    def write(self, folder, name):
        folder.mkdir(parents=True)
        rng = np.random.default_rng(self.rng_seed)
        resources = []
        for order in range(1, 3):
            recording = f"r{order:03d}"
            rows = "".join(f"{k * 1e-7:.9g},{k % 3},{rng.normal():.6g}\n" for k in range(20))
            (folder / f"{recording}.csv").write_text("time_s,drive_V,sensor_V\n" + rows)
            fields = [{"name": n, "type": "number"} for n in ("time_s", "drive_V", "sensor_V")]
            own = {"channel": "self_sensing", "excitation": "bipolar", "initial_state": "periodic", "order": order}
            resources.append(
                {
                    "name": recording,
                    "path": f"{recording}.csv",
                    "format": "csv",
                    "schema": {"fields": fields},
                    "inkjet": {**own, "repeat_of": None, "condition": {}},
                }
            )
        descriptor = {"name": name, "inkjet": {"format": "campaign/1"}, "resources": resources}
        (folder / "datapackage.json").write_text(json.dumps(descriptor))

    def truth(self):
        return {"family": self.case.family, "effects": list(self.case.effects), "rho": 1.0, "seed": self.case.seed}


def build(case):
    if case.seed % 5 == 0:
        raise ValueError("out of reach")
    return Plant(case)
