"""Studies of accuracy, speed and correctness: simulator, identification and diagnosis."""
