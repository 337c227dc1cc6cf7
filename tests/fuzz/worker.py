"""A child process that works through a batch of random mechanisms, one JSON line before and one after each.

    python -m tests.fuzz.worker BATCH FIRST COUNT ENGINE [FAULT]

FAULT plants one in every mechanism, to prove that it is found: hang, die, wrong, nan, or stray for an exception that is
none of the package's.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
import traceback
from dataclasses import asdict
from typing import Any

import numpy as np

from tests.fuzz.check import check, mechanisms, plans_of


def _without_llvm() -> None:
    """Kernels on CasADi's virtual machine: the same graphs, without the time that compiling takes."""
    # The package has a function of the module's name.
    module: Any = importlib.import_module("leg_dynamics.kernels.kernel")
    module.llvm_is_available = lambda: False


def _planted(fault: str) -> Any:
    def change(route: str, method: str, result: np.ndarray) -> np.ndarray:
        if fault == "hang":
            time.sleep(3600.0)
        elif fault == "die":
            os.abort()
        elif fault == "stray":
            raise ZeroDivisionError
        elif route == "symbolic" and method == "bias":
            return result * (np.nan if fault == "nan" else 1.0 + 1e-6)
        return result

    return change


def _say(**what: Any) -> None:
    print(json.dumps(what), flush=True)


def main(batch: int, first: int, count: int, engine: str, fault: str = "") -> None:
    """Work through plans `first` to `count` of a batch."""
    if engine == "casadi":
        _without_llvm()
    # Compiling takes most of the time, and grows faster than a mechanism does.
    plans = plans_of(batch, 1 if engine == "llvm" else 3)
    for number, plan in list(enumerate(plans))[first:count]:
        made = mechanisms.build(plan)
        if made is None:
            _say(done=number, built=False)
            continue
        _say(start=number, plan=repr(plan), text=made.text, foot=made.foot)
        began = time.monotonic()
        try:
            verdict = check(made.text, made.foot, plan.seed, _planted(fault) if fault else None)
        except Exception as error:
            _say(done=number, failure=f"{type(error).__name__}: {error}", trace=traceback.format_exc())
        else:
            _say(done=number, built=True, seconds=time.monotonic() - began, **asdict(verdict))


if __name__ == "__main__":
    batch, first, count = map(int, sys.argv[1:4])
    main(batch, first, count, *sys.argv[4:])
