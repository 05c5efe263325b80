"""Fig. 12: six robots meet head-on in pairs, with priorities and without."""

from __future__ import annotations

from collections.abc import Sequence

from dashboards import figures
from swarm.run.reproduce import claims, experiments
from swarm.run.reproduce.claims import Run
from swarm.run.reproduce.experiments import CONTROLLERS, Claim, Experiment, Figure, Picture

MUTUAL_K_E = 1.0  # where robots treat each other as obstacles: 0.01 leaves the side to chance
# panels (a) to (d) of Fig. 12
ENCOUNTERS = (
    ("lanes", "head-on-pairs", "priority"),
    ("star", "head-on-star", "priority"),
    ("lanes", "head-on-pairs", "mutual"),
    ("star", "head-on-star", "mutual"),
)


def table() -> dict[str, Figure]:
    """Figures by name."""
    return {"fig12": _meeting()}


def _encounter(layout: str, scenario: str, strategy: str, controller: str) -> Experiment:
    settings = [f"priority.strategy={strategy}", f"robot.controller={controller}"]
    if strategy == "mutual":
        settings.append(f"field.k_e={MUTUAL_K_E}")
    name = f"{layout}-{strategy}-{controller}"
    return Experiment(name=name, scenario=scenario, settings=tuple(settings))


def _meeting() -> Figure:
    every: list[Experiment] = []
    pictures, said = [], []
    for controller in CONTROLLERS:
        some = [_encounter(*panel, controller) for panel in ENCOUNTERS]
        every += some
        pictures.append(
            Picture(
                f"fig12-{controller}",
                f"Controller {controller}. Left: the higher priority passes, the others wait. "
                "Right: all are moving obstacles to each other. Digits are the robots' positions "
                "at the same times.",
                experiments.names(some),
                _draw_encounters,
            )
        )
        for letter, (layout, _, strategy), one in zip("abcd", ENCOUNTERS, some, strict=True):
            where = f"({letter}) {layout}, {strategy}, {controller}"
            said.append(
                Claim(
                    f"{where}: collisions are avoided",
                    (one.name,),
                    claims.all_arrive_without_contact,
                )
            )
            waits = strategy == "priority"
            said.append(
                Claim(
                    f"{where}: the first passes, others stop and wait"
                    if waits
                    else f"{where}: all avoid each other, without priorities",
                    (one.name,),
                    claims.first_passes_others_wait if waits else claims.nobody_waits,
                )
            )
    return Figure(
        "Fig. 12: collision avoidance between robots", tuple(every), tuple(pictures), tuple(said)
    )


def _draw_encounters(runs: Sequence[Run]) -> bytes:
    titles = [f"{layout}, {strategy}" for layout, _, strategy in ENCOUNTERS]
    paths = {title: run.tracks for title, run in zip(titles, runs, strict=True)}
    return figures.png(figures.encounters(paths))
