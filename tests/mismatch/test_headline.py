"""The verdict in at most two sentences."""

import math

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.diagnosis import NamedEffect
from inkjet_env.mismatch.headline import headline
from inkjet_env.mismatch.localization.location import Location

SETTINGS = DiagnosisSettings()

SOMEWHERE = Location(("r003", "r005"), frequency_Hz=((3.7e4, 5.2e4), (5.8e4, 6.6e4), (9e4, 1e5)))


def named(effect, delta_nll, sentence):
    return NamedEffect(effect, sentence, delta_nll, 1e-9, {}, {})


def test_one_effect_is_told_with_its_share(effects):
    one = named(effects["slew_limit"], 40.0, "The amplifier cannot follow edges steeper than 23 V/µs.")
    said = headline("named", [one], [], 0.9961, 0.0, None, SOMEWHERE, SETTINGS.verdict)
    assert said == one.sentence + " It explains 99.6 % of the mismatch."
    assert headline("named", [one], [], math.nan, 0.0, None, SOMEWHERE, SETTINGS.verdict) == one.sentence


def test_of_several_effects_the_weightiest_comes_first_and_the_others_by_name(effects):
    less = named(effects["creep"], 40.0, "After a change it goes on.")
    most = named(effects["slew_limit"], 400.0, "Edges are cut.")
    said = headline("named", [less, most], [], 0.93, 0.0, None, SOMEWHERE, SETTINGS.verdict)
    assert said == "Edges are cut. Creep is present as well; together they explain 93 % of the mismatch."


def test_what_held_out_recordings_bear_out_only_when_fitted_is_said(effects):
    one, other = named(effects["slew_limit"], 400.0, "Edges are cut."), named(effects["creep"], 40.0, "It goes on.")
    said = headline("named", [one], [], -0.2, 0.0, None, SOMEWHERE, SETTINGS.verdict)
    assert said == (
        "Edges are cut. Held-out recordings were predicted worse, but are explained once they are fitted as well."
    )
    said = headline("named", [one, other], [], -0.2, 0.0, None, SOMEWHERE, SETTINGS.verdict)
    assert said.startswith("Edges are cut. Creep is present as well; held-out recordings were")


def test_a_set_names_all_its_members_and_what_is_certain_beside_it(effects):
    both = [named(effects["second_mode"], 9.0, "A mode."), named(effects["mains_hum"], 4.0, "A hum.")]
    said = headline("set", both, [("second_mode", "air_bubble")], 0.99, 0.0, None, SOMEWHERE, SETTINGS.verdict)
    assert said.startswith(
        "Second mode or air bubble: these recordings cannot distinguish between them. Mains hum is present as well;"
    )
    said = headline("set", both[:1], [("second_mode", "air_bubble")], 0.99, 0.0, None, SOMEWHERE, SETTINGS.verdict)
    assert said.endswith("between them. Either explains 99 % of the mismatch.")


def test_an_unknown_cause_tells_how_much_where_and_what_came_closest():
    said = headline("unknown", [], [], 0.2, 0.9, (("second_mode", "creep"), 0.1), SOMEWHERE, SETTINGS.verdict)
    assert said == (
        "Unknown: something is missing that the catalogue does not have. 90 % of the mismatch is not explained by any "
        "of its effects; second mode with creep comes closest and explains 10 %. The "
        "mismatch is largest in r003, at 37 to 52 kHz and 58 to 66 kHz."
    )
    assert headline("unknown", [], [], 0.2, 0.9, None, Location(), SETTINGS.verdict).count(".") == 2


def test_a_mismatch_that_is_certain_but_small_is_told_without_a_share():
    said = headline("unknown", [], [], 0.0, 0.0, (("creep",), 0.3), Location(), SETTINGS.verdict)
    assert (
        said == "Unknown: the residuals have structure that noise has not, but no effect of the catalogue explains it."
    )


def test_the_name_that_is_refused_is_the_one_that_was_chosen(effects):
    chosen = [named(effects["slew_limit"], 400.0, "Edges are cut.")]
    said = headline("unknown", chosen, [], 0.3, 0.0, (("creep", "wave_echo"), 1.0), Location(), SETTINGS.verdict)
    assert said == "Unknown: slew limit explains the fitted recordings but predicts the held-out ones poorly."
    assert headline("unknown", chosen, [], -0.1, 0.03, None, Location(), SETTINGS.verdict) == said


def test_what_explains_all_but_is_not_probable_enough_is_not_said_to_predict_badly(effects):
    rest = "these recordings, but so may physics that the catalogue lacks"
    both = f"Unknown: creep with wave echo together explain {rest}, which several laws often imitate."
    for ids, closure, expected in (
        (("creep",), math.nan, f"Unknown: creep explains {rest}."),
        (("creep", "wave_echo"), 0.99, both),
    ):
        chosen = [named(effects[name], 400.0, "It.") for name in ids]
        assert headline("unknown", chosen, [], closure, 0.0, None, Location(), SETTINGS.verdict) == expected


def test_too_many_that_explain_it_alike_are_not_listed(effects):
    chosen, alike = [named(effects["creep"], 400.0, "It creeps.")], tuple("abcdefg")
    said = headline("unknown", chosen, [alike], math.nan, 0.0, (("creep",), 1.0), Location(), SETTINGS.verdict)
    assert said == "Unknown: a small mismatch is present, and each of 7 effects explains it equally well."
    said = headline("unknown", chosen, [alike[:6]], -0.1, 0.0, (("creep",), 1.0), Location(), SETTINGS.verdict)
    assert said == "Unknown: creep explains the fitted recordings but predicts the held-out ones poorly."


def test_nothing_found_is_not_noise_where_nothing_tells_the_noise():
    said = headline("none", [], [], math.nan, 0.0, None, Location(), SETTINGS.verdict)
    assert said.startswith("The base model explains these recordings to within their noise")
    said = headline("none", [], [], math.nan, 0.0, None, Location(), SETTINGS.verdict, noise_known=False)
    assert "within their noise" not in said
    assert "repeat a recording" in said
