# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a valve has to bring: `ValveModel`, the whole of it.

A valve is an object of a class that inherits from `ValveModel`, named by an entry point of the
group `valve_twin.valves`. What most valves do alike has a default here; the kit
(`core/valves/kit`) brings the rest from a law of motion. The rest of the house knows valves only
through this protocol.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeVar

from valve_twin.core.diagnosis.generic.features import FEATURE_SET
from valve_twin.core.quantity import describe

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.quantity import Descriptor
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import (
        ByteArray,
        Cycle,
        Estimate,
        FloatArray,
        Parameter,
        ParameterValue,
    )
    from valve_twin.core.valves.bench_fit import BenchFit

Options: TypeAlias = Any
"""The options of the model at hand, an instance of its own dataclass: only the model reads it."""

O_co = TypeVar("O_co", covariant=True)


@dataclass(frozen=True, slots=True)
class ModelOptions:
    """What the house reads of the options of any model; by itself the options of one without any.

    The options of a model inherit from it and declare as fields what they have of these.
    """

    @property
    def estimators(self) -> tuple[str, ...]:
        """Names of the estimators to run, where there is a choice."""
        return ()

    @property
    def lag(self) -> int:
        """Input to output lag that is given [samples]; -1 = found in each cycle."""
        return 0

    @property
    def tolerances(self) -> object:
        """Half widths of the constants' tolerances, of `kit.tolerances`; None = no constants."""
        return None


class HasOptions(Protocol[O_co]):
    """What has a name and a dataclass of options with their defaults."""

    @property
    def name(self) -> str:
        """Name in configurations."""
        ...

    @property
    def options(self) -> O_co:
        """Its options with their defaults."""
        ...


@dataclass(frozen=True, slots=True)
class Approximation:
    """What an approximation behind a model changes.

    Attributes
    ----------
    letter : str
        Its row in an error budget, "g" or later.
    text : str
        What is approximated.
    error : (N,) array
        What the real valve does beyond the approximate one under the same commands [1].
    """

    letter: str
    text: str
    error: FloatArray


@dataclass(frozen=True, slots=True)
class Scale:
    """How a signal is shown to people.

    Attributes
    ----------
    unit : str
        Unit of what is shown, such as "mm".
    size : float
        What a change of the signal by 1 is [unit].
    zero : float
        What the signal's 0 is [unit].
    ends : str
        What its ends are, such as "0 = closed seat, 8 = open seat".
    """

    unit: str
    size: float = 1.0
    zero: float = 0.0
    ends: str = ""


@dataclass(frozen=True, slots=True)
class Demonstration:
    """How a valve is shown; what is left out follows from its file in `config/`.

    Attributes
    ----------
    namespace, label : str
        Where its nodes live and how its files begin; empty = after the model.
    followed : str
        Published parameter that shows the aging; empty = that of the name of what ages.
    aging_rate : float
        Relative change a cycle [1]; 0 = 15 % over the demo, in the direction of the file's law.
    cycles : int
        Cycles to wait for.
    rate : float
        Simulated seconds a second [1]; 0 = one cycle in 0.6 s, at least in real time.
    batched : bool
        Whether messages may carry more than one sample.
    counter : bool
        Whether the simulated valve's counter cuts the cycles rather than the file's rule.
    file : str
        Name of the file in `config/` that is shown; empty = that of the name of the model.
    """

    namespace: str = ""
    label: str = ""
    followed: str = ""
    aging_rate: float = 0.0
    cycles: int = 60
    rate: float = 0.0
    batched: bool = True
    counter: bool = False
    file: str = ""


class ValveModel(Protocol):
    """What is identified from a cycle, and how it predicts.

    Attributes
    ----------
    name : str
        Name in configurations, e.g. "press_cartridge".
    inputs : tuple of str
        Signal names of the commands, in the column order of `Frames.inputs`.
    output : str
        Signal name of the position.
    driven_by : tuple of str
        Inputs that the free run is computed from, what a model without physics may see, too;
        empty = all. A setpoint beside the currents that its controller makes is not among them.
    parameters : tuple of Parameter
        Every parameter that an estimator of this model may publish.
    options : frozen dataclass
        Options of estimation and prediction with their defaults, of a class that inherits from
        `ModelOptions`, fields declared by `core.quantity`; `ModelOptions()` where there are none.
    trend_estimator : str
        Name of the estimator that feeds the trend and the predictions.
    normalised : bool
        Whether inputs and output are parts of their full scale: percent are then recognised.
    variants : tuple of mapping
        Options under which further kernels run, which are then compiled at installation, too.
    budget_estimator : str
        Estimator that an error budget shows beside the trend's; empty = none.
    approximation_rows : int
        How many `approximations` there are.
    proposed_for : str
        Kind of record for which `configure` proposes the model, of `core.survey`; empty = none.
    demonstration : Demonstration
        How `make demo` shows the valve.
    feature_set : FeatureSet
        Which features are followed, and how: those of any valve without what means nothing here,
        and what `features` returns (`generic.features.feature_set`); empty = no features.
    """

    name: str
    inputs: tuple[str, ...]
    output: str
    parameters: tuple[Parameter, ...]
    options: Options
    trend_estimator: str
    driven_by: tuple[str, ...] = ()
    normalised: bool = False
    variants: tuple[Mapping[str, object], ...] = ()
    budget_estimator: str = ""
    approximation_rows: int = 0
    proposed_for: str = ""
    demonstration: Demonstration = Demonstration()
    feature_set: FeatureSet = FEATURE_SET

    def estimate(
        self, cycle: Cycle, options: Options, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate every configured estimator's parameters from one cycle.

        Deterministic; never raises for bad data: a refusal is an `Estimate` with its reason.
        Leaves `mse_test`, `fit_test`, standard errors and limits that need other cycles at NaN:
        `estimation.sequence` fills them.

        Parameters
        ----------
        cycle : Cycle
            Samples of one cycle.
        options : dataclass
            The model's options.
        earlier : sequence of Estimate
            Estimates of the cycles before, oldest first: what does not age, such as a ratio of
            noises, may be pooled with them; what is trended comes from this cycle alone.
        """
        ...

    def coefficients(
        self, values: Mapping[str, float], lag: int, period_s: float, options: Options
    ) -> FloatArray:
        """Return the (K,) coefficients of `predict` for parameter values.

        Parameters
        ----------
        values : mapping
            Parameter values by name, all finite [unit of each].
        lag : int
            Input to output lag [samples].
        period_s : float
            Sampling time [s].
        options : dataclass
            The model's options.
        """
        ...

    def initial_state(self) -> FloatArray:
        """Return the (S,) state of `predict` before the first sample."""
        ...

    def predict(
        self,
        state: FloatArray,
        coefficients: FloatArray,
        position: FloatArray,
        inputs: FloatArray,
        restart: ByteArray,
        predicted: FloatArray,
        simulated: FloatArray,
        validity: ByteArray,
    ) -> None:
        """Predict N consecutive samples with one compiled kernel; same bits for any block length.

        A sample whose past is too short gets NaN and STARTING; AT_SEAT and STALE as in `Validity`.
        `predicted[n]` may use positions before n only.

        Parameters
        ----------
        state : (S,) array
            Written in place [unit by state].
        coefficients : (K,) array
            What `coefficients` returned [unit by coefficient].
        position : (N,) array
            Measured position; may be NaN where the sample is not valid [unit of the signal].
        inputs : (N, M) array
            Commands in the order of `inputs` [unit of the signals].
        restart : (N,) uint8 array
            0 = go on, 1 = a new cycle starts here (the free run starts from the measured position,
            the measured past stays), 2 = a gap or clock jump lies before this sample (forget the
            past), 3 = the sample is not valid (hold, mark BAD_INPUT); see `Restart`.
        predicted, simulated : (N,) arrays
            Overwritten with one-step prediction and free run [unit of the signal].
        validity : (N,) uint8 array
            Overwritten with one `Validity` a sample.
        """
        ...

    def input_fault(self, cycle: Cycle, options: Options) -> str:
        """Return in one line why the signals cannot be what is configured; empty = plausible.

        Parameters
        ----------
        cycle : Cycle
            At least one sample.
        options : dataclass
            The model's options.
        """
        del cycle, options
        return ""

    def scales(self, options: Options) -> Mapping[str, Scale]:
        """Return how signals are shown to people, by name; others are shown as they are."""
        del options
        return {}

    def also_followed(self, options: Options) -> tuple[str, ...]:
        """Return parameters whose aging `configure` follows beside those marked `trend`.

        Parameters
        ----------
        options : dataclass
            The model's options: a term that is on has parameters of its own.
        """
        del options
        return ()

    def bench_fits(self) -> tuple[BenchFit, ...]:
        """Return the kinds of test-bench records that are evaluated with this valve."""
        return ()

    def judges(self, options: Options) -> bool:
        """Return whether estimates are judged by the cycles before and feed predictions."""
        del options
        return True

    def merge(self, estimates: Sequence[Estimate]) -> Mapping[str, float]:
        """Return what several cycles together know: the newest finite value of each parameter.

        Parameters
        ----------
        estimates : sequence of Estimate
            Of one estimator, oldest first, at least one, none refused.
        """
        found: dict[str, float] = {}
        for estimate in reversed(estimates):  # the newest mostly has them all
            for p in estimate.parameters:
                if p.name not in found and isfinite(p.value):
                    found[p.name] = p.value
        return found

    def options_for(self, cycle: FloatArray, period_s: float) -> Mapping[str, object]:
        """Return options that `configure` reads off the mean cycle of a record without commands.

        Parameters
        ----------
        cycle : (N,) array
            The output over a cycle, the mean of many [unit of the output].
        period_s : float
            Sampling time [s].
        """
        del cycle, period_s
        return {}

    def features(self, cycle: Cycle, options: Options) -> tuple[ParameterValue, ...]:
        """Return what a cycle shows of faults beyond the features of any valve."""
        del cycle, options
        return ()

    def signatures(self) -> SignatureTable | None:
        """Return how faults change the features; None = those of any valve do.

        These are `TABLE` of a module `signatures` beside the model's, else derived from its
        simulation: `generic.signatures.signatures_of`.
        """
        return None

    def approximations(
        self, simulation: SimulationConfig, commands: FloatArray, values: Mapping[str, float]
    ) -> tuple[Approximation, ...]:
        """Return what the approximations behind the model change in the output of a cycle.

        Parameters
        ----------
        simulation : SimulationConfig
            The simulated valve.
        commands : (N, M) array
            Recorded commands of one cycle [unit of the signals].
        values : mapping
            Identified parameters by name [unit of each].
        """
        del simulation, commands, values
        return ()

    def simulation(self) -> SimulationConfig | None:
        """Return the valve's default simulation; None = it cannot be simulated."""
        return None

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return valves that are not as the options say: simulation values by name and by key."""
        return {}

    def truth(self, simulation: SimulationConfig, cycle: int) -> Mapping[str, float]:
        """Return the true values of followed parameters in a cycle of the simulated valve.

        Parameters
        ----------
        simulation : SimulationConfig
            The simulation with its laws of aging; its scatter plays no part.
        cycle : int
            Number of the cycle.

        Returns
        -------
        mapping
            By name [unit of the parameter]; here the plant's numbers of the same name and unit.
        """
        numbers = simulation.plant_numbers(cycle)
        followed = [(p.name, p.unit) for p in self.parameters if p.trend]
        return {key[0]: numbers[key] for key in followed if key in numbers}


def option_descriptors(model: ValveModel, prefix: str = "") -> tuple[Descriptor, ...]:
    """Return the descriptors of a model's options; one named like a parameter starts its search.

    Parameters
    ----------
    model : ValveModel
        The model.
    prefix : str
        What stands before the names, with its dot.
    """
    estimated = {f"{prefix}{p.name}" for p in model.parameters}
    return tuple(
        replace(d, note="estimated, this is where the search starts") if d.name in estimated else d
        for d in describe(model.options, prefix)
    )


def estimator_choices(model: ValveModel) -> tuple[str, ...]:
    """Return the estimators that a model's options choose from; empty = there is no choice."""
    return next((d.choices for d in describe(model.options) if d.name == "estimators"), ())
