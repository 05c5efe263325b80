"""What a robot saw, weighed and did at one moment, told from the recording."""

from __future__ import annotations

import json
import re
import subprocess
from math import pi
from pathlib import Path

import pytest

from swarm import errors, recording
from swarm.run import explain, why
from tests.run import processes, test_replay


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """8 s of a formation in which robot2 is dead from 4.8 s to 6.4 s, and robot3 is slow."""

    def befall(swarm: test_replay.Swarm, tick: int) -> None:
        if tick == 50:
            swarm.inflict("slow:robot3,late_s=0.4")
        if tick == 60:
            swarm.lose("robot2")
            swarm.say("fault", "robot2", "kill")
        if tick == 80:
            swarm.restart("robot2", 1)

    plan = test_replay.plan_of()
    records = test_replay.run(test_replay.Swarm(plan), befall, ticks=100)
    return test_replay.write(tmp_path_factory.mktemp("why"), plan, records)


def test_why_tells_what_the_recording_holds(recorded: Path) -> None:
    found = why.why(recorded, "robot1", 4.0)
    record = next(one for one in recording.read(recorded).ticks if one.tick == 50)
    command = next(one for one in record.commands if one.robot == "robot1")
    assert (found.tick, found.time_s, found.alive, found.answered) == (50, 4.0, True, True)
    assert found.pose == record.robots[1].pose
    assert (found.commanded, found.applied) == (command.set_point, record.robots[1].applied)
    assert (found.speed_limit_mps, found.limited_by) == (
        command.trace.speed_limit_mps,
        command.trace.limited_by,
    )
    assert found.sectors_m == tuple(command.trace.sectors.numpy().tolist())
    assert len(found.occupied) == sum(one < 9.0 for one in found.sectors_m)
    assert [one.name for one in found.heard] == ["leader", "robot2", "robot3", "robot4", "robot5"]
    assert {(one.age_ticks, one.age_s) for one in found.heard} == {(1, 0.08)}
    assert [one.name for one in found.heard if one.passes_first] == ["leader", "robot2"]
    assert found.unheard == ()
    assert found.leadership is not None
    assert found.leadership.name == "leader"
    assert found.leader_age_s == pytest.approx(0.08)
    assert [force.term for force in found.forces] == list(why.FORCES)
    assert found.tracking is not None


def test_why_follows_a_late_answer_and_tells_ages(recorded: Path) -> None:
    found = why.why(recorded, "robot3", 5.6)  # tick 70
    assert (found.answered, found.late_ticks) == (True, 5)
    assert found.commanded != found.applied
    heard = {one.name: one for one in why.why(recorded, "robot1", 5.6).heard}
    assert (heard["robot3"].age_ticks, heard["leader"].age_ticks) == (6, 1)
    assert "robot2" not in heard


def test_why_tells_events_around_and_the_incarnation(recorded: Path) -> None:
    found = why.why(recorded, "robot2", 7.2)
    assert found.incarnation == 1
    assert [(one.tick, one.kind) for one in found.events] == [(80, "robot-started")]
    at = why.why(recorded, "robot4", 5.6)
    assert [(one.tick, one.kind) for one in at.events] == [(60, "fault"), (80, "robot-started")]


def test_why_of_the_first_tick_and_of_a_robot_that_has_just_begun(recorded: Path) -> None:
    assert why.why(recorded, "leader", 0.0).heard == ()
    assert why.why(recorded, "robot2", 6.4).answered


@pytest.mark.parametrize(
    ("name", "time_s", "said"),
    [
        ("robot9", 1.0, "expected one of leader, robot1.*got 'robot9'"),
        ("robot1", -1.0, "seconds >= 0, got -1"),
        ("robot1", float("nan"), "seconds >= 0, got nan"),
        ("robot1", 8.0, "from 0 to 7.92, when the recording ends, got 8.00"),
        ("robot2", 5.6, r"robot2 lived.*fault at 4.80 s: kill; the last one before is 4.72 s"),
    ],
)
def test_why_says_what_is_wrong_with_a_question(
    recorded: Path, name: str, time_s: float, said: str
) -> None:
    with pytest.raises(errors.UsageError, match=said):
        why.why(recorded, name, time_s)


def test_why_says_that_a_tick_is_lost(recorded: Path, tmp_path: Path) -> None:
    source = recording.read(recorded)
    with recording.Writer(tmp_path, source.scenario_toml, source.metadata) as writer:
        for record in source.ticks:
            if record.tick != 50:
                writer.write(record)
    with pytest.raises(errors.RecordingError, match="expected tick 50, got none"):
        why.why(tmp_path, "robot1", 4.0)


def test_why_prints_for_people_and_for_machines(
    recorded: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def ask(question: str) -> subprocess.CompletedProcess[str]:
        return processes.here(monkeypatch, capsys, recorded, f"why {recorded} {question}")

    done = ask("robot2 4.0 --json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["heard"][0]["name"] == "leader"
    done = ask("robot2 4.0")
    for part in (
        "robot2 at 4.00 s (tick 50)",
        "What it saw",
        "What pulled and pushed it",
        "its place in the formation was",
        "Whom it heard",
        "it followed leader, leader of term 0, whose newest sign of life was 0.08 s old",
        "it ordered:",
        "within 2 s",
    ):
        assert part in done.stdout, done.stdout
    for question in ("robot2 5.6", "robot9 1", "robot1 99"):
        assert ask(question).returncode == 2


def test_explain_prints_every_robot_at_every_moment(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("leader", "robot2", "robot3"):
        for time_s in (0.0, 0.08, 4.72, 6.4, 7.92):
            explain.show(why.why(recorded, name, time_s))
    said = capsys.readouterr().out
    assert said.count("What it saw") == 15
    assert "started for the 2. time" in said
    assert re.search(r"the order arrived 5 ticks late", said)


def test_picture_has_left_on_the_left() -> None:
    free = float("inf")
    sectors_m = [free] * 72
    sectors_m[53] = 2.9  # sectors go from behind over the right (17) and ahead (35) to the left
    sectors_m[36] = 12.0
    columns, ruler = explain.picture(sectors_m)
    assert columns == "    " + "." * 18 + "2" + "." * 16 + "9" + "." * 36
    assert ruler.index("left") < ruler.index("ahead") < ruler.index("right")


def test_side_is_what_people_say() -> None:
    assert explain.side(0.5 * pi) == "90.0 deg left"
    assert explain.side(-0.25 * pi) == "45.0 deg right"
    assert explain.side(0.0) == "straight ahead"
    assert explain.side(-pi) == "straight behind"
