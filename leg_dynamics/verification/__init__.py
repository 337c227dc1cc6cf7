"""Where routes meet: independent derivations held against each other and against first principles."""

from leg_dynamics.verification.crosscheck import crosscheck
from leg_dynamics.verification.report import Check, CrosscheckReport, OwnCheck, OwnFormulasReport

__all__ = ["Check", "CrosscheckReport", "OwnCheck", "OwnFormulasReport", "crosscheck"]
