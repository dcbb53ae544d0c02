"""Where recordings and model differ, and which physics was left out."""

from inkjet_env.mismatch.diagnose import diagnose
from inkjet_env.mismatch.diagnosis import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
