"""Diagnosis: where recordings and model differ, and which physical effect is missing."""

from inkjet_env.mismatch.diagnose import diagnose
from inkjet_env.mismatch.diagnosis import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
