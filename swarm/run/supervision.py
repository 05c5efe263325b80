"""What is done about one process, as a state machine: step(policy, life, event, now_s).

    dead --Start--> starting --Ready--> running <--Pause, Resume--> stopped
     ^                 |                   |                           |
     |                 '-------------------+------ Kill, overdue ------'--> killed --Exited--.
     |                                     '------ Exited ------------------------------.   |
     '-- given up, or nobody wants it <----------------------- by policy: waiting <-----'---'
    any --Stop--> ending --overdue--> killed --Exited--> over

Pure: what happened goes in as an Event, what to do comes out as Actions; a shell carries them out
and comes back with Passed when `due_s` is reached. There is never more than one live process of a
name: a new one is spawned only after Exited. After Stop nothing is ever spawned again, and `over`
is reached within `bound_s` whatever the process does.
"""

from __future__ import annotations

import signal
from typing import Literal

import msgspec

from swarm import scenario

KILL_S = 5.0  # SIGKILL has worked by then, or a driver holds the process: nobody can end it
STOPPED_FACTOR = 5.0  # hang_timeout_s times this: a person who stops the world may be debugging
FOREVER = float("inf")

Phase = Literal[
    "dead",  # there is no process; it may be started
    "starting",  # it runs, and has not said yet that it is ready
    "running",
    "stopped",  # by SIGSTOP
    "ending",  # asked to end, SIGTERM
    "killed",  # SIGKILL was sent
    "waiting",  # dead, to be started again at due_s
    "over",  # dead, and never started again
]
LIVE: tuple[Phase, ...] = ("starting", "running", "stopped", "ending", "killed")


class Policy(msgspec.Struct, frozen=True, kw_only=True):
    """How one process is looked after; all times of the wall clock."""

    restart: Literal["never", "on-failure", "always"] = "never"
    restart_max: int = 5  # within the window
    restart_window_s: float = 60.0
    restart_delay_s: float = 0.5  # doubles with every restart in the window
    stopped_s: float = 10.0  # by a hand from outside, for so long: taken for hung
    start_timeout_s: float = 30.0  # from its start until it says ready
    stop_timeout_s: float = 2.0  # from SIGTERM until SIGKILL


class Life(msgspec.Struct, frozen=True):
    """All that is remembered about one process."""

    phase: Phase = "dead"
    incarnation: int = 0
    due_s: float = FOREVER  # when Passed is awaited
    ready: bool = False  # this process has said so
    proven: bool = False  # one of its incarnations has: it can run at all
    then: Literal["policy", "start", "over"] = "policy"  # what follows its death
    next_incarnation: int = 0  # of the one to start then
    restarts_s: tuple[float, ...] = ()  # when the policy had it started again, within the window
    restarts: int = 0  # by policy, in all
    gave_up: bool = False


class Start(msgspec.Struct, frozen=True):
    """Somebody wants a new process; one that lives is killed first."""

    incarnation: int = 0


class Ready(msgspec.Struct, frozen=True):
    """The process says that it is ready."""


class Exited(msgspec.Struct, frozen=True):
    """The process is gone; the code is negative when a signal killed it."""

    code: int


class Kill(msgspec.Struct, frozen=True):
    """Somebody wants it dead; what follows is up to the policy."""


class Pause(msgspec.Struct, frozen=True):
    """Somebody wants it stopped until Resume."""


class Resume(msgspec.Struct, frozen=True):
    """Somebody wants it to go on."""


class Halted(msgspec.Struct, frozen=True):
    """It is seen to be stopped."""


class Continued(msgspec.Struct, frozen=True):
    """It is seen to go on."""


class Stop(msgspec.Struct, frozen=True):
    """The run is over: end in good order, for good."""


class End(msgspec.Struct, frozen=True):
    """The run is over: end now, for good."""


class Passed(msgspec.Struct, frozen=True):
    """Time has passed."""


Event = Start | Ready | Exited | Kill | Pause | Resume | Halted | Continued | Stop | End | Passed


class Spawn(msgspec.Struct, frozen=True):
    """Start a process; Exited follows when that fails."""

    incarnation: int


class Signal(msgspec.Struct, frozen=True):
    """Send a signal to the process."""

    number: signal.Signals


class Report(msgspec.Struct, frozen=True):
    """Tell people, beginning with the process's name."""

    text: str


Action = Spawn | Signal | Report
Step = tuple[Life, tuple[Action, ...]]

_KILL = Signal(signal.SIGKILL)


def of_world(restart: scenario.Restart, *, start_timeout_s: float, stop_timeout_s: float) -> Policy:
    """The world is started again by the wall clock, unless it ended by itself."""
    return Policy(
        restart="never" if restart.world == "never" else "on-failure",
        restart_max=restart.restart_max,
        restart_window_s=restart.restart_window_s,
        restart_delay_s=restart.restart_delay_s,
        stopped_s=STOPPED_FACTOR * restart.hang_timeout_s,
        start_timeout_s=start_timeout_s,
        stop_timeout_s=stop_timeout_s,
    )


def of_robot(*, start_timeout_s: float, stop_timeout_s: float) -> Policy:
    """A robot is started again when the world says so, in simulated time: never from here."""
    return Policy(restart="never", start_timeout_s=start_timeout_s, stop_timeout_s=stop_timeout_s)


def bound_s(policy: Policy) -> float:
    """Longest time from Stop until `over`."""
    return policy.stop_timeout_s + KILL_S


def step(policy: Policy, life: Life, event: Event, now_s: float) -> Step:
    """What an event makes of a life, and what is to be done, in order."""
    match event:
        case Start(incarnation):
            return _start(policy, life, incarnation, now_s)
        case Ready():
            return _ready(life)
        case Exited(code):
            return _exited(policy, life, code, now_s)
        case Kill():
            return _kill(life, now_s)
        case Pause():
            return _halt(policy, life, now_s, asked=True)
        case Halted():
            return _halt(policy, life, now_s, asked=False)
        case Resume():
            went_on, said = _go_on(policy, life, now_s)
            return went_on, (Signal(signal.SIGCONT), *said) if life.phase in LIVE else ()
        case Continued():
            return _go_on(policy, life, now_s)
        case Stop():
            return _stop(policy, life, now_s)
        case End():
            return _end(life, now_s)
        case Passed():
            return _passed(policy, life, now_s) if now_s >= life.due_s else (life, ())


# --- what is wanted -----------------------------------------------------------------------------


def _start(policy: Policy, life: Life, incarnation: int, now_s: float) -> Step:
    if life.phase in ("ending", "over") or life.then == "over":
        return life, ()
    if life.phase in ("dead", "waiting"):
        return _spawn(policy, life, incarnation, now_s)
    wanted = _changed(life, then="start", next_incarnation=incarnation)
    if life.phase == "killed":
        return wanted, ()
    return _changed(wanted, phase="killed", due_s=now_s + KILL_S), (_KILL,)


def _spawn(policy: Policy, life: Life, incarnation: int, now_s: float) -> Step:
    born = _changed(
        life,
        phase="starting",
        incarnation=incarnation,
        due_s=now_s + policy.start_timeout_s,
        ready=False,
        then="policy",
    )
    return born, (Spawn(incarnation),)


def _kill(life: Life, now_s: float) -> Step:
    if life.phase not in LIVE:
        return life, ()
    if life.phase == "killed":
        return life, (_KILL,)
    then = "over" if life.phase == "ending" else "policy"
    return _changed(life, phase="killed", then=then, due_s=now_s + KILL_S), (_KILL,)


def _stop(policy: Policy, life: Life, now_s: float) -> Step:
    if life.phase not in LIVE:
        return _over(life), ()
    if life.phase == "killed":
        return _changed(life, then="over", due_s=min(life.due_s, now_s + KILL_S)), ()
    if life.phase == "ending":
        return life, ()
    ending = _changed(life, phase="ending", then="over", due_s=now_s + policy.stop_timeout_s)
    # one that is stopped has to go on to see that it should end
    return ending, (Signal(signal.SIGTERM), Signal(signal.SIGCONT))


def _end(life: Life, now_s: float) -> Step:
    if life.phase not in LIVE:
        return _over(life), ()
    if life.phase == "killed":
        return _changed(life, then="over", due_s=min(life.due_s, now_s + KILL_S)), (_KILL,)
    return _changed(life, phase="killed", then="over", due_s=now_s + KILL_S), (_KILL,)


# --- what is seen -------------------------------------------------------------------------------


def _ready(life: Life) -> Step:
    if life.phase not in LIVE or life.ready:
        return life, ()
    known = _changed(life, ready=True, proven=True)
    said = (Report("is back"),) if life.restarts_s and life.then == "policy" else ()
    if life.phase == "starting":
        return _changed(known, phase="running", due_s=FOREVER), said
    return known, said


def _halt(policy: Policy, life: Life, now_s: float, *, asked: bool) -> Step:
    """Stopped: for as long as who asked wants it, or for `stopped_s` when it was somebody else."""
    if life.phase == "stopped" and asked:
        return _changed(life, due_s=FOREVER), (Signal(signal.SIGSTOP),)
    if life.phase not in ("starting", "running"):
        return life, ()
    if asked:
        return _changed(life, phase="stopped", due_s=FOREVER), (Signal(signal.SIGSTOP),)
    if policy.restart == "never":
        return _changed(life, phase="stopped", due_s=FOREVER), (
            Report("is stopped (SIGSTOP) and holds up the run until it is continued (SIGCONT)"),
        )
    return _changed(life, phase="stopped", due_s=now_s + policy.stopped_s), (
        Report(f"is stopped (SIGSTOP); in {policy.stopped_s:g} s it is taken for hung and killed"),
    )


def _go_on(policy: Policy, life: Life, now_s: float) -> Step:
    if life.phase != "stopped":
        return life, ()
    if life.ready:
        return _changed(life, phase="running", due_s=FOREVER), ()
    return _changed(life, phase="starting", due_s=now_s + policy.start_timeout_s), ()


def _exited(policy: Policy, life: Life, code: int, now_s: float) -> Step:
    if life.phase not in LIVE:
        return life, ()
    if life.then == "over":
        return _over(life), ()
    if life.then == "start":
        return _spawn(policy, life, life.next_incarnation, now_s)
    failed = code != 0 or life.phase == "killed"
    if policy.restart == "never" or not (failed or policy.restart == "always"):
        return _changed(life, phase="dead", due_s=FOREVER), ()
    if not life.proven and code > 0:  # it said itself that it cannot: it would say so again
        return _give_up(life, "")
    recent_s = tuple(one for one in life.restarts_s if one > now_s - policy.restart_window_s)
    if len(recent_s) >= policy.restart_max:
        count, window_s = policy.restart_max, policy.restart_window_s
        return _give_up(life, f"was started again {count} times within {window_s:g} s: no more")
    delay_s = min(policy.restart_delay_s * 2.0 ** min(len(recent_s), 64), policy.restart_window_s)
    waiting = _changed(
        life,
        phase="waiting",
        due_s=now_s + delay_s,
        next_incarnation=life.incarnation + 1,
        restarts_s=recent_s,
    )
    return waiting, (
        Report(
            f"is started again in {delay_s:g} s "
            f"({len(recent_s) + 1} of at most {policy.restart_max})"
        ),
    )


def _passed(policy: Policy, life: Life, now_s: float) -> Step:
    """The time is up: `due_s` has been reached."""
    match life.phase:
        case "starting":
            killed = _changed(life, phase="killed", then="policy", due_s=now_s + KILL_S)
            return killed, (_KILL, Report(f"was not ready within {policy.start_timeout_s:g} s"))
        case "stopped":
            killed = _changed(life, phase="killed", then="policy", due_s=now_s + KILL_S)
            return killed, (_KILL, Report(f"has been stopped for {policy.stopped_s:g} s: killed"))
        case "ending":
            killed = _changed(life, phase="killed", due_s=now_s + KILL_S)
            return killed, (
                _KILL,
                Report(f"did not end within {policy.stop_timeout_s:g} s when asked: killed"),
            )
        case "killed":
            text = f"does not die of SIGKILL within {KILL_S:g} s: the kernel holds it"
            left = _over(life) if life.then == "over" else _changed(life, due_s=FOREVER)
            return left, (Report(text),)
        case "waiting":
            again = _changed(life, restarts_s=(*life.restarts_s, now_s), restarts=life.restarts + 1)
            return _spawn(policy, again, life.next_incarnation, now_s)
        case _:
            return _changed(life, due_s=FOREVER), ()


# --- pieces -------------------------------------------------------------------------------------


def _give_up(life: Life, text: str) -> Step:
    left = _changed(life, phase="dead", due_s=FOREVER, gave_up=True)
    return left, (Report(text),) if text else ()


def _over(life: Life) -> Life:
    return _changed(life, phase="over", then="over", due_s=FOREVER)


def _changed(life: Life, **changes: object) -> Life:
    return msgspec.structs.replace(life, **changes)
