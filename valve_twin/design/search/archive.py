# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""All evaluated designs in a file: one JSON line each, the first says of which problem.

A run that was interrupted goes on from it, and no design is computed twice.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from valve_twin import __version__
from valve_twin.core.quantity import describe, example
from valve_twin.design.chain import FIDELITIES
from valve_twin.design.search.tasks import Outcome

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from valve_twin.design.geometry import DoubleStroke
    from valve_twin.design.search.tasks import DesignTask, Run

_FORM = 5
_NO_DESIGN = "no evaluated design: remove the line, and it is computed again"


class Archive:
    """Outcomes by key and fidelity.

    Parameters
    ----------
    path : Path
        The file; made where it is missing.
    problem : mapping
        What the designs have in common, as JSON holds it: what it differs in makes other figures.

    Raises
    ------
    ValueError
        If the file is no archive, or one of another problem; says what differs.
    """

    def __init__(self, path: Path, problem: Mapping[str, object]) -> None:
        self._path = path
        self._found: dict[tuple[str, str], Outcome] = {}
        header = {"form": _FORM, "problem": json.loads(json.dumps(problem))}
        try:
            data = path.read_bytes() if path.exists() else b""
            whole = data[: data.rfind(b"\n") + 1]
            lines = whole.decode("utf-8").split("\n")[:-1]
        except (OSError, UnicodeDecodeError) as err:
            message = f"{path}: cannot be read ({' '.join(str(err).split())})"
            raise ValueError(message) from err
        if not lines:
            if not f"{json.dumps(header)}\n".encode().startswith(data):
                _parsed(path, 1, "")  # somebody else's file: it stays as it is
            path.write_bytes(b"")
            self._append(header)
            return
        _check(path, _parsed(path, 1, lines[0]), header)
        if len(whole) < len(data):  # the last line was being written when a run was killed
            with path.open("r+b") as file:
                file.truncate(len(whole))
        for number, line in enumerate(lines[1:], start=2):
            outcome = _outcome(path, number, line)
            self._found[outcome.key, outcome.fidelity] = outcome

    def __iter__(self) -> Iterator[Outcome]:
        """Go through all outcomes in the order in which they were found."""
        return iter(tuple(self._found.values()))

    def get(self, key: str, fidelity: str) -> Outcome | None:
        """Return what is known of a design.

        Parameters
        ----------
        key, fidelity : str
            Of its task.
        """
        return self._found.get((key, fidelity))

    def evaluate(self, tasks: Sequence[DesignTask], run: Run) -> Iterator[Outcome]:
        """Evaluate what is not known yet; yield each new outcome once it is kept.

        Parameters
        ----------
        tasks : sequence of DesignTask
            The same design may stand among them more than once.
        run : callable
            Evaluates tasks anywhere, in any order.
        """
        left = {(t.key, t.fidelity): t for t in tasks if (t.key, t.fidelity) not in self._found}
        for outcome in run(tuple(left.values())) if left else ():
            self._found[outcome.key, outcome.fidelity] = outcome
            self._append(asdict(outcome))
            yield outcome

    def outcomes(
        self, tasks: Sequence[DesignTask], run: Run, advance: Callable[[], None] = lambda: None
    ) -> list[Outcome]:
        """Return the outcome of every task, evaluated now where it is not known.

        Parameters
        ----------
        tasks : sequence of DesignTask
            The same design may stand among them more than once.
        run : callable
            Evaluates tasks anywhere, in any order.
        advance : callable
            Called once a design.

        Raises
        ------
        ValueError
            If `run` returns no outcome for a task.
        """
        for task in tasks:
            if (task.key, task.fidelity) in self._found:
                advance()
        for _ in self.evaluate(tasks, run):
            advance()
        lacking = [t.key for t in tasks if (t.key, t.fidelity) not in self._found]
        if lacking:
            message = f"no outcome came back of the design {lacking[0]}"
            raise ValueError(message)
        return [self._found[t.key, t.fidelity] for t in tasks]

    def _append(self, values: Mapping[str, object]) -> None:
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(_plain(values), allow_nan=False) + "\n")


def header_of(start: DoubleStroke, valve: str) -> dict[str, object]:
    """Return what designs have to have in common to stand in one archive.

    Parameters
    ----------
    start : DoubleStroke
        What they are changes of.
    valve : str
        Model of the valve, empty = the first that takes a design.
    """
    numbers = {d.name: example(d.default) for d in describe(start)}
    fidelities = {name: asdict(of) for name, of in FIDELITIES.items()}
    return {"valve": valve, "fidelities": fidelities, "version": __version__, **numbers}


def _plain(value: object) -> object:
    """Return a value as JSON holds it; what is not finite becomes a text."""
    if isinstance(value, dict):
        return {key: _plain(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _mapping(value: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        message = f"{value!r} is no mapping"
        raise TypeError(message)
    return value


def _parsed(path: Path, number: int, line: str) -> dict[str, object]:
    try:
        return _mapping(json.loads(line))
    except (TypeError, ValueError, RecursionError) as err:
        what = "no archive of valve-twin design" if number == 1 else _NO_DESIGN
        message = f"{path}, line {number}: is {what}"
        raise ValueError(message) from err


def _check(path: Path, found: Mapping[str, object], wanted: Mapping[str, object]) -> None:
    if found.get("form") != wanted["form"] or not isinstance(found.get("problem"), dict):
        message = f"{path}: is no archive of valve-twin design of form {_FORM}"
        raise ValueError(message)
    there, here = _dotted(found["problem"]), _dotted(wanted["problem"])
    for name in {**here, **there}:
        if there.get(name) != here.get(name):
            message = (
                f"{path}: is the archive of another problem: {name} is "
                f"{_short(there.get(name))} there and {_short(here.get(name))} here; name another "
                "file"
            )
            raise ValueError(message)


def _dotted(value: object, name: str = "") -> dict[str, object]:
    """Return what a mapping of mappings holds by its dotted name."""
    if not isinstance(value, dict):
        return {name: value}
    parts = (_dotted(of, f"{name}.{key}" if name else str(key)) for key, of in value.items())
    return {key: of for part in parts for key, of in part.items()}


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def _outcome(path: Path, number: int, line: str) -> Outcome:
    held = _parsed(path, number, line)
    try:
        figures, curves = _mapping(held["figures"]), _mapping(held["curves"])
        values = _mapping(held["values"])
        return Outcome(
            key=str(held["key"]),
            fidelity=str(held["fidelity"]),
            values={k: float(v) for k, v in values.items()},
            figures={k: float(v) for k, v in figures.items()},
            curves={k: tuple(float(x) for x in v) for k, v in curves.items()},
            error=str(held["error"]),
            broken=float(str(held["broken"])),
            cpu_s=float(str(held["cpu_s"])),
        )
    except (KeyError, TypeError, ValueError) as err:
        message = f"{path}, line {number}: is {_NO_DESIGN}"
        raise ValueError(message) from err
