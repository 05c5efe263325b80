"""Scenarios: strict decoding, texts that help, and the round trip of a resolved one."""

from __future__ import annotations

import re
from math import pi, sqrt
from pathlib import Path

import pytest
import tomli_w

import world.scenarios
from swarm import errors
from swarm.messages import Slot
from swarm.scenario import Scenario, decode, to_builtins

HEAD = 'title = "test"\nseed = 7\ndt_s = 0.08\nduration_s = 10.0\n'
A = '[[robots]]\nname = "a"\nstart = [0.0, 0.0, 0.0]\n'
B = '[[robots]]\nname = "b"\nstart = [-1.0, 1.0, 0.0]\n'
FORMATION = '[formation]\nleader = "a"\n'
BUILT_IN = sorted(Path(world.scenarios.__file__).parent.glob("*.toml"))


def decoded(text: str, **changes: object) -> Scenario:
    return decode(text.encode(), "corridor.toml", **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "path", "expected", "got"),
    [
        (HEAD.replace("0.08", "0.5") + A, "dt_s", "<= 0.1", "0.5"),
        (HEAD.replace("0.08", '"fast"') + A, "dt_s", "expected `float`", "'fast'|`str`"),
        (HEAD.replace("seed = 7\n", "") + A, "", "expected the key 'seed'", "none"),
        (HEAD.replace("seed = 7", "seed = -1") + A, "seed", ">= 0", "-1"),
        (HEAD + "colour = 1\n" + A, "", "expected one of the keys", "'colour'"),
        (HEAD, "", "expected the key 'robots'", "none"),
        (HEAD + "robots = []\n", "robots", "length >= 1", r"\[\]"),
        (HEAD + A.replace('"a"', '"A"'), r"robots\[0\]\.name", "expected", "'A'"),
        (HEAD + A.replace("[0.0, 0.0, 0.0]", "[0.0]"), r"robots\[0\]\.start", "length 3", "1"),
        (HEAD + A.replace("0.0, 0.0, 0.0", "nan, 0.0, 0.0"), r"robots\[0\]\.start", ">=", "nan"),
        (HEAD + A + A, "", "its own name", r"\['a'\] twice"),
        (HEAD + A + B.replace("-1.0, 1.0", "0.3, 0.0"), "", "do not touch", "0.300 m apart"),
        (HEAD + "[robot]\nbody_radius_m = -1.0\n" + A, "robot.body_radius_m", "> 0.0", "-1.0"),
        (HEAD + "[robot]\nwheels = 2\n" + A, "robot", "expected one of the keys", "'wheels'"),
        (HEAD + A + "speed_mps_max = 99.0\n", r"robots\[0\]\.speed_mps_max", "<= 20.0", "99.0"),
        (HEAD + A + "[[obstacles]]\ncircle = [1.0, 1.0]\n", r"obstacles\[0\]", "length 3", "2"),
        (HEAD + A + "[[obstacles]]\n", r"obstacles\[0\]", "either circle or polygon", "none"),
        (HEAD + A + "[sensor]\nbeams = 100\n", "", "divide sensor.beams", "72"),
        (HEAD + A + '[formation]\nleader = "z"\n', "", r"leader to be one of \['a'\]", "'z'"),
        (
            HEAD + A + '[[faults]]\nkind = "kill"\ntarget = "z"\nat_s = 1.6\n',
            "",
            r"faults\[0\]\.target: expected one of",
            "'z'",
        ),
        (
            HEAD + A + '[[faults]]\nkind = "kill"\ntarget = "a"\nat_s = 1.0\n',
            "",
            "multiple of dt_s",
            "1.0; the nearest is 0.96",
        ),
        (
            HEAD + A + '[[faults]]\nkind = "burn"\n',
            r"faults\[0\]\.kind",
            "expected one of",
            "'burn'",
        ),
        (HEAD + A + "[clock]\ncommand_ttl = 0\n", "clock.command_ttl", ">= 1", "0"),
        (HEAD + A + "[disturbance]\nlatency_ticks = 5\n", "disturbance.latency_ticks", "<= 4", "5"),
        (HEAD + A + "[disturbance]\nnoise = 1.0\n", "disturbance", "keys range_sigma_m", "'noise'"),
        (
            HEAD + A + "[disturbance]\nloss_probability = 0.8\nloss_ticks_max = 5\n",
            "disturbance",
            r"<= 0\.75",
            r"0\.8",
        ),
        (
            HEAD + A + "[disturbance]\ndrift_m_per_m = 0.02\n",
            "disturbance",
            "drift_m_per_m and drift_m_max.*both or neither",
            r"0\.02 and 0\.0",
        ),
        (
            HEAD + A + "[[obstacles]]\ncircle = [9.0, 0.0, 1.0]\npath = [[9.0, 3.0]]\n",
            r"obstacles\[0\]",
            "path and speed_mps together",
            "one of them",
        ),
        (
            HEAD + A + "[random_obstacles]\ncount = 1\narea = [5.0, 0.0, 1.0, 9.0]\n",
            "random_obstacles",
            "x_min, y_min, x_max, y_max",
            "5.0",
        ),
        (HEAD + "[line]\ncount = 0\n", "line.count", ">= 1", "0"),
        (HEAD + A + "[expect]\nspeed = 1.0\n", "expect", "expected one of the keys", "'speed'"),
        (HEAD + "title\n", "", "expected TOML", "line 5"),
    ],
)
def test_decode_says_file_path_expected_and_got_when_a_setting_is_bad(
    text: str, path: str, expected: str, got: str
) -> None:
    with pytest.raises(errors.ScenarioError) as caught:
        decoded(text)
    message = str(caught.value)
    assert message.startswith("corridor.toml: ")

    assert re.search(path, message), message
    assert re.search(expected, message), message
    assert re.search(got, message), message


def test_decode_refuses_bytes_that_are_no_text() -> None:
    with pytest.raises(errors.ScenarioError, match=r"corridor\.toml: expected UTF-8.* 0xff at 3"):
        decode(b"a =\xff", "corridor.toml")


@pytest.mark.parametrize("value", ["inf", "-inf", "nan"])
@pytest.mark.parametrize("key", ["dt_s", "duration_s"])
def test_decode_refuses_what_is_not_finite(key: str, value: str) -> None:
    lines = [line for line in HEAD.splitlines() if not line.startswith(key)]
    with pytest.raises(errors.ScenarioError, match=rf"corridor\.toml: {key}: expected"):
        decoded("\n".join(lines) + f"\n{key} = {value}\n" + A)


def test_decode_gives_rows_the_defaults_that_they_do_not_set() -> None:
    plan = decoded(HEAD + "[robot]\nspeed_mps_max = 0.5\n" + A + B + "speed_mps_max = 0.7\n")
    assert [robot.speed_mps_max for robot in plan.robots] == [0.5, 0.7]
    assert plan.robots[0].body_radius_m == 0.22


def test_decode_takes_settings_seed_and_duration_from_the_command_line() -> None:
    plan = decoded(
        HEAD + A,
        settings=["field.k_e=1.0", "robots.0.goal=[3.0, 4.0]", "priority.strategy=mutual"],
        seed=9,
        duration_s=2.0,
    )
    assert plan.field.k_e == 1.0
    assert plan.robots[0].goal == (3.0, 4.0)
    assert plan.priority.strategy == "mutual"
    assert (plan.seed, plan.duration_s) == (9, 2.0)


@pytest.mark.parametrize(
    ("setting", "match"),
    [
        ("field.k_e", "expected PATH=VALUE"),
        ("=1", "expected PATH=VALUE"),
        ("field..k_e=1", "expected PATH=VALUE"),
        ("seed.x=1", "expected a table at 'seed'"),
        ("robots.7=1", "expected a row number from 0 to 0, got '7'"),
        ("field.k_q=1.0", "field: expected one of the keys"),
        ("field.k_e=many", "field.k_e: expected `float`"),
    ],
)
def test_decode_says_which_setting_is_wrong(setting: str, match: str) -> None:
    with pytest.raises(errors.ScenarioError, match=match):
        decoded(HEAD + A, settings=[setting])


def test_decode_keeps_as_many_rows_as_asked_for() -> None:
    assert [robot.name for robot in decoded(HEAD + A + B, robots=1).robots] == ["a"]
    with pytest.raises(errors.ScenarioError, match=r"--robots between 1 and 2 .* got 3"):
        decoded(HEAD + A + B, robots=3)


def test_decode_lines_robots_up_along_y() -> None:
    plan = decoded(HEAD + "[line]\ncount = 6\nspacing_m = 2.0\n", robots=3)
    assert [(robot.name, robot.start) for robot in plan.robots] == [
        ("robot1", (0.0, -2.0, 0.0)),
        ("robot2", (0.0, 0.0, 0.0)),
        ("robot3", (0.0, 2.0, 0.0)),
    ]


def test_decode_lets_the_first_of_a_line_lead_a_shape() -> None:
    text = HEAD + "[line]\ncount = 4\ngoal = [9.0, 0.0]\n"
    plan = decoded(text + '[formation]\nleader = "robot1"\nshape = "column"\nspacing_m = 1.2\n')
    assert [robot.goal for robot in plan.robots] == [(9.0, 0.0), None, None, None]
    slots = [slot for slot in plan.slots() if slot is not None]
    assert [slot.distance_m for slot in slots] == pytest.approx([1.2, 2.4, 3.6])
    assert [slot.bearing_rad for slot in slots] == pytest.approx([0.0, 0.0, 0.0])
    assert plan.setup("robot3").slot_distance_m_max == pytest.approx(3.6)


SLOTS = "[[formation.slots]]\ndistance_m = 2.0\nbearing_rad = 0.5\n"


def test_decode_gives_slots_in_row_order_and_a_robot_its_own_only() -> None:
    text = HEAD + A + "goal = [9.0, 0.0]\n" + B + FORMATION + SLOTS
    plan = decoded(text)
    assert plan.slot(1) == Slot(2.0, 0.5)
    setup = plan.setup("b")
    assert setup.slot == Slot(2.0, 0.5)
    assert setup.formation is not None
    assert setup.formation.slots == ()
    assert decode(tomli_w.dumps(to_builtins(plan)).encode(), "resolved.toml") == plan


@pytest.mark.parametrize(
    ("formation", "match"),
    [
        ('shape = "star"\n', "formation.shape: expected one of .*wedge"),
        ('shape = "wedge"\n' + SLOTS, "expected either shape or slots, got 'wedge' and slots"),
        ('shape = "column"\nspacing_m = 0.4\n', "slots that do not touch, got those of 'a' and"),
        ('shape = "line"\nspacing_m = 11.0\n', r"the slot of 'b' within radio.range_m \(10\)"),
        (SLOTS, "expected formation.slots for 2 followers, got 1"),
        (SLOTS + SLOTS, "slots that do not touch, got those of 'b' and 'c' 0.000 m apart"),
    ],
)
def test_decode_says_which_slots_are_bad(formation: str, match: str) -> None:
    c = A.replace('"a"', '"c"').replace("[0.0, 0.0", "[0.0, 3.0")
    with pytest.raises(errors.ScenarioError, match=match):
        decoded(HEAD + A + "goal = [9.0, 0.0]\n" + B + c + FORMATION + formation)


@pytest.mark.parametrize("path", BUILT_IN, ids=lambda path: path.stem)
def test_to_builtins_decodes_to_the_same_scenario_when_written_and_read(path: Path) -> None:
    plan = decode(path.read_bytes(), path.name)
    assert decode(tomli_w.dumps(to_builtins(plan)).encode(), "resolved.toml") == plan


def test_to_builtins_decodes_to_the_same_scenario_when_much_is_set() -> None:
    plan = decoded(
        HEAD
        + A.replace("0.0, 0.0, 0.0", "0.1, -0.7, 3.1")
        + "goal = [5.0, 1e-3]\nvia = [[1.0, 2.0], [2.0, 2.0]]\n"
        + B
        + FORMATION
        + "[[obstacles]]\npolygon = [[4.0, 4.0], [5.0, 4.0], [5.0, 5.0]]\n"
        + '[[faults]]\nkind = "kill"\ntarget = "b"\nat_s = 0.8\n'
        + '[expect]\narrived = 1\nmirror_pairs = [["a", "b"]]\n'
    )
    assert decode(tomli_w.dumps(to_builtins(plan)).encode(), "resolved.toml") == plan


def test_setup_tells_a_robot_its_own_row_and_nothing_of_its_peers() -> None:
    plan = decoded(HEAD + A + "goal = [9.0, 0.0]\n" + B + FORMATION)
    leader, follower = plan.setup("a"), plan.setup("b")
    assert (leader.row, leader.leads, leader.slot) == (0, True, None)
    assert (follower.row, follower.leads) == (1, False)
    assert follower.slot is not None
    assert follower.slot.distance_m == sqrt(2.0)
    assert follower.slot.bearing_rad == pytest.approx(-pi / 4.0)  # left-rear: Table I, R1
    assert leader.slot_distance_m_max == follower.slot_distance_m_max == sqrt(2.0)
    assert follower.robot == plan.robots[1]
    assert not hasattr(follower, "robots")


def test_tick_of_and_stamp_agree_with_the_step_length() -> None:
    plan = decoded(HEAD + A)
    assert plan.tick_of(9.6) == 120
    assert plan.stamp_ns(120) == 9_600_000_000
