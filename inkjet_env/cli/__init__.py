"""The command line of the printhead: simulate, record, identify, evaluate and diagnose."""
