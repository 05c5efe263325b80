"""One process under the worst luck: every order of events, and what must never come of it."""

from __future__ import annotations

import math
import signal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm.run import supervision
from swarm.run.supervision import (
    Continued,
    End,
    Event,
    Exited,
    Halted,
    Kill,
    Life,
    Passed,
    Pause,
    Policy,
    Ready,
    Resume,
    Signal,
    Spawn,
    Start,
    Stop,
)
from swarm.scenario import Restart

ROBOT = supervision.of_robot(start_timeout_s=15.0, stop_timeout_s=2.0)
WORLD = supervision.of_world(Restart(), start_timeout_s=30.0, stop_timeout_s=3.0)


class Play:
    """A life, and the process that it is about."""

    def __init__(self, policy: Policy, *, obedient: bool = True) -> None:
        self.policy = policy
        self.life = Life()
        self.now_s = 0.0
        self.lives = False
        self.obedient = obedient  # ends on SIGTERM
        self.stopped = False
        self.dying: int | None = None  # code with which it will end
        self.final = False  # Stop or End was told
        self.spawned: list[tuple[float, int]] = []
        self.signals: list[signal.Signals] = []
        self.texts: list[str] = []

    def tell(self, event: Event) -> None:
        self.final |= isinstance(event, Stop | End)
        self.life, actions = supervision.step(self.policy, self.life, event, self.now_s)
        for action in actions:
            if isinstance(action, Spawn):
                assert not self.lives, "two processes of one name"
                assert not self.final, "started again after the end"
                self.lives, self.stopped, self.dying = True, False, None
                self.spawned.append((self.now_s, action.incarnation))
            elif isinstance(action, Signal):
                self.signals.append(action.number)
                self.deliver(action.number)
            else:
                self.texts.append(action.text)

    def deliver(self, number: signal.Signals) -> None:
        match number:
            case signal.SIGKILL:
                self.dying = -9
            case signal.SIGTERM if self.obedient and self.dying is None:
                self.dying = 0
            case signal.SIGSTOP:
                self.stopped = True
            case signal.SIGCONT:
                self.stopped = False

    def die(self) -> None:
        """What was sent to it has its effect."""
        if self.lives and self.dying is not None and (self.dying == -9 or not self.stopped):
            self.exit(self.dying)

    def exit(self, code: int) -> None:
        if self.lives:
            self.lives = False
            self.tell(Exited(code))

    def wait(self, for_s: float) -> None:
        """Let time pass; the timer is heeded when it is due."""
        until_s = self.now_s + for_s
        while self.life.due_s <= until_s:
            self.now_s = max(self.now_s, self.life.due_s)
            self.tell(Passed())
        self.now_s = until_s
        self.tell(Passed())

    def run(self) -> None:
        self.tell(Start())
        self.tell(Ready())


# --- every order of events ----------------------------------------------------------------------

moves = st.one_of(
    st.builds(Start, st.integers(0, 9)),
    st.sampled_from(
        [Ready(), Kill(), Pause(), Resume(), Halted(), Continued(), Passed(), Stop(), End(), "die"]
    ),
    st.builds(Exited, st.sampled_from([0, 1, -9, -11, 71])),
    st.floats(0.0, 40.0),  # wait
)
policies = st.builds(
    Policy,
    restart=st.sampled_from(["never", "on-failure", "always"]),
    restart_max=st.integers(0, 3),
    restart_window_s=st.sampled_from([1.0, 30.0]),
    restart_delay_s=st.sampled_from([0.0, 0.5]),
    stopped_s=st.just(10.0),
    start_timeout_s=st.just(5.0),
    stop_timeout_s=st.just(2.0),
)


@settings(max_examples=1500)
@given(policies, st.booleans(), st.lists(moves, max_size=25))
def test_any_order_of_events_keeps_one_process_and_comes_to_an_end(
    policy: Policy, obedient: bool, story: list[Event | float | str]
) -> None:
    play = Play(policy, obedient=obedient)
    play.run()
    for move in story:
        if move == "die":
            play.die()
        elif isinstance(move, float):
            play.wait(move)
        elif isinstance(move, Exited):
            play.exit(move.code)
        elif isinstance(move, Passed) or not isinstance(move, str):
            play.tell(move)
        held = play.life.phase == "over" and play.dying == -9  # not even SIGKILL ends it
        assert play.lives == (play.life.phase in supervision.LIVE) or held
        if play.life.phase in ("starting", "ending", "waiting"):
            assert math.isfinite(play.life.due_s), "would stay like this for ever"
        assert play.life.restarts <= len(play.spawned)
    play.tell(Stop())
    play.wait(policy.stop_timeout_s)
    play.die()
    assert play.life.phase == "over", "a process that dies of SIGKILL is gone by then"
    assert not play.lives
    play.tell(Start(7))
    play.wait(1000.0)
    assert not play.lives


@settings(max_examples=300)
@given(policies, st.lists(moves, max_size=15))
def test_end_is_reached_in_bounded_time_whatever_the_process_does(
    policy: Policy, story: list[Event | float | str]
) -> None:
    play = Play(policy, obedient=False)
    play.run()
    for move in story:
        if isinstance(move, float):
            play.wait(move)
        elif isinstance(move, Exited):
            play.exit(move.code)
        elif not isinstance(move, str):
            play.tell(move)
    play.tell(Stop())
    play.wait(supervision.bound_s(policy))  # it does not even die of SIGKILL
    assert play.life.phase == "over"


@settings(max_examples=300)
@given(policies, st.lists(st.floats(0.0, 20.0), min_size=1, max_size=30))
def test_restarts_by_policy_are_bounded_within_the_window(
    policy: Policy, lasted_s: list[float]
) -> None:
    play = Play(policy)
    play.run()
    for one_s in lasted_s:
        play.wait(one_s)
        play.exit(-9)
        play.wait(policy.restart_window_s)
        play.tell(Ready())
    again_s = [at_s for at_s, _ in play.spawned[1:]]
    for first_s in again_s:
        within = [s for s in again_s if first_s <= s < first_s + policy.restart_window_s]
        assert len(within) <= policy.restart_max
    assert len(again_s) == play.life.restarts


# --- the defects of others, one by one ----------------------------------------------------------


def test_start_of_one_that_runs_kills_it_first() -> None:
    play = Play(ROBOT)
    play.run()
    play.tell(Start(1))
    assert play.signals == [signal.SIGKILL]
    assert len(play.spawned) == 1
    play.tell(Start(2))  # and again, while it dies
    play.die()
    assert play.spawned == [(0.0, 0), (0.0, 2)]
    assert play.life.phase == "starting"


def test_stop_while_a_restart_waits_is_the_end() -> None:
    play = Play(WORLD)
    play.run()
    play.exit(-9)
    assert play.life.phase == "waiting"
    play.tell(Stop())
    assert play.life.phase == "over"
    play.wait(100.0)
    assert len(play.spawned) == 1


def test_stop_while_one_is_killed_for_a_new_one_is_the_end() -> None:
    play = Play(ROBOT)
    play.run()
    play.tell(Start(1))
    play.tell(Stop())
    play.die()
    assert play.life.phase == "over"
    assert len(play.spawned) == 1


@pytest.mark.parametrize("last", [Kill(), End()])
def test_kill_of_one_that_ends_is_the_end(last: Event) -> None:
    play = Play(WORLD, obedient=False)
    play.run()
    play.tell(Stop())
    play.tell(last)
    play.die()
    assert play.life.phase == "over"


def test_killed_world_is_started_again_after_delays_that_double_until_it_is_given_up() -> None:
    play = Play(WORLD)
    play.run()
    for _ in range(6):
        play.exit(-9)
        play.wait(9.0)
        play.tell(Ready())
    # killed as soon as nine seconds have passed: at 0, 9, 18, 27, 36, and the sixth for good
    assert play.spawned == [(0.0, 0), (0.5, 1), (10.0, 2), (20.0, 3), (31.0, 4), (44.0, 5)]
    assert play.life.phase == "dead"
    assert play.life.gave_up
    assert play.texts[-1] == "was started again 5 times within 60 s: no more"


def test_restarts_are_forgotten_after_the_window() -> None:
    play = Play(WORLD)
    play.run()
    for _ in range(20):
        play.exit(-9)
        play.wait(61.0)
        play.tell(Ready())
    assert play.life.restarts == 20
    assert not play.life.gave_up


def test_restart_that_never_becomes_ready_is_killed_counted_and_given_up() -> None:
    play = Play(WORLD)
    play.run()
    play.exit(-9)
    for number in range(1, 6):
        play.wait(0.5 * 2 ** (number - 1))
        assert play.life.phase == "starting"
        play.wait(30.0)
        assert play.signals[-1] == signal.SIGKILL
        play.die()
        if number > 1:
            assert play.life.phase == "waiting"  # 30 s each: two at most lie in the window
    assert play.life.restarts == 5


def test_first_start_that_fails_by_itself_is_not_tried_again() -> None:
    play = Play(WORLD)
    play.tell(Start())
    play.exit(2)
    assert play.life.phase == "dead"
    assert play.life.gave_up


def test_world_that_ended_by_itself_is_not_started_again() -> None:
    play = Play(supervision.of_world(Restart(world="always"), start_timeout_s=1, stop_timeout_s=1))
    play.run()
    play.exit(0)
    assert play.life.phase == "dead"
    assert not play.life.gave_up


def test_child_that_ignores_sigterm_is_killed_in_time() -> None:
    play = Play(ROBOT, obedient=False)
    play.run()
    play.tell(Stop())
    assert play.signals == [signal.SIGTERM, signal.SIGCONT]
    play.wait(1.9)
    assert play.life.phase == "ending"
    play.wait(0.1)
    assert play.signals[-1] == signal.SIGKILL
    play.die()
    assert play.life.phase == "over"


def test_stopped_child_is_continued_so_that_it_can_end() -> None:
    play = Play(ROBOT)
    play.run()
    play.tell(Pause())
    assert play.stopped
    play.tell(Stop())
    play.die()
    assert play.life.phase == "over"
    assert signal.SIGKILL not in play.signals


def test_world_stopped_from_outside_is_paused_first_then_hung() -> None:
    play = Play(WORLD)
    play.run()
    play.tell(Halted())
    play.wait(9.9)
    assert play.signals == []
    play.tell(Continued())
    assert play.life.phase == "running"
    play.wait(100.0)
    play.tell(Halted())
    play.wait(10.0)
    assert play.signals == [signal.SIGKILL]
    play.die()
    assert play.life.phase == "waiting"


@pytest.mark.parametrize("event", [Halted(), Pause()])
def test_stopped_one_is_left_alone_when_asked_for_or_nothing_would_follow(event: Event) -> None:
    play = Play(ROBOT)
    play.run()
    play.tell(event)
    play.wait(1e6)
    assert play.life.phase == "stopped"
    assert signal.SIGKILL not in play.signals
    play.tell(Resume())
    assert play.life.phase == "running"


def test_robot_that_was_stopped_before_it_was_ready_has_its_time_again() -> None:
    play = Play(ROBOT)
    play.tell(Start())
    play.wait(14.0)
    play.tell(Pause())
    play.wait(100.0)
    play.tell(Resume())
    play.wait(14.0)
    assert play.life.phase == "starting"
    play.wait(1.0)
    assert play.life.phase == "killed"


@pytest.mark.parametrize("phase", ["starting", "running", "stopped", "ending", "killed"])
def test_death_in_any_state_is_noticed(phase: str) -> None:
    story: dict[str, list[Event]] = {
        "starting": [Start()],
        "running": [Start(), Ready()],
        "stopped": [Start(), Ready(), Halted()],
        "ending": [Start(), Ready(), Stop()],
        "killed": [Start(), Ready(), Kill()],
    }
    play = Play(WORLD)
    for event in story[phase]:
        play.tell(event)
    assert play.life.phase == phase
    play.exit(-11)
    assert play.life.phase == ("over" if phase == "ending" else "waiting")


def test_robot_is_never_started_again_unasked() -> None:
    play = Play(ROBOT)
    play.run()
    play.tell(Kill())
    play.die()
    play.wait(1e6)
    assert play.life.phase == "dead"
    play.tell(Start(1))
    assert play.spawned[-1] == (1e6, 1)
