"""The command line for the printhead: simulate, record, identify, evaluate and diagnose."""
