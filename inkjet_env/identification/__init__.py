"""From recordings to a printhead, with intervals."""
