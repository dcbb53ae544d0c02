"""Drives that show effects of the resonator, recorded one after the other."""

import numpy as np

from inkjet_env.plant import Excitation
from inkjet_env.printhead import Printhead

PERIOD_S = 1 / Printhead.published().frequency_Hz


def pulses(samples=1500):
    """Two steep bipolar pulses with rest after each."""
    corners = [0, 20, 70, 110, 160, 200, 500, 510, 550, 560]
    return np.interp(np.arange(samples), corners, [0.0, 80.0, 80.0, -60.0, -60.0, 0.0, 0.0, 45.0, 45.0, 0.0])


def session(orders=8):
    """The same pulses at several amplitudes, one after the other."""
    sizes = np.resize([0.4, 1.2, 0.8, -1.0], orders)
    return [
        Excitation("self_sensing", "periodic", PERIOD_S / 50, size * pulses(900), order=order)
        for order, size in enumerate(sizes, start=1)
    ]
