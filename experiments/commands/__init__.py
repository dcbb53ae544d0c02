"""The commands that need the optimisers: optimize, bench and prove."""
