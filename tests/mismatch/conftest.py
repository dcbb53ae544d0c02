"""Small campaigns of known truth: short recordings of a few lines of the battery."""

import functools
from dataclasses import replace

import pytest

from inkjet_env.experiments.validation.synthetic_campaigns import largest_signal_V, record_synthetic, synthetic_values
from inkjet_env.identification.convention import in_convention
from inkjet_env.mismatch import DiagnosisSettings, diagnose
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.campaign_noise import noise_seen
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.plant import catalogue
from inkjet_env.plant.effect import complete
from inkjet_env.printhead import Printhead
from inkjet_env.rig.battery import default_battery
from tests.mismatch.diagnoses import LOOKED_FOR

SETTINGS = DiagnosisSettings()

HEAD = in_convention(Printhead.published().varied(48e3, 0.05, 1.1, 0.8))
EFFECTS = {effect.id: effect for effect in catalogue()}
FAST = ("trapezoid-40V", "trapezoid-60V", "trapezoid-100V", "trapezoid-minus100V", "trapezoid-steep",
        "bipolar-full", "bipolar-uneven", "pulse-pair-0.50T")  # fmt: skip
TWICE = ("loop-1", "trapezoid-60V", "zero")
SAMPLES = 400
SLOW_SAMPLES_EVERY = 4


def campaign_lines(fast=FAST, slow=("loop-1",), twice=TWICE):
    """Lines of the battery, cut short: the fast ones are fired again before they have decayed."""
    chosen = []
    for line in default_battery(HEAD.frequency_Hz):
        if line.channel == "strain_gauge" and line.label in slow:
            drive_V, step_s = line.drive_V[::SLOW_SAMPLES_EVERY], SLOW_SAMPLES_EVERY * line.step_s
            chosen.append(replace(line, drive_V=drive_V, step_s=step_s))
        elif line.channel == "self_sensing" and line.label in (*fast, "zero"):
            chosen.append(replace(line, drive_V=line.drive_V[:SAMPLES]))
    return chosen + [line for line in chosen if line.label in twice]


BESIDE = {"feedthrough": 4.0, "mains_hum": 4.0}
"""How much more of an effect is planted beside another: enough to be named, not minor."""


def _values(name, strength=1.0, alone=True):
    """What is planted of an effect."""
    size = strength if alone else strength * BESIDE.get(name, 1.0)
    return synthetic_values(EFFECTS[name], size, HEAD, largest_signal_V(HEAD, campaign_lines()))


@functools.cache
def _recorded(*names, strength=1.0, seed=3, snr_dB=50.0, monitored=False, noise_kind="white", **lines):
    """A campaign with these effects on."""
    effects = [(EFFECTS[name], _values(name, strength, len(names) == 1)) for name in names]
    return record_synthetic(HEAD, effects, seed, snr_dB, monitored, campaign_lines(**lines), noise_kind)


@functools.cache
def _recorded_as(name, **given):
    """A campaign with one effect on, of these values; what is not given of it is off or plain."""
    slow = ("loop-0.5", "loop-1", "loop-5", "staircase") if name == "creep" else ("loop-1",)
    planted = [(EFFECTS[name], complete(EFFECTS[name], **given))]
    return record_synthetic(HEAD, planted, 3, lines=campaign_lines(slow=slow))


def _true_head(campaign):
    """The head that recorded a campaign, as the base model's."""
    offsets = {"strain_gauge": 0.05, "self_sensing": -0.1}
    gains = {"strain_gauge": 0.02, "self_sensing": HEAD.b1}
    present = {r.channel for r in campaign.recordings}
    return Head(HEAD, *({c: v for c, v in of.items() if c in present} for of in (gains, offsets)))


def _fitted(campaign, held_out=None, random_effects=()):
    """The base model, begun at the true head, on a campaign with its own noise."""
    observed, head = observe(campaign, held_out), _true_head(campaign)
    residuals = {o.name: o.measured - head.plant().signal(o.excitation) for o in observed}
    return OutputErrorFit(
        observed, noise_seen(observed, residuals, {}, SETTINGS.fitting), head, SETTINGS, random_effects
    )


@pytest.fixture(scope="session")
def head():
    return HEAD


@pytest.fixture(scope="session")
def effects():
    """The catalogue by id."""
    return EFFECTS


@pytest.fixture(scope="session")
def recorded():
    """A function: a campaign with effects on, each campaign recorded once."""
    return _recorded


@pytest.fixture(scope="session")
def recorded_as():
    """A function: a campaign with one effect on, of values of one's own, each campaign recorded once."""
    return _recorded_as


@pytest.fixture(scope="session")
def values():
    return _values


@pytest.fixture(scope="session")
def true_head():
    return _true_head


@pytest.fixture(scope="session")
def fitted():
    return _fitted


@pytest.fixture(scope="session")
def diagnosed(recorded, head, effects):
    """A function: the diagnosis of a planted campaign, begun at the true head; each made once."""
    made = {}

    def found(*names, looked_for=LOOKED_FOR, **options):
        key = (names, looked_for, tuple(options.items()))
        if key not in made:
            campaign = recorded(*names, **options)
            made[key] = diagnose(campaign, head, [effects[name] for name in looked_for], 0, workers=1)
        return made[key]

    return found
