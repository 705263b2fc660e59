# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valves of a plant by MQTT: Sparkplug B, or plain JSON."""
