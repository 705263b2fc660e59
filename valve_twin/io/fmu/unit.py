# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An FMU for co-simulation (FMI 2.0, 3.0) that FMPy runs: file, variables, running instances.

An FMU is a program that runs with the rights of the user: only trusted files belong here.
"""

from __future__ import annotations

import os
import weakref
import zipfile
from collections import deque
from contextlib import contextmanager, suppress
from ctypes import byref
from dataclasses import dataclass
from functools import cache
from keyword import iskeyword
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

from valve_twin.core.quantity import suggest
from valve_twin.io.errors import ConfigError
from valve_twin.io.limits import TOO_MUCH, bounded_memory, too_large

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

KEY = "simulation.fmu"
_REAL = ("Real", "Float64")
_SAID: weakref.WeakValueDictionary[int, deque[str]] = weakref.WeakValueDictionary()
"""What each running instance of FMI 2.0 said last, by its environment."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A real variable: name, reference, unit, one line, role and value at the start [unit]."""

    name: str
    reference: int
    unit: str
    text: str
    causality: str
    tunable: bool
    start: float


class Unit:
    """An FMU, unpacked.

    Parameters
    ----------
    path : path
        File of the FMU.

    Raises
    ------
    ConfigError
        If it is missing, no FMU for co-simulation, or has no binary for this machine; one line.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            import fmpy
        except ModuleNotFoundError as err:
            msg = f"{KEY}.file = {path}: fmpy is missing: pip install valve_twin[fmu]"
            raise ConfigError(msg) from err
        if not Path(path).is_file():
            msg = f"{KEY}.file = {path}: there is no such file; write the path of an FMU"
            raise ConfigError(msg)
        self.path = str(path)
        try:
            with zipfile.ZipFile(self.path) as packed:
                size = sum(one.file_size for one in packed.infolist())
            problem = too_large(size, Path(path).stat().st_size)
            if not problem:
                with bounded_memory():
                    told = fmpy.read_model_description(self.path, validate=False)
        except MemoryError as err:
            raise self._refused(TOO_MUCH) from err
        except Exception as err:
            why = " ".join(str(err).split()) or type(err).__name__
            why = f"is no FMU that can be read ({why})"
            raise self._refused(why) from err
        if problem:
            raise self._refused(problem)
        self._version = told.fmiVersion.partition(".")[0]
        if self._version not in {"2", "3"}:
            why = f"is of FMI {told.fmiVersion}; give one of FMI 2.0 or 3.0"
            raise self._refused(why)
        if told.coSimulation is None:
            why = "is for model exchange only; export it for co-simulation"
            raise self._refused(why)
        self._name, self._guid = told.coSimulation.modelIdentifier or "", told.guid
        if self._name in {"", ".", ".."} or set(self._name) & set("/\\"):
            why = f"its modelIdentifier '{self._name}' names no file of its own"
            raise self._refused(why)
        self._variables = {
            v.name: Variable(
                v.name,
                v.valueReference,
                v.unit or "1",
                " ".join((v.description or v.name).split()),
                v.causality or "local",
                v.variability == "tunable",
                self._start(v.name, v.start),
            )
            for v in told.modelVariables
            if v.type in _REAL and not v.dimensions
        }
        self._types = {v.name: v.type for v in told.modelVariables}
        self._folder = mkdtemp(prefix="valve_twin_fmu_")
        weakref.finalize(self, rmtree, self._folder, ignore_errors=True)
        try:
            fmpy.extract(self.path, self._folder)
        except Exception as err:
            why = " ".join(str(err).split()) or type(err).__name__
            why = f"cannot be unpacked to {self._folder} ({why})"
            raise self._refused(why) from err
        self._check_platform(fmpy.platform, fmpy.platform_tuple, fmpy.sharedLibraryExtension)

    def _start(self, name: str, text: str | None) -> float:
        try:
            return float(text or 0.0)
        except ValueError as err:
            why = f"its variable {name} starts at '{text}', which is no number"
            raise self._refused(why) from err

    def _refused(self, why: str) -> ConfigError:
        return ConfigError(f"{KEY}.file = {self.path}: {why}")

    def _check_platform(self, plain: str, full: str, ending: str) -> None:
        wanted = plain if self._version == "2" else full
        binaries = Path(self._folder, "binaries")
        if not (binaries / wanted / f"{self._name}{ending}").is_file():
            has = sorted(p.name for p in binaries.iterdir()) if binaries.is_dir() else []
            there = ", ".join(has) or "none"
            why = f"has no binary for {wanted}, it has those of: {there}; export it for {wanted}"
            raise self._refused(why)

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """Its real parameters with a plain name, such as the plant of a simulation can have."""
        return tuple(
            v
            for v in self._variables.values()
            if v.causality == "parameter"
            and v.name.isidentifier()
            and not (v.name.startswith("_") or iskeyword(v.name))
        )

    def find(self, key: str, name: str, *, given: bool) -> Variable:
        """Return a variable by its name.

        Parameters
        ----------
        key : str
            Key of the configuration that names it.
        name : str
            Its name.
        given : bool
            Whether the valve gives its value: it then has to be an input.

        Raises
        ------
        ConfigError
            If there is none, or it is of another type or role.
        """
        where = f"{KEY}.{key} = {name}"
        fitting = [n for n, v in self._variables.items() if (v.causality == "input") == given]
        found = self._variables.get(name)
        kind = "input" if given else "output"
        if found is not None and (found.causality == "input") == given:
            return found
        if found is not None:
            why = f"is of causality {found.causality}, no {kind}; {suggest(name, fitting)}"
        elif name in self._types:
            why = f"is of type {self._types[name]}, or an array; one real number is needed"
        else:
            why = f"{self.path} has no such variable; {suggest(name, fitting)}"
        msg = f"{where}: {why}"
        raise ConfigError(msg)

    def start(self, values: Mapping[Variable, float]) -> Instance:
        """Return a new instance, initialized at time 0 with these parameters [unit of each].

        Raises
        ------
        ConfigError
            If it refuses them or does not start; one line.
        """
        return Instance(self, self._version, self._arguments(), values)

    def _arguments(self) -> dict[str, str]:
        return {
            "guid": self._guid,
            "modelIdentifier": self._name,
            "unzipDirectory": self._folder,
            "instanceName": "simulated_valve",
        }


class Instance:
    """A running FMU; it ends with the last reference to it.

    Parameters
    ----------
    unit : Unit
        The FMU.
    version : str
        "2" or "3".
    arguments : mapping
        What FMPy needs to load it.
    values : mapping
        Parameters before the initialization [unit of each].
    """

    def __init__(
        self,
        unit: Unit,
        version: str,
        arguments: Mapping[str, str],
        values: Mapping[Variable, float],
    ) -> None:
        self.unit = unit
        self.failure = ""
        self._said: deque[str] = deque(maxlen=1)
        make = _instance_2 if version == "2" else _instance_3
        try:
            with _here():
                self._slave = make(arguments, self._said)
        except Exception as err:
            msg = f"{KEY}.file = {unit.path}: does not start: {self._why(err)}"
            raise ConfigError(msg) from err
        self._three = version == "3"
        weakref.finalize(self, _end, self._slave)
        try:
            for variable, value in values.items():
                self._put([variable.reference], [value])
            if not self._three:
                self._slave.setupExperiment(startTime=0.0)
            self._slave.enterInitializationMode()
            self._slave.exitInitializationMode()
        except Exception as err:
            msg = f"{KEY}.file = {unit.path}: does not initialize: {self._why(err)}"
            raise ConfigError(msg) from err

    def set(self, references: Sequence[int], values: Sequence[float], time_s: float) -> None:
        """Set variables by their references; a refusal is the failure.

        Parameters
        ----------
        references : sequence of int
            Value references.
        values : sequence of float
            Values [unit of each].
        time_s : float
            Present time, to be told [s].
        """
        try:
            self._put(references, values)
        except Exception as err:
            self._fail(time_s, err)

    def get(self, reference: int, time_s: float) -> float:
        """Return a variable [its unit]; one that is not finite is the failure."""
        try:
            read = self._slave.getFloat64 if self._three else self._slave.getReal
            value = float(read([reference])[0])
        except Exception as err:
            self._fail(time_s, err)
            return float("nan")
        if not -float("inf") < value < float("inf"):
            self._note(f"its output is {value} at {time_s:.6g} s")
        return value

    def step(self, time_s: float, step_s: float) -> None:
        """Advance by a step [s]; an error, or that it asks to end, is the failure."""
        try:
            answer = self._slave.doStep(time_s, step_s)
        except Exception as err:
            self._fail(time_s, err)
            return
        if self._three and answer is not None and bool(answer[1]):
            self._note(f"asks to end the simulation at {time_s + step_s:.6g} s")

    def _put(self, references: Sequence[int], values: Sequence[float]) -> None:
        write = self._slave.setFloat64 if self._three else self._slave.setReal
        write(list(references), list(values))

    def _fail(self, time_s: float, err: Exception) -> None:
        self._note(f"fails at {time_s:.6g} s: {self._why(err)}")

    def _note(self, text: str) -> None:
        self.failure = self.failure or f"{self.unit.path} {text}"

    def _why(self, err: Exception) -> str:
        """Return what the FMU has said last and what FMPy says, in one line."""
        said = f"{self._said[-1]} ({err})" if self._said else f"{err}"
        return " ".join(said.split())


@contextmanager
def _here() -> Iterator[None]:
    """Stay in the working directory: FMPy stays in the FMU's where its binary cannot be loaded."""
    before = os.getcwd()
    try:
        yield
    finally:
        os.chdir(before)


def _instance_2(arguments: Mapping[str, str], said: deque[str]) -> Any:  # noqa: ANN401  FMPy has no types
    from fmpy import fmi2

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = _spoken_2().logger
    callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
    callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
    callbacks.componentEnvironment = id(said)
    _SAID[id(said)] = said
    slave = fmi2.FMU2Slave(**arguments)
    slave.instantiate(callbacks=callbacks)
    return slave


@cache
def _spoken_2() -> Any:  # noqa: ANN401  likewise
    """Return callbacks whose logger serves all FMUs of this process.

    FMPy's proxy, which puts the texts together, knows one logger: the last that it was given. Of
    one an instance, that of an ended instance was called for another one, and the process died.
    """
    from fmpy import fmi2
    from fmpy.logging import addLoggerProxy

    def log(environment: int | None, *given: Any) -> None:  # noqa: ANN401  likewise
        text = (given[-1] or b"").decode("utf-8", "replace")
        # whoever does not say for which instance it speaks may speak for any
        for said in [_SAID.get(environment)] if environment else list(_SAID.values()):
            if said is not None:
                said.append(text)

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(log)
    addLoggerProxy(byref(callbacks))
    return callbacks


def _instance_3(arguments: Mapping[str, str], said: deque[str]) -> Any:  # noqa: ANN401  FMPy has no types
    from fmpy.fmi3 import FMU3Slave

    def log(*given: Any) -> None:  # noqa: ANN401  likewise
        said.append((given[-1] or b"").decode("utf-8", "replace"))

    slave = FMU3Slave(**arguments)
    slave.instantiate(logMessage=log)
    return slave


def _end(slave: Any) -> None:  # noqa: ANN401  likewise
    with suppress(Exception):
        slave.terminate()
    with suppress(Exception):
        slave.freeInstance()
