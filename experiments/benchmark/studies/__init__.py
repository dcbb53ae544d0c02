"""Studies about the comparison: best known waveforms, tuned settings, the overhead of a run, Fig. 7 of the paper."""
