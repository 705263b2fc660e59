# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""More is asked of a change where the cycles before strayed from their lines."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.lines import strayed

CONFIG = DetectionConfig()


@pytest.mark.parametrize(("spread", "least", "most"), [(1.0, 1.0, 1.25), (3.0, 2.2, 3.5)])
def test_it_is_the_root_mean_square_of_what_was_known_before(spread, least, most):
    ratio = spread * np.random.default_rng(5).standard_normal((200, 30))
    factor = strayed(ratio, CONFIG)
    assert np.all(factor[: CONFIG.recent] == 1.0)
    assert np.all((factor[150:] >= least) & (factor[150:] <= most))


def test_the_newest_cycles_which_are_judged_do_not_count():
    ratio = np.zeros((40, 1))
    ratio[30:] = 5.0
    factor = strayed(ratio, CONFIG)[:, 0]
    assert np.all(factor[: 30 + CONFIG.recent] == 1.0)
    assert factor[-1] > 1.0
