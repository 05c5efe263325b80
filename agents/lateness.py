"""How late a robot's commands take effect, learnt from what its body does.

    set-points sent, measured twist --which of them is it?--> ticks late

A robot whose commands come too late cannot be told so; but its body then does what it was told some
ticks before. Guards reckon with it: who stops later must begin earlier.
"""

from __future__ import annotations

import msgspec

from swarm.geometry import Twist

# An older command is not heeded any more: the world brakes by then.
LATE_TICKS_MAX = 4
# The body does what a set-point says when it is this near to it. One whose wheels lag, or are weak,
# never is, and nothing is learnt.
SAME_MPS, SAME_RADPS = 1e-3, 1e-3
# And something else beyond this.
STRAY_MPS, STRAY_RADPS = 0.05, 0.3


class State(msgspec.Struct, frozen=True):
    """The newest set-points, the last one first, and by how much they are late."""

    sent: tuple[Twist, ...] = ()
    late_ticks: int = 0


def step(state: State, twist: Twist, elapsed_ticks: int, least_ticks: int = 0) -> State:
    """Lateness at this tick. What it was taken for is kept as long as it explains what is seen.

    Args:
        twist: measured; on time it is the last set-point.
        elapsed_ticks: since the last frame; whoever missed some knows nothing of the time between.
        least_ticks: what is declared for all; it is not less.
    """
    if elapsed_ticks != 1:
        return State(late_ticks=state.late_ticks)
    known = state.late_ticks
    if least_ticks <= known < len(state.sent) and _is_same(state.sent[known], twist):
        return state
    fitting = [
        ticks
        for ticks, sent in enumerate(state.sent)
        if ticks >= least_ticks and _is_same(sent, twist)
    ]
    if not fitting:
        return state
    return State(state.sent, fitting[0])


def stops(state: State, before: Twist, twist: Twist, brakes_mps: float) -> bool:
    """Whether the body brakes as hard as it can, or stands, though it was told something else.

    Args:
        before, twist: measured, a tick ago and now.
        brakes_mps: what full braking takes from the speed in a tick.
    """
    if len(state.sent) <= state.late_ticks:
        return False
    told = state.sent[state.late_ticks]
    if _is_near(told, twist, STRAY_MPS, STRAY_RADPS):
        return False
    return abs(twist.speed_mps) <= max(0.0, abs(before.speed_mps) - brakes_mps) + STRAY_MPS / 10.0


def send(state: State, set_point: Twist) -> State:
    """State after a set-point has been sent."""
    return State((set_point, *state.sent)[: LATE_TICKS_MAX + 1], state.late_ticks)


def base(state: State, twist: Twist) -> Twist:
    """What the body will do when the next set-point takes effect: the one before it, if late."""
    return state.sent[0] if state.late_ticks and state.sent else twist


def _is_same(one: Twist, other: Twist) -> bool:
    return _is_near(one, other, SAME_MPS, SAME_RADPS)


def _is_near(one: Twist, other: Twist, near_mps: float, near_radps: float) -> bool:
    return (
        abs(one.speed_mps - other.speed_mps) < near_mps
        and abs(one.turn_rate_radps - other.turn_rate_radps) < near_radps
    )
