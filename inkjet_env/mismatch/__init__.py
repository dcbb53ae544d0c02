"""Where recordings and model differ, and which physics was left out."""
