"""An effect of a user's own, which the catalogue does not hold."""

import numpy as np

from inkjet_env.plant import Effect, Parameter


class Leak(Effect):
    """The sensor hears the integral of its own signal."""

    id, stage = "leak", "sensing"
    sentence = "The sensor's integrator leaks into its output."
    equation, source, signature, shown_by = "y = y₀ + k ∫ y₀ dt", "a test", "a slope after each pulse", "any pulse"
    parameters = (Parameter("leak_per_s", "1/s", -1e6, 1e6),)
    strengths = ("leak_per_s",)

    def starts(self, printhead, excitations):
        return [{"leak_per_s": 0.05 * printhead.frequency_Hz}]

    def sensing(self, values, signal, drive_V, printhead, excitation):
        if excitation.channel != "self_sensing":
            return signal
        return signal + values["leak_per_s"] * excitation.step_s * np.cumsum(signal - signal.mean())
