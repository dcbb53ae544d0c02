"""How accurate, how fast and how often right: studies of simulator, identification and diagnosis."""
