"""Where a model fails, which effect it lacks, how sure that is, and what to measure next."""

from kinid.diagnosis.inquiry import diagnose
from kinid.diagnosis.result import Diagnosis, EffectStatus, EffectVerdict, Step, Verdict
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.residuals import Cell

__all__ = ["Cell", "Diagnosis", "DiagnosisSettings", "EffectStatus", "EffectVerdict", "Step", "Verdict", "diagnose"]
