# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Enamelled round copper wires of EN IEC 60317-0-1: nominal and largest overall diameters."""

from __future__ import annotations

from dataclasses import dataclass

_MM = 1e-3

_OVERALL_MM = {
    # nominal conductor: largest overall diameter of grade 1 and grade 2
    0.100: (0.117, 0.125),
    0.112: (0.130, 0.139),
    0.125: (0.144, 0.154),
    0.140: (0.160, 0.171),
    0.160: (0.182, 0.194),
    0.180: (0.204, 0.217),
    0.200: (0.226, 0.239),
    0.224: (0.252, 0.266),
    0.250: (0.281, 0.297),
    0.280: (0.312, 0.329),
    0.315: (0.349, 0.367),
    0.355: (0.392, 0.411),
    0.400: (0.439, 0.459),
    0.450: (0.491, 0.513),
    0.500: (0.544, 0.566),
    0.560: (0.606, 0.630),
    0.630: (0.679, 0.704),
    0.710: (0.762, 0.789),
    0.800: (0.855, 0.884),
    0.900: (0.959, 0.989),
    1.000: (1.062, 1.094),
    1.120: (1.184, 1.217),
    1.250: (1.316, 1.349),
    1.400: (1.468, 1.502),
    1.600: (1.670, 1.706),
}


@dataclass(frozen=True, slots=True)
class Wire:
    """Diameters of a wire without and with its enamel [m]."""

    copper: float
    overall: float


def find_wire(copper: float, grade: int = 1) -> Wire:
    """Return the standard wire of a conductor diameter.

    Parameters
    ----------
    copper : float
        Nominal diameter of the conductor [m].
    grade : int
        Thickness of the enamel, 1 or 2 [1].

    Raises
    ------
    ValueError
        If the standard's series has no such wire; names its neighbours.
    """
    if grade not in {1, 2}:
        message = f"wire_grade = {grade!r}: must be 1 or 2"
        raise ValueError(message)
    for nominal, overall in _OVERALL_MM.items():
        if abs(copper - nominal * _MM) < 1e-9:
            return Wire(copper, overall[grade - 1] * _MM)
    sizes = list(_OVERALL_MM)
    if not sizes[0] * _MM <= copper <= sizes[-1] * _MM:
        message = (
            f"wire = {copper:g}: must be {sizes[0] * _MM:g} to {sizes[-1] * _MM:g} [m], the wires "
            "of EN IEC 60317-0-1; give wire_overall as well for any other"
        )
        raise ValueError(message)
    near = sorted(sorted(sizes, key=lambda d: abs(d * _MM - copper))[:2])
    message = (
        f"wire = {copper:g}: no nominal diameter of EN IEC 60317-0-1 from {sizes[0] * _MM:g} to "
        f"{sizes[-1] * _MM:g} [m]; the nearest are {near[0] * _MM:g} and {near[1] * _MM:g}, or "
        "give wire_overall as well"
    )
    raise ValueError(message)
