"""Base model and effects fitted together, held against the plant, an identification and the truth."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial

from inkjet_env.identification import identify
from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.campaign_noise import Noise, noise_seen
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, finer, observe
from inkjet_env.mismatch.fitting.fit_result import ModelState
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.plant import Excitation, Plant
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import complete, coordinates
from inkjet_env.printhead import Printhead

SETTINGS = DiagnosisSettings()

CHANNELS = ("strain_gauge", "self_sensing", "displacement", "drive_monitor")


@pytest.fixture(scope="module")
def plain(recorded, fitted):
    return fitted(recorded())


@pytest.fixture
def four_channels(head):
    gains = {"strain_gauge": 0.02, "self_sensing": head.b1, "displacement": 3e-3, "drive_monitor": 1.01}
    return Head(head, gains, {"strain_gauge": 0.05, "self_sensing": -0.1, "displacement": 0.3, "drive_monitor": 0.0})


def pulse(channel, state="periodic"):
    drive_V = np.interp(np.arange(300.0), [0, 10, 25, 60, 75, 100, 110], [0, 0, 80, 80, -50, -50, 0])
    excitation = Excitation(channel, state, 2e-7, drive_V)
    return ObservedRecording(channel, channel, "V", 0, excitation, np.zeros(300), 300)


@pytest.mark.parametrize("state", ["periodic", "demagnetised"])
@pytest.mark.parametrize("channel", CHANNELS)
def test_sensitivities_are_derivatives_of_the_plants_signal(channel, state, four_channels):
    o = pulse(channel, state)
    found = four_channels.sensitivities(o)
    assert found.shape == (300, four_channels.size)
    for k in range(four_channels.size):
        step = np.zeros(four_channels.size)
        step[k] = 1e-4
        ends = [four_channels.moved(sign * step).plant().signal(o.excitation) for sign in (1, -1)]
        expected = (ends[0] - ends[1]) / 2e-4
        np.testing.assert_allclose(found[:, k], expected, atol=1e-6 * (np.abs(expected).max() + 1e-9))


def test_sensitivities_beside_an_effect_predict_what_a_law_of_high_degree_does(head, effects):
    """Its coefficients are large and cancel: two laws a hair apart differ by thousands in single coefficients."""
    bump = Chebyshev.basis(11, domain=[0.0, 1.0]).convert(kind=Polynomial).coef
    large = replace(head, coefficients=tuple(np.pad(head.coefficients, (12 - len(head.coefficients), 0))
                                             + 0.01 * np.append(bump[:0:-1], 0.0)))  # fmt: skip
    assert max(map(abs, large.coefficients)) > 1e4
    o, beside = pulse("self_sensing"), [(effects["cubic_stiffness"], {"stiffening_per_V2": 1e-6})]
    start = Head(large, {"self_sensing": large.b1}, {"self_sensing": 0.0})
    step = np.zeros(start.size)
    for degree in (3, 7, 11):
        powers = Chebyshev.basis(degree, domain=[0.0, 1.0]).convert(kind=Polynomial).coef[1:]
        step[:11] = 1e-3 * np.pad(powers, (0, 11 - degree))
        ends = [start.moved(sign * step).plant(beside).signal(o.excitation) for sign in (1, -1)]
        expected = (ends[0] - ends[1]) / 2
        found = start.sensitivities(o, beside) @ step
        assert np.linalg.norm(found - expected) < 1e-4 * np.linalg.norm(expected)


def test_one_gain_is_held_because_the_law_carries_its_scale(four_channels):
    assert four_channels.reference == "strain_gauge"
    assert four_channels.free_gains == ("self_sensing", "displacement", "drive_monitor")
    still = four_channels.moved(np.zeros(four_channels.size))
    assert still.gains == four_channels.gains
    assert still.offsets == four_channels.offsets
    assert still.printhead == four_channels.printhead
    step = np.zeros(four_channels.size)
    step[four_channels.degree + 2] = 0.01
    moved = four_channels.moved(step)
    assert moved.gains["self_sensing"] == moved.printhead.b1 == pytest.approx(1.01 * four_channels.printhead.b1)
    fast_only = Head(four_channels.printhead, {"self_sensing": 1.0, "displacement": 1.0}, {"self_sensing": 0.0})
    assert fast_only.reference == "self_sensing"


def test_the_base_fit_leaves_what_an_identification_leaves(recorded):
    campaign = recorded()
    found = identify(campaign, degree=9)
    head = Head(found.printhead, {c: g.value for c, g in found.gains.items()}, found.offsets)
    observed = observe(campaign)
    joint = OutputErrorFit(observed, Noise(found.noise, dict.fromkeys(found.noise, 1)), head, SETTINGS)
    modelled = joint.modelled(joint.base)
    for recording, o in zip(found.recordings, observed, strict=True):
        assert recording.name == o.name
        assert recording.fitted == o.fitted
        apart = modelled[o.name] - recording.modelled["base"]
        assert np.sqrt(np.mean(apart**2)) < 0.03 * recording.noise_rms  # nodes between samples against exact solutions


def test_noise_alone_leaves_as_much_as_noise_less_the_parameters(plain):
    rows = int(plain.ends[-1])
    expected = rows - plain.basis[0].shape[1]
    assert 2 * plain.base.nll == pytest.approx(expected, abs=5 * np.sqrt(2 * rows))
    residuals = np.concatenate([plain.base.residuals[o.name][: o.fitted] for o in plain.seen])
    assert 0.5 * residuals @ residuals == pytest.approx(plain.base.nll)
    assert (
        np.linalg.norm(plain.basis[0].T @ residuals) < 0.05
    )  # nothing the base could still say, in standard deviations


def errors_of(joint, fit):
    """Standard errors of the point, base parameters adapting."""
    q, _ = joint.near(fit).basis
    own = fit.jacobian - q @ (q.T @ fit.jacobian)
    told = ~fit.idle
    errors = np.full(told.size, np.inf)
    errors[told] = np.sqrt(np.diag(np.linalg.inv(own[:, told].T @ own[:, told])))
    return errors


@pytest.mark.parametrize("name", ["feedthrough", "cubic_stiffness", "sensor_bandwidth", "rate_dependent_hysteresis"])
def test_a_planted_effect_is_recovered_to_its_standard_errors(name, recorded, fitted, effects, values):
    effect = effects[name]
    joint = fitted(recorded(name, strength=0.35))
    truth = coordinates(effect, values(name, 0.35))
    begin = next(iter(effect.starts(joint.base.head.printhead, [o.excitation for o in joint.seen])))
    fit = joint.fit(ActiveEffects.of([(effect, begin)]))
    fit = joint.near(fit).fit(fit.active, fit.head)
    assert fit.converged
    assert fit.nll < joint.base.nll - 10
    told = [i for i, p in enumerate(effect.parameters) if p.name in effect.strengths and not fit.idle[i]]
    assert told
    apart = (fit.active.theta - truth) / errors_of(joint, fit)
    assert np.abs(apart[told]).max() < 4
    rows = int(joint.ends[-1])
    assert 2 * fit.nll == pytest.approx(rows, abs=5 * np.sqrt(2 * rows))


def test_errors_of_a_strength_are_as_large_as_told(recorded, fitted, effects, values, true_head):
    """Over campaigns that differ by their noise alone."""
    effect, campaign = effects["feedthrough"], recorded("feedthrough")
    truth = values("feedthrough")
    plant = true_head(campaign).plant([(effect, truth)])
    joint = fitted(campaign)
    clean = {o.name: plant.signal(o.excitation) for o in joint.observed}
    rng = np.random.default_rng(8)
    apart = []
    for _ in range(30):
        observed = []
        for o in joint.observed:
            rms = joint.noise.models[o.noise_key].rms
            observed.append(replace(o, measured=clean[o.name] + rms * rng.standard_normal(o.excitation.samples)))
        again = OutputErrorFit(observed, joint.noise, joint.start, SETTINGS)
        fit = again.fit(ActiveEffects.of([(effect, truth)]))
        apart.append(((fit.active.theta - coordinates(effect, truth)) / errors_of(again, fit))[~fit.idle])
    size = np.sqrt(np.mean(np.array(apart) ** 2, axis=0))
    assert np.all((size > 0.65) & (size < 1.4))
    assert np.all(np.abs(np.mean(apart, axis=0)) < 4 / np.sqrt(30))


def test_the_jacobian_holds_derivatives_of_what_is_compared(recorded, fitted, effects, values):
    effect = effects["second_mode"]
    joint = fitted(recorded("second_mode"))
    at = ModelState(joint.start, ActiveEffects.of([(effect, values("second_mode"))]), {})
    low, high = joint.limits([effect])
    jacobian = joint.jacobian(at, low, high)
    for k, size in enumerate((1e-3, 1e-3, 1e-4)):
        ends = []
        for sign in (1, -1):
            there = at.active.theta.copy()
            there[k] += sign * size
            of = {p.name: p.value(z) for p, z in zip(effect.parameters, there, strict=True)}
            signals = joint.signals(replace(at, active=ActiveEffects.of([(effect, of)])), joint.seen)
            ends.append(joint.stacked(signals))
        expected = (ends[0] - ends[1]) / (2 * size)
        assert np.linalg.norm(jacobian[:, k] - expected) < 2e-3 * np.linalg.norm(expected)


def test_a_parameter_that_the_base_model_can_stand_in_for_stays_where_it_is(recorded, fitted, effects):
    """Beyond a knee at nothing, branches that are both steeper are a branch law of another scale."""
    joint, effect = fitted(recorded("asymmetric_hysteresis")), effects["asymmetric_hysteresis"]
    names = [p.name for p in effect.parameters]
    for knee_V, stays in ((0.0, True), (20.0, False)):
        begin = complete(effect, asymmetry=0.02, bowing=0.01, knee_V=knee_V)
        fit = joint.fit(ActiveEffects.of([(effect, begin)]), most_steps=1)
        assert fit.idle[names.index("bowing")] == stays
        assert (fit.active.theta[names.index("bowing")] == 0.01) == stays
        assert not fit.idle[names.index("asymmetry")]


def test_sensitivities_taken_elsewhere_lead_to_the_same_end(recorded, fitted, effects):
    joint = fitted(recorded("feedthrough", "quadratic_damping"))
    first = joint.fit(ActiveEffects((effects["quadratic_damping"],), np.array([1e-4])))
    feedthrough = effects["feedthrough"]
    both = first.active.plus(feedthrough, complete(feedthrough, capacitive_s=4e-9))
    own = joint.fit(both, first.head)
    lent = joint.fit(both, first.head, known=first.jacobian)
    for _ in range(3):  # a fit ends where the next step promises less than 1
        own = joint.fit(own.active, own.head)
        lent = joint.fit(lent.active, lent.head, known=lent.jacobian)
    assert lent.nll == pytest.approx(own.nll, abs=0.1)
    assert lent.nll < first.nll - 100
    again = joint.again(lent.end, lent.jacobian_at, lent.started, True, False)
    np.testing.assert_array_equal(lent.jacobian, again.jacobian)


def test_a_fit_begun_where_the_head_has_no_rest_under_the_first_drive_fails(head, effects):
    cubic = effects["cubic_stiffness"]
    o = pulse("self_sensing", "demagnetised")
    o = replace(o, excitation=replace(o.excitation, drive_V=o.excitation.drive_V + 40, cache={}))
    start = Head(head, {"self_sensing": head.b1}, {"self_sensing": 0.0})
    clean = start.plant([(cubic, {"stiffening_per_V2": 1e-5})]).signal(o.excitation)
    measured = clean + 1e-3 * np.ptp(clean) * np.random.default_rng(0).standard_normal(clean.size)
    observed = [replace(o, measured=measured)]
    joint = OutputErrorFit(
        observed, noise_seen(observed, {o.name: measured - clean}, {}, SETTINGS.fitting), start, SETTINGS
    )
    assert joint.fit(ActiveEffects((cubic,), np.array([1e-5]))).nll == pytest.approx(0.5 * o.fitted, rel=0.2)
    with pytest.raises(FloatingPointError, match="no rest was found"):
        joint.fit(ActiveEffects((cubic,), np.array([5e-4])))


def test_a_fit_stays_within_its_bounds(recorded, fitted, effects, values):
    effect = effects["second_mode"]
    joint = fitted(recorded("second_mode"))
    low, high = joint.limits([effect])
    fit = joint.fit(ActiveEffects((effect,), np.array([1e3, 1e3, -1e3, 0.0])), most_steps=3)
    assert np.all((low <= fit.active.theta) & (fit.active.theta <= high))


def test_what_was_held_out_tells_a_fit_nothing(recorded, fitted, effects, values):
    campaign, effect = recorded("feedthrough"), effects["feedthrough"]
    joint = fitted(campaign)
    rng = np.random.default_rng(9)
    changed = tuple(
        replace(o, measured=o.measured + 10 * rng.standard_normal(o.excitation.samples)) if not o.fitted else o
        for o in joint.observed
    )
    assert any(not o.fitted for o in changed)
    theta = coordinates(effect, values("feedthrough"))
    one, other = (
        OutputErrorFit(observed, joint.noise, joint.start, SETTINGS).fit(ActiveEffects((effect,), theta))
        for observed in (joint.observed, changed)
    )
    np.testing.assert_array_equal(one.active.theta, other.active.theta)
    assert one.nll == other.nll
    for o in changed:
        same = np.array_equal(one.residuals[o.name], other.residuals[o.name])
        assert same == bool(o.fitted)


def ringing_on(head, states, seed=1):
    """Recordings that begin while the head still rings, by the plant; and one at rest."""
    rng, recordings = np.random.default_rng(seed), []
    plant = Plant(head, {}, {"self_sensing": 0.2})
    drive_V = np.interp(np.arange(500.0), [0, 100, 115, 150, 165], [0, 0, 60, 60, 0])
    for k, start in enumerate((*states, None), start=1):
        state = "demagnetised" if start is None else "free"
        volts = np.zeros(500) if start is None else (0.4 + 0.3 * k) * drive_V
        excitation = Excitation("self_sensing", state, 2e-7, volts, k, None, 16, start or (0.0, 0.0))
        measured = plant.signal(excitation) + 0.02 * rng.standard_normal(500)
        coarse = replace(excitation, substeps=2, start=(0.0, 0.0), cache={})
        recordings.append(ObservedRecording(f"r{k}", "self_sensing", "V", k, coarse,
                                   measured, 0 if k == 2 else 500))  # fmt: skip
    noise = noise_seen(recordings, {o.name: o.measured for o in recordings}, {}, SETTINGS.fitting)
    return OutputErrorFit(recordings, noise, Head(head, {"self_sensing": head.b1}, {"self_sensing": 0.0}), SETTINGS)


def test_unknown_initial_states_are_found_held_out_ones_too(head):
    states = ((8.0, -3.0), (0.0, 12.0), (-5.0, 0.5))
    joint = ringing_on(head, states)
    assert joint.base.end.states.keys() == {"r1", "r2", "r3"}
    for name, truth in zip(joint.base.end.states, states, strict=True):
        assert joint.base.end.states[name] == pytest.approx(truth, abs=0.15)
    rows = int(joint.ends[-1])
    assert 2 * joint.base.nll == pytest.approx(rows, abs=6 * np.sqrt(2 * rows))
    held_out = joint.base.residuals["r2"]
    assert np.std(held_out) < 1.3


def test_a_state_said_to_be_at_rest_is_not_fitted(head):
    joint = ringing_on(head, ((8.0, -3.0), (0.0, 12.0)))
    at_rest = [
        replace(o, excitation=replace(o.excitation, initial_state="demagnetised", cache={})) for o in joint.observed
    ]
    wrong = OutputErrorFit(at_rest, joint.noise, joint.start, SETTINGS)
    assert wrong.base.end.states == {}
    assert wrong.base.nll > 10 * joint.base.nll


@pytest.mark.parametrize("name", ["baseline_drift", "mains_hum"])
def test_what_a_standing_effect_can_explain_changes_no_fit(name, recorded, fitted, effects, values):
    """However much of it is in each recording."""
    effect, told = effects[name], values(name)
    joint = fitted(recorded(), random_effects=[(effect, told)])
    rng = np.random.default_rng(4)
    changed = []
    for o in joint.observed:
        columns = effect.random_effect_basis(told, o.excitation)
        more = 0.0 if columns is None else columns @ (3 * rng.standard_normal(columns.shape[1]))
        changed.append(replace(o, measured=o.measured + more))
    other = OutputErrorFit(changed, joint.noise, joint.start, SETTINGS, joint.random_effects)
    assert other.base.nll == pytest.approx(joint.base.nll, rel=1e-6)
    assert other.base.head.printhead.a0 == pytest.approx(joint.base.head.printhead.a0, rel=1e-6)
    bare = OutputErrorFit(changed, joint.noise, joint.start, SETTINGS)
    assert bare.base.nll > 3 * other.base.nll
    for o in changed:  # and its own share of each recording is in what is modelled
        residuals = joint.noise.whitened(o, o.measured - other.modelled(other.base)[o.name])
        assert np.sqrt(np.mean(residuals**2)) < 1.6


@pytest.mark.parametrize("name", ["cubic_stiffness", "sensor_bandwidth"])
def test_the_numerical_error_falls_with_the_nodes(name, recorded, fitted, effects, values):
    effect, told = effects[name], values(name)
    joint = fitted(recorded(name))
    errors = []
    for substeps in (2, 4, 8):
        fine = OutputErrorFit(finer(joint.observed, substeps), joint.noise, joint.start, SETTINGS, base=joint.base)
        fit = joint.base.moved(active=ActiveEffects.of([(effect, told)]))
        errors.append(fine.numerical_error(fit, substeps))
    assert errors[0] > 3 * errors[1] > 9 * errors[2] > 0


def test_a_signature_is_what_switching_the_effect_on_changes(plain, effects, values):
    effect, told = effects["feedthrough"], values("feedthrough")
    found = plain.signature(effect, told)
    on, off = (plain.base.head.plant(e) for e in ([(effect, told)], []))
    expected = plain.stacked({o.name: on.signal(o.excitation) - off.signal(o.excitation) for o in plain.seen})
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    doubled = {name: 2 * value for name, value in told.items()}
    np.testing.assert_allclose(plain.signature(effect, doubled), 2 * found, atol=1e-9 * np.abs(found).max())


def test_a_head_of_another_frequency_is_found_from_a_start_that_is_off(recorded, fitted, true_head):
    campaign = recorded()
    joint, truth = fitted(campaign), true_head(campaign)
    off = replace(truth, printhead=Printhead(1.02 * truth.printhead.a0, 1.2 * truth.printhead.a1, truth.printhead.b1,
                                             truth.printhead.coefficients, truth.printhead.full_scale_V))  # fmt: skip
    other = OutputErrorFit(joint.observed, joint.noise, off, SETTINGS)
    assert other.base.nll == pytest.approx(joint.base.nll, rel=1e-4)


def test_fits_of_a_first_effect_begin_at_the_plain_head_and_gain_over_the_same_base_model(
    recorded, fitted, effects, values
):
    """A law bent by the mismatch is no place to begin; what an effect gains is told from the base model as it is."""
    joint = fitted(recorded("quadratic_damping"))
    head = Head(joint.start.printhead, joint.start.gains, joint.start.offsets)
    assert joint.from_plain is joint
    begun = joint.anew(head=joint.base.head, base=joint.base)
    begun.plain = head
    assert begun.from_plain.start is head
    assert begun.from_plain.base is joint.base
    active = ActiveEffects.of([(effects["quadratic_damping"], values("quadratic_damping"))])
    first = begun.from_plain.fit(active, head, most_steps=8)
    assert first.nll == pytest.approx(joint.fit(active).nll, abs=0.6)
