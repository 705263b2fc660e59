# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Units as instruments write them, and what a channel measures by its unit and its name."""

from __future__ import annotations

import re
from dataclasses import dataclass

from valve_twin.core.survey.choose import ANSWERS
from valve_twin.core.valves.registry import DEFAULT_MODEL, get_model

PRESSURE, FLOW = ANSWERS[1:3]
_TABLE = {
    "time": "s 1 sec 1 sek 1 seconds 1 ms 1e-3 msec 1e-3 us 1e-6 µs 1e-6 ns 1e-9 min 60 h 3600",
    "length": "m 1 mm 1e-3 cm 1e-2 um 1e-6 µm 1e-6 in 0.0254 inch 0.0254",
    "share": "% 0.01 pct 0.01 percent 0.01 prozent 0.01",
    PRESSURE: "pa 1 kpa 1e3 hpa 1e2 mpa 1e6 bar 1e5 mbar 1e2 barg 1e5 bara 1e5 psi 6894.757 "
    "psig 6894.757",
    "current": "a 1 ma 1e-3 ka 1e3 µa 1e-6",
    "voltage": "v 1 mv 1e-3 kv 1e3",
    FLOW: "m3/s 1 m³/s 1 m3/h 2.777777777777778e-4 m³/h 2.777777777777778e-4 "
    "l/s 1e-3 l/min 1.6666666666666667e-5 lpm 1.6666666666666667e-5 l/h 2.7777777777777776e-7 "
    "ml/min 1.6666666666666667e-8 gpm 6.30902e-5",
    "mass flow": "kg/s 1 kg/h 2.777777777777778e-4 t/h 0.2777777777777778 "
    "t_per_h 0.2777777777777778",
    "temperature": "k 1 °c 1 degc 1 c 1 °f 1 degf 1",
    "angle": "rad 1 deg 0.017453292519943295 ° 0.017453292519943295",
    "speed": "rpm 0.10471975511965977 1/min 0.10471975511965977 m/s 1 mm/s 1e-3 rad/s 1",
    "force": "n 1 kn 1e3 nm 1",
    "frequency": "hz 1 khz 1e3",
    "number": "- 1 1 1 raw 1 counts 1 count 1 digits 1 inc 1",
}
_ROLES = {
    "command": r"cv|co|mv|cmd|command|soll\w*|set|setpoint|set_point|sp|demand|duty|ref|"
    r"stell(?!ung|weg)\w*|stellung\w*(?:soll|regler)\w*|reference|u|input|opening|request|out_?put_signal|drive|target|"
    + "|".join(get_model(DEFAULT_MODEL).inputs),
    "position": r"pos|position|travel|stroke|hub|weg|lvdt|spool|stem|rod|x|ist\w*|lift|y|"
    r"valve_pos|opening_fb|feedback|fb|rueck\w*|rück\w*|zt|stellweg|"
    r"(?:ventil|klappen|schieber|kolben|spindel)?(?:stellung(?!\w*(?:soll|regler))\w*|hub|weg|position)",
    PRESSURE: r"p\d?|press|pressure|druck|pt\d*",
    FLOW: r"q|flow|durchfluss|volumenstrom|fs\d|ft\d*|f",
    "current": r"i|current|strom|amp",
    "voltage": r"volt|voltage|spannung",
    "temperature": r"t|temp|temperature|temperatur|tt\d*",
    "time": r"t|time|zeit|timestamp|date|datum|datetime|uhrzeit|clock|elapsed|"
    r"sekunden|stamp|x_value",
    "count": r"index|idx|nr|no|number|count|counter|cycle|zyklus|sample|row",
}
_WORD = {role: re.compile(rf"(?:{text})", re.IGNORECASE) for role, text in _ROLES.items()}
_BY_QUANTITY = {
    "length": "position",
    PRESSURE: PRESSURE,
    "current": "current",
    "voltage": "voltage",
    FLOW: FLOW,
    "mass flow": FLOW,
    "temperature": "temperature",
    "time": "time",
}
"""What a channel of a quantity is by itself; a command is told by its name only."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: what it measures, and what 1 of it is in SI."""

    quantity: str
    size: float


def _units() -> dict[str, Unit]:
    found = {}
    for quantity, text in _TABLE.items():
        words = text.split()
        for symbol, size in zip(words[::2], words[1::2], strict=True):
            found[symbol] = Unit(quantity, float(size))
    return found


_UNITS = _units()
_BRACKETS = re.compile(r"^(.*?)\s*[\[(<{]\s*([^\[\](){}<>]*)\s*[\])>}]\s*$", re.DOTALL)
_DIVIDED = re.compile(r"^(.*\S)\s*/\s*(\S+)$", re.DOTALL)
_SPACED = re.compile(r"^(.*\S)[\s,]+in\s+(\S+)$", re.DOTALL | re.IGNORECASE)


def known_unit(symbol: str) -> Unit | None:
    """Return a unit by its symbol as instruments write it, None where it is none."""
    text = symbol.strip().strip("[]()").strip().lower().replace("μ", "µ").replace(" ", "")
    return _UNITS.get(text)


def split_name(name: str) -> tuple[str, str]:
    """Return name and unit of a header cell such as "p [bar]", "Weg/mm", "p1_kPa", "t(s)"."""
    text = " ".join(name.split())
    found = _BRACKETS.match(text)
    if found and found[1]:
        return found[1], found[2].strip()
    for pattern in (_DIVIDED, _SPACED):
        found = pattern.match(text)
        if found and known_unit(found[2]):
            return found[1], found[2]
    parts = text.split("_")
    for count in (3, 1):
        unit = "_".join(parts[-count:])
        if unit == "in" and len(parts[0]) == 1:  # v_in, p_in
            continue
        if len(parts) > count and known_unit(unit) and unit not in {"c", "C", "k", "1"}:
            return "_".join(parts[:-count]), unit
    return text, ""


def _said(words: list[str]) -> list[str]:
    return [role for role, word in _WORD.items() if any(word.fullmatch(w) for w in words)]


def roles_of(name: str, unit: str) -> tuple[str, ...]:
    """Return what a channel may be, the most likely first: its words, then its unit.

    A word says more than a symbol: the Y of "Stellwert Y" is no position.

    Parameters
    ----------
    name, unit : str
        As `split_name` gives them.
    """
    name = name.replace("ß", "ss")
    words = [w for w in re.split(r"[^A-Za-zÀ-ÿ0-9]+|(?<=[a-z])(?=[A-Z])", name) if w]
    words += [re.sub(r"^\d+|\d+$", "", w) for w in words] + [name]
    found = _said([w for w in words if len(w) > 1]) or _said(words)
    known = known_unit(unit)
    if known is None:
        return tuple(found)
    own = _BY_QUANTITY.get(known.quantity, "")
    if own in {PRESSURE, FLOW, "temperature", "time"}:  # the unit settles it
        return (*(["command"] if own in {PRESSURE, FLOW} and "command" in found else []), own)
    kept = [r for r in found if r in {"command", "position", "count", own}]
    return tuple(dict.fromkeys([*kept, *([own] if own else [])]))
