"""Settings of a diagnosis: every threshold, number and grid on which its answer rests.

Each field names its unit and its source. Sources that recur:

decision 6
    docs/explanation/decisions/0006-what-a-diagnosis-may-claim.md gives the reason.
tables
    Judgement. The tables of docs/results/diagnosis.md were made with this value; no study has varied it.
speed
    Judgement. It limits how much is computed, not what may be claimed; no study has varied it.
reader
    It limits what is listed or put into words, not what is found.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from numbers import Integral, Real

import numpy as np


@dataclass(frozen=True)
class _Settings:
    """Settings that are all numbers, or tuples of numbers, finite and positive."""

    def __post_init__(self) -> None:
        """Raise ValueError at the first field that is not."""
        for one in fields(self):
            value, whole = getattr(self, one.name), isinstance(one.default, int)
            for number in value if isinstance(value, tuple) else (value,):
                kind = isinstance(number, Integral if whole else Real) and not isinstance(number, bool)
                if not kind or not math.isfinite(number) or number <= 0:
                    wanted = "a whole number of at least 1" if whole else "a finite number above 0"
                    raise ValueError(
                        f"{type(self).__name__}.{one.name} must be {wanted}; got {number!r}. Its default is "
                        f"{one.default!r}."
                    )


@dataclass(frozen=True)
class FittingSettings(_Settings):
    """How noise is estimated and models are fitted."""

    repeats_to_rest_variance: float = 1.5
    """Ratio of the variance of repeats' deviations to that at rest, above which repeats differ by more than noise and
    recordings at rest alone determine it. Unit: 1. Source: decision 6."""
    slight_memory: float = 0.1
    """Ratio of the power of noise with a memory to that of the autoregression, at the line where it is largest, below
    which it is neglected. Unit: 1. Source: speed."""
    upper_lines: float = 0.1
    """Frequency above which residuals show the colour of noise known at another sampling step only. Unit: half the
    sampling rate. Source: a loop's mismatch lies at its lowest multiples."""
    louder_colour: float = 1.2
    """Ratio of noise RMS up to which such residuals are taken for noise. Unit: 1. Source: tables."""
    other_colour_gain: float = 10.0
    """Gain from which their colour counts. Unit: log-likelihood. Source: e¹⁰, as for a random effect."""
    colour_rounds: int = 3
    """Number of fits of a colour, each with the lower lines as the one before expects them. Unit: 1. Source: speed."""
    offset_gain: float = 5.0
    """Gain from which recordings' offsets scatter by more than the noise's spectrum tells. Unit: log-likelihood.
    Source: chi-square with one degree of freedom, 0.08 %."""
    level_window: int = 64
    """Longest window of a cell of time and frequency in which the noise's level is read. Unit: samples. Source:
    tables."""
    level_windows: int = 16
    """Least number of windows in a recording, so that its level is read at as many times. Unit: 1. Source: tables."""
    level_cells: int = 40
    """Least number of quiet cells from which a recording's own level is read. Unit: cells. Source: 16 % of a level's
    square."""
    level_at_rest: float = 1.2
    """Least ratio between the squared levels at rest and otherwise that counts. Unit: 1. Source: a mismatch may add a
    tenth to quiet cells."""
    quiet_cell: float = 1.0
    """Largest power of the modelled signal in a quiet cell, relative to the noise's. Unit: 1. Source: a mismatch is a
    share of the signal, so it is quieter still."""
    hidden_step: float = 0.4
    """Standard deviation of the noise before a converter above which its rounding is noise. Unit: steps. Source: the
    first harmonic of the mean error is then below 1.4 % of a step."""
    sharpest_step: float = 0.1
    """Least standard deviation with which the mean error is smoothed: the base model is no more exact. Unit: steps.
    Source: tables."""
    coarse_step: float = 0.15
    """Standard deviation of the noise before a converter, in its steps, below which the correction is not exact enough.
    Unit: steps. Source: docs/results/diagnosis.md, 2 false alarms on 15 heads."""
    on_grid: float = 0.05
    """Largest distance of a value from a multiple of its converter's step: values may be printed with few digits. Unit:
    steps. Source: tables."""
    rounding_rounds: int = 3
    """Number of base fits, each with the mean error of rounding at the signal of the one before. Unit: 1. Source:
    speed."""
    shortest_rest: int = 100
    """Least number of samples before the drive from which the noise can be estimated. Unit: samples. Source: tables."""
    law_degree: int = 14
    """Least degree of the branch law: the base model explains all that it can before an effect is named. Unit: 1.
    Source: decision 6."""
    poor_start_share: float = 0.7
    """Share of the fast recordings' variance. If the base model refitted from a given printhead leaves more
    unexplained, that printhead belongs to another head. Unit: 1. Source: tables."""
    nodes_per_period: int = 36
    """Least number of simulation nodes per period of the resonance. Unit: nodes. Source: tables."""
    most_substeps: int = 16
    """Largest number of simulation nodes per sampling step. Unit: nodes. Source: speed."""
    simulation_error: float = 0.5
    """Largest error of the simulation; above it, nodes are doubled. Unit: standard errors of a parameter. Source:
    decision 6."""
    quieter_noise: float = 0.7
    """Ratio of noise RMS with the effects found to that without, below which further effects are looked for once more.
    Unit: 1. Source: tables."""
    most_base_fits: int = 10
    """Largest number of times that the base model is refitted from the end of its last fit. Unit: 1. Source: speed."""
    most_steps: int = 25
    """Number of steps after which a fit ends, converged or not. Unit: 1. Source: speed."""
    step_gain: float = 0.01
    """A step that is predicted to gain less is the last one. Unit: log-likelihood. Source: speed."""
    step_gain_share: float = 1e-3
    """Share of the misfit beyond noise: a step that is predicted to gain less is the last one too, because a wrong
    model need be fitted only roughly. Unit: 1. Source: decision 6."""
    own_sensitivity: float = 1e-4
    """Share of a sensitivity that the base parameters cannot reproduce, below which a coordinate is not moved. Unit: 1.
    Source: decision 6."""
    settled_gain: float = 0.5
    """A repetition of a fit with new base sensitivities that gains less is the last one. Unit: log-likelihood. Source:
    the mean gain of one parameter from noise alone."""


@dataclass(frozen=True)
class SelectionSettings(_Settings):
    """How effects are looked for, fitted and compared."""

    significance_level: float = 1e-3
    """Largest p-value of the score test for an effect to be looked for. Unit: 1. Source: decision 6."""
    undoubted_gain: float = 50.0
    """Gain from which an effect is there whatever the noise may be. Unit: log-likelihood. Source: 1/f noise and coarse
    rounding gained up to 47 in 360 campaigns without an effect."""
    scatter_significance: float = 0.05
    """Largest p-value by the scatter between conditions of an effect with a smaller gain. Unit: 1. Source: the interval
    of its size, of 90 %, does not hold 0."""
    score_draws: int = 2000
    """Number of draws of noise that the largest score is judged against. Unit: 1. Source: twice the reciprocal of the
    significance level; Bonferroni's bound takes over in the tail."""
    alike_starts: float = 0.95
    """Cosine of two starts' signatures, above which only one of them is tried. Unit: 1. Source: speed."""
    same_start: float = 0.99
    """The same for a fit of an effect's plain law, where starts that differ a little may lead to different minima.
    Unit: 1. Source: speed."""
    most_law_starts: int = 4
    """Largest number of starts of an effect's whole law. Unit: 1. Source: speed."""
    starts: int = 3
    """Number of starts of each effect with a fair score, fitted with a few steps each; the best one is continued. Other
    effects get one start. Unit: 1. Source: speed."""
    fair_score: float = 0.2
    """Share of the best effect's score from which a score is fair. Unit: 1. Source: speed."""
    least_score: float = 0.05
    """Share of the best effect's score below which an effect is not fitted at all: it explains a four hundredth as
    much. Unit: 1. Source: speed."""
    screening_steps: int = 1
    """Number of steps after which a start is compared with the others. Unit: 1. Source: speed."""
    screened_gain: float = 0.05
    """Share of the best gain by then, below which a start is not continued. Unit: 1. Source: speed."""
    screened_starts: int = 2
    """Largest number of starts of an effect that are continued. Unit: 1. Source: speed."""
    same_start_gain: float = 0.01
    """Relative difference of two starts' gains below which they count as one. Unit: 1. Source: speed."""
    first_steps: int = 6
    """Number of steps from each start. Unit: 1. Source: speed."""
    hopeless_gain: float = 0.5
    """Share of the best effect's gain, after the first steps, below which an effect is not fitted to the end. Unit: 1.
    Source: speed."""
    worse_law: float = 10.0
    """Loss by leaving out a term of a law, with the base sensitivities of the whole law, above which the law without it
    is not fitted to the end. Unit: log-likelihood. Source: speed; new sensitivities gain about 1."""
    scan_width: float = 0.015
    """Largest logarithm of the ratio by which a strength on which the signal depends in jumps is moved from the end of
    a fit. Unit: 1. Source: the jumps of a thousand updates coincide to a thousandth."""
    scan_precision: float = 0.02
    """Distance of a jump at the end of a recording from where it should be, down to which values are tried. Unit:
    distance of two jumps. Source: a gradient finds the minimum from there."""
    wide_scan_width: float = 0.5
    """The same from each start, where nothing else explains the recordings. Unit: 1. Source: starts are a factor of two
    or so apart."""
    scan_intervals: int = 50
    """Number of intervals, from the start of a recording, on which an interval is tried in its whole range. Unit: 1.
    Source: their jumps coincide to one percent, the distance of the values tried."""
    scan_recordings: int = 4
    """Number of recordings on which these are tried. Unit: recordings. Source: speed."""
    scan_values: int = 101
    """Number of values that such a scan tries. Unit: 1. Source: speed."""
    most_rounds: int = 4
    """Largest number of times that the base parameters' sensitivities are computed anew for a fit. Unit: 1. Source:
    speed."""
    at_bound: float = 1e-3
    """Distance within which a coordinate counts as at its bound: a share of its range, or of the bound for a strength.
    Unit: 1. Source: tables."""
    equation_error: float = 1e-3
    """Share of the whole mismatch up to which what is left may be the error of the equations. Unit: 1. Source: decision
    6."""
    named_share: float = 0.015
    """Share of the whole mismatch that a further effect must explain to be named; with less it may be minor. Unit: 1.
    Source: of the effects that version 1 of the proof named beside another, none of 170 right and 10 of 16 wrong ones
    explained less."""
    whole_law_gain: float = 0.5
    """Share of the best effect's gain from which the other terms of an effect's law are fitted too. Unit: 1. Source:
    speed."""
    close_gain: float = 0.97
    """Share of the best effect's gain from which the other terms of an effect's law are fitted too although the best
    leaves nothing: a rival is not ruled out by its simple law. Unit: 1. Source: amplifiers of second order, which a
    delay explains better by 1e-4 to 1e-2 of its gain than a single pole."""
    most_whole_laws: int = 2
    """Largest number of effects, beside another one, whose other terms are fitted too. Unit: 1. Source: speed."""
    most_effects: int = 3
    """Largest number of effects in a hypothesis. Unit: 1. Source: decision 6."""
    beam_width: int = 3
    """Number of single effects to which a second one is added; of pairs only the best one is continued. Unit: 1.
    Source: speed."""
    beam_gain: float = 0.5
    """Share of the best hypothesis's gain from which a hypothesis stays in the beam. Unit: 1. Source: speed."""
    predicted_standard_errors: float = 2.0
    """Amount by which left-out conditions must be predicted better, all together. Unit: standard errors. Source:
    decision 6."""
    affected_condition: float = 2.0
    """Amount by which an effect must change a condition to count as affecting it. Unit: standard deviations. Source:
    tables."""
    better_conditions: float = 0.5
    """Share of the conditions affected by an effect that must be predicted better. Unit: 1. Source: decision 6."""
    single_condition: float = 0.9
    """Share of the information on a parameter direction that comes from one condition, above which leaving that
    condition out does not test it. Unit: 1. Source: tables."""
    further_effect: float = 0.5
    """Share of the misfit beyond noise that a further effect must explain. Unit: 1. Source: decision 6."""
    further_effect_if_large: float = 0.25
    """Smaller share that suffices if the further effect explains a large share of the whole mismatch. Unit: 1. Source:
    decision 6."""
    large_share: float = 0.02
    """Share of the whole mismatch that counts as large. Unit: 1. Source: decision 6."""
    further_score: float = 0.5
    """Share of the best score from which a further effect is fitted. Unit: 1. Source: speed."""
    most_minor: int = 2
    """Largest number of minor effects. Unit: 1. Source: speed."""
    minor_gain: float = 50.0
    """Gain, less the penalty for its parameters, from which a minor effect counts. Unit: log-likelihood. Source: e⁵⁰ to
    one is beyond any doubt about the noise model."""
    alternative_gain: float = 0.8
    """Share of the best gain, after the first steps, from which an alternative is fitted to the end. Unit: 1. Source:
    speed."""
    lost: float = 0.1
    """Unexplained share of the mismatch, above which alternatives are no longer compared: the verdict is unknown
    already. Unit: 1. Source: speed."""
    same_signature: float = 0.95
    """Cosine above which a signature is nearly the winner's. Such an effect is distinguished from the winner only by a
    difference larger than what the winner itself leaves unexplained, because the equations may be wrong by as much.
    Unit: 1. Source: decision 6."""
    alike_gain: float = 10.0
    """Temperature T₀ of Eq. (2) of docs/explanation/diagnosis.md, for a hypothesis that leaves noise alone. Unit:
    log-likelihood. Source: answers of proof 1."""
    alike_excess: float = 0.05
    """Its growth α with the sum of squares that the hypothesis leaves beyond noise. Unit: 1. Source: decision 6."""
    alike_explained: float = 5e-4
    """Its growth κ with the gain of the hypothesis: a law's equation describes a head to about 2 %, so 5e-4 of what it
    explains. Unit: 1. Source: lags of second order, which other laws imitate to a few 1e-4 of their gain; of 177
    right names among development-2's answers it makes one a set."""
    alike_weight: float = 0.5
    """Relative weight exp(−Δ/T) from which an effect could replace another. Unit: 1. Source: on the same answers, at
    strong and medium strength, 98 % of the sets hold the truth, with 1.25 members."""
    least_conditions: float = 3.0
    """Effective number of conditions that determine a parameter, below which their scatter says nothing about its
    error. Unit: conditions. Source: two degrees of freedom."""
    conditions_significance: float = 0.95
    """Probability that the scatter between conditions is not taken for more than noise where it is noise. Unit: 1.
    Source: intervals keep their coverage to within two percent."""
    unidentifiable: float = 5.0
    """Standard error of a parameter's logarithm, above which the parameter is reported as not identifiable. Unit: 1.
    Source: a factor of 3,700 (90 %): no interval of use to anybody."""
    law_gain: float = 0.5
    """Share of the effects' gain that a bend of the branch law alone must reach to be tried in their place. Unit: 1.
    Source: decision 6."""
    law_scales_screened: tuple[float, ...] = (0.9, 0.75, 0.5)
    """Full scales, relative to the base model's, whose laws together with its own reveal a bend wherever it is. Unit:
    1. Source: speed."""
    law_scales: tuple[float, ...] = tuple(float(scale) for scale in np.linspace(0.975, 0.5, 20))
    """Full scales that are compared, relative to the base model's; none is smaller. Unit: 1. Source: tables."""
    law_scales_fitted: int = 3
    """Number of them that are fitted: those that promise most to first order. Unit: 1. Source: speed."""
    law_steps: int = 3
    """Largest number of steps of a fit with another full scale. Unit: 1. Source: speed."""
    law_scale_tolerance: float = 2e-3
    """Tolerance of the full scale, relative to the base model's. Unit: 1. Source: speed."""
    random_effect_gain: float = 10.0
    """Gain on unseen recordings, in both halves, from which a random effect counts as present. Unit: log-likelihood.
    Source: decision 6."""
    split_recordings: int = 4
    """Least number of recordings that are divided into halves whole; fewer are cut into parts. Unit: recordings.
    Source: two in each half."""
    any_drift: float = 10.0
    """Memory with which noise is a drift; a tone must be distinguished from that as well. Unit: durations of a
    recording. Source: tables."""
    shortest_part: int = 100
    """Shortest part of a recording. Unit: samples. Source: tables."""
    longest_part: int = 1000
    """Longest part of a recording in an exact likelihood. Unit: samples. Source: speed."""
    slow_part: int = 250
    """Number of means to which a recording is reduced when a drift is looked for. Unit: samples. Source: speed."""
    samples_a_period: int = 8
    """Least number of means in a period of a tone. Unit: samples. Source: 3 % of its amplitude."""
    hum_periods: float = 3.0
    """Least number of periods of a tone in the longest recording; a slower one is a drift. Unit: periods. Source: the
    width of a line, on either side of it."""
    hum_trend: int = 4
    """Degree of the polynomial without which a tone is looked for in each recording, so that it is not mistaken for a
    drift. Unit: 1. Source: a tone of ``hum_periods`` periods keeps nearly all of its power."""
    random_effect_gain_at_rest: float = 3.0
    """Gain that the recordings at rest alone must show. Unit: log-likelihood. Source: decision 6."""
    random_effect_refined: float = 5.0
    """Gain from which a start is refined: within a quarter of a line it has most of its gain. Unit: log-likelihood.
    Source: speed."""
    spectral_lines: int = 4
    """Number of strongest lines of the pooled periodogram that serve as starts. Unit: 1. Source: speed."""
    same_random_gain: float = 0.02
    """Relative difference in gain, below which two random effects are not distinguished. Unit: 1. Source: tables."""
    ridge_penalties: tuple[float, ...] = tuple(float(penalty) for penalty in np.geomspace(1e-3, 1e5, 17))
    """Ridge penalties that the discrepancy regression tries, for features of unit norm. Unit: 1. Source: tables."""
    delays: tuple[float, ...] = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 6.0, 9.0, 13.0)
    """Delays of the copies of the motion among the regression's features. Unit: periods of the resonance. Source:
    tables."""
    most_rugged_reach: float = 16.0
    """Largest factor by which the interval of a value is widened if the likelihood is rugged there. Unit: 1. Source:
    cost."""


@dataclass(frozen=True)
class LocalizationSettings(_Settings):
    """How the mismatch is located without knowledge of effects."""

    false_alarms: float = 0.05
    """Probability that anything is significant if the model is right, over all cells and trends. Unit: 1. Source:
    Bonferroni's bound; docs/results/diagnosis.md counts the alarms on 100 heads without a mismatch."""
    least_degrees_of_freedom: float = 10.0
    """Least number of degrees of freedom of a cell. Unit: 1. Source: Paulson's approximation, Ann. Math. Stat. 13,
    1942, holds from there on."""
    growing_noise: float = 30.0
    """Largest number of independent samples that a noise which grows with the signal counts as estimated from: how it
    grows is a model. Unit: samples. Source: tables."""
    heavy_tails: float = 1.3
    """Variance of the noise's power, relative to that of normal noise, from which single samples that stand out are cut
    down. Unit: 1. Source: tables."""
    weak: float = 0.01
    """Share of the strongest cell's surplus power per sample, below which another cell of the same recording, or of all
    together, is not told. Unit: 1. Source: a tenth of the amplitude."""
    least_extent_degrees: float = 2.0
    """Least number of degrees of freedom of a stretch of one recording. Unit: 1. Source: one spectral line."""
    smooth_spectrum: float = 4.0
    """Number of noise samples, per coefficient of the noise model, that count as one for the noise at a single spectral
    line. Unit: samples. Source: tables."""
    trend_recordings: int = 4
    """Least number of recordings in a trend. Unit: recordings. Source: tables."""
    trend_error: float = 0.05
    """Standard error of a relative shift, from which a recording takes no part in a trend. Unit: 1. Source: tables."""
    most_recordings: int = 10
    """Largest number of recordings that a location lists. Unit: recordings. Source: reader."""
    strong: float = 0.5
    """Share of the strongest cell's surplus power from which the sentence calls a cell one of the strongest. Unit: 1.
    Source: reader."""
    part_stands_out: float = 2.0
    """Ratio of surplus power per sample to that of the next part of the waveform, from which a part is named. Unit: 1.
    Source: reader."""
    group_stands_out: float = 4.0
    """The same ratio for groups of recordings, which differ in more than what they are grouped by. Unit: 1. Source:
    reader."""
    weak_for_its_drive: float = 0.1
    """Share of the surplus power that a mismatch proportional to the drive would leave, below which a drive is omitted.
    Unit: 1. Source: reader."""
    time_intervals: int = 64
    """Largest number of equal intervals of a recording's time. Unit: 1. Source: reader."""
    bands_per_octave: int = 6
    """Number of frequency bands per octave. Unit: 1. Source: reader."""
    drive_levels: int = 10
    """Number of equal intervals of the largest drive. Unit: 1. Source: reader."""
    settled_drive: float = 0.05
    """Share of its time for which a drive must stand still; one that does so for less is always moving. Unit: 1.
    Source: tables."""
    pulse_gap: int = 3
    """Least number of samples at rest between two pulses. Unit: samples. Source: tables."""
    distortion_lines: int = 3
    """Distortion is looked for up to this multiple of the drive's highest line. Unit: 1. Source: tables."""


@dataclass(frozen=True)
class VerdictSettings(_Settings):
    """When a name is given, a set, or none."""

    left_over: float = 0.05
    """Unexplained share of a mismatch in which nothing was found, above which the verdict is unknown. Unit: 1. Source:
    decision 6."""
    certain_p_value: float = 1e-6
    """Probability of so large a mismatch by chance, by score test and scatter, below which the verdict is unknown
    though nothing was found. Unit: 1. Source: a thousandth of that from which effects are looked for."""
    least_closure: float = 0.5
    """Closure below which an effect keeps its name only if it explains the held-out recordings once they are fitted.
    Unit: 1. Source: decision 6."""
    held_out_standard_deviations: float = 2.0
    """Standard deviations of the noise taken off what is left in held-out recordings. Unit: 1. Source: 95 %."""
    least_probability: float = 0.8
    """Probability, Eq. (3) of docs/explanation/diagnosis.md, that what was found is right, below which the verdict is
    unknown. Unit: 1. Source: a wrong name costs four times what an open question does."""
    least_weight: float = 1e-3
    """Relative weight below which an explanation has no probability of its own. Unit: 1. Source: reader."""
    most_alike: int = 6
    """Largest number of effects in a set: if more explain the recordings equally well, the verdict is unknown. Unit:
    effects. Source: decision 6."""
    excess_standard_deviations: float = 5.0
    """Amount by which residual power must exceed the noise to count. Unit: standard deviations. Source: decision 6."""
    least_excess: float = 0.03
    """Share of the noise's power by which residual power must exceed it: less may be the noise's own uncertainty. Unit:
    1. Source: tables."""
    usual_level_recordings: int = 5
    """Least number of recordings with the same noise from which its usual level can be read. Unit: recordings. Source:
    tables."""
    regression_gain: float = 8.0
    """Least gain from which a prediction of the discrepancy regression counts as mismatch. Unit: log-likelihood.
    Source: tables."""
    most_listed: int = 24
    """Largest number of hypotheses that a diagnosis lists. Unit: hypotheses. Source: reader."""


@dataclass(frozen=True)
class RemainderSettings(_Settings):
    """How the unexplained remainder is modelled, and when it is used."""

    standard_errors: float = 2.0
    """Amount by which the remainder must gain on held-out recordings to be used. Unit: standard errors. Source:
    decision 10."""
    least_fall: float = 0.05
    """Share by which it must lower the held-out residual's RMS to be used. Unit: 1. Source: decision 10."""
    ridge_penalties: tuple[float, ...] = (1e-4, 1e-2, 1.0)
    """Ridge penalties that are tried, for features of unit norm. Unit: 1. Source: tables."""
    base_ridge: float = 1e-4
    """Penalty of the base parameters' orthonormal columns: what no other condition determines stays. Unit: 1. Source:
    tables."""
    most_features: int = 40
    """Largest number of features of a channel. Unit: features. Source: tables."""
    nearly_best: float = 1.05
    """Squared error of left-out rows, relative to the least one, up to which fewer features are preferred. Unit: 1.
    Source: tables."""
    folds: int = 4
    """Largest number of folds, of several conditions each. Unit: folds. Source: tables."""
    fewest_conditions: int = 3
    """Number of conditions below which stretches of time are left out instead. Unit: conditions. Source: tables."""
    blocks: int = 8
    """Number of these stretches. Unit: 1. Source: tables."""
    rounds: int = 4
    """Largest number of Gauss-Newton rounds. Unit: rounds. Source: tables."""
    enough: float = 0.01
    """Relative fall of the sum of squares, below which a round is the last. Unit: 1. Source: tables."""
    substeps: int = 4
    """Largest number of nodes per sampling step at which sensitivities are taken. Unit: nodes. Source: speed."""
    slack: float = 1.05
    """Limit of a sum of features, relative to its largest magnitude in the fitted recordings. Unit: 1. Source:
    the few nodes on which that is computed."""
    delays: tuple[float, ...] = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 6.0, 9.0, 13.0)
    """Delays of the copies of the motion. Unit: periods of the resonance. Source: tables."""
    coarse_samples: float = 40.0
    """Samples per period of the resonance below which copies of the drive come earlier as well as later. Unit: samples.
    Source: decision 10."""
    lags: int = 6
    """Number of low-pass copies of the drive, between three samples and a third of a recording. Unit: 1. Source:
    tables."""
    plays: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4, 0.6, 0.8)
    """Thresholds of the copies of the drive behind play operators. Unit: largest drive. Source: tables."""


@dataclass(frozen=True)
class DesignSettings(_Settings):
    """How the next experiment is designed."""

    separation: float = 21.5
    """Expected difference from which two candidates are separated. Unit: log-likelihood. Source: it then exceeds two
    standard errors, as a verdict asks of it, in nine of ten repetitions: (2 · (2 + 1.28))² / 2."""
    most_requests: int = 3
    """Largest number of different recordings that are proposed at once. Unit: recordings. Source: reader."""
    law_unknown: float = 0.1
    """Share of a candidate's contribution to a signal by which a law that is none of them is expected to differ. Unit:
    1. Source: chosen; it decides which recording is asked for, and no verdict."""
    most_recordings: int = 40
    """Largest number of recordings that are proposed in all, repeats counted; pairs of candidates for which it takes
    more are left. Unit: recordings. Source: what one takes at a bench in one go, and what a diagnosis can hold."""
    refining_evaluations: int = 40
    """Number of evaluations spent on optimising a pulse's height and times. Unit: 1. Source: speed."""
    refining_step: float = 0.5
    """First step of that optimisation, in the logarithms of height and times. Unit: 1. Source: speed."""
    plausible_signal: float = 10.0
    """Multiple of a channel's largest recorded signal, above which a prediction is an extrapolation of the law. Unit:
    1. Source: tables."""
    probe_signal: float = 1.2
    """The same for a pulse that is recorded for a probe at the head: the sensor's range stays as it is. Unit: 1.
    Source: the room that ranges leave."""
    repeats_for_noise: int = 2
    """Least number of recordings with a probe or a sampling step that the campaign has not. Unit: recordings. Source:
    only repeats show their noise."""
    monitor_noise: float = 0.005
    """Noise RMS of a voltage measured at the head, relative to the largest drive. Unit: 1. Source: the probe of an
    8-bit oscilloscope."""
    sign_used: float = 0.01
    """Share of its largest drive that a campaign must exceed in a sign for drives of that sign to be proposed. Unit: 1.
    Source: tables."""
    pulse_window: int = 16
    """Length of a pulse with its ring-down. Unit: periods of the resonance. Source: tables."""
    multisine_window: int = 40
    """Length of one repetition of a multisine. Unit: periods of the resonance. Source: tables."""
    probe_window: int = 4
    """Length of a pulse that is sampled fast for a probe at the head. Unit: periods of the resonance. Source: speed."""
    probe_samples: int = 4000
    """Number of its samples. Unit: samples. Source: a thousandth of a period, 20 ns, shows lags as short."""
    finest_probe_step: float = 1.3e-4
    """Sampling step of the shortest pulses for a probe, which shows how an edge's corners are rounded. Unit: periods of
    the resonance. Source: 2 ns, which any oscilloscope offers; the pulses are within `most_samples`."""
    highest_line: float = 0.2
    """Highest line of a multisine, at most. Unit: cycles per sample. Source: two fifths of Nyquist's frequency."""
    slow_samples: int = 1200
    """Length of a slow loop or of slow silence. Unit: samples. Source: tables."""
    hold_samples: int = 2000
    """Length of a slow step and hold. Unit: samples. Source: tables."""
    most_samples: int = 20_000
    """Largest length of a recording; a changed train of pulses ends within half of it. Unit: samples. Source: speed."""


@dataclass(frozen=True)
class EnsembleSettings(_Settings):
    """How many heads represent what the recordings leave possible."""

    heads: int = 16
    """Number of heads that are drawn. Unit: 1. Source: speed; each costs a simulation at every evaluation."""


@dataclass(frozen=True)
class DiagnosisSettings:
    """Every number on which a diagnosis's answer rests; the defaults are those of all published results.

    Constants that only guard arithmetic (steps of finite differences, ranks of matrices) are not among them: they stand
    beside the code that uses them.

    Parameters
    ----------
    fitting : FittingSettings
        How noise is estimated and models are fitted.
    selection : SelectionSettings
        How effects are looked for, fitted and compared.
    localization : LocalizationSettings
        How the mismatch is located without knowledge of effects.
    verdict : VerdictSettings
        When a name is given, a set, or none.
    remainder : RemainderSettings
        How the unexplained remainder is modelled, and when it is used.
    design : DesignSettings
        How the next experiment is designed.
    ensemble : EnsembleSettings
        How many heads represent what the recordings leave possible.

    Raises
    ------
    ValueError
        A setting is not a finite positive number, or not a whole number where it counts something.

    Examples
    --------
    >>> strict = DiagnosisSettings(selection=SelectionSettings(significance_level=1e-4))
    >>> strict.selection.significance_level, strict.selection.beam_width
    (0.0001, 3)
    """

    fitting: FittingSettings = field(default_factory=FittingSettings)
    selection: SelectionSettings = field(default_factory=SelectionSettings)
    localization: LocalizationSettings = field(default_factory=LocalizationSettings)
    verdict: VerdictSettings = field(default_factory=VerdictSettings)
    remainder: RemainderSettings = field(default_factory=RemainderSettings)
    design: DesignSettings = field(default_factory=DesignSettings)
    ensemble: EnsembleSettings = field(default_factory=EnsembleSettings)
