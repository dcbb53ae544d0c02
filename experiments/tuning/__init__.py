"""The closed loop from a campaign to a waveform that is safe to fire: diagnose, ask, optimise, check, propose."""
