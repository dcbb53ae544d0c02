"""A proof of the fake rig, driven in a process that may be killed: drive.py FOLDER [SCHEDULER]."""

import json
import sys
from pathlib import Path

from fake_steps import STEPS

from inkjet_env.experiments.execution.cluster import workers_of
from inkjet_env.experiments.proof.protocol import prove
from inkjet_env.experiments.proof.sealing import Settings

if __name__ == "__main__":
    folder, scheduler = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None
    with workers_of(scheduler, None if scheduler else 1) as client:
        outcome = prove(
            Settings(1, "quick", "fake_rig"), folder, client, STEPS, lambda draws: {draw.number: {} for draw in draws}
        )
    table = [[case["draw"]["number"], case["judged"]] for case in outcome.cases]
    print(json.dumps(table))
