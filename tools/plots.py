#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Draw figures of docs/ (valves, papers, FMU) anew: tools/run python tools/plots.py [NAME ...]."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import fmpy
import numpy as np

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.physics.solenoid_map import coil_force as solenoid_force
from valve_twin.core.prediction import fit_percent
from valve_twin.core.simulation import AgingRule, simulate_cycles, to_frames
from valve_twin.core.types import Cycle
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.double_solenoid.step_response import step_response
from valve_twin.core.valves.hybrid_actuator.landing.strokes import (
    open_stroke,
    samples_of,
    soft_stroke,
)
from valve_twin.core.valves.hybrid_actuator.magnetics import KERNELS, coil_force, magnet_force
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation
from valve_twin.core.valves.servo_system.dynamics import IS, P1, P2, PLR, PLS, VP, XP, XV
from valve_twin.core.valves.servo_system.loops import FREQUENCIES_HZ, valve_loop
from valve_twin.core.valves.servo_system.plant import ServoSystemPlant
from valve_twin.core.valves.stepper_servo.plant import StepperServoPlant
from valve_twin.gateway.fmu.export import write_fmu
from valve_twin.gateway.fmu.valve import law_of, valve_of
from valve_twin.io.history.tables import cycle_record
from valve_twin.report.svg import Panel, drawing, thin
from valve_twin.validation import landing
from valve_twin.validation.bench_004 import track_square, velocity_sweep
from valve_twin.validation.layers_002 import FREQUENCIES, fit_layer
from valve_twin.validation.paper_002 import REFRESH_3, REFRESH_4, SEED
from valve_twin.validation.paper_003 import STEP_M
from valve_twin.validation.paper_003 import step_response as servo_step
from valve_twin.validation.paper_004 import WORKING_MM, bode
from valve_twin.validation.theory_002 import PERIOD_S

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.core.types import FloatArray

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
CYCLES = 40
TOP, ROW = 26.0, 230.0
STYLE = """<style>
svg { font: 11px sans-serif; fill: #1b2026; } path { fill: none; }
.tick, .label { fill: #545d68; } .end { text-anchor: end; } .mid { text-anchor: middle; }
.head { font-weight: 600; } .grid { stroke: #e4e7eb; } .axis { stroke: #8a929b; }
.dot { stroke: #545d68; stroke-width: 2.2; stroke-linecap: round; }
.fine { stroke: #545d68; stroke-width: 1.2; }
.truth { stroke: #c2500a; stroke-width: 1.5; }
.a { stroke: #0072b2; stroke-width: 1.6; } .b { stroke: #c2500a; stroke-width: 1.6; }
.c { stroke: #00664f; stroke-width: 1.6; }
.dash { stroke-dasharray: 5 3; } .ink-a { fill: #0072b2; } .ink-b { fill: #c2500a; }
.ink-c { fill: #00664f; }
</style>
<rect width="100%" height="100%" fill="#fff"/>"""


def main(names: Sequence[str]) -> None:
    """Draw the named figures, all without a name."""
    for name in names or FIGURES:
        panels = FIGURES[name]()
        path = IMAGES / f"{name}.svg"
        rows = 1 + round((max(p.top for p in panels) - TOP) / ROW)
        parts = [part for p in panels for part in p.parts]
        svg = str(drawing(960, ROW * rows, parts, name.replace("_", " ")))
        svg = svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
        path.write_text(svg.replace(">\n", f">\n{STYLE}\n", 1) + "\n", encoding="utf-8")
        print(f"{path} written")


def panel(
    column: int,
    x: tuple[float, float],
    y: tuple[float, float],
    labels: tuple[str, str],
    row: int = 0,
) -> Panel:
    """Return one of three pairs of axes in a row, drawn."""
    made = Panel(48.0 + 320.0 * column, TOP + ROW * row, 258.0, 160.0, x, y)
    made.axes(x_label=labels[0], y_label=labels[1], x_ticks=5)
    return made


def first_cycle(name: str, seed: int = 1) -> Cycle:
    """Return one simulated cycle of a new valve."""
    simulation = get_simulation(name)
    (block,) = simulate_cycles(simulation, 1, seed)
    return Cycle(1, simulation.period_s, to_frames(block))


def followed(name: str, aged: str, drift: float, wanted: Sequence[str]) -> list[FloatArray]:
    """Return estimates over cycles (CYCLES,) while a number of the plant drifts linearly."""
    simulation, model = get_simulation(name), get_model(name)
    rule = AgingRule(aged, "linear", drift / (CYCLES - 1), 2)
    simulation = replace(simulation, aging=(rule,))
    options, memory, found = complete_options(model, {}), Memory.empty(), []
    for number, block in enumerate(simulate_cycles(simulation, CYCLES, 1), 1):
        cycle = Cycle(number, simulation.period_s, to_frames(block))
        estimates, memory = estimate_cycle(model, options, cycle, memory)
        found += [e for e in estimates if e.used_by_trend]
    for trend in assess(found, (), AgingConfig(parameters=tuple(wanted)),
                        parameters=model.parameters).trends:  # fmt: skip
        print(
            f"{name} {trend.parameter}: {trend.drift_reference:+.1f} % "
            f"({trend.drift_reference_lower_95:+.1f} .. {trend.drift_reference_upper_95:+.1f})"
        )
    return [np.array([e.value(n) for e in found]) for n in wanted]


def draw_stepper() -> list[Panel]:
    """Return backlash between count and spool, dead band of the flow, and a thread that wears."""
    mm = 2.1
    cycle = first_cycle("stepper_servo")
    motor, flow = cycle.frames.inputs.T
    away = cycle.frames.position - motor
    play = panel(0, (0.0, mm), (-0.2, 0.2), ("counted motor position [mm]", "spool − motor [mm]"))
    play.dots(mm * motor, mm * away, "dot")
    for side in (-0.05, 0.05):
        play.level(side, "truth")
    band = panel(1, (0.0, mm), (-0.05, 1.15), ("spool position [mm]", "metered flow [1]"))
    band.dots(mm * cycle.frames.position, flow, "dot")
    for edge in (0.45, 1.70):
        band.mark(edge, "truth")
    (backlash,) = followed("stepper_servo", "backlash", 0.15, ["backlash"])
    return [play, band, course(mm * backlash, 0.1, 0.15, "backlash [mm]", (0.098, 0.118))]


def course(
    values: FloatArray, new: float, drift: float, label: str, y: tuple[float, float]
) -> Panel:
    """Return estimates over cycles beside the injected drift."""
    made = panel(2, (0.0, CYCLES + 1.0), y, ("cycle", label))
    number = np.arange(1.0, CYCLES + 1)
    made.dots(number, values, "dot")
    made.line(number, new * (1.0 + drift * (number - 1.0) / (CYCLES - 1)), "truth")
    return made


def draw_actuator() -> list[Panel]:
    """Return an opening, the kernels' forces over the gap, and a magnet that fades."""
    cycle = first_cycle("hybrid_actuator")
    ms = np.arange(len(cycle.frames)) * 0.1
    shown = ms <= 30.0
    stroke = panel(0, (0.0, 30.0), (-0.45, 1.25), ("time [ms]", "position, current / 50 A [1]"))
    for values, style in (
        (cycle.frames.inputs[:, 3], "b"),
        (cycle.frames.inputs[:, 2], "a"),
        (cycle.frames.position, "fine"),
    ):
        stroke.line(*thin(ms[shown], values[shown], 300), style)
    stroke.text(200, 45, "position", "label")
    stroke.text(200, 122, "opening coil", "ink-a")
    stroke.text(80, 178, "closing coil", "ink-b")
    gap = np.linspace(0.15, 4.0, 200)
    force = panel(1, (0.0, 4.0), (0.0, 1000.0), ("gap [mm]", "force of a coil at 20 and 60 A [N]"))
    for kernel, style in zip(KERNELS, "abc", strict=True):
        m = replace(HybridActuatorPlant(), kernel=kernel).magnetics()
        for current, dash in ((20.0, " dash"), (60.0, "")):
            newton = np.array([coil_force(m, current, 1e-3 * g) for g in gap])
            force.line(gap, np.where(newton < 1000.0, newton, np.nan), style + dash)
    magnet = np.array([magnet_force(m, 1e-3 * g) for g in gap])
    force.line(gap, magnet, "fine")
    for i, (text, style) in enumerate(
        (
            ("linear", "ink-a"),
            ("saturating", "ink-b"),
            ("saturating_fit", "ink-c"),
            ("magnet alone", ""),
        )
    ):
        force.text(505, 60 + 15 * i, text, style)
    magnet_course, _ = followed("hybrid_actuator", "magnet_force", -0.15,
                                ["magnet_force", "seating_speed_open"])  # fmt: skip
    return [stroke, force, course(magnet_course, 128.0, -0.15, "magnet force [N]", (105.0, 133.0))]


def draw_landing() -> list[Panel]:
    """Return an opening under the open sequence and the controller, and speeds at contact."""
    noise = np.random.default_rng(landing.GRID_SEED).normal(size=samples_of())
    _, loose = open_stroke(landing.VALVE, True)
    stroke, soft = soft_stroke(landing.VALVE, landing.DATA_SHEET, True, noise)
    ms, fine_ms = 0.05 * np.arange(len(soft)), 0.01 * np.arange(len(loose))
    place = panel(0, (0.0, 20.0), (-4.2, 4.2), ("time [ms]", "armature towards the seat [mm]"))
    place.line(*thin(fine_ms[fine_ms < 20.0], 1e3 * loose[fine_ms < 20.0], 300), "b")
    place.line(*thin(ms[ms < 20.0], 1e3 * soft[ms < 20.0, 0], 300), "a")
    place.text(205, 120, "controller", "ink-a")
    place.text(205, 135, "open sequence", "ink-b")
    currents = panel(1, (0.0, 20.0), (-30.0, 50.0), ("time [ms]", "currents, controller [A]"))
    for column, style in ((3, "b"), (2, "a")):
        currents.line(*thin(ms[ms < 20.0], soft[ms < 20.0, column], 400), style)
    currents.text(520, 60, "coil that catches", "ink-a")
    currents.text(520, 75, "coil that lets go", "ink-b")
    print(f"landing: {stroke}")
    speeds = panel(2, (-0.5, 26.5), (0.0, 1.2), ("valve of the grid", "speed at contact [m/s]"))
    for opens, style in ((True, "dot"), (False, "fine")):
        for values in landing.strokes_of(landing.grid(), opens):
            found = np.array([s.speed for s in values])
            if style == "dot":
                speeds.dots(np.arange(27.0), found, style)
            else:
                speeds.line(np.arange(27.0), found, style)
    speeds.level(landing.GOAL, "truth")
    return [place, currents, speeds]


def draw_double_solenoid() -> list[Panel]:
    """Return steps by both controllers, the force map, and friction that grows."""
    plant = DoubleSolenoidPlant()
    steps = panel(0, (0.0, 15.0), (-0.1, 1.3), ("time [ms]", "position over the step [1]"))
    for share, dash in ((0.05, " dash"), (0.98, "")):
        for control, style in (("pid", "b"), ("trajectory_set", "a")):
            of = step_response(replace(plant, control=control), share)
            steps.line(1e3 * of.time_s[:151], of.position[:151], style + dash)
    steps.text(170, 120, "trajectory set control", "ink-a")
    steps.text(170, 135, "nonlinear PID", "ink-b")
    steps.text(170, 150, "98 %, dashed 5 %", "label")
    labels = ("position [mm]", "force of coil A [N]")
    force = panel(1, (-0.9, 0.9), (0.0, 45.0), labels)
    x, m = np.linspace(-0.9e-3, 0.9e-3, 181), plant.tables()
    for current, style in ((1.0, "a"), (1.8, "b"), (2.6, "c")):
        newton = np.array([solenoid_force(m, current, place) for place in x])
        force.line(1e3 * x, newton, style)
    for i, (text, style) in enumerate((("2.6 A", "ink-c"), ("1.8 A", "ink-b"), ("1 A", "ink-a"))):
        force.text(385, 60 + 15 * i, text, style)
    (friction,) = followed("double_solenoid", "friction", 0.15, ["friction"])
    return [steps, force, course(friction, 6.0, 0.15, "friction [N]", (5.8, 7.1))]


def draw_servo_loops() -> list[Panel]:
    """Return valve position over current at the paper's three frequencies, with minor loops."""
    plant, panels = ServoSystemPlant(), []
    for column, frequency in enumerate(FREQUENCIES_HZ):
        labels = (f"current at {frequency:g} Hz [mA]", "valve position [µm]")
        made = panel(column, (-65.0, 65.0), (-280.0, 280.0), labels)
        for amplitude, mean, style in ((0.06, 0.0, "a"), (0.03, 0.0, "c"), (0.01, 0.03, "b")):
            loop = valve_loop(plant, frequency, amplitude, mean=mean)
            made.line(*thin(1e3 * loop.current, 1e6 * loop.position, 400), style)
        panels.append(made)
    panels[0].text(60, 50, "60 mA", "ink-a")
    panels[0].text(60, 65, "30 mA", "ink-c")
    panels[0].text(60, 80, "10 mA about 30 mA", "ink-b")
    return panels


def draw_servo() -> list[Panel]:
    """Return the moves of a cycle, its pressures, and orifices that erode."""
    plant, cycle = ServoSystemPlant(), first_cycle("servo_system")
    frames, model = cycle.frames, get_model("servo_system")
    second = np.arange(len(frames)) * cycle.period_s
    move = panel(0, (0.0, 4.0), (0.0, 1.0), ("time [s]", "desired and piston position [1]"))
    move.line(second, frames.inputs[:, 0], "truth")
    move.line(*thin(second, frames.position, 500), "a")
    pressure = panel(1, (0.0, 0.8), (0.0, 22.0), ("time [s]", "pressure [MPa]"))
    shown = second <= 0.8
    scale = 1e-6 * plant.pressure_scale
    for signal, style, text, y in (
        ("supply_line_pressure", "fine", "supply line", 55),
        ("pressure_1", "a", "chamber 1", 68),
        ("pressure_2", "b", "chamber 2", 81),
    ):
        values = scale * frames.inputs[shown, model.inputs.index(signal)]
        pressure.line(*thin(second[shown], values, 400), style)
        pressure.text(560, y, text, f"ink-{style}" if len(style) == 1 else "label")
    back = 1e-6 * plant.return_scale * frames.inputs[:, model.inputs.index("return_line_pressure")]
    pressure.line(*thin(second[shown], back[shown], 400), "c")
    pressure.text(560, 94, "return line", "ink-c")
    (discharge,) = followed("servo_system", "discharge", 0.15, ["discharge"])
    return [move, pressure, course(discharge, 0.62, 0.15, "discharge C_d [1]", (0.61, 0.72))]


def draw_paper_002_spectrum() -> list[Panel]:
    """Return the mean spectrum of the residuals of the QP in both layers of paper 002."""
    labels = ("frequency [Hz]", "share of the power in a band [1]")
    made = panel(0, (0.0, 0.5 / PERIOD_S), (0.0, 0.16), labels)
    for line, (layer, style) in enumerate(((REFRESH_3, "a"), (REFRESH_4, "b"))):
        spectrum = fit_layer(layer, 105, SEED, lambda: None).spectrum
        hz = (np.arange(FREQUENCIES) + 0.5) / (2.0 * FREQUENCIES * PERIOD_S)
        made.line(hz, spectrum, style)
        made.text(60, 45 + 15 * line, layer.name, f"ink-{style}")
    made.mark(1.0 / 0.09, "truth dash")
    made.text(60, 75, "dashed: a period of 0.09 s", "label")
    return [made]


def draw_paper_003_step() -> list[Panel]:
    """Return figures 8 to 18 of paper 003 for our servosystem and a step of 10 mm."""
    step = servo_step(ServoSystemPlant(), STEP_M)
    y, ms = step.states, 1e3 * step.time_s
    shown: tuple[tuple[str, tuple[float, float], tuple[tuple[FloatArray, str, str], ...]], ...] = (
        ("Fig. 8: current [mA]", (-10, 60), ((1e3 * y[:, IS], "a", ""),)),
        ("Fig. 9: valve position [µm]", (-40, 250), ((1e6 * y[:, XV], "a", ""),)),
        ("Figs. 10, 12: position [mm]", (-1, 12),
         ((1e3 * y[:, XP], "a", "piston"), (1e3 * step.load, "b dash", "load"))),
        ("Figs. 11, 13: speed [m/s]", (-0.08, 0.25),
         ((step.load_speed, "b", "load"), (y[:, VP], "a", "piston"))),
        ("Fig. 14: force in the member [N]", (-600, 600), ((step.force, "a", ""),)),
        ("Figs. 15, 16: chambers [MPa]", (0, 6),
         ((1e-6 * y[:, P1], "a", "chamber 1"), (1e-6 * y[:, P2], "b", "chamber 2"))),
        ("Fig. 17: supply line [MPa]", (19, 23), ((1e-6 * y[:, PLS], "a", ""),)),
        ("Fig. 18: return line [MPa]", (0, 1), ((1e-6 * y[:, PLR], "a", ""),)),
    )  # fmt: skip
    panels = []
    for place, (label, limits, curves) in enumerate(shown):
        made = panel(place % 3, (0.0, 300.0), limits, ("time [ms]", label), place // 3)
        for line, (values, style, name) in enumerate(curves):
            keep = ms <= 300.0
            made.line(ms[keep], values[keep], style)
            made.text(
                made.left + 190,
                made.top + (40 if "speed" in label else 110) + 15 * line,
                name,
                f"ink-{style[0]}",
            )
        panels.append(made)
    return panels


def draw_paper_004_tracking() -> list[Panel]:
    """Return velocity sweep, steps over the working range and magnitude of G(z), paper 004."""
    plant = StepperServoPlant()
    time_s, spool, speed = velocity_sweep(plant)
    sweep = panel(0, (0.0, 280.0), (0.8, 1.6), ("time [ms]", "Fig. 10: position [mm]"))
    sweep.line(1e3 * time_s, spool, "a")
    fast = panel(
        1, (0.0, 280.0), (-12.0, 12.0), ("time [ms]", "Fig. 10: speed of the motor [mm/s]")
    )
    fast.line(1e3 * time_s, speed, "c")
    gain = panel(2, (-1.0, 1.7), (-30.0, 40.0),
                 ("log10 of frequency [Hz]", "Fig. 8: printed G(z) [dB]"))  # fmt: skip
    log_hz = np.linspace(-1.0, np.log10(50.0), 200)
    gain.line(log_hz, bode(10.0**log_hz), "a")
    panels = [sweep, fast, gain]
    for column, frequency in enumerate((1.0, 3.0)):
        reference, spool = track_square(plant, frequency, WORKING_MM)
        made = panel(column, (0.0, 1.2), (0.0, 2.1),
                     ("time [s]", f"Fig. 11: steps at {frequency:g} Hz [mm]"), 1)  # fmt: skip
        shown = np.arange(2000, 3200)
        second = 1e-3 * (shown - 2000.0)
        made.line(second, reference[shown], "c")
        made.line(second, spool[shown], "a")
        panels.append(made)
    return panels


def draw_fmu() -> list[Panel]:
    """Return an FMU's free run over the next cycle: whole, near a step, and what is off."""
    simulation, model = get_simulation("first_order"), get_model("first_order")
    first, second = (
        Cycle(n, simulation.period_s, to_frames(block))
        for n, block in enumerate(simulate_cycles(simulation, 2, 3), 1)
    )
    (estimate,) = model.estimate(first, complete_options(model, {}))
    lag, frames = max(estimate.lag, 1), second.frames
    start = frames.position[lag - 1]
    law, core = law_of("first_order").law, np.full(len(frames), start)
    values, x = np.array([p.value for p in estimate.parameters]), np.array([start])
    for n in range(lag, len(frames)):
        law.step(x, frames.inputs[n - lag], values, second.period_s)
        core[n] = x[0]
    with TemporaryDirectory() as folder:
        path = Path(folder, "valve.fmu")
        write_fmu(valve_of("", "/valve", estimate, cycle_record(first)), path, 3)
        time_s = second.period_s * np.arange(len(frames))
        given = np.zeros(len(frames), dtype=[("time", float), ("command", float)])
        given["time"], given["command"] = time_s, frames.inputs[:, 0]
        fmu = fmpy.simulate_fmu(
            str(path),
            input=given,
            start_values={"position_start": start},
            output=["position"],
            stop_time=time_s[-1],
            step_size=second.period_s,
            output_interval=second.period_s,
        )["position"]
    print(f"fmu: fit {fit_percent(frames.position, fmu):.2f} %, off {np.abs(fmu - core).max():g}")
    whole = panel(0, (0.0, 20.0), (0.0, 0.9), ("time [s]", "position [1]"))
    whole.line(time_s, frames.inputs[:, 0], "fine")
    whole.dots(time_s, frames.position, "dot")
    whole.line(time_s, fmu, "truth")
    near = panel(1, (4.8, 7.0), (0.0, 0.9), ("time [s]", "core (dots), FMU (line) [1]"))
    part = (time_s >= 4.8) & (time_s <= 7.0)
    near.dots(time_s[part], core[part], "dot")
    near.line(time_s[part], fmu[part], "truth")
    off = panel(2, (0.0, 20.0), (-6e-3, 6e-3), ("time [s]", "measured − FMU [1]"))
    off.dots(time_s, frames.position - fmu, "dot")
    return [whole, near, off]


FIGURES: dict[str, Callable[[], list[Panel]]] = {
    "stepper_servo": draw_stepper,
    "hybrid_actuator": draw_actuator,
    "hybrid_actuator_landing": draw_landing,
    "double_solenoid": draw_double_solenoid,
    "servo_system": draw_servo,
    "servo_system_loops": draw_servo_loops,
    "paper_002_spectrum": draw_paper_002_spectrum,
    "paper_003_step": draw_paper_003_step,
    "paper_004_tracking": draw_paper_004_tracking,
    "fmu": draw_fmu,
}

if __name__ == "__main__":
    main(sys.argv[1:])
