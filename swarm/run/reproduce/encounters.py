"""Fig. 12: six robots meet head-on in pairs, with priorities and without."""

from __future__ import annotations

from collections.abc import Sequence

from dashboards import figures
from swarm.run.reproduce import claims, experiments
from swarm.run.reproduce.claims import Run
from swarm.run.reproduce.experiments import Claim, Draw, Experiment, Figure, Picture

MUTUAL_K_E = 1.0  # where robots treat each other as obstacles: 0.01 leaves the side to chance
# panels (a) to (d) of Fig. 12: layout, scenario, strategy
PANELS = (
    ("lanes", "head-on-pairs", "priority"),
    ("star", "head-on-star", "priority"),
    ("lanes", "head-on-pairs", "mutual"),
    ("star", "head-on-star", "mutual"),
)
LAYOUTS = PANELS[:2]  # a navigator has one strategy, its own


def table() -> dict[str, Figure]:
    """Figures by name."""
    return {"fig12": _meeting()}


def _encounter(layout: str, scenario: str, strategy: str) -> Experiment:
    settings = [f"priority.strategy={strategy}", "robot.controller=paper"]
    if strategy == "mutual":
        settings.append(f"field.k_e={MUTUAL_K_E}")
    name = f"{layout}-{strategy}-paper"
    return Experiment(name=name, scenario=scenario, settings=tuple(settings))


def _meeting() -> Figure:
    paper = tuple(_encounter(*panel) for panel in PANELS)
    ours = tuple(
        Experiment(
            name=f"{layout}-navigator",
            scenario=scenario,
            settings=("robot.controller=navigator",),
        )
        for layout, scenario, _ in LAYOUTS
    )
    said: list[Claim] = []
    for letter, (layout, _, strategy), one in zip("abcd", PANELS, paper, strict=True):
        where = f"({letter}) {layout}, {strategy}, paper"
        said += _claims(where, one, waits=strategy == "priority")
    for (layout, _, _), one in zip(LAYOUTS, ours, strict=True):
        said += _claims(f"{layout}, navigator", one, waits=False)
    return Figure(
        "Fig. 12: collision avoidance between robots",
        (*paper, *ours),
        (
            Picture(
                "fig12-paper",
                "Controller paper. Left: the higher priority passes, the others wait. Right: all "
                "are moving obstacles to each other. Digits are the robots' positions at the same "
                "times.",
                experiments.names(paper),
                _draw([f"{layout}, {strategy}" for layout, _, strategy in PANELS]),
            ),
            Picture(
                "fig12-navigator",
                "Controller navigator: all go round each other on the right.",
                experiments.names(ours),
                _draw([layout for layout, _, _ in LAYOUTS]),
            ),
        ),
        tuple(said),
    )


def _claims(where: str, one: Experiment, *, waits: bool) -> list[Claim]:
    return [
        Claim(f"{where}: collisions are avoided", (one.name,), claims.all_arrive_without_contact),
        Claim(
            f"{where}: the first passes, others stop and wait"
            if waits
            else f"{where}: all avoid each other, without priorities",
            (one.name,),
            claims.first_passes_others_wait if waits else claims.nobody_waits,
        ),
    ]


def _draw(titles: Sequence[str]) -> Draw:
    def draw(runs: Sequence[Run]) -> bytes:
        paths = {title: run.tracks for title, run in zip(titles, runs, strict=True)}
        return figures.png(figures.encounters(paths))

    return draw
