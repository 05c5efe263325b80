"""One page that tells a run to somebody who was not there; or two runs side by side.

    Run --numbers--> Report, the `--json` object       Run --html--> text of the page
    Run, Run --comparison--> text                      Run --pngs--> the figures as files

What a Run is made of is read by swarm.run.report; here is only what is made of it.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Sequence
from math import isfinite

import msgspec
import numpy as np

from dashboards import charts, course, drawing, incidents, narrative, page, tracks, traffic
from dashboards.charts import Load
from dashboards.course import Course, Nearest, Waiting
from dashboards.incidents import Incident
from dashboards.traffic import TopicRow
from swarm import metrics
from swarm.geometry import Floats
from swarm.recording import Verdict

TEMPLATE = "report.html"
COMPARISON = "comparison.html"
Number = float | None


class ProcessRow(msgspec.Struct, frozen=True):
    """What the processes of one name used, all that ever had it."""

    name: str
    processes: int
    cpu_s: float
    cpu_mean: float  # share of one core
    cpu_most: float
    memory_mb_max: float


class Run(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All that is known of a run."""

    name: str  # of its folder
    seen: Course
    summary: metrics.Summary
    verdict: Verdict
    versions: dict[str, str]
    scenario_toml: str
    command: str  # that makes the run again
    processes: tuple[ProcessRow, ...]
    loads: tuple[Load, ...]
    problems: tuple[str, ...]  # why this page cannot be the whole truth

    @property
    def ok(self) -> bool:
        """Whether the run is what it should be: succeeded, and nothing expected is missed."""
        return self.summary.outcome == "succeeded" and not self.summary.expect.missed


class Series(msgspec.Struct, frozen=True):
    """What the figures draw; nan and inf are None. Lists are by tick."""

    times_s: list[Number]
    formation_error_m: list[Number]
    robots: dict[str, dict[str, list[Number] | list[str]]]


class Report(msgspec.Struct, frozen=True):
    """The object of `swarm report --json`."""

    ok: bool
    summary: metrics.Summary
    lead: str
    words: tuple[str, ...]
    problems: tuple[str, ...]
    incidents: tuple[Incident, ...]
    nearest_robot: Nearest | None
    nearest_obstacle: Nearest | None
    waits: tuple[Waiting, ...]
    topics: tuple[TopicRow, ...]
    processes: tuple[ProcessRow, ...]
    recording: Verdict
    versions: dict[str, str]
    command: str
    series: Series


def numbers(run: Run) -> Report:
    """Every number of the page."""
    found = incidents.incidents(run.seen, run.summary)
    story = narrative.tell(run.seen, run.summary, found)
    return Report(
        ok=run.ok,
        summary=run.summary,
        lead=story.lead,
        words=story.paragraphs,
        problems=run.problems,
        incidents=found,
        nearest_robot=course.nearest_robot(run.seen),
        nearest_obstacle=course.nearest_obstacle(run.seen),
        waits=course.waits(run.seen),
        topics=traffic.rows(run.seen, run.summary),
        processes=run.processes,
        recording=run.verdict,
        versions=run.versions,
        command=run.command,
        series=_series(run.seen),
    )


def pngs(run: Run) -> Iterator[tuple[str, bytes]]:
    """Name and PNG of every figure."""
    for chart in _charts(run):
        yield chart.name, charts.png(chart)


# --- the page -----------------------------------------------------------------------------------


class Drawn(msgspec.Struct, frozen=True):
    """A figure as the page holds it."""

    name: str
    title: str
    caption: str
    svg: str


class Told(msgspec.Struct, frozen=True):
    """One incident as the page tells it."""

    number: int
    incident: Incident
    who: str


class View(msgspec.Struct, frozen=True, kw_only=True):
    """One run, ready for the page."""

    run: Run
    story: narrative.Story
    incidents: tuple[Told, ...]
    figures: tuple[Drawn, ...]
    waits: tuple[Waiting, ...]
    topics: tuple[TopicRow, ...]
    merits: tuple[Merit, ...]
    tenures: tuple[Tenure, ...]
    scenario_link: str
    colours: tuple[tuple[str, str, str], ...]  # variable, upon light, upon dark


class Tenure(msgspec.Struct, frozen=True):
    """Someone's time as the leader."""

    name: str
    term: int
    tick: int
    start_s: float
    end_s: float


def html(run: Run) -> str:
    """The page of one run."""
    return page.render(TEMPLATE, view=_view(run, ""))


def comparison(a: Run, b: Run) -> str:
    """The page of two runs."""
    views = (_view(a, "a-"), _view(b, "b-"))
    rows = [compare(*pair) for pair in zip(views[0].merits, views[1].merits, strict=True)]
    names = [chart.name for view in views for chart in view.figures]
    figures = [
        [next((one for one in view.figures if one.name == name), None) for view in views]
        for name in dict.fromkeys(names)
    ]
    return page.render(COMPARISON, views=views, rows=rows, figures=figures)


def _view(run: Run, prefix: str) -> View:
    seen, summary = run.seen, run.summary
    found = incidents.incidents(seen, summary)
    colours = _colours(run, prefix)
    variables = {light: name for name, light, _ in colours}
    toml = base64.b64encode(run.scenario_toml.encode()).decode()
    return View(
        run=run,
        story=narrative.tell(seen, summary, found),
        incidents=tuple(
            Told(
                number,
                one,
                narrative.names(one.robots) if one.robots else "world",
            )
            for number, one in enumerate(found, 1)
        ),
        figures=tuple(
            Drawn(chart.name, chart.title, chart.caption, charts.svg(chart, variables))
            for chart in _charts(run)
        ),
        waits=course.waits(seen),
        topics=traffic.rows(seen, summary),
        merits=merits(run),
        tenures=tuple(_tenures(run)),
        scenario_link=f"data:application/toml;base64,{toml}",
        colours=colours,
    )


def _charts(run: Run) -> tuple[charts.Chart, ...]:
    found = incidents.incidents(run.seen, run.summary)
    return charts.charts(run.seen, run.summary, found, run.loads)


def _colours(run: Run, prefix: str) -> tuple[tuple[str, str, str], ...]:
    """Lines of robots: dark upon light ground, and the other way round."""
    path = run.seen.path
    return tuple(
        (f"{prefix}robot-{row}", dark[:7], light[:7])
        for row, (dark, light) in enumerate(
            zip(drawing.colours(path, drawing.LINE_SHARE), drawing.colours(path), strict=True)
        )
    )


def _tenures(run: Run) -> Iterator[Tenure]:
    dt_s = run.seen.path.scenario.dt_s
    leaders = run.summary.leaders
    for number, row in enumerate(leaders):
        end = leaders[number + 1].tick if number + 1 < len(leaders) else run.summary.ticks
        yield Tenure(row.name, row.term, row.tick, row.tick * dt_s, end * dt_s)


# --- figures of merit ---------------------------------------------------------------------------


class Merit(msgspec.Struct, frozen=True):
    """One figure of a run, and which way is better: 1 more, -1 less, 0 neither."""

    label: str
    value: Number
    unit: str
    digits: int
    better: int
    main: bool = False  # for who wants only a few

    @property
    def text(self) -> str:
        """For people."""
        return number(self.value, self.unit, self.digits)


def number(value: Number, unit: str = "", digits: int = 0) -> str:
    """A figure with its unit; a dash for what does not apply."""
    if value is None or not isfinite(value):
        return "–"  # noqa: RUF001
    return f"{round(value, digits) + 0.0:.{digits}f}{' ' + unit if unit else ''}"


def merits(run: Run) -> tuple[Merit, ...]:
    """What tells one run from another, most important first."""
    summary = run.summary
    formation = summary.formation
    of_formation: Callable[[str], Number] = lambda name: (  # noqa: E731
        None if formation is None else getattr(formation, name)
    )
    beacons = next(row for row in traffic.rows(run.seen, summary) if row.topic == "beacon")
    recorded = summary.recording
    return (
        Merit("robots that arrived", summary.arrived, "", 0, 1, True),
        Merit("collisions", summary.collisions, "", 0, -1, True),
        Merit("expectations missed", len(summary.expect.missed), "", 0, -1, True),
        Merit("last arrival", summary.makespan_s, "s", 2, -1, True),
        Merit("path over straight way, mean", summary.path_ratio_mean, "", 3, -1),
        Merit("least distance to an obstacle", summary.min_clearance_obstacle_m, "m", 3, 1, True),
        Merit("least distance between robots", summary.min_clearance_robot_m, "m", 3, 1, True),
        Merit("formation error, largest", of_formation("error_m_max"), "m", 3, -1, True),
        Merit("formation error, final", of_formation("error_m_final"), "m", 3, -1, True),
        Merit("formation settled after", of_formation("settling_s"), "s", 2, -1, True),
        Merit("mirror images off by", of_formation("symmetry_m"), "m", 3, -1),
        Merit("times robots gave way", summary.priority.yields, "", 0, -1),
        Merit("longest wait of a robot, in all", summary.priority.waiting_s_max, "s", 2, -1, True),
        Merit("times a guard held a robot", summary.priority.guard_interventions, "", 0, -1),
        Merit("changes of the leader", max(0, len(summary.leaders) - 1), "", 0, 0, True),
        Merit("faults injected", len({fault_key(row) for row in summary.faults}), "", 0, 0),
        Merit("restarts of robots", sum(row.restarts for row in summary.per_robot), "", 0, 0),
        Merit("restarts of the world", summary.world_restarts, "", 0, 0),
        Merit("commands that came late", summary.late_commands, "", 0, -1),
        Merit(
            "beacons lost within range",
            100.0 * beacons.lost / beacons.expected if beacons.expected else None,
            "%",
            2,
            -1,
        ),
        Merit("messages not recorded", None if recorded is None else recorded.lost, "", 0, -1),
        Merit("simulated time", summary.sim_time_s, "s", 2, 0, True),
        Merit("times real time", summary.real_time_factor, "", 2, 1),
        Merit(
            "CPU of all processes",
            sum(row.cpu_s for row in run.processes) if run.processes else None,
            "s",
            2,
            -1,
        ),
    )


def fault_key(row: metrics.FaultRow) -> tuple[str, int]:
    """One fault may strike many at once."""
    return row.kind, row.tick


class MeritPair(msgspec.Struct, frozen=True):
    """One figure of two runs."""

    label: str
    a: str
    b: str
    difference: str
    verdict: str  # of the second against the first: "better", "worse" or ""


def compare(a: Merit, b: Merit) -> MeritPair:
    """The same figure of two runs; what does not apply any more is worse."""
    difference, verdict = "", ""
    if a.value is not None and b.value is not None:
        change = b.value - a.value
        difference = f"{change:+.{a.digits}f}{' ' + a.unit if a.unit else ''}"
        if abs(change) < 0.5 * 10.0**-a.digits:
            difference = "="
        elif a.better:
            verdict = "better" if change * a.better > 0 else "worse"
    elif a.value != b.value and a.better:
        verdict = "worse" if b.value is None else "better"
    return MeritPair(a.label, a.text, b.text, difference, verdict)


# --- what the figures draw ----------------------------------------------------------------------


def _series(seen: Course) -> Series:
    path = seen.path
    distance_m, bearing_rad, off_m = tracks.tracking_errors(path)
    names = [robot.name for robot in path.scenario.robots]
    columns = {
        "x_m": path.poses[:, :, 0],
        "y_m": path.poses[:, :, 1],
        "yaw_rad": path.poses[:, :, 2],
        "force_angle_rad": path.forces_rad,
        "distance_error_m": distance_m,
        "bearing_error_rad": bearing_rad,
        "slot_error_m": off_m,
        "clearance_obstacle_m": seen.clearance_obstacle_m,
        "clearance_robot_m": seen.clearance_robot_m,
    }
    robots: dict[str, dict[str, list[Number] | list[str]]] = {}
    for row, name in enumerate(names):
        robots[name] = {
            **{key: _plain(values[:, row]) for key, values in columns.items()},
            "state": [states[row] for states in path.states],
            "leader": [names[led] if led >= 0 else "" for led in path.leaders[:, row]],
        }
    return Series(_plain(path.times_s), _plain(course.formation_error_m(seen)), robots)


def _plain(values: Floats) -> list[Number]:
    found: Sequence[float] = values.tolist()
    return [
        value if finite else None for value, finite in zip(found, np.isfinite(values), strict=True)
    ]
