"""Studies for the comparison: best known waveforms, tuned settings, overhead of a run, Fig. 7 of the paper."""
