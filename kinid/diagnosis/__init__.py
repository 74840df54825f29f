"""Where a model fails, which effect it lacks, how sure that is, and what to measure next."""

from kinid.diagnosis.inquiry import diagnose, experiment_of
from kinid.diagnosis.result import Cell, Diagnosis, EffectVerdict, Step

__all__ = ["Cell", "Diagnosis", "EffectVerdict", "Step", "diagnose", "experiment_of"]
