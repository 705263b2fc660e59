# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The provenance that a report page carries: its input, configuration, versions and arguments.

It stands in the page as JSON in one `meta` element. Passwords and the address of the history are
left out of the configuration.
"""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

import valve_twin
from valve_twin.io.config.parameter_file import WRAPPER
from valve_twin.io.config.valve import parse_config
from valve_twin.io.errors import ValveTwinError
from valve_twin.io.limits import CONSTRUCTORS_MEET, load_yaml

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.io.config.valve import ValveConfig

META = "valve_twin.provenance"
"""Name of the element that holds it."""

BAG, HISTORY = "bag", "history"

_FORM = 1
_ALL = "/**"
_LIBRARIES = ("numpy", "scipy", "numba")
_TO_DO = "make the page again with valve-twin report"


@dataclass(frozen=True, slots=True)
class Part:
    """One signal of a bag or one kind of rows of a history.

    Attributes
    ----------
    count : int
        Samples or rows [1].
    sha256 : str
        Hash of their values, hexadecimal.
    """

    count: int
    sha256: str


@dataclass(frozen=True, slots=True)
class Origin:
    """What a page was made from.

    Attributes
    ----------
    kind : str
        "bag" or "history".
    where : str
        The bag as it was given, or the history's file or URL without a password.
    size : int
        Bytes of its files; 0 = no file [B].
    parts : mapping
        The signals by name, or the rows by kind.
    """

    kind: str
    where: str
    size: int
    parts: Mapping[str, Part]


@dataclass(frozen=True, slots=True)
class Provenance:
    """Everything that decides what a page says.

    Attributes
    ----------
    valve : str
        Name of the valve.
    origin : Origin
        What it was made from.
    configuration : str
        A parameter file with the keys that were given for that valve.
    label : str
        The argument `--label`.
    budget : bool
        Whether the error budget is on the page.
    versions : mapping
        Version of each program that computed it, by name.
    written_ns : int
        When it was written [ns since 1970].
    """

    valve: str
    origin: Origin
    configuration: str
    label: str
    budget: bool
    versions: Mapping[str, str]
    written_ns: int

    @property
    def text(self) -> str:
        """The JSON that stands in the page."""
        fields = {"form": _FORM, **asdict(self), "configuration_sha256": _hash(self.configuration)}
        return json.dumps(fields, sort_keys=True, allow_nan=False)

    def config(self, where: str) -> ValveConfig:
        """Return the configuration with which the page was made.

        Parameters
        ----------
        where : str
            The page, for messages.

        Raises
        ------
        ConfigError
            If this version cannot use it.
        """
        values = _values(self.configuration, where)
        return parse_config(values, f"{where}: its configuration", namespace=self.valve)[0]

    def keys(self, where: str) -> dict[str, object]:
        """Return what was configured by dotted name; parameters as of `config`."""
        return _values(self.configuration, where)


def configuration_text(config: ValveConfig) -> str:
    """Return the keys that were given for a valve as a parameter file."""
    tree = {_ALL: {WRAPPER: dict(config.given)}}
    return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, width=10**6)


def parse_provenance(text: str, where: str) -> Provenance:
    """Read what a page carries.

    Parameters
    ----------
    text : str
        JSON.
    where : str
        The page, for messages.

    Raises
    ------
    ValveTwinError
        If it is damaged or of a later version.
    """
    try:
        found = json.loads(text)
        form = found.pop("form")
        if form != _FORM:
            msg = (
                f"{where}: its provenance has form {form!r}, known is {_FORM}: verify it with the "
                "version of valve_twin that wrote it"
            )
            raise ValveTwinError(msg)
        sha256 = found.pop("configuration_sha256")
        origin = found.pop("origin")
        parts = {name: Part(**part) for name, part in origin.pop("parts").items()}
        made = Provenance(origin=Origin(parts=parts, **origin), **found)
        sound = _is_sound(made) and sha256 == _hash(made.configuration)
    except (ValueError, *CONSTRUCTORS_MEET):
        sound = False
    if not sound:
        msg = f"{where}: its provenance is damaged or was changed: {_TO_DO}"
        raise ValveTwinError(msg)
    return made


def versions() -> dict[str, str]:
    """Return the version of each program that computes a page, by name."""
    return {
        "valve_twin": valve_twin.__version__,
        "code of valve_twin": _code(),
        **{name: metadata.version(name) for name in _LIBRARIES},
        "python": platform.python_version(),
        "machine": platform.machine(),
    }


@cache
def _code() -> str:
    """Return a hash of the package's sources: between two releases the version says nothing."""
    folder = Path(valve_twin.__file__).parent
    total = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        total.update(str(path.relative_to(folder).as_posix()).encode())
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()[:16]


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()


def _is_sound(found: Provenance) -> bool:
    """Return whether all values have their types."""
    origin, parts = found.origin, found.origin.parts
    texts: list[object] = [found.valve, found.configuration, found.label, origin.where]
    texts += [*found.versions.values(), *(part.sha256 for part in parts.values())]
    numbers: list[object] = [found.written_ns, origin.size, *(p.count for p in parts.values())]
    flags: list[object] = [found.budget]
    return (
        origin.kind in {BAG, HISTORY}
        and all(isinstance(flag, bool) for flag in flags)
        and all(isinstance(text, str) for text in texts)
        and all(isinstance(n, int) and not isinstance(n, bool) and n >= 0 for n in numbers)
    )


def _values(text: str, where: str) -> dict[str, object]:
    try:
        return dict(load_yaml(text)[_ALL][WRAPPER])
    except (yaml.YAMLError, *CONSTRUCTORS_MEET):
        msg = f"{where}: the configuration in it cannot be read: {_TO_DO}"
        raise ValveTwinError(msg) from None
