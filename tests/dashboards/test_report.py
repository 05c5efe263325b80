"""The report: its numbers are the summary's, its words tell what happened, it stands alone."""

from __future__ import annotations

import html.parser
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from dashboards import charts, course, report
from swarm import errors, metrics
from swarm.run import report as reading
from tests.run import processes

MadeRun = Callable[..., Path]

KILL = "kill:robot1@2.4"
CHROMIUM = shutil.which("chromium")
WIDTHS = (1280, 390)
FEW = 2
FIGURES = ["timeline", "trajectories", "tracking", "formation", "clearances", "angles"]


class Page(html.parser.HTMLParser):
    """What is in a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.ids: list[str] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "xlink:href", "srcset", "poster", "data", "action"):
                self.links.append(value or "")
            if name == "id":
                self.ids.append(value or "")

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.texts.append(data.strip().replace("\xa0", " "))


@pytest.fixture(scope="module")
def killed(made_run: MadeRun) -> report.Run:
    return reading.read(made_run(KILL))


@pytest.fixture(scope="module")
def page(killed: report.Run) -> str:
    return report.html(killed)


@pytest.fixture(scope="module")
def compared(killed: report.Run, made_run: MadeRun) -> str:
    """Both runs with a few of their figures, which take the most time."""
    with pytest.MonkeyPatch.context() as patch:
        few(patch)
        return report.comparison(reading.read(made_run()), killed)


def few(patch: pytest.MonkeyPatch) -> None:
    draw = charts.charts
    patch.setattr(charts, "charts", lambda *arguments: draw(*arguments)[:FEW])


def summary_of(folder: Path) -> metrics.Summary:
    return msgspec.json.decode((folder / "summary.json").read_bytes(), type=metrics.Summary)


# --- numbers ------------------------------------------------------------------------------------


def test_numbers_are_those_of_the_summary(killed: report.Run, made_run: MadeRun) -> None:
    summary = summary_of(made_run(KILL))
    found = report.numbers(killed)
    assert found.summary == summary
    assert found.problems == ()
    assert summary.formation is not None
    error_m = course.formation_error_m(killed.seen)
    assert float(np.nanmax(error_m)) == pytest.approx(summary.formation.error_m_max, abs=1e-12)
    assert error_m[-1] == pytest.approx(summary.formation.error_m_final, abs=1e-12)
    assert found.nearest_robot is not None
    assert found.nearest_obstacle is not None
    assert found.nearest_robot.distance_m == pytest.approx(summary.min_clearance_robot_m, abs=1e-12)
    assert found.nearest_obstacle.distance_m == summary.min_clearance_obstacle_m
    assert sum(one.times for one in found.waits) >= summary.priority.yields
    waited_s = sum(row.waiting_s for row in summary.per_robot)
    assert sum(one.total_s for one in found.waits) == pytest.approx(waited_s)
    assert sum(row.came for row in found.topics if row.topic == "command") == summary.commands_total
    [fault] = summary.faults
    [incident] = found.incidents
    assert (incident.detected_s, incident.recovered_s) == (fault.detected_s, fault.recovered_s)
    assert len(found.series.times_s) == summary.ticks + 1


def test_page_shows_the_numbers_of_the_summary(page: str, killed: report.Run) -> None:
    texts = Page(page).texts
    summary = killed.summary
    assert f"{summary.min_clearance_robot_m:.3f} m" in texts
    assert f"{summary.min_clearance_obstacle_m:.3f} m" in texts
    assert summary.formation is not None
    assert f"{summary.formation.error_m_max:.3f} m" in texts
    assert f"{summary.formation.error_m_final:.3f} m" in texts
    assert f"{summary.sim_time_s:.2f} s" in texts
    assert f"{summary.makespan_s:.2f} s" in texts
    assert summary.state_hash in texts
    for row in summary.per_robot:
        assert f"{row.path_m:.2f} m" in texts
    for version in killed.versions.values():
        assert any(version in text for text in texts)


# --- words --------------------------------------------------------------------------------------


def test_reader_learns_who_was_killed_when_why_and_who_led_then(killed: report.Run) -> None:
    found = report.numbers(killed)
    [incident] = found.incidents
    assert (incident.kind, incident.robots, incident.led) == ("kill", ("robot1",), True)
    assert incident.successor in ("robot2", "robot3")
    assert incident.successor_s is not None
    assert incident.shape is not None
    assert incident.shape.settled_s is not None
    words = " ".join(found.words).replace("\xa0", " ")
    assert "the leader, robot1, was killed (SIGKILL) at 2.40 s" in found.lead.replace("\xa0", " ")
    assert "At 2.40 s (tick 30) robot1, which led the formation, was killed" in words
    assert f"as asked for by {KILL}" in words
    assert f"All followed {incident.successor} after {incident.successor_s:.2f} s" in words
    assert f"after {incident.shape.settled_s:.2f} s everyone was within 0.1 m" in words
    assert "nothing touched anything" in words
    assert "The one expectation of the scenario is met." in words


def test_reader_learns_that_nothing_went_wrong(made_run: MadeRun) -> None:
    found = report.numbers(reading.read(made_run()))
    assert found.ok
    assert found.incidents == ()
    assert found.lead.startswith("It succeeded")
    assert "No fault was planned." in found.words[0]


def test_one_fault_of_many_robots_is_one_incident_and_a_restart_is_told(made_run: MadeRun) -> None:
    run = reading.read(made_run("loss:all@0.8+1.6", "restart:robot3@1.6+0.8"))
    loss, restart = report.numbers(run).incidents
    assert (loss.kind, len(loss.robots), loss.over_s) == ("loss", 3, pytest.approx(1.6))
    assert (restart.kind, restart.robots, restart.led) == ("restart", ("robot3",), False)
    assert restart.back_s == pytest.approx(0.8)
    beacons = next(row for row in report.numbers(run).topics if row.topic == "beacon")
    assert beacons.lost > 0
    assert beacons.gap_ms_max is not None
    assert beacons.gap_ms_max > 80.0
    words = " ".join(report.numbers(run).words).replace("\xa0", " ")
    assert "After 0.80 s a new process of robot3 went on" in words


def test_world_that_is_killed_and_comes_back_takes_nobody_away(made_run: MadeRun) -> None:
    found = report.numbers(reading.read(made_run("kill:world@1.6")))
    [incident] = found.incidents
    assert (incident.kind, incident.robots, incident.back_s) == ("kill", (), 0.0)
    assert incident.shape is None
    assert "the world was killed (SIGKILL)" in " ".join(found.words)
    assert "It was started again and went on where it had been." in " ".join(found.words)


def test_change_of_the_leader_without_an_incident_is_told(killed: report.Run) -> None:
    last = killed.summary.leaders[-1]
    later = metrics.LeaderRow(tick=last.tick + 50, name="robot1", term=last.term + 1)
    summary = msgspec.structs.replace(killed.summary, leaders=[*killed.summary.leaders, later])
    words = report.numbers(msgspec.structs.replace(killed, summary=summary)).words
    when = f"robot1 at {later.tick * 0.08:.2f} s (term {later.term})".replace(" s (", "\xa0s (")
    assert f"The leader changed without such a cause: to {when}." in words
    assert not any("without such a cause" in text for text in report.numbers(killed).words)


# --- the page -----------------------------------------------------------------------------------


def test_page_needs_nothing_from_outside(page: str) -> None:
    found = Page(page)
    assert [link for link in found.links if not link.startswith(("#", "data:"))] == []
    assert {"script", "iframe", "object", "embed", "base"} & set(found.tags) == set()
    assert "@import" not in page
    assert not [part for part in page.split("url(")[1:] if not part.startswith("#")]


def test_page_has_every_figure_once_and_links_that_lead_somewhere(page: str) -> None:
    found = Page(page)
    assert [name for name in found.ids if name in FIGURES] == FIGURES
    assert found.tags.count("svg") == len(FIGURES)
    assert [link for link in found.links if link.startswith("#")]
    anchors = [link[1:] for link in found.links if link.startswith("#")]
    assert [name for name in anchors if name not in found.ids] == []
    for name in ("robot1", "robot2", "robot3"):
        assert name in found.texts


def test_page_of_the_same_run_is_the_same(
    page: str, made_run: MadeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    few(monkeypatch)
    again = report.html(reading.read(made_run(KILL)))
    upto = again.index("</svg>")
    assert upto > 10_000
    assert again[:upto] == page[:upto]


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """No figures, which take the most time, where they do not matter."""
    monkeypatch.setattr(charts, "charts", lambda *arguments: ())


@pytest.mark.usefixtures("undrawn")
def test_texts_of_the_run_are_escaped(made_run: MadeRun) -> None:
    run = reading.read(made_run())
    run = msgspec.structs.replace(run, name="<script>x</script>", problems=("<b>a & b",))
    text = report.html(run)
    assert "<script>" not in text
    assert "&lt;b&gt;a &amp; b" in text


def test_comparison_marks_better_and_worse_by_what_the_figure_means() -> None:
    more = report.Merit("arrived", 5.0, "", 0, 1)
    fewer = msgspec.structs.replace(more, value=4.0)
    assert report.compare(more, fewer).verdict == "worse"
    assert report.compare(fewer, more).difference == "+1"
    less_is_better = report.Merit("error", 0.25, "m", 2, -1)
    smaller = msgspec.structs.replace(less_is_better, value=0.125)
    row = report.compare(less_is_better, smaller)
    assert (row.a, row.b, row.difference, row.verdict) == ("0.25 m", "0.12 m", "-0.12 m", "better")
    same = report.compare(less_is_better, msgspec.structs.replace(smaller, value=0.2501))
    assert (same.difference, same.verdict) == ("=", "")
    nothing = report.compare(less_is_better, msgspec.structs.replace(smaller, value=None))
    assert (nothing.difference, nothing.verdict) == ("", "worse")
    neither = report.Merit("leaders", 1.0, "", 0, 0)
    assert report.compare(neither, msgspec.structs.replace(neither, value=2.0)).verdict == ""


def test_comparison_holds_both_runs_and_every_figure_of_both(
    compared: str, killed: report.Run, made_run: MadeRun
) -> None:
    found = Page(compared)
    assert found.tags.count("svg") == 2 * FEW
    assert [link for link in found.links if not link.startswith(("#", "data:"))] == []
    assert "worse" in found.texts
    assert any(text.startswith("Nothing went wrong") for text in found.texts)
    assert summary_of(made_run()).state_hash in found.texts
    assert killed.summary.state_hash in found.texts


# --- in a browser -------------------------------------------------------------------------------


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_browser_shows_every_figure_and_asks_nobody(
    page: str, compared: str, tmp_path: Path
) -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    pages = {"report": page, "comparison": compared}
    asked: list[str] = []
    said: list[str] = []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM,
            headless=True,
            args=["--no-sandbox", "--disable-dev-shm-usage"],
        )
        for name, text in pages.items():
            file = tmp_path / f"{name}.html"
            file.write_text(text)
            for width in WIDTHS:
                tab = browser.new_page(viewport={"width": width, "height": 800})
                tab.on("request", lambda request: asked.append(request.url))
                tab.on("console", lambda message: said.append(message.text))
                tab.on("pageerror", lambda error: said.append(str(error)))
                tab.goto(file.as_uri())
                figures = tab.locator("figure svg")
                sizes = [figures.nth(place).bounding_box() for place in range(figures.count())]
                assert len(sizes) == text.count("<svg ")
                assert all(size and size["width"] > 250 and size["height"] > 80 for size in sizes)
                assert tab.evaluate("document.documentElement.scrollWidth") <= width
                tab.close()
        browser.close()
    assert said == []
    assert {url.split(":")[0] for url in asked} == {"file"}
    assert len(asked) == len(pages) * len(WIDTHS)


# --- the verb -----------------------------------------------------------------------------------


@pytest.fixture
def swarm(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., object]:
    """`swarm REPORT...` in this process, in an empty folder."""
    return lambda *arguments: processes.here(monkeypatch, capsys, tmp_path, " ".join(arguments))


def copy_of(folder: Path, into: Path) -> Path:
    return shutil.copytree(folder, into / "copied")


def test_verb_writes_page_pictures_and_one_json_object(
    swarm: Callable, made_run: MadeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few(monkeypatch)
    run = copy_of(made_run(), tmp_path)
    ended = swarm("report", str(run), "--png", "pictures", "--json")
    assert ended.returncode == 0
    told = json.loads(ended.stdout)
    assert told["summary"] == json.loads((run / "summary.json").read_text())
    assert len(told["series"]["robots"]["robot2"]["slot_error_m"]) == len(told["series"]["times_s"])
    assert "</html>" in (run / "report.html").read_text()
    pictures = sorted((tmp_path / "pictures").iterdir())
    assert [one.stem for one in pictures] == sorted(FIGURES[:FEW])
    assert all(one.read_bytes().startswith(b"\x89PNG") for one in pictures)


@pytest.mark.usefixtures("undrawn")
def test_verb_exits_1_when_an_expectation_is_missed(
    swarm: Callable, made_run: MadeRun, tmp_path: Path
) -> None:
    run = copy_of(made_run(), tmp_path)
    summary = summary_of(run)
    row = metrics.ExpectRow(met=[], missed=["arrived >= 4: 3"])
    changed = msgspec.structs.replace(summary, expect=row)
    (run / "summary.json").write_bytes(msgspec.json.encode(changed))
    ended = swarm("report", str(run), "--out", "page.html")
    assert ended.returncode == 1
    assert "arrived &gt;= 4: 3" in (tmp_path / "page.html").read_text()
    assert not (run / "report.html").exists()


@pytest.mark.usefixtures("undrawn")
def test_cut_recording_without_summary_still_has_a_report_that_says_so(
    swarm: Callable, made_run: MadeRun, tmp_path: Path
) -> None:
    run = copy_of(made_run(KILL), tmp_path)
    (run / "summary.json").unlink()
    data = (run / "run.mcap").read_bytes()
    (run / "run.mcap").write_bytes(data[: len(data) // 2])
    ended = swarm("report", str(run))
    assert ended.returncode == 1
    assert "The recording is not whole" in ended.stdout
    text = (run / "report.html").read_text()
    assert "has left no summary" in text
    assert "Not whole." in text
    assert "At 2.40 s" in text.replace("\xa0", " ")  # it was killed before the cut


def test_summary_of_another_run_is_noticed(made_run: MadeRun, tmp_path: Path) -> None:
    run = copy_of(made_run(), tmp_path)
    changed = msgspec.structs.replace(summary_of(run), state_hash="0" * 64)
    (run / "summary.json").write_bytes(msgspec.json.encode(changed))
    [problem] = reading.read(run).problems
    assert "state hash" in problem


@pytest.mark.parametrize(
    ("content", "code", "words"),
    [
        (None, 2, "expected a run's folder"),
        (b"", 1, "empty file"),
        (b"\x89MCAP0\r\n" + bytes(200), 1, "expected a recording"),
        (b"hello" * 100, 1, "expected a recording"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(
    swarm: Callable, tmp_path: Path, content: bytes | None, code: int, words: str
) -> None:
    if content is not None:
        (tmp_path / "run.mcap").write_bytes(content)
    ended = swarm("report", ".")
    assert ended.returncode == code
    assert words in ended.stderr
    assert ended.stderr.count("\n") == 1
    assert not (tmp_path / "report.html").exists()


@pytest.mark.usefixtures("undrawn")
def test_place_that_cannot_be_written_is_refused(
    swarm: Callable, made_run: MadeRun, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    ended = swarm("report", str(made_run()), "--out", "file/page.html")
    assert ended.returncode == 2
    assert "--out" in ended.stderr


def test_course_refuses_ticks_of_another_scenario(
    made_ticks: Callable, made_scenario: Callable
) -> None:
    with pytest.raises(errors.RecordingError, match="expected the 4 robots"):
        course.follow(made_scenario(4), (), made_ticks(3, 2))
