# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Names of the press valve's model and of its estimators, for whoever runs none of them."""

NAME = "press_cartridge"
"""Name of the model."""

OUTPUT_ERROR = "output_error"
"""The free run, fitted to the measured position."""

KALMAN = "kalman"
"""The output error with residuals whitened by a Kalman filter."""

TERM_SETS: dict[str, tuple[int, ...]] = {
    "3": (1, 2, 3),
    "4": (1, 2, 3, 5),
    "5": (1, 2, 3, 4, 5),
    "8": (1, 2, 3, 4, 5, 6, 7, 8),
}
"""Terms by their number in the paper: eq. (25), (32), (29) and (18)."""

EQUATION_ERROR = {
    f"equation_error_{kind}{number}": (kind, terms)
    for kind in ("ls", "qp")
    for number, terms in TERM_SETS.items()
}
"""The equation error: every name `fit_equation_error` knows, such as equation_error_qp4; ls or qp
(constrained), and the terms."""
