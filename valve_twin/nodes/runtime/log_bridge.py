# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Say on the node's log, and so on /rosout, what the reading of bags says on Python's."""

from __future__ import annotations

import logging
from typing import Any


class LogBridge(logging.Handler):
    """Hands warnings of this package on to a node's logger.

    Parameters
    ----------
    logger : rclpy logger
        Of the node.
    """

    def __init__(self, logger: Any) -> None:
        super().__init__(logging.WARNING)
        self._logger = logger
        logging.getLogger("valve_twin").addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Log one line."""
        self._logger.warning(record.getMessage())

    def close(self) -> None:
        """Hand nothing on any more."""
        logging.getLogger("valve_twin").removeHandler(self)
        super().close()
