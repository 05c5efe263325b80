"""Faults as a language: what goes wrong on purpose, to whom, from when to when.

    kind:target@at_s[+for_s][,key=value]     on the command line
    [[faults]] kind, target, at_s, for_s     the same in a scenario

    parse(text) <--> text_of(fault)      choose(fault, ...) -> the rows that it strikes

A fault is due at tick round(at_s / dt_s) and over at round((at_s + for_s) / dt_s), or never. What a
kind does to processes is the supervisor's to carry out, to radio, sensors and motors the world's.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, get_args

import msgspec
import numpy as np
from msgspec import Meta

from swarm import errors

# A robot's name, several joined by `/`, or: `leader`, whoever leads then; `all`; `any:0.3`, so many
# of those that live, drawn by the seed; `world`, the process that all are in.
Target = Annotated[str, Meta(min_length=1, max_length=20_000)]
Seconds = Annotated[float, Meta(ge=0.0, le=1e6)]
Lasting = Annotated[float, Meta(gt=0.0, le=1e6)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]

EVERYONE = "all"
LEADER = "leader"
WORLD = "world"
ANY = "any:"
STREAM = 7  # of the draws for `any:`, apart from all other streams of the seed


class _Fault(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"
):
    """What all kinds have; `for_s` None lasts to the end of the run."""

    target: Target
    at_s: Seconds  # simulation time
    for_s: Lasting | None = None

    of_world: ClassVar[bool] = False  # whether `world` may be its target


# --- processes ----------------------------------------------------------------------------------


class Kill(_Fault, frozen=True, kw_only=True, tag="kill"):
    """SIGKILL. Whether it is started again is up to the restart policy."""

    of_world: ClassVar[bool] = True


class Restart(_Fault, frozen=True, kw_only=True, tag="restart"):
    """SIGKILL, and a new process `for_s` later: it remembers nothing."""

    for_s: Lasting | None = 1.0


class Hang(_Fault, frozen=True, kw_only=True, tag="hang"):
    """SIGSTOP, and SIGCONT at the end: it remembers all, and has missed what went by."""


class Slow(_Fault, frozen=True, kw_only=True, tag="slow"):
    """Its commands, beacons with them, come so much too late, in whole ticks; none is lost.

    Later than clock.command_ttl they move nothing: the body brakes. At the end all that is on its
    way comes at once, and the newest counts. Of several the longest.
    """

    late_s: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.16


# --- links: beacons to and from the target ------------------------------------------------------
# Whom the radio does not reach hears nothing all the same. Every link is drawn for itself, in every
# tick. Commands and frames are not touched.


class Loss(_Fault, frozen=True, kw_only=True, tag="loss"):
    """Each beacon to or from the target is lost with this probability."""

    probability: Share = 0.2


class Delay(_Fault, frozen=True, kw_only=True, tag="delay"):
    """Beacons to or from the target arrive so much later, in whole ticks.

    At first nothing arrives: it is on its way. At the end the newest arrives at once, and what was
    on its way is lost. Of several on one link the longest.
    """

    delay_s: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.16


class Duplicate(_Fault, frozen=True, kw_only=True, tag="duplicate"):
    """With this probability the beacon before the newest arrives once more, after the newest.

    Both ways, and only together with the newest: what is lost is lost twice.
    """

    probability: Share = 0.2


class Partition(_Fault, frozen=True, kw_only=True, tag="partition"):
    """The target and all others do not hear each other; within both groups they do."""


class Deaf(_Fault, frozen=True, kw_only=True, tag="deaf"):
    """The target hears nobody."""


class Mute(_Fault, frozen=True, kw_only=True, tag="mute"):
    """Nobody hears the target."""


# --- sensors: the lidar. Poses and twists stay true --------------------------------------------


class Dropout(_Fault, frozen=True, kw_only=True, tag="dropout"):
    """Each beam misses what it should hit with this probability, in every tick anew: inf."""

    probability: Share = 0.2


class SensorStuck(_Fault, frozen=True, kw_only=True, tag="sensor-stuck"):
    """The lidar shows the scan of the tick when it began, over and over, with its faults then."""


class Noise(_Fault, frozen=True, kw_only=True, tag="noise"):
    """Ranges are off by a normal deviate, clipped at three sigma and never out of [0, range]."""

    sigma_m: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.02


class Bias(_Fault, frozen=True, kw_only=True, tag="bias"):
    """Ranges are off by so much, all the same way, never out of [0, range]; a miss stays one."""

    bias_m: Annotated[float, Meta(ge=-5.0, le=5.0)] = 0.05


class Nan(_Fault, frozen=True, kw_only=True, tag="nan"):
    """All ranges are NaN: invalid, as REP-117 says."""


# --- motors: what the body makes of the set-point. A robot that is dead brakes all the same ----


class ActuatorStuck(_Fault, frozen=True, kw_only=True, tag="actuator-stuck"):
    """The motors keep the set-point that was in force when it began, whatever they are told."""


class Weak(_Fault, frozen=True, kw_only=True, tag="weak"):
    """The motors take only this share, in speed and turn rate, of every set-point."""

    factor: Share = 0.5


class Dead(_Fault, frozen=True, kw_only=True, tag="dead"):
    """The motors brake and do not turn any more; radio and lidar work on."""


# --- what is around -----------------------------------------------------------------------------


class Corrupt(_Fault, frozen=True, kw_only=True, tag="corrupt"):
    """Garbage on the target's topics, both ways, beside what belongs there."""


class DiskFull(_Fault, frozen=True, kw_only=True, tag="disk-full"):
    """The recorder's disk takes nothing."""

    target: Target = WORLD
    of_world: ClassVar[bool] = True


ProcessFault = Kill | Restart | Hang
LinkFault = Loss | Delay | Duplicate | Partition | Deaf | Mute
SensorFault = Dropout | SensorStuck | Noise | Bias | Nan
ActuatorFault = ActuatorStuck | Weak | Dead
Fault = (
    Kill
    | Restart
    | Hang
    | Slow
    | Loss
    | Delay
    | Duplicate
    | Partition
    | Deaf
    | Mute
    | Dropout
    | SensorStuck
    | Noise
    | Bias
    | Nan
    | ActuatorStuck
    | Weak
    | Dead
    | Corrupt
    | DiskFull
)
KINDS: dict[str, type[_Fault]] = {
    str(type_.__struct_config__.tag): type_ for type_ in get_args(Fault)
}
ONLY_WORLD = (DiskFull,)

_SPEC = re.compile(
    r"^(?P<kind>[a-z-]+):(?P<target>[^@+,]+)(?:@(?P<at>[0-9.eE-]+))?(?:\+(?P<lasts>[0-9.eE-]+))?"
    r"(?P<others>(?:,[a-z_]+=[^,]*)*)\Z"
)
EXAMPLE = "kind:target@start_s[+for_s][,key=value] such as kill:robot3@9.6 or loss:all@0"


def table(spec: str, *, at_s: float | None = None, where: str = "--fault") -> dict[str, Any]:
    """Table of a fault as the command line writes it; raises ScenarioError.

    Args:
        at_s: when it begins if the text does not say: now, for a swarm that runs.
    """
    match = _SPEC.match(spec.strip())
    try:
        if match is None or (match["at"] is None and at_s is None):
            raise ValueError
        result: dict[str, Any] = {
            "kind": match["kind"],
            "target": match["target"],
            "at_s": at_s if match["at"] is None else float(match["at"]),
        }
        if match["lasts"] is not None:
            result["for_s"] = float(match["lasts"])
        for pair in filter(None, match["others"].split(",")):
            key, _, text = pair.partition("=")
            result[key] = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, tomllib.TOMLDecodeError) as error:
        raise errors.ScenarioError(f"{where}: expected {EXAMPLE}, got '{spec}'") from error
    return result


def kind_of(fault: Fault) -> str:
    """Word for what it does."""
    return str(fault.__struct_config__.tag)


def text_of(fault: Fault) -> str:
    """The fault as the command line writes it; `table` reads it again."""
    lasts = "" if fault.for_s is None else f"+{fault.for_s:.9g}"
    others = "".join(f",{name}={getattr(fault, name):.9g}" for name in fault.__struct_fields__[3:])
    return f"{kind_of(fault)}:{fault.target}@{fault.at_s:.9g}{lasts}{others}"


def names_in(target: str) -> tuple[str, ...]:
    """Robots that a target names; none for a role, a share or the world."""
    if target in (EVERYONE, LEADER, WORLD) or target.startswith(ANY):
        return ()
    return tuple(target.split("/"))


def choose(
    target: str,
    names: Sequence[str],
    alive: Sequence[bool],
    leader: str | None,
    *,
    seed: int,
    number: int,
) -> tuple[int, ...]:
    """Rows of the robots that a fault strikes when it is due.

    Args:
        leader: who leads at that moment, None when nobody does.
        number: of the fault in the run, so that two of a kind draw apart.
    Returns:
        rising; empty for the world, or when nobody of them is there.
    """
    if target == EVERYONE:
        return tuple(range(len(names)))
    if target == LEADER:
        return () if leader is None else (names.index(leader),)
    if target.startswith(ANY):
        living = [row for row, lives in enumerate(alive) if lives]
        if not living:
            return ()
        count = min(len(living), max(1, round(float(target.removeprefix(ANY)) * len(living))))
        generator = np.random.Generator(
            np.random.Philox(key=[seed, STREAM], counter=[0, 0, number, 0])
        )
        drawn = generator.choice(len(living), size=count, replace=False)
        return tuple(sorted(living[index] for index in drawn.tolist()))
    return tuple(sorted(names.index(name) for name in names_in(target) if name in names))


def problem_of(fault: Fault, names: Sequence[str]) -> str | None:
    """What is wrong with a fault's target, as "expected ..., got ...", None when nothing is."""
    if fault.target == WORLD:
        if not fault.of_world:
            return f"expected a robot for '{kind_of(fault)}', got 'world'"
        return None
    if isinstance(fault, ONLY_WORLD):
        return f"expected 'world' for '{kind_of(fault)}', got '{fault.target}'"
    if fault.target.startswith(ANY) and not _is_share(fault.target.removeprefix(ANY)):
        return f"expected a share from 0 to 1 such as any:0.3, got '{fault.target}'"
    for name in names_in(fault.target):
        if name not in names:
            return (
                f"expected one of {', '.join(names)}, {LEADER}, {EVERYONE}, any:SHARE"
                f"{', world' if fault.of_world else ''}, got '{name}'"
            )
    if isinstance(fault, Kill) and fault.for_s is not None:
        return "expected no duration for 'kill' (use 'restart'), got one"
    return None


def _is_share(text: str) -> bool:
    return re.fullmatch(r"[0-9]*\.?[0-9]+", text) is not None and float(text) <= 1.0
