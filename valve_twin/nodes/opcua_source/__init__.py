# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tags of a PLC on topics: a client of OPC UA that only subscribes."""
