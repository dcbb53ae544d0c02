"""The 90 % intervals hold what they promise."""

import numpy as np
import pytest

from inkjet_env.identification import identify, in_convention
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign
from inkjet_env.rig import record_campaign, self_sensing_battery, strain_gauge_battery

HEADS = 12
GAUGE = ("loop-1", "minor-loops", "zero")
FAST = ("trapezoid-60V", "bipolar-full", "bipolar-quiet", "multisine-50V-a", "pulse-pair-0.50T", "zero")


def small_campaign(seed):
    """A random head and a few recordings of it at 30 dB."""
    rng = np.random.default_rng(seed)
    head = Printhead.published().varied(
        rng.uniform(35e3, 70e3), rng.uniform(0.03, 0.08), rng.uniform(0.7, 1.3), rng.uniform(0.6, 1.4)
    )
    battery = [line for line in strain_gauge_battery() if line.label in GAUGE]
    battery += [line for line in self_sensing_battery(head.frequency_Hz) if line.label in FAST]
    return head, record_campaign(head, rng, battery=battery, snr_dB=30)


def without_what_tells_the_noise(campaign):
    """No repeats, nothing at rest."""
    kept = tuple(r for r in campaign.recordings if r.repeat_of is None and r.excitation != "zero")
    return Campaign(campaign.name, tuple(r for r in kept if r.initial_state == "periodic"))


def covered(prepared, **options):
    """By parameter, in how many heads the interval holds the truth."""
    hits = dict.fromkeys(("a0", "a1", "b1"), 0)
    for seed in range(HEADS):
        head, campaign = small_campaign(seed)
        found = identify(prepared(campaign), **options)
        truth = in_convention(head, found.printhead.full_scale_V)
        for name in hits:
            estimate = found.dynamics[name]
            hits[name] += estimate.low <= getattr(truth, name) <= estimate.high
    return hits


def test_most_intervals_hold_the_truth_where_nothing_tells_the_noise():
    hits = covered(without_what_tells_the_noise, degree=8)
    assert min(hits.values()) >= 7, hits


def test_nine_of_ten_intervals_hold_the_truth():
    # Of 12 at 90 %: fewer than 8 in 1 of 230; of 36, if they were independent: fewer than 28 in 1 of 130.
    hits = covered(lambda campaign: campaign)
    assert min(hits.values()) >= 8, hits
    assert sum(hits.values()) >= 28, hits


def test_the_interval_shrinks_with_the_noise():
    head = Printhead.published()
    battery = [line for line in strain_gauge_battery() if line.label in GAUGE]
    battery += [line for line in self_sensing_battery() if line.label in FAST]
    loud, quiet = (identify(record_campaign(head, 3, battery=battery, snr_dB=snr), degree=8) for snr in (20, 40))
    for name in ("a0", "a1", "b1"):
        widths = [found.dynamics[name].high - found.dynamics[name].low for found in (loud, quiet)]
        assert widths[0] / widths[1] == pytest.approx(10, rel=0.25)


def test_the_interval_of_the_branch_law_holds_it(other_found, other_head):
    x = np.linspace(0.05, 0.95, 19)
    powers = x[:, None] ** np.arange(1, len(other_found.printhead.coefficients))
    sigma = np.sqrt(np.einsum("ij,jk,ik->i", powers, other_found.coefficient_covariance, powers))
    off = other_found.printhead.branch_law.Q(x) - in_convention(other_head).branch_law.Q(x)
    assert (np.abs(off) < 4 * sigma).all()
    assert np.sqrt(np.mean((off / sigma) ** 2)) > 0.05  # and is not absurdly wide
