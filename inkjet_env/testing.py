"""Tests that every effect must pass, one of your own too.

In a test file of yours, for pytest::

    from inkjet_env.testing import EffectTests
    from my_lab import QuadraticStiffness


    class TestQuadraticStiffness(EffectTests):
        effect = QuadraticStiffness()
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from inkjet_env.plant import Effect, Excitation, Plant
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.effect import SCALES, STAGES, complete, coordinates, switched_off, values_at
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.plant.registry import own_class, register
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
FREQUENCIES_HZ = (50.0, 1.7e3, 51.7e3)
MOST_STARTS = 48


def excitations_of(head: Printhead) -> list[Excitation]:
    """Fast and slow recordings of a head, in every channel and initial state, two of them with a neighbour."""
    step_s = 1 / (100 * head.frequency_Hz)
    steps = np.arange(900)
    bipolar = np.interp(steps, [0, 20, 70, 100, 160, 190, 900], [0, 90, 90, -60, -60, 0, 0])
    loops = 70 * np.sin(2 * np.pi * np.arange(200) / 80) * np.linspace(0.2, 1, 200)
    tones = 50 * np.sin(2 * np.pi * steps / 450) + 20 * np.cos(2 * np.pi * steps / 90) - 20
    return [
        Excitation("self_sensing", "demagnetised", step_s, bipolar, 1, np.roll(bipolar, 300)),
        Excitation("self_sensing", "periodic", step_s, tones, 2),
        Excitation("self_sensing", "free", step_s, -bipolar, 3, start=(3.0, -2.0)),
        Excitation("displacement", "periodic", step_s, bipolar, 4, np.roll(bipolar, 300)),
        Excitation("displacement", "demagnetised", step_s, -tones, 5, substeps=4),
        Excitation("strain_gauge", "demagnetised", 1000 * step_s, loops, 6),
        Excitation("strain_gauge", "periodic", 1000 * step_s, loops[120:], 7),
    ]


class EffectTests:
    """Tests of the rules of `Effect`; a subclass names what is tested.

    Attributes
    ----------
    effect : Effect
        The effect.
    """

    effect: Effect

    def test_it_declares_what_it_is(self) -> None:
        effect = self.effect
        missing = [name for name in Effect.__annotations__ if not hasattr(effect, name)]
        assert not missing, f"it does not declare {', '.join(missing)}"
        assert effect.stage in STAGES, f"stage must be one of {', '.join(STAGES)}; it is {effect.stage!r}"
        assert effect.sentence.endswith("."), f"sentence must end with a full stop: {effect.sentence!r}"
        assert effect.id not in effect.confusable_with, "confusable_with names the effect itself"

    def test_parameters_have_units_and_bounds_that_include_off(self) -> None:
        effect = self.effect
        names = {parameter.name for parameter in effect.parameters}
        assert effect.strengths, "it has no strength: without one it cannot be switched off"
        assert set(effect.strengths) <= names, f"strengths must be parameters; they are {effect.strengths}"
        assert set(effect.tuned) <= set(effect.strengths), f"tuned must be strengths; they are {effect.tuned}"
        strange = set(effect.characteristic) - {p.name for p in effect.parameters}
        assert not strange, f"characteristic must be parameters; {sorted(strange)} are none"
        assert set(effect.also) <= set(STAGES), f"also must be stages ({', '.join(STAGES)}); it is {effect.also}"
        for parameter in effect.parameters:
            assert parameter.scale in SCALES, f"scale of {parameter.name} must be one of {', '.join(SCALES)}"
            assert parameter.unit, f'{parameter.name} has no unit; write "1" for a dimensionless one'
            low, high = parameter.bounds
            assert np.isfinite([low, high]).all(), f"the bounds of {parameter.name} are not finite"
            assert low < high, f"the bounds of {parameter.name} are {low} and {high}"
            if parameter.name in effect.strengths:
                assert low <= 0 <= high, f"the strength {parameter.name} cannot be off within its bounds"

    def test_starts_are_complete_and_within_the_bounds_for_any_head(self) -> None:
        effect = self.effect
        for frequency_Hz in FREQUENCIES_HZ:
            head = HEAD.varied(frequency_Hz=frequency_Hz)
            starts = effect.starts(head, excitations_of(head))
            assert 0 < len(starts) <= MOST_STARTS, f"{len(starts)} starts; from 1 to {MOST_STARTS} are allowed"
            for start in starts:
                assert start.keys() == {p.name for p in effect.parameters}, f"the start {start} is not complete"
                again = values_at(effect, coordinates(effect, start))
                assert all(np.isclose(again[name], start[name]) for name in start), f"{start} becomes {again}"
                for parameter in effect.parameters:
                    low, high = parameter.bounds
                    at = parameter.coordinate(start[parameter.name])
                    assert low <= at <= high, f"{parameter.name} of the start {start} is out of bounds"

    def test_switched_off_it_leaves_the_base_model(self) -> None:
        effect, excitations = self.effect, excitations_of(HEAD)
        base = Plant(HEAD, {"displacement": 0.02}, {"self_sensing": 0.1})
        for start in effect.starts(HEAD, excitations):
            off = switched_off(effect, start)
            for excitation in excitations:
                expected = base.signal(excitation)
                error = np.abs(base.with_effects([(effect, off)]).signal(excitation) - expected).max()
                assert error <= 1e-12 * np.abs(expected).max(), f"at {off} a recording differs by {error:.3g}"
                assert effect.random_effect_basis(off, excitation) is None, "it is random though it is off"

    def test_switched_on_it_changes_a_recording_unless_it_is_random(self) -> None:
        effect, excitations, base = self.effect, excitations_of(HEAD), Plant(HEAD)
        for start in effect.starts(HEAD, excitations):
            plant = base.with_effects([(effect, start)])
            changed = max(np.abs(plant.signal(one) - base.signal(one)).max() for one in excitations)
            bases = [effect.random_effect_basis(start, one) is not None for one in excitations]
            assert any(bases) == effect.random, f"random is {effect.random}, but it has {sum(bases)} random bases"
            if not effect.random:
                assert changed > 1e-6, f"at {start} it changes no recording"

    def test_example_values_are_within_bounds_and_change_a_recording_by_some_per_cent(self) -> None:
        effect = self.effect
        values = complete(effect, **effect.example_values(HEAD))
        for parameter in effect.parameters:
            inside = parameter.low <= values[parameter.name] <= parameter.high
            assert inside, f"{parameter.name} of the example is {values[parameter.name]}, out of bounds"
        pulse = replace(excitations_of(HEAD)[0], order=20)
        held = Excitation("strain_gauge", "demagnetised", 0.05, np.repeat([0.0, 90.0], [20, 380]), 20)
        if effect.random:
            basis = effect.random_effect_basis(values, pulse)
            assert basis is not None, "its random basis is constant"
            assert np.ptp(basis) > 0, "its random basis is constant"
        else:
            share = max(self._change(excitation) for excitation in (pulse, held))
            assert 4e-3 < share < 0.25, f"the example changes recordings by {100 * share:.3g} %; 0.4 to 25 are allowed"

    def test_it_depends_on_the_order_only_if_it_declares_so(self) -> None:
        excitation = excitations_of(HEAD)[0]
        early, late = (self._change(replace(excitation, order=order)) for order in (2, 20))
        depends = self.effect.depends_on_order
        assert (early != late) == depends, f"depends_on_order is {depends}, but changes are {early} and {late}"

    def test_it_needs_a_neighbour_only_if_it_declares_so(self) -> None:
        excitation = replace(excitations_of(HEAD)[0], order=20)
        alone, beside = self._change(replace(excitation, neighbour_V=None, cache={})), self._change(excitation)
        needs = self.effect.needs_neighbour
        assert (alone != beside) == needs, f"needs_neighbour is {needs}, but changes are {alone} and {beside}"
        assert not needs or alone == 0, "it acts without a neighbour though needs_neighbour is true"

    def test_it_describes_itself_and_what_cannot_show_it(self) -> None:
        effect, excitations = self.effect, excitations_of(HEAD)
        for start in effect.starts(HEAD, excitations):
            text = effect.description(start)
            assert text.endswith("."), f"the description must end with a full stop: {text!r}"
        reason = effect.untestable(excitations)
        assert reason is None, f"it cannot be tested where every channel is recorded: {reason}"

    def test_a_printhead_file_with_it_can_be_read(self) -> None:
        effect = self.effect
        if own_class(effect) is not None:
            register(type(effect))
        values = complete(effect, **effect.example_values(HEAD))
        head = AugmentedPrinthead(HEAD, ((effect, values),))
        read = printhead_of(head.as_json())
        assert isinstance(read, AugmentedPrinthead), "a file with it is read as one without effects"
        ((found, again),) = read.effects
        assert (found.id, again) == (effect.id, values), f"a file with {values} is read as {found.id} with {again}"

    def _change(self, excitation: Excitation) -> float:
        """Change of a recording by the example, without its offset, relative to the recording: a ratio of RMS."""
        plain = Plant(HEAD).signal(excitation)
        given = self.effect.example_values(HEAD, largest=float(np.abs(plain).max()))
        plant = Plant(HEAD, effects=((self.effect, complete(self.effect, **given)),))
        return float(np.std(plant.signal(excitation) - plain) / np.std(plain))
