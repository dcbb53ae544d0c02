"""Types that signatures share."""

"""An array of doubles; its shape and unit stand in the docstring."""
