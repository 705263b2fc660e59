# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""FMUs of a stored valve, run by FMPy: the core's numbers, states, instances, refusals."""

import json
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit

from test.core.valves.hybrid_actuator import test_law as hybrid
from test.core.valves.press_cartridge import test_law as press
from test.core.valves.stepper_servo import test_law as stepper
from test.gateway.fmu.portable_executable import AMD64, read_image
from test.gateway.fmu.test_valve import made, record
from valve_twin.cli import main
from valve_twin.core.prediction import fit_percent
from valve_twin.core.types import ParameterStatus, ParameterValue
from valve_twin.core.valves.first_order import VALVE
from valve_twin.core.valves.hybrid_actuator.model import HybridActuatorModel
from valve_twin.core.valves.kit import Law, Valve, parameter
from valve_twin.gateway.fmu.export import write_fmu
from valve_twin.gateway.fmu.valve import valve_of
from valve_twin.io.config.valve import load_config
from valve_twin.io.history.store import History
from valve_twin.io.offline.run import run_bag
from valve_twin.io.offline.simulated_bag import write_simulated_bag

fmpy = pytest.importorskip("fmpy")
validate_fmu = pytest.importorskip("fmpy.validation").validate_fmu
pytest.importorskip("ziglang")
pytestmark = pytest.mark.timeout(900)  # the first use of the compiler builds its C libraries

ROOT = Path(__file__).resolve().parents[3]
CONFIG = ROOT / "config" / "first_order.yaml"
NAME = "/first_order"


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """Return a folder with a history of four simulated cycles, and what offline made of them."""
    folder = tmp_path_factory.mktemp("fmu")
    (config,) = load_config(CONFIG)
    write_simulated_bag(config, folder / "bag", cycles=4, seed=3)
    record = run_bag(config, folder / "bag")
    with History(folder / "history.sqlite") as history:
        for cycle in record.cycles:
            made = [e for e in record.estimates if e.cycle == cycle.cycle]
            history.store(NAME, cycle, made)
    return folder, record


@pytest.fixture(scope="module")
def fmus(known):
    """Return the FMUs of the cycle before the last by their version."""
    folder, record = known
    cycle = str(record.last.number - 1)
    arguments = ["--url", str(folder / "history.sqlite"), "--valve", NAME, "--cycle", cycle]
    out = folder / "valve.fmu"
    assert main(["export-fmu", *arguments, "--fmi", "both", "--out", str(out)]) == 0
    return {2: folder / "valve_fmi2.fmu", 3: folder / "valve_fmi3.fmu"}


both = pytest.mark.parametrize("version", [2, 3])


def trend_estimate(record, number):
    (found,) = (e for e in record.estimates if e.cycle == number and e.used_by_trend)
    return found


def simulated(path, position, command, period_s, **values):
    time_s = period_s * np.arange(len(command))
    columns = np.zeros(len(command), dtype=[("time", float), ("command", float)])
    columns["time"], columns["command"] = time_s, command
    result = fmpy.simulate_fmu(
        str(path),
        input=columns,
        start_values={"position_start": position, **values},
        output=["position"],
        stop_time=time_s[-1],
        step_size=period_s,
        output_interval=period_s,
    )
    assert len(result) == len(command)
    return result["position"]


@both
def test_fmpy_finds_no_problem(fmus, version):
    assert validate_fmu(str(fmus[version])) == []
    assert fmpy.read_model_description(str(fmus[version])).fmiVersion == f"{version}.0"


@both
def test_a_cycle_is_that_of_the_core(fmus, known, version):
    _, record = known
    estimate = trend_estimate(record, record.last.number - 1)
    values = np.array([p.value for p in estimate.parameters])
    frames, period_s = record.last.frames, record.last.period_s
    lag, inputs = estimate.lag, np.ascontiguousarray(frames.inputs)
    out = np.empty(len(inputs))
    VALVE.law.free_run(np.array([frames.position[0]]), values, period_s, inputs, lag, lag, out)
    # the core knows its first output at sample `lag`; the FMU holds it until an input acts
    fmu = simulated(fmus[version], frames.position[0], inputs[1:, 0], period_s)
    np.testing.assert_allclose(fmu[lag - 1 :], out[lag:], atol=1e-9)
    assert np.ptp(fmu) > 0.4


@both
def test_the_free_run_over_the_next_cycle_has_the_fit_that_the_report_prints(fmus, known, version):
    _, record = known
    frames, number = record.last.frames, record.last.number
    lag = trend_estimate(record, number - 1).lag
    free = simulated(
        fmus[version], frames.position[lag - 1], frames.inputs[:, 0], record.last.period_s
    )
    free[:lag] = np.nan  # the report's begins where the first input acts
    told = trend_estimate(record, number).fit_test
    assert told > 50.0
    assert fit_percent(frames.position, free) == pytest.approx(told, abs=1e-9)


@both
def test_it_says_what_its_values_are(fmus, known, version):
    folder, record = known
    estimate = trend_estimate(record, record.last.number - 1)
    told = fmpy.read_model_description(str(fmus[version]))
    for part in (NAME, f"cycle {estimate.cycle}", str(folder), "output_error", "valve_twin"):
        assert part in told.description
    variables = {v.name: v for v in told.modelVariables}
    for p in estimate.parameters:
        v = variables[p.name]
        assert float(v.start) == p.value
        assert (float(v.min), float(v.max)) == (p.lower_95, p.upper_95)
    assert variables["time_constant"].unit == "s"
    assert float(variables["input_delay"].start) == estimate.lag * 0.05
    assert float(told.defaultExperiment.stepSize) == 0.05


@both
def test_the_same_history_gives_the_same_bytes_with_sources_and_both_binaries(
    fmus, known, tmp_path, version
):
    folder, record = known
    url, out = str(folder / "history.sqlite"), tmp_path / "again.fmu"
    cycle = str(record.last.number - 1)
    rest = ["--cycle", cycle, "--fmi", str(version), "--out", str(out)]
    assert main(["export-fmu", "--url", url, "--valve", NAME.strip("/"), *rest]) == 0
    assert out.read_bytes() == fmus[version].read_bytes()
    with zipfile.ZipFile(out) as archive:
        names = set(archive.namelist())
        ends = {n: archive.read(n)[:4] for n in names if n.startswith("binaries/")}
        assert all(
            f"fmi{version}DoStep".encode() in archive.read(n) for n in ends
        )  # both platforms export it
        headers = [archive.read(n) for n in names if n.endswith("Functions.h")]
    assert {p[:2] for p in ends.values()} == {b"\x7fE", b"MZ"}
    assert {"sources/law.h", "sources/model.h", f"sources/fmi{version}.c"} <= names
    assert all(b"2-Clause BSD" in text for text in headers)
    assert ("sources/buildDescription.xml" in names) == (version == 3)


OF_WINDOWS = re.compile(r"kernel32\.dll|ntdll\.dll|msvcrt\.dll|api-ms-win-crt-[a-z]+-l1-1-0\.dll")
"""Libraries that every 64-bit Windows 10 and later brings along."""
NOT_OF_CO_SIMULATION = (
    "NewDiscreteStates|ContinuousTimeMode|CompletedIntegratorStep|SetTime|ContinuousStates|"
    "Derivatives$|EventIndicators|EventMode"
)


@both
def test_the_windows_binary_exports_all_of_fmi_and_needs_nothing_but_windows(fmus, version):
    with zipfile.ZipFile(fmus[version]) as packed:
        (name,) = (n for n in packed.namelist() if n.endswith(".dll"))
        (other,) = (n for n in packed.namelist() if n.endswith(".so"))
        image, linux = read_image(packed.read(name)), packed.read(other)
        header = packed.read(f"sources/fmi{version}Functions.h").decode()
    wanted = set(re.findall(rf"^\s*FMI{version}_Export \w+\s+(\w+);", header, re.MULTILINE))
    assert len(wanted) > 40
    assert (image.machine, image.is_dll) == (AMD64, True)
    missing = wanted - image.exports
    if version == 2:  # of FMI 3.0 all functions are there, of 2.0 those of the kind
        missing = {n for n in missing if not re.search(NOT_OF_CO_SIMULATION, n)} | {
            n for n in missing if re.search("(Input|Output)Derivatives", n)
        }
    assert missing == set()
    assert all(e.encode() + b"\0" in linux for e in image.exports)  # the same as on Linux
    assert image.exports <= wanted  # and nothing else
    assert [n for n in image.imports if not OF_WINDOWS.fullmatch(n)] == []
    assert not any(entry.startswith("#") for found in image.imports.values() for entry in found)


@both
def test_the_sources_alone_build_the_same_valve(fmus, tmp_path, version):
    """A tool of others compiles what lies in sources/, warnings as errors."""
    with zipfile.ZipFile(fmus[version]) as archive:
        archive.extractall(tmp_path)
    command = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-linux-gnu.2.17", "-O2"]
    command += ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function"]
    command += ["-Wno-unused-parameter", "-fno-sanitize=all", "-c", f"fmi{version}.c"]
    done = subprocess.run(
        command, cwd=tmp_path / "sources", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.fixture
def slave(fmus, tmp_path, request):
    """Return what makes instances of an FMU, and the value references by name."""
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

    version = request.param
    told = fmpy.read_model_description(str(fmus[version]))
    folder = fmpy.extract(str(fmus[version]), str(tmp_path / "unzipped"))
    made: list[Any] = []

    def new():
        kind = FMU2Slave if version == 2 else FMU3Slave
        one = kind(
            guid=told.guid,
            unzipDirectory=folder,
            modelIdentifier=told.coSimulation.modelIdentifier,
            instanceName=f"valve_{len(made)}",
        )
        one.instantiate()
        if version == 3:
            one.getReal, one.setReal = one.getFloat64, one.setFloat64
            one.getFMUstate, one.setFMUstate = one.getFMUState, one.setFMUState
            one.freeFMUstate = one.freeFMUState
            one.start = one.enterInitializationMode
        else:

            def start():
                one.setupExperiment(startTime=0.0)
                one.enterInitializationMode()

            one.start = start
        made.append(one)
        return one

    yield new, {v.name: v.valueReference for v in told.modelVariables}
    for one in made:
        one.freeInstance()
    shutil.rmtree(folder)


versions = pytest.mark.parametrize("slave", [2, 3], indirect=True)


def run(one, references, count, first=0, command=0.9, step=0.05):
    found = []
    for n in range(first, first + count):
        one.setReal([references["command"]], [command])
        one.doStep(n * step, step)
        found += one.getReal([references["position"]])
    return found


@versions
def test_a_kept_state_a_reset_and_a_second_instance_repeat_the_run(slave):
    new, references = slave
    one, other = new(), new()
    for each in (one, other):
        each.start()
        each.exitInitializationMode()
    begin = run(one, references, 20)
    kept = one.getFMUstate()
    rest = run(one, references, 20, 20)
    assert run(other, references, 5, command=0.2)[-1] < begin[4]  # nothing is shared
    one.setFMUstate(kept)
    assert run(one, references, 20, 20) == rest
    one.freeFMUstate(kept)
    one.reset()
    one.start()
    one.exitInitializationMode()
    assert run(one, references, 40) == begin + rest


@versions
def test_steps_of_any_length_see_the_samples_of_the_law(slave):
    new, references = slave
    runs = []
    for step, count in ((0.05, 40), (0.025, 80), (0.1, 20)):
        one = new()
        one.start()
        one.exitInitializationMode()
        runs.append(run(one, references, count, step=step))
    assert runs[1][1::2] == pytest.approx(runs[0], abs=1e-15)
    assert runs[2] == pytest.approx(runs[0][1::2], abs=1e-15)


@versions
@pytest.mark.parametrize(
    ("name", "value"), [("time_constant", 0.0), ("time_constant", float("nan")), ("position", 0.5)]
)
def test_a_value_that_the_law_does_not_allow_is_refused(slave, name, value):
    from fmpy.fmi1 import FMICallException

    new, references = slave
    one = new()
    with pytest.raises(FMICallException):
        one.setReal([references[name]], [value])


@versions
def test_steps_that_make_no_sense_and_inputs_that_are_no_number_are_refused(slave):
    from fmpy.fmi1 import FMICallException

    new, references = slave
    one = new()
    with pytest.raises(FMICallException):
        one.doStep(0.0, 0.05)  # before its initialization
    one.start()
    one.exitInitializationMode()
    for wrong in ((0.0, -0.05), (0.3, 0.05), (0.0, float("nan"))):
        with pytest.raises(FMICallException):
            one.doStep(*wrong)
    with pytest.raises(FMICallException):
        one.setReal([references["command"]], [float("inf")])
    assert len(run(one, references, 3)) == 3  # it lives


@versions
def test_a_parameter_may_age_while_it_runs(slave):
    new, references = slave
    one = new()
    one.start()
    one.exitInitializationMode()
    one.setReal([references["time_constant"]], [50.0])
    assert run(one, references, 20)[-1] < 0.05


def played(estimate, period_s, inputs, version, path, output="spool_position", **values):
    """Return what the FMU of an estimate [1] makes of inputs by name (N,) [1]."""
    write_fmu(valve_of("db", "/v", estimate, record(), period_s), path, version)
    assert validate_fmu(str(path)) == []
    count = len(next(iter(inputs.values())))
    columns = np.zeros(count, dtype=[(n, float) for n in ("time", *inputs)])
    columns["time"] = period_s * np.arange(count)
    for name, column in inputs.items():
        columns[name] = column
    return fmpy.simulate_fmu(
        str(path),
        input=columns,
        start_values=values,
        output=[output],
        stop_time=columns["time"][-1],
        step_size=period_s,
        output_interval=period_s,
    )[output]


@both
def test_a_press_valve_equals_the_free_run_of_its_prediction(tmp_path, version):
    values = tuple(ParameterValue(name, value) for name, value in press.VALUES.items())
    estimate = made(values=values, model="press_cartridge", lag=2)
    inputs = dict(zip(("v_in", "v_out"), press.commands().T, strict=True))
    own = ("v_offset_in", "v_offset_out", "upper_seat", "v_ref")
    given = {name: getattr(press.OPTIONS, name) for name in own}
    found = played(estimate, press.PERIOD_S, inputs, version, tmp_path / "press.fmu", **given)
    np.testing.assert_allclose(found, press.free_run(press.VALUES, press.commands()), atol=1e-9)


@both
def test_a_stepper_valve_equals_the_free_run_of_its_prediction(tmp_path, version):
    values = tuple(ParameterValue(name, value) for name, value in stepper.VALUES.items())
    estimate = made(values=values, model="stepper_servo", lag=9)
    inputs = dict(zip(("motor_position", "flow"), stepper.motor_and_flow().T, strict=True))
    path, start = tmp_path / "stepper.fmu", 0.302
    found = played(estimate, stepper.PERIOD_S, inputs, version, path, spool_position_start=start)
    wanted = stepper.free_run(stepper.VALUES, stepper.motor_and_flow(), start)
    known = np.isfinite(wanted)  # before, its line fills
    assert np.flatnonzero(~known).tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(found[known], wanted[known], atol=1e-9)


@both
def test_a_hybrid_actuator_equals_the_free_run_of_its_prediction(tmp_path, version):
    values = (
        *(ParameterValue(name, value) for name, value in hybrid.VALUES.items()),
        ParameterValue("coulomb_friction", float("nan"), ParameterStatus.NOT_EXCITED),
    )
    estimate = made(values=values, model="hybrid_actuator", lag=0)
    signals, model = hybrid.voltages_and_currents(), HybridActuatorModel()
    late = signals[1:]  # an FMU takes what acts up to a sample at the sample before
    inputs = dict(zip(model.inputs, late.T, strict=True))
    found = played(estimate, hybrid.PERIOD_S, inputs, version, tmp_path / "h.fmu", "position")
    wanted = hybrid.free_run(hybrid.VALUES, signals, model)[: len(late)]
    assert np.ptp(wanted[1:]) == 1.0
    np.testing.assert_allclose(found[1:], wanted[1:], atol=1e-9)


@pytest.mark.parametrize(
    ("model", "values", "command"),
    [
        ("first_order", {"time_constant": 0.41, "dead_band": 0.0}, 0.8),
        ("press_cartridge", press.VALUES, 0.8),
        ("stepper_servo", stepper.VALUES, 0.8),
        ("hybrid_actuator", hybrid.VALUES, -0.12),
    ],
)
def test_a_step_takes_less_than_two_microseconds(model, values, command, tmp_path):
    """Processor time of doStep in a loop of C, so that Python's calls do not count."""
    path = tmp_path / "valve.fmu"
    known = tuple(ParameterValue(name, value) for name, value in values.items())
    estimate = made(values=known, model=model, lag=1)
    write_fmu(valve_of("db", "/v", estimate, record(), 2e-4), path, 2)
    folder = Path(fmpy.extract(str(path), str(tmp_path / "unzipped")))
    told = fmpy.read_model_description(str(path))
    (folder / "sources" / "loop.c").write_text(f"""
#include "fmi2.c"
#include <time.h>
int main(void) {{
    fmi2Component c = fmi2Instantiate("v", fmi2CoSimulation, "{told.guid}", "", 0, 0, 0);
    fmi2ValueReference in[VT_INPUTS], out = VT_OUTPUT;
    double u[VT_INPUTS], y = 0.0, low = 1e9, high = -1e9;
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
    for (int k = 0; k < VT_INPUTS; k++) in[k] = VT_INPUT + k;
    clock_t begin = clock();
    for (int n = 0; n < 1000000; n++) {{
        for (int k = 0; k < VT_INPUTS; k++) u[k] = (n / 4000 + k) % 2 ? {command} : 0.0;
        fmi2SetReal(c, in, VT_INPUTS, u);
        if (fmi2DoStep(c, n * VT_PERIOD, VT_PERIOD, 1) != fmi2OK) return 1;
        fmi2GetReal(c, &out, 1, &y);
        if (y < low) low = y;
        if (y > high) high = y;
    }}
    double us = 1.0 * (clock() - begin) / CLOCKS_PER_SEC;
    printf("{{\\"us\\": %g, \\"way\\": %g}}\\n", us, high - low);
    return 0;
}}
""")
    command = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-linux-gnu.2.17", "-O2"]
    command += ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function"]
    command += ["-Wno-unused-parameter", "-fno-sanitize=all", "loop.c", "-o", "loop", "-lm"]
    subprocess.run(command, cwd=folder / "sources", check=True)
    answers = [
        json.loads(subprocess.check_output([folder / "sources" / "loop"], text=True))
        for _ in range(3)
    ]
    assert min(a["us"] for a in answers) < 2.0, answers
    assert answers[0]["way"] > 0.1
    print(f"\na step of {model}: {min(a['us'] for a in answers):.3f} us of a core")  # noqa: T201


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--valve", "other"], "there is no valve '/other'"),
        (["--valve", NAME, "--cycle", "99"], "no usable estimate of cycle 99"),
        (["--valve", NAME, "--period", "0"], "'0' is refused"),
    ],
)
def test_bad_arguments_get_one_line(known, tmp_path, capsys, arguments, said):
    folder, _ = known
    whole = ["--url", str(folder / "history.sqlite"), "--out", str(tmp_path / "x.fmu"), *arguments]
    code: object
    try:
        code = main(["export-fmu", *whole])
    except SystemExit as end:
        code = end.code
    text = capsys.readouterr().err
    assert code in {1, 2}
    assert said in text
    assert text.count("\n") == 1
    assert not list(tmp_path.iterdir())


@njit
def swing(x, u, p, period_s):
    """Advance a damped pendulum in substeps, semi-implicitly."""
    h = period_s / SUBSTEPS
    for _ in range(SUBSTEPS):
        x[1] += h * (p[0] ** 2 * (u[0] - x[0]) - 2.0 * p[1] * p[0] * x[1])
        x[0] += h * x[1]


@njit
def begin(x, u, p):
    x[1] = 0.1 * p[0] * (u[0] - x[0])


SUBSTEPS = 10
LAW = Law(
    step=swing,
    states=2,
    parameters=(
        parameter("frequency", 3.0, "rad/s", "of the swing", lower=0.1, upper=100.0),
        parameter("damping", 0.3, "1", "of the swing", lower=0.0, upper=10.0),
    ),
    rest=begin,
)
PENDULUM = Valve(name="pendulum", inputs=("command",), output="position", law=LAW)


@both
def test_a_law_of_two_states_with_a_rest_of_its_own(tmp_path, monkeypatch, version):
    from fmpy.validation import validate_fmu

    monkeypatch.setattr("valve_twin.gateway.fmu.valve.law_of", lambda _: PENDULUM)
    values = (ParameterValue("frequency", 4.0), ParameterValue("damping", 0.2))
    path = tmp_path / "pendulum.fmu"
    write_fmu(valve_of("db", "/v", made(values=values), record()), path, version)
    assert validate_fmu(str(path)) == []
    command = np.repeat([0.2, 0.8], 60)
    out = np.empty(121)
    inputs = np.append(command[0], command)[:, None]
    LAW.free_run(np.array([0.1, 0.0]), np.array([4.0, 0.2]), 0.05, inputs, 1, 1, out)
    fmu = simulated(path, 0.1, command, 0.05)
    np.testing.assert_allclose(fmu, out[1:], atol=1e-9)
    assert fmu.max() > 0.9  # it overshoots
    told = {v.name: v for v in fmpy.read_model_description(str(path)).modelVariables}
    assert told["state_1"].causality == "local"
    assert told["frequency"].unit == "rad/s"


@both
def test_a_positioner_runs_as_its_prediction_does(tmp_path, version):
    from test.gateway.fmu.test_valve import PLAIN
    from valve_twin.core.types import Restart
    from valve_twin.core.valves.positioner import MODEL

    lag, period_s, start = 3, 0.05, 0.2
    valve = valve_of("db", "/v", made(values=PLAIN, model="positioner", lag=lag), record())
    write_fmu(valve, tmp_path / "p.fmu", version)
    random = np.random.default_rng(11)
    command = np.repeat(random.uniform(-0.2, 1.3, 20), 20)  # beyond both stops, too
    values = {p.name: p.value for p in PLAIN if np.isfinite(p.value)}
    c = MODEL.coefficients(values, lag, period_s, MODEL.options)
    state = np.zeros(MODEL.state_size)
    predicted, free = np.empty(len(command)), np.empty(len(command))
    restart = np.full(len(command), Restart.GO_ON, dtype=np.uint8)
    restart[0] = Restart.NEW_CYCLE
    validity = np.zeros(len(command), dtype=np.uint8)
    measured = np.full(len(command), start)
    block = (measured, command[:, np.newaxis], restart, predicted, free, validity)
    MODEL.kernel_of(c)(state, c, *block)
    # the prediction begins to move one sample behind the lag, the FMU with it
    fmu = simulated(tmp_path / "p.fmu", start, command[1:], period_s)
    first = int(np.flatnonzero(np.isfinite(free))[0])
    np.testing.assert_allclose(fmu[max(lag, first) :], free[max(lag, first) + 1 :], atol=1e-9)
    assert np.ptp(fmu) > 0.9
