# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Every use of what rclpy, numba, asyncua and Python keep private or global, in one place.

Each function says why it is needed, what is known of it upstream and when it can go. Nothing heavy
is imported here: the first of them run before the slow imports of a node. Only what `kernels`
takes of numba stands there: a kernel is compiled anew with each change of a file behind it.
"""
