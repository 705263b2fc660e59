# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The one prediction loop: restart and validity codes, one step ahead and free.

It is a template. `predictor` makes a compiled copy for each valve, in which the global names below
are the valve's own. The state holds the samples seen since the last gap, the run that follows the
measured output, the free run, and a memory that both share, such as the inputs so far.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

from valve_twin.core.types import Restart, Validity
from valve_twin.core.valves.kit.bind import bind, per_sample
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from valve_twin.core.types import ByteArray, FloatArray
    from valve_twin.core.valves.kit.bind import Loop

    Compiled = Callable[..., Any]

_SEEN, _FOLLOWED = 0, 1

RUN, OUTPUT = 1, 0
AT_ONCE = False


@njit(cache=True)
def numbers(c: FloatArray) -> FloatArray:
    """Return the model's numbers from the coefficients (K,), in whatever form."""
    return c


def advance(
    m: FloatArray, seen: float, followed: FloatArray, free: FloatArray, memory: FloatArray,
    inputs: FloatArray, n: int, bad: bool,
) -> Validity:  # fmt: skip
    """Take both runs from the sample before to this one; STARTING = not possible yet.

    Parameters
    ----------
    m : any
        What `numbers` returned.
    seen : float
        Samples since the last gap, from the first that is not bad on [1].
    followed, free : (RUN,) arrays
        The run that follows the measured output and the free run [unit by state]; written in
        place.
    memory : (S,) array
        What they share, such as the inputs up to the sample before [unit by state]; written in
        place.
    inputs, n : (N, M) array, int
        Inputs [unit of the signals] and the row of this sample.
    bad : bool
        Whether the sample is unusable: the inputs before it hold.
    """
    raise NotImplementedError


@per_sample
def shown(m: FloatArray, value: float) -> float:
    """Return the output [unit of the signal] where number OUTPUT of a run is `value`."""
    return value


def follow(
    m: FloatArray, followed: FloatArray, memory: FloatArray, x: float,
    inputs: FloatArray, n: int, code: Validity,
) -> Validity:  # fmt: skip
    """Correct the run by a measured output x, or begin it where `code` is STARTING.

    The rest as `advance`; returns the code of the sample.
    """
    raise NotImplementedError


def predict(
    state: FloatArray,
    c: FloatArray,
    measured: FloatArray,
    inputs: FloatArray,
    restart: ByteArray,
    predicted: FloatArray,
    simulated: FloatArray,
    validity: ByteArray,
) -> None:
    """Predict N samples in place; see `ValveModel.predict`.

    Parameters
    ----------
    state : (1 + 2 RUN + S,) array
        See the module [unit by state]; written in place.
    c : (K,) array
        Coefficients [unit of each].
    measured : (N,) array
        Output [unit of the signal].
    inputs : (N, M) array
        Inputs [unit of the signals].
    restart : (N,) uint8 array
        One `Restart` a sample.
    predicted, simulated : (N,) arrays
        One-step prediction and free run [unit of the signal], NaN where they have not begun.
    validity : (N,) uint8 array
        One `Validity` a sample.
    """
    m = numbers(c)
    followed = state[_FOLLOWED : _FOLLOWED + RUN]
    free = state[_FOLLOWED + RUN : _FOLLOWED + 2 * RUN]
    memory = state[_FOLLOWED + 2 * RUN :]
    for n in range(len(measured)):
        flag = restart[n]
        bad = flag == Restart.BAD
        if flag == Restart.GAP:
            state[_SEEN] = 0.0
        seen = state[_SEEN]
        code = advance(m, seen, followed, free, memory, inputs, n, bad)
        ready = code != Validity.STARTING
        begun = seen > 0.0 if AT_ONCE else ready
        predicted[n] = shown(m, followed[OUTPUT]) if ready else nan
        if bad:
            code = Validity.BAD_INPUT
        else:
            code = follow(m, followed, memory, measured[n], inputs, n, code)
            if flag == Restart.NEW_CYCLE or not begun:
                for j in range(RUN):
                    free[j] = followed[j]
        validity[n] = code
        if not bad or seen > 0.0:
            state[_SEEN] = seen + 1.0
        simulated[n] = shown(m, free[OUTPUT]) if begun or (AT_ONCE and not bad) else nan


def predictor(
    advance: Compiled,
    follow: Compiled,
    *,
    run: int,
    numbers: Compiled = numbers,
    output: int = 0,
    shown: Compiled = shown,
    at_once: bool = False,
) -> Loop:
    """Return the compiled prediction loop of a valve, cached beside the file of its `advance`.

    Parameters
    ----------
    advance, follow, numbers, shown : callable
        The valve's own, compiled, as described under these names in this module.
    run, output : int
        Numbers of one run, and which of them is the output.
    at_once : bool
        Whether the free run begins with the first measured output, else with the prediction.
    """
    return bind(
        predict,
        advance,
        error_model="numpy",
        RUN=run,
        OUTPUT=output,
        AT_ONCE=at_once,
        numbers=numbers,
        advance=advance,
        follow=follow,
        shown=shown,
    )


def state_size(run: int, memory: int) -> int:
    """Return the length of the state of `predict`."""
    return _FOLLOWED + 2 * run + memory
