# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from xml.etree import ElementTree

import numpy as np

from valve_twin.report.pictures.configure import draw_proposal


def test_the_picture_shows_every_channel_and_the_free_run_over_the_last():
    t = np.linspace(0.0, 10.0, 200)
    rows = [("command <%>", t, np.sign(np.sin(t))), ("stroke mm", t, np.sin(t))]
    picture = draw_proposal("a & b", rows, (t[100:], 5.0 * np.cos(t[100:])), "sample")
    root = ElementTree.fromstring(picture)
    words = [e.text for e in root.iter("{http://www.w3.org/2000/svg}text")]
    assert {"a & b", "command <%>", "stroke mm", "sample"} <= set(words)
    styles = [e.get("class") for e in root.iter("{http://www.w3.org/2000/svg}path")]
    assert styles.count("measured") == 2
    assert styles.count("fit") == 1
    assert "−5" in words  # the axis reaches as far as the free run
