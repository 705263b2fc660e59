# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin campaign`: are faults found and named, and how often is there none."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin.cli.common import OK, USAGE, add_verb, check_writable, fail, positive, progress_of
from valve_twin.cli.output import console, plain, table
from valve_twin.cli.strangers import add_strangers, run_strangers
from valve_twin.io.config.campaign import load_campaign, write_severities
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    import argparse

    from rich.console import Console

    from valve_twin.cli.common import Verbs
    from valve_twin.core.diagnosis.campaign import CampaignConfig, CampaignResult
    from valve_twin.core.diagnosis.derive import AgingBench
    from valve_twin.core.diagnosis.isolability import Isolability
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.simulation.config import SimulationConfig


def add(verbs: Verbs) -> None:
    """Add the verb."""
    text = "Inject faults into a simulated valve and count what is detected and named right."
    parser = add_verb(verbs, "campaign", text, _campaign)
    parser.add_argument(
        "--config", metavar="FILE", help="YAML of the campaign; of the valve with --strangers"
    )
    parser.add_argument(
        "--model", metavar="NAME", help="instead of FILE: the faults of any valve, this model's"
    )
    parser.add_argument(
        "--fmu", metavar="FILE", help="with --model: the plant is this FMU (FMI 2.0 or 3.0)"
    )
    parser.add_argument(
        "--fmu-input",
        action="append",
        metavar="VARIABLE",
        help="variable of the FMU that takes an input of the model, in their order; default those "
        "of the same names",
    )
    parser.add_argument(
        "--fmu-output", default="", metavar="VARIABLE", help="the one that is measured, likewise"
    )
    parser.add_argument(
        "--first", type=positive, default=1, metavar="SEED", help="seed of the first record"
    )
    parser.add_argument("--seeds", type=positive, metavar="N", help="records, default as in FILE")
    parser.add_argument(
        "--fault", action="append", metavar="NAME", help="only this fault; may be repeated"
    )
    parser.add_argument("--json", metavar="OUT", help="also write all figures to this file")
    parser.add_argument(
        "--derive",
        metavar="TABLE",
        help="instead derive signatures and sizes by simulation: write them to this JSON file "
        "and into FILE",
    )
    add_strangers(parser)


def _campaign(arguments: argparse.Namespace) -> int:
    check_writable(arguments.json, arguments.derive)
    if arguments.strangers:
        return run_strangers(arguments)
    if bool(arguments.config) == bool(arguments.model):
        return fail("campaign: give --config FILE, --model NAME, or --strangers", USAGE)
    if arguments.fmu and (arguments.config or arguments.derive):
        text = "campaign: --fmu needs --model NAME; in a FILE of --config it is simulation.fmu"
        return fail(text, USAGE)
    if arguments.derive:
        return _derive(arguments)
    from valve_twin.core.diagnosis.campaign import run_campaign
    from valve_twin.core.diagnosis.config import detection_of

    try:
        rig, table, config, how = _chosen(arguments)
    except ValueError as err:
        return fail(f"campaign: {err}", USAGE)
    for name in arguments.fault or ():
        if name not in config.severities:
            known = ", ".join(config.severities)
            return fail(f"campaign: there is no fault '{name}'; there are {known}", USAGE)
    if arguments.fault:
        config = replace(config, severities={n: config.severities[n] for n in arguments.fault})
    with progress_of("records", len(config.seeds)) as advance:
        detection = detection_of(rig.feature_set) if arguments.model else None
        result = run_campaign(rig, table, config, detection=detection, advance=advance, **how)
    _show(result)  # also where the file cannot be written: it took long
    if arguments.json:
        text = json.dumps(_plain(result, config.seeds), indent=1, allow_nan=False)
        write_whole(arguments.json, f"{text}\n")
    return OK


def _chosen(
    arguments: argparse.Namespace,
) -> tuple[AgingBench[Any], SignatureTable, CampaignConfig, dict[str, Any]]:
    """Return valve and model, signatures, what is simulated, and how it is looked at."""
    first = arguments.first
    seeds = tuple(range(first, first + arguments.seeds)) if arguments.seeds else ()
    if arguments.config:
        campaign = load_campaign(arguments.config)
        config = campaign.config
        config = replace(config, seeds=seeds) if seeds else config
        return campaign.rig, campaign.rig.model.signatures(), config, {}
    from valve_twin.core.diagnosis.generic.campaign import (
        campaign_of,
        look_of,
        model_rig,
        own_signatures,
    )
    from valve_twin.core.diagnosis.generic.faults import FAULTS
    from valve_twin.core.diagnosis.generic.signatures import signatures_of

    rig = model_rig(arguments.model, _fmu_of(arguments))
    table = signatures_of(rig.model)
    assert table is not None
    with progress_of("sizes", len(FAULTS)) as advance:
        config = campaign_of(rig, seeds or tuple(range(first, first + 20)), advance=advance)
    return rig, table, config, {"own": partial(own_signatures, rig), "look": look_of(rig)}


def _fmu_of(arguments: argparse.Namespace) -> SimulationConfig | None:
    """Return the simulation whose plant is the FMU that is given; None without one."""
    if not arguments.fmu:
        return None
    from valve_twin.io.fmu.plant import simulation_for

    given = {"fmu.file": arguments.fmu, "fmu.output": arguments.fmu_output}
    if arguments.fmu_input:
        given["fmu.inputs"] = tuple(arguments.fmu_input)
    return simulation_for(arguments.model, given)


def _derive(arguments: argparse.Namespace) -> int:
    from valve_twin.core.diagnosis.derive import derive
    from valve_twin.core.diagnosis.source import table_source

    if arguments.model:
        from valve_twin.core.diagnosis.generic.campaign import model_rig
        from valve_twin.core.diagnosis.generic.signatures import derive_table

        rig_of_any = model_rig(arguments.model)
        table = derive_table(rig_of_any.model)
        write_whole(arguments.derive, table_source(table))
        return OK
    rig = load_campaign(arguments.config).rig
    with progress_of("faults", len(rig.model.feature_set.first_sizes)) as advance:
        table = derive(rig, advance=advance)
    write_whole(arguments.derive, table_source(table))
    write_severities(arguments.config, table)
    return OK


def _plain(result: CampaignResult, seeds: tuple[int, ...]) -> dict[str, object]:
    """Return the outcome as plain data: not a number = null."""
    found = result.isolability
    return {
        "seeds": len(seeds),
        "healthy_cycles": result.healthy,
        "false_alarms": [
            {"seed": seed, "fault": fault, "cycle": cycle} for seed, fault, cycle in result.alarms
        ],
        "rows": [plain(asdict(row)) for row in result.rows],
        "classes": [list(c) for c in found.classes if len(c) > 1],
        "faults": list(found.faults),
        "distance": [[round(float(d), 2) for d in row] for row in found.distance],
    }


def _show(result: CampaignResult) -> None:
    """Print what was found, then which faults can be told apart."""
    numbers = ("severity", "detected", "in 5 cycles", "delay median", "most", "named", "class")
    shown = table("Faults", ("fault", "size"), numbers)
    for r in result.rows:
        shown.add_row(
            r.fault,
            r.size,
            f"{r.severity:.3g}",
            f"{r.detected}/{r.cases}",
            f"{r.within_5}/{r.cases}",
            f"{r.delay_median:.1f}",
            f"{r.delay_most:.0f}",
            f"{r.named}/{r.cases}",
            f"{r.in_class}/{r.cases}",
        )
    out = console()
    out.print(shown)
    _show_isolability(result.isolability, out)
    out.print(
        f"{len(result.alarms)} false alarms in {result.healthy} healthy aging cycles",
        highlight=False,
    )


def _show_isolability(found: Isolability, out: Console) -> None:
    title = "Distance of a fault of medium size (row) from another [standard deviations]"
    shown = table(title, ("",))
    for name in found.faults:
        shown.add_column(name.replace("_", " "), justify="right", max_width=10)
    for name, row in zip(found.faults, found.distance, strict=True):
        shown.add_row(
            name,
            *(
                "-" if other == name else f"{d:.1f}"
                for other, d in zip(found.faults, row, strict=True)
            ),
        )
    out.print(shown)
    pairs = "; ".join(" = ".join(c) for c in found.classes if len(c) > 1) or "none"
    out.print(f"No data of this kind tell apart: {pairs}")
