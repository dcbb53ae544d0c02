"""A concealed plant that is none: enough of the real one's interface for everything around it to be tried."""

import json

import numpy as np

from fake_rig.case import Case

__all__ = ["Case", "build"]


class Plant:
    def __init__(self, case):
        self.case = case

    def write(self, folder, name):
        folder.mkdir(parents=True)
        rng = np.random.default_rng(self.case.seed)
        resources = []
        for order in (1, 2):
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
        effects = [{"id": name, "variant": "", "parameters": {}} for name in self.case.effects]
        location = {"recordings": [], "details": []}
        return {"family": self.case.family, "effects": effects, "rho": 1.0, "location": location}


def build(case):
    if case.seed % 5 == 0:
        raise ValueError("creep (fake) does not reach rho 2.0 within its bounds: 1.09 at its strongest.")
    return Plant(case)
