# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""QoS profiles: what the publisher of a recorded topic offered, what a user wants instead.

The words and the file are those of rosbag2: `offered_qos_profiles` in the bag, and a YAML file
that maps topics to policies.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from valve_twin.core.quantity import suggest
from valve_twin.io.errors import ConfigError
from valve_twin.io.limits import load_yaml

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

FOREVER_NS = 2**63 - 1
"""A duration that never ends [ns]."""

_WORDS: dict[str, dict[object, str]] = {
    "reliability": {1: "reliable", 2: "best_effort"},
    "durability": {1: "transient_local", 2: "volatile"},
    "history": {1: "keep_last", 2: "keep_all"},
    "liveliness": {1: "automatic", 3: "manual_by_topic"},
}
_STRONGEST = {"reliability": "reliable", "durability": "transient_local", "history": "keep_all"}
_DURATIONS = {"deadline", "lifespan", "liveliness_lease_duration"}
_IGNORED = {"avoid_ros_namespace_conventions"}


@dataclass(frozen=True, slots=True)
class QosProfile:
    """What a publisher offers, in the order in which a bag says it; where it says nothing, this.

    Attributes
    ----------
    history, reliability, durability, liveliness : str
        In the words of rosbag2.
    depth : int
        History [messages].
    deadline, lifespan, liveliness_lease_duration : int
        Durations [ns].
    """

    history: str = "keep_last"
    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"
    deadline: int = FOREVER_NS
    lifespan: int = FOREVER_NS
    liveliness: str = "automatic"
    liveliness_lease_duration: int = FOREVER_NS

    @property
    def is_latched(self) -> bool:
        """Whether a subscriber that comes later gets what was sent before."""
        return self.durability == "transient_local"

    def as_map(self) -> dict[str, object]:
        """Return it as it stands in a bag."""
        values = {
            name: _seconds(value) if name in _DURATIONS else value
            for name, value in asdict(self).items()
        }
        return {**values, "avoid_ros_namespace_conventions": False}


def _seconds(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, 10**9)
    return {"sec": seconds, "nsec": rest}


def qos_text(profiles: Sequence[QosProfile]) -> str:
    """Return profiles as the text that channels carry."""
    return yaml.safe_dump([p.as_map() for p in profiles], sort_keys=False).strip()


def read_profiles(text: str) -> tuple[QosProfile, ...]:
    """Return the profiles that a channel carries; none where it says nothing that can be read.

    Parameters
    ----------
    text : str
        `offered_qos_profiles` of a bag: numbers or words; many bags write nothing.
    """
    try:
        listed = load_yaml(text) if text else None
    except yaml.YAMLError:
        return ()
    if not isinstance(listed, list):
        return ()
    return tuple(_read(one, QosProfile()) for one in listed if isinstance(one, dict))


def read_offer(text: str) -> QosProfile:
    """Return what was offered; of several publishers the strongest, which serves every subscriber.

    Parameters
    ----------
    text : str
        As `read_profiles` takes it.
    """
    return _strongest(list(read_profiles(text)) or [QosProfile()])


def read_overrides(path: str | Path) -> dict[str, dict[str, Any]]:
    """Return the policies by topic of a file such as `ros2 bag play` takes.

    Raises
    ------
    ConfigError
        If there is no such file or it holds something else; names the topic and the policy.
    """
    try:
        found = load_yaml(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as err:
        reason = err.strerror if isinstance(err, OSError) else "is no YAML"
        msg = f"{path}: cannot be read ({reason}); give a YAML file of policies by topic"
        raise ConfigError(msg) from err
    if not isinstance(found, dict) or not all(isinstance(v, dict) for v in found.values()):
        msg = f"{path}: is no map of topics; write '/topic:' and below it 'reliability: reliable'"
        raise ConfigError(msg)
    for topic, policies in found.items():
        override(QosProfile(), policies, f"{path}: topic '{topic}'")
    return {str(topic): dict(policies) for topic, policies in found.items()}


def override(offer: QosProfile, policies: Mapping[str, Any], where: str) -> QosProfile:
    """Return an offer with some policies replaced.

    Parameters
    ----------
    offer : QosProfile
        What was offered.
    policies : mapping
        Words, numbers or maps of seconds and nanoseconds by policy, as in YAML.
    where : str
        File and topic, for messages.


    Raises
    ------
    ConfigError
        If a policy or its value does not exist; names the nearest.
    """
    names = [f.name for f in fields(QosProfile)]
    for name, value in policies.items():
        if name in _IGNORED:
            continue
        if name not in names:
            msg = f"{where}: there is no policy '{name}'; {suggest(str(name), names)}"
            raise ConfigError(msg)
        if name in _WORDS and value not in {*_WORDS[name], *_WORDS[name].values()}:
            choices = ", ".join(sorted(_WORDS[name].values()))
            msg = f"{where}: {name} cannot be '{value}'; write one of {choices}"
            raise ConfigError(msg)
        is_size = isinstance(value, int) and not isinstance(value, bool) and value > 0
        if name == "depth" and not is_size:
            msg = f"{where}: depth cannot be '{value}'; write a whole number above 0"
            raise ConfigError(msg)
        if name in _DURATIONS and _duration(value) is None:
            msg = f"{where}: {name} cannot be '{value}'; write it as {{sec: 1, nsec: 0}}"
            raise ConfigError(msg)
    return _read(policies, offer)


def _read(policies: Mapping[str, Any], before: QosProfile) -> QosProfile:
    """Take over the policies that can be read; what is unknown or unset stays."""
    found: dict[str, Any] = {}
    for name, words in _WORDS.items():
        value = policies.get(name)
        word = words.get(value, value)
        if word in words.values():
            found[name] = word
    depth = policies.get("depth")
    if isinstance(depth, int) and depth > 0:
        found["depth"] = depth
    for name in _DURATIONS:
        duration = _duration(policies.get(name))
        if duration is not None:
            found[name] = duration
    return replace(before, **found)


def _duration(value: object) -> int | None:
    """Read seconds and nanoseconds [ns]; zero is unset, which never ends."""
    if not isinstance(value, dict):
        return None
    try:
        total = int(value.get("sec", 0)) * 10**9 + int(value.get("nsec", 0))
    except (TypeError, ValueError):
        return None
    if total < 0:
        return None
    return min(total, FOREVER_NS) if total else FOREVER_NS


def _strongest(offers: list[QosProfile]) -> QosProfile:
    found = offers[0]
    for offer in offers[1:]:
        words = {
            name: word
            for name, word in _STRONGEST.items()
            if word in (getattr(found, name), getattr(offer, name))
        }
        found = replace(
            found,
            **words,
            depth=max(found.depth, offer.depth),
            deadline=min(found.deadline, offer.deadline),
            lifespan=max(found.lifespan, offer.lifespan),
            liveliness_lease_duration=min(
                found.liveliness_lease_duration, offer.liveliness_lease_duration
            ),
        )
    return found
