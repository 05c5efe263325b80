"""What the world makes of every robot's process: there, gone, or due to come back; pure.

Member --lost, restarted, returned--> Member       due(policy, member, tick) -> tick of a start
"""

from __future__ import annotations

from typing import Literal

import msgspec

from swarm.messages import RobotState
from swarm.scenario import Restart, Scenario

# Those that are sent frames, and waited for.
PRESENT: tuple[RobotState, ...] = ("running", "collided")
# Those that may come back by themselves: what they remember is still there.
AWAY: tuple[RobotState, ...] = ("lost", "hung", "missing")
BACKOFF_DOUBLINGS_MAX = 10


class Member(msgspec.Struct, frozen=True):
    """One robot's process as the world knows it."""

    state: RobotState = "starting"
    incarnation: int = 0
    late_commands: int = 0
    sent_tick: int = -1  # of the newest frame this incarnation was sent
    answered_tick: int = -1  # of the newest that it answered
    start_tick: int | None = None  # when it is to be started again
    continue_tick: int | None = None  # when an injected hang is over
    hang: int | None = None  # number of the fault that stopped it: it cannot come back before
    owes: bool = False  # it has its token, but must answer before it is taken back
    awaited: Literal["", "back", "new"] = ""  # it was continued, or started, and is not ready yet
    starts: tuple[int, ...] = ()  # ticks of its restarts within the policy's window
    restarts: int = 0

    @property
    def is_present(self) -> bool:
        """Whether it is sent frames and waited for."""
        return self.state in PRESENT

    @property
    def is_expected(self) -> bool:
        """Whether it will be there again at a known tick."""
        return bool(self.awaited) or self.start_tick is not None or self.continue_tick is not None


def without(member: Member, state: RobotState) -> Member:
    """Member whose process is gone or does not answer."""
    return msgspec.structs.replace(
        member, state=state, continue_tick=None, hang=None, awaited="", owes=False
    )


def back(member: Member, *, touched: bool) -> Member:
    """Member that is there again with all that it remembers."""
    return msgspec.structs.replace(
        member,
        state="collided" if touched else "running",
        start_tick=None,
        continue_tick=None,
        hang=None,
        awaited="",
        owes=False,
    )


def starting(member: Member, incarnation: int, tick: int) -> Member:
    """Member of which a new process is on its way; it will remember nothing."""
    return msgspec.structs.replace(
        without(member, "restarting"),
        incarnation=incarnation,
        sent_tick=-1,
        answered_tick=-1,
        start_tick=None,
        awaited="new",
        starts=(*member.starts, tick),
        restarts=member.restarts + 1,
    )


def start_due(scenario: Scenario, member: Member, tick: int, *, after_s: float = 0.0) -> int | None:
    """Tick at which the policy starts a failed robot again, None when it does not.

    The delay doubles with every restart within the window; a robot that was started as often as
    the policy allows within it stays away.

    Args:
        after_s: earliest, for one that may still come back by itself.
    """
    policy: Restart = scenario.restart
    if policy.robot == "never":
        return None
    window_ticks = scenario.tick_of(policy.restart_window_s)
    recent = [start for start in member.starts if start > tick - window_ticks]
    if len(recent) >= policy.restart_max:
        return None
    delay_s = policy.restart_delay_s * 2.0 ** min(len(recent), BACKOFF_DOUBLINGS_MAX)
    return tick + max(1, scenario.tick_of(max(delay_s, after_s)))
