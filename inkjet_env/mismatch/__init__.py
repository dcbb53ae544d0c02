"""Diagnosis: where recordings and model differ, and which physical effect is missing."""

from inkjet_env.mismatch.diagnose import clear_checkpoint, diagnose
from inkjet_env.mismatch.diagnosis import Diagnosis
from inkjet_env.mismatch.settings import (
    DesignSettings,
    DiagnosisSettings,
    FittingSettings,
    LocalizationSettings,
    SelectionSettings,
    VerdictSettings,
)

__all__ = [
    "DesignSettings",
    "Diagnosis",
    "DiagnosisSettings",
    "FittingSettings",
    "LocalizationSettings",
    "SelectionSettings",
    "VerdictSettings",
    "clear_checkpoint",
    "diagnose",
]
