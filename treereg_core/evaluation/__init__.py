"""Evaluation: any number of methods and starts on the same trials with known misplacements.

A trial's two surveys come from a `Source`: simulated families, or surveys that were misregistered on purpose.
"""

from treereg_core.evaluation.case import Case, Families, Misregistered
from treereg_core.evaluation.running import Study, run_all
from treereg_core.evaluation.trial import Trial, run_trial

__all__ = ["Case", "Families", "Misregistered", "Study", "Trial", "run_all", "run_trial"]
