# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An FMU as the plant of a simulated valve, through `simulate` and `estimate`; bad ones."""

import gc
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from test.gateway.fmu.test_valve import made, record
from valve_twin.cli import main
from valve_twin.core.simulation import SimulatedValve
from valve_twin.core.types import ParameterValue
from valve_twin.gateway.fmu.export import write_fmu
from valve_twin.gateway.fmu.valve import valve_of
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import ConfigError
from valve_twin.io.fmu.plant import simulation_for
from valve_twin.io.fmu.unit import Unit
from valve_twin.io.limits import VARIABLE
from valve_twin.io.offline.run import run_bag
from valve_twin.io.offline.simulated_bag import simulation_of, write_simulated_bag

pytest.importorskip("fmpy")
pytest.importorskip("ziglang")
pytestmark = pytest.mark.timeout(900)  # the first use of the compiler builds its C libraries

ROOT = Path(__file__).resolve().parents[3]
CONFIG = ROOT / "config" / "first_order.yaml"
VALUES = (
    ParameterValue("time_constant", 0.7, lower_95=0.69, upper_95=0.71),
    ParameterValue("dead_band", 0.02, lower_95=0.01, upper_95=0.03),
)
QUIET = {"measurement.noise": 0.0}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plant")
    valve = valve_of("db", "/v", made(values=VALUES), record())
    for version in (2, 3):
        write_fmu(valve, folder / f"v{version}.fmu", version)
    return folder


both = pytest.mark.parametrize("version", [2, 3])


@both
def test_the_valve_of_an_fmu_moves_as_the_one_it_was_made_from(fmus, version):
    given = {"plant.time_constant": 0.7, "plant.dead_band": 0.02, **QUIET}
    ours = SimulatedValve(simulation_for("first_order", given), 1).advance(800)
    fmu = {"fmu.file": str(fmus / f"v{version}.fmu"), **QUIET}
    theirs = SimulatedValve(simulation_for("first_order", fmu), 1)
    blocks = [theirs.advance(n) for n in (1, 399, 250, 150)]  # the same for any block length
    position = np.concatenate([b.position for b in blocks])
    assert theirs.failure == ""
    np.testing.assert_allclose(position, ours.position, atol=1e-12)
    assert np.ptp(position) > 0.5


@both
def test_simulate_and_estimate_find_the_parameters_of_the_fmu(fmus, tmp_path, version):
    text = CONFIG.read_text().replace(
        "    simulation:\n", f"    simulation:\n      fmu: {{file: {fmus}/v{version}.fmu}}\n"
    )
    path = tmp_path / "valve.yaml"
    path.write_text(text.replace("rate: 0.005", "rate: 0.02"))
    bag = tmp_path / "bag"
    arguments = ["--config", str(path), "--cycles", "6", "--seed", "2"]
    assert main(["simulate", *arguments, "--out", str(bag)]) == 0
    (config,) = load_config(path)
    estimates = [e for e in run_bag(config, bag).estimates if e.used_by_trend]
    found = [e.value("time_constant") for e in estimates]
    assert len(found) == 6
    simulation = simulation_of(config)
    true = [vars(simulation.aged_plant(e.cycle))["time_constant"] for e in estimates]
    assert true[-1] == pytest.approx(0.7 * 1.12)  # it ages inside the FMU
    np.testing.assert_allclose(found, true, rtol=0.005)


def test_two_valves_of_one_fmu_share_nothing(fmus):
    simulation = simulation_for("first_order", {"fmu.file": str(fmus / "v2.fmu"), **QUIET})
    one, other = SimulatedValve(simulation, 1), SimulatedValve(simulation, 1)
    first = one.advance(300).position
    parts = [other.advance(150).position]
    one.advance(100)
    assert np.array_equal(np.concatenate([*parts, other.advance(150).position]), first)


@both
def test_an_fmu_speaks_for_itself_also_after_another_one_has_ended(fmus, version):
    """FMPy's proxy knows one logger: that of the one that ended was called, and all died."""
    unit = Unit(fmus / f"v{version}.fmu")
    (constant,) = (v for v in unit.parameters if v.name == "time_constant")
    one, other, ended = (unit.start({}) for _ in range(3))
    del ended
    gc.collect()
    one.set([constant.reference], [-1.0], 1.0)
    other.set([constant.reference], [-2.0], 2.0)
    assert "fails at 1 s: time_constant = -1: must lie" in one.failure
    assert "fails at 2 s: time_constant = -2: must lie" in other.failure


def test_stuck_and_lost_commands_act_and_what_an_fmu_cannot_do_is_told(fmus):
    simulation = simulation_for("first_order", {"fmu.file": str(fmus / "v2.fmu"), **QUIET})
    valve = SimulatedValve(simulation, 1)
    valve.advance(110)
    valve.set_fault("stuck")
    assert np.ptp(valve.advance(50).true_position[1:]) == 0.0
    valve.set_fault("none")
    assert np.ptp(valve.advance(50).true_position) > 0.1
    valve.set_fault("leak", 0.1)
    valve.advance(5)
    assert "takes neither a leak nor process noise" in valve.failure


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"file": "gone.fmu"}, r"simulation.fmu.file = .*gone.fmu: there is no such file"),
        ({"file": "text.fmu"}, "is no FMU that can be read"),
        ({"file": "windows.fmu"}, "has no binary for linux64, it has those of: win64"),
        ({"file": "v2.fmu", "output": "postion"}, "no such variable; did you mean 'position'"),
        ({"file": "v2.fmu", "output": "command"}, "is of causality input, no output"),
        ({"file": "v2.fmu", "inputs": ["position"]}, "is of causality output, no input"),
        ({"file": "v2.fmu", "inputs": ["command", "x"]}, "has 1 inputs .command.; name as many"),
        ({"file": "v2.fmu", "ouput": "x"}, "simulation.fmu.ouput: unknown setting.*output"),
        ({"file": "words.fmu"}, "its variable time_constant starts at '0.7 s', which is no numb"),
        ({"file": 7}, "simulation.fmu.file"),
        ({"file": "v2.fmu", "plant": {"time_constant": -1.0}}, "time_constant = -1: must lie"),
    ],
)
def test_an_fmu_that_cannot_be_the_plant_is_one_line(fmus, tmp_path, keys, said):
    (tmp_path / "text.fmu").write_text("no archive")
    with (
        zipfile.ZipFile(fmus / "v2.fmu") as old,
        zipfile.ZipFile(tmp_path / "windows.fmu", "w") as new,
    ):
        for name in old.namelist():
            if "linux64" not in name:
                new.writestr(name, old.read(name))
    shutil.copy(fmus / "v2.fmu", tmp_path / "v2.fmu")
    described(fmus / "v2.fmu", tmp_path / "words.fmu", 'start="0.7"', 'start="0.7 s"')
    given = dict(keys)
    if isinstance(given["file"], str):
        given["file"] = str(tmp_path / given["file"])
    plant = given.pop("plant", {})
    with pytest.raises((ConfigError, ValueError), match=said) as caught:
        SimulatedValve(simulation_for("first_order", {"fmu": given, "plant": plant}), 1)
    assert "\n" not in str(caught.value)


@both
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ('if (s->sample == 50) { snprintf(why, VT_TEXT, "broke"); return 1; }', "broke"),
        ("if (s->sample == 50) s->x[0] = NAN;", "state 0 is not finite at"),
        ("if (s->sample == 50) s->value[VT_OUTPUT] = NAN, s->x[0] = NAN;", "not finite"),
    ],
)
def test_an_fmu_that_fails_in_a_step_ends_simulate_in_one_line(
    fmus, tmp_path, capsys, version, change, said
):
    path = broken(fmus, tmp_path, version, "    const double until = from + step;\n", change)
    text = f"      fmu: {{file: {path}}}\n"
    config = tmp_path / "valve.yaml"
    config.write_text(CONFIG.read_text().replace("    simulation:\n", f"    simulation:\n{text}"))
    (loaded,) = load_config(config)
    with pytest.raises(ConfigError, match=r"cycle 1: .*v\.fmu fails at 2\.5 s") as caught:
        write_simulated_bag(loaded, tmp_path / "bag", cycles=1)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert main(["simulate", "--config", str(config), "--out", str(tmp_path / "b2")]) == 2
    assert capsys.readouterr().out == ""


@both
def test_an_output_that_is_no_number_is_the_failure(fmus, tmp_path, version):
    path = broken(
        fmus,
        tmp_path,
        version,
        "    *value = s->value[reference];\n",
        "if (s->sample == 50 && reference == VT_OUTPUT) *value = NAN;",
    )
    valve = SimulatedValve(simulation_for("first_order", {"fmu.file": str(path)}), 1)
    valve.advance(100)
    assert valve.failure == f"{path} its output is nan at 2.5 s"


def test_a_parameter_that_no_field_can_be_called_keeps_its_value(fmus, tmp_path):
    path = tmp_path / "word.fmu"
    described(fmus / "v2.fmu", path, 'name="time_constant"', 'name="lambda"')
    given = {"plant.dead_band": 0.02, **QUIET}
    ours = SimulatedValve(simulation_for("first_order", {**given, "plant.time_constant": 0.7}), 1)
    theirs = SimulatedValve(simulation_for("first_order", {**given, "fmu.file": str(path)}), 1)
    np.testing.assert_allclose(theirs.advance(99).position, ours.advance(99).position, atol=1e-12)


def described(fmu, target, old, new):
    """Copy an FMU with another description."""
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(target, "w") as copy:
        for name in source.namelist():
            content = source.read(name)
            if name == "modelDescription.xml":
                assert old.encode() in content
                content = content.replace(old.encode(), new.encode())
            copy.writestr(name, content)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sources/law.h": None}, "cannot be unpacked"),
        ({"resources/bomb": b"\0" * (2 << 20)}, "unpacks to 2 MB, allowed are 1;"),
    ],
)
def test_an_fmu_that_cannot_be_unpacked_is_one_line(fmus, tmp_path, monkeypatch, change, said):
    ((name, content),) = change.items()
    path = tmp_path / "v.fmu"
    shutil.copy(fmus / "v2.fmu", path)
    if content is None:  # damaged behind its description
        with zipfile.ZipFile(path) as archive:
            begin = archive.getinfo(name).header_offset
        data = bytearray(path.read_bytes())
        data[begin + 60 : begin + 90] = bytes(30)
        path.write_bytes(data)
    else:
        monkeypatch.setenv(VARIABLE, "1")
        with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(name, content)
    with pytest.raises(ConfigError, match=said) as caught:
        simulation_for("first_order", {"fmu.file": str(path)})
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "refused"), [("../beside.txt", ""), ("../../above.txt", ""), ("/here.txt", "Illegal")]
)
def test_no_name_in_an_fmu_leads_out_of_its_folder(fmus, tmp_path, monkeypatch, name, refused):
    places = tmp_path / "places"
    places.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(places))
    path = tmp_path / "v.fmu"
    shutil.copy(fmus / "v2.fmu", path)
    inside = name if name.startswith("..") else f"{tmp_path}{name}"
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(inside, "not here")
    if refused:
        with pytest.raises(ConfigError, match=refused) as caught:
            simulation_for("first_order", {"fmu.file": str(path)})
        assert "\n" not in str(caught.value)
    else:
        assert simulation_for("first_order", {"fmu.file": str(path)}) is not None
    outside = [p for p in tmp_path.rglob("*.txt") if "valve_twin_fmu_" not in str(p)]
    assert not outside


def broken(fmus, folder, version, after, change):
    """Return an FMU whose C was changed behind a line, compiled anew."""
    with zipfile.ZipFile(fmus / f"v{version}.fmu") as archive:
        archive.extractall(folder / "broken")
    source = folder / "broken" / "sources" / "model.h"
    text = source.read_text()
    assert after in text
    source.write_text(text.replace(after, f"{after}    {change}\n"))
    (binary,) = (folder / "broken" / "binaries").glob("*linux*/*.so")
    command = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-linux-gnu.2.17", "-O2"]
    command += ["-std=c99", "-ffp-contract=off", "-fno-sanitize=all", "-shared", "-s", "-fPIC"]
    done = subprocess.run(
        [*command, f"fmi{version}.c", "-o", str(binary), "-lm"],
        cwd=source.parent,
        env={**os.environ, "LD_LIBRARY_PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    path = folder / "v.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        for file in (folder / "broken").rglob("*"):
            archive.write(file, file.relative_to(folder / "broken"))
    return path


HEAD = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g"><CoSimulation modelIdentifier="%s"/>
<ModelVariables>%s</ModelVariables><ModelStructure/></fmiModelDescription>"""
VARIABLES = """<ScalarVariable name="command" valueReference="0" causality="input">
<Real start="0"/></ScalarVariable><ScalarVariable name="position" valueReference="1"
causality="output"><Real/></ScalarVariable>"""


def packed(path, identifier="m", more=()):
    from fmpy import platform, sharedLibraryExtension

    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", HEAD % (identifier, VARIABLES))
        file.writestr(f"binaries/{platform}/m{sharedLibraryExtension}", b"no program")
        for name in more:
            file.writestr(name, b"")
    return {"fmu.file": str(path)}


def test_after_an_fmu_that_cannot_be_loaded_another_one_can(fmus, tmp_path):
    """FMPy stayed in its folder, which is gone soon: nothing could be started any more."""
    given, here = packed(tmp_path / "a.fmu"), Path.cwd()
    with pytest.raises(ConfigError, match="does not start"):
        SimulatedValve(simulation_for("first_order", given), 1)
    assert Path.cwd() == here
    sound = simulation_for("first_order", {"fmu.file": str(fmus / "v2.fmu"), **QUIET})
    assert SimulatedValve(sound, 1).advance(3).position.size == 3


def test_an_fmu_that_leaves_out_its_identifier_is_refused_in_one_line(tmp_path):
    """It was a bare TypeError."""
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", (HEAD % ("", "")).replace(' modelIdentifier=""', ""))
    with pytest.raises(ConfigError, match="modelIdentifier '' names no file of its own"):
        simulation_for("first_order", {"fmu.file": str(path), **QUIET})


@pytest.mark.parametrize("name", ["../../../outside", "/tmp/outside", "..", ""])
def test_an_fmu_names_no_program_outside_and_writes_nothing_there(name, tmp_path):
    with pytest.raises(ConfigError, match=r"modelIdentifier '.*' names no file of its own|no FMU"):
        simulation_for("first_order", packed(tmp_path / "a.fmu", identifier=name))
    slip = packed(tmp_path / "a.fmu", more=["../../valve_twin_slipped"])
    with pytest.raises(ConfigError, match=r"does not start|cannot be unpacked"):
        SimulatedValve(simulation_for("first_order", slip), 1)
    assert not list(tmp_path.parent.glob("valve_twin_slipped"))
