# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valves of a plant as devices of OPC UA (DI), read only; needs the extra `gateway`."""
