"""What a figure of the paper takes: experiments to run, pictures to draw, claims to measure.

Every experiment is a built-in scenario with settings and a seed, that is a `swarm run` of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from swarm.run.reproduce.claims import Measure, Run

CONTROLLERS = ("paper", "navigator")  # where both are asked

Draw = Callable[[Sequence[Run]], bytes]  # a PNG


class Experiment(msgspec.Struct, frozen=True, kw_only=True):
    """One run to be made."""

    name: str  # also of its folder
    scenario: str  # built in
    settings: tuple[str, ...] = ()
    seed: int | None = None

    @property
    def command(self) -> str:
        """What a person types to make this run alone."""
        words = ["swarm run", self.scenario]
        words += [f"--set {setting}" for setting in self.settings]
        words += [] if self.seed is None else [f"--seed {self.seed}"]
        return " ".join(words)


class Picture(msgspec.Struct, frozen=True):
    """A picture of some experiments' runs, in the order of their names."""

    name: str
    caption: str
    of: tuple[str, ...]
    draw: Draw


class Claim(msgspec.Struct, frozen=True):
    """Something the paper says, measured on some experiments' runs."""

    text: str
    of: tuple[str, ...]
    measure: Measure


class Figure(msgspec.Struct, frozen=True):
    """One figure of the paper."""

    title: str
    experiments: tuple[Experiment, ...]
    pictures: tuple[Picture, ...]
    claims: tuple[Claim, ...]


def names(experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """Their names, for pictures and claims."""
    return tuple(experiment.name for experiment in experiments)
