"""Fig. 10 and 11: one robot among random obstacles, and the force that leads it."""

from __future__ import annotations

from collections.abc import Sequence

from dashboards import figures
from swarm.run.reproduce import claims, experiments
from swarm.run.reproduce.claims import Run
from swarm.run.reproduce.experiments import CONTROLLERS, Claim, Experiment, Figure, Picture

SEEDS = 8  # fields of Fig. 10; the paper shows one, of unknown obstacles


def table(seeds: int) -> dict[str, Figure]:
    """Figures by name; the fields are those of the seeds 1, 2, ..."""
    return {"fig10": _crossing(seeds), "fig11": _force_angle(seeds)}


def _crossings(controller: str, seeds: int) -> tuple[Experiment, ...]:
    return tuple(
        Experiment(
            name=f"single-robot-{controller}-{seed}",
            scenario="single-robot",
            settings=(f"robot.controller={controller}",),
            seed=seed,
        )
        for seed in range(1, seeds + 1)
    )


def _crossing(seeds: int) -> Figure:
    runs = {controller: _crossings(controller, seeds) for controller in CONTROLLERS}
    every = tuple(experiment for some in runs.values() for experiment in some)

    def draw(runs: Sequence[Run]) -> bytes:
        parts = [runs[first : first + seeds] for first in range(0, len(runs), seeds)]
        fields = [
            {name: run.tracks for name, run in zip(CONTROLLERS, some, strict=True)}
            for some in zip(*parts, strict=True)
        ]
        return figures.png(figures.fields(fields))

    return Figure(
        "Fig. 10: trajectories of a single robot among random obstacles",
        every,
        (
            Picture(
                "fig10",
                "The paper's controller and ours across the same fields, each drawn from its seed.",
                experiments.names(every),
                draw,
            ),
        ),
        tuple(
            Claim(
                f"the robot crosses a complex environment, {controller}",
                experiments.names(some),
                claims.all_arrive_without_contact,
            )
            for controller, some in runs.items()
        ),
    )


def _force_angle(seeds: int) -> Figure:
    runs = {controller: _crossings(controller, seeds) for controller in CONTROLLERS}
    firsts = tuple(some[0] for some in runs.values())

    def draw(runs: Sequence[Run]) -> bytes:
        titles = [f"controller {name}, seed 1" for name in CONTROLLERS]
        paths = {title: run.tracks for title, run in zip(titles, runs, strict=True)}
        return figures.png(figures.force_angles(paths))

    return Figure(
        "Fig. 11: angle of the resultant force",
        tuple(experiment for some in runs.values() for experiment in some),
        (
            Picture(
                "fig11",
                "Angle of the resultant force in the first field of Fig. 10, and the heading that "
                "follows it; both unwrapped, 45 degrees point from start to goal.",
                experiments.names(firsts),
                draw,
            ),
        ),
        tuple(
            Claim(
                f"the angle of the force matches the trajectories, {name}",
                experiments.names(some),
                claims.force_matches_trajectory,
            )
            for name, some in runs.items()
        ),
    )
