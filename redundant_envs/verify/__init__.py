"""Is a motion simulated correctly? Checks of arms, scenes, effects, tasks and environments, and their table.

A check is a function in one of the modules of its kind; :mod:`~.report` has the table of all of them. It
measures one number of a subject and compares it with a promise. A promise is a bound that the equations keep
in float64 for any reasonable arm, not the value that the arms of this package happen to have.
"""

from redundant_envs.verify.promises import Mode, Verdict
from redundant_envs.verify.report import Report, verify
from redundant_envs.verify.subjects import Subject, subject_from, subjects_of

__all__ = ["Mode", "Report", "Subject", "Verdict", "subject_from", "subjects_of", "verify"]
