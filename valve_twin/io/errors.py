# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Errors of files and databases: one line that says what, where, which value and what to do.

ValveTwinError
  ConfigError   a configuration key or value cannot be used
  BagError      a bag or CSV file cannot be read or written
    IndexLiesError  a bag states wrong times: read once more, it is read another way
  StoreError    the history database cannot be used
  FmuError      a Functional Mock-up Unit cannot be made, read or run
"""

from __future__ import annotations


class ValveTwinError(Exception):
    """Base of all errors that a user can cause and repair."""


class ConfigError(ValveTwinError):
    """A configuration key or value cannot be used."""


class BagError(ValveTwinError):
    """A bag or CSV file cannot be read or written."""


class IndexLiesError(BagError):
    """A bag states wrong times; opened anew it is read by its data section."""


class StoreError(ValveTwinError):
    """The history database cannot be used."""


class FmuError(ValveTwinError):
    """A Functional Mock-up Unit cannot be made, read or run."""
