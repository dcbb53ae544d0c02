"""A head with a second mode, and diagnoses of it that take two rounds and no time."""

from types import SimpleNamespace

import numpy as np

from inkjet_env.experiments.tuning import proposals, session
from inkjet_env.mismatch.design.next_experiment import NextExperiment
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.printhead import Printhead

BASE = Printhead.published()
MODE = next(effect for effect in catalogue() if effect.id == "second_mode")
TRUE = AugmentedPrinthead(BASE, ((MODE, MODE.example_values(BASE)),))
FIT = {"base_heldout_rms_V": 0.5, "augmented_heldout_rms_V": 0.1}
PULSE_V = tuple(np.interp(np.arange(400), [0, 20, 35, 70, 85], [0, 0, 60, 60, 0]))
ASKED = NextExperiment("Record a pulse.", "self_sensing", "periodic", 2e-7, PULSE_V, 9.0, repeats=2)


class Diagnoses:
    """A diagnosis that asks for a recording in its first round and names the effect in its second."""

    def __init__(self, corrected=TRUE, fit=FIT):
        self.rounds, self.held_out, self.corrected, self.fit = [], [], corrected, fit

    def __call__(self, campaign, printhead=None, **options):
        self.rounds.append(len(campaign.recordings))
        self.held_out.append(options["held_out"])
        sure = any(recording.name == "request-1" for recording in campaign.recordings)
        ensemble = HeadEnsemble((self.corrected, BASE), (3.0, 1.0))
        content = self.corrected.as_json(fit=self.fit) | {"ensemble": ensemble.as_json()}
        return SimpleNamespace(
            verdict="named" if sure else "set",
            headline="A second mode." if sure else "A second mode or an echo.",
            effects=(),
            candidates=() if sure else (("second_mode", "wave_echo"),),
            next_experiments=() if sure else (ASKED,),
            recordings=[SimpleNamespace(name=r.name, fitted=k > 0) for k, r in enumerate(campaign.recordings)],
            as_json=lambda: {"format": "diagnosis/1"},
            augmented_json=lambda: content,
        )


def put_in_place(monkeypatch):
    """Let sessions use these diagnoses, and refine what they find by few evaluations; return the diagnoses."""
    found, refined = Diagnoses(), proposals.refined
    monkeypatch.setattr(
        proposals, "refined", lambda objective, points, count=2, evaluations=0: refined(objective, points, count, 40)
    )
    monkeypatch.setattr(session, "diagnose", found)
    monkeypatch.setattr(session, "diagnosis_html", lambda _: "<html></html>")
    monkeypatch.setattr(session, "identify", lambda *_, **__: SimpleNamespace(as_json=BASE.as_json))
    return found
