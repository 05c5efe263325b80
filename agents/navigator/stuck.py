"""A robot that gets nowhere in the open turns its way aside for a moment, the other side next time.

position, tick by tick --no headway--> way turned right, then left, then right ...
"""

from __future__ import annotations

from math import pi

import msgspec

from swarm.geometry import Vec2, length

HEADWAY_M, PATIENCE_S = 0.25, 3.0
ESCAPE_S = 1.5
ESCAPE_RAD = 97.0 * pi / 180.0  # more than across: a step back out of what holds it
NEAR_M = 0.3  # not so near to the goal


class State(msgspec.Struct, frozen=True):
    """Where headway is measured from, and which side is next."""

    place: Vec2 | None = None
    still_s: float = 0.0
    escape_s: float = 0.0  # left of the turn at hand
    side: float = -1.0  # of the next or the present one; right first

    def turn_rad(self) -> float:
        """By how much to turn the way, left is positive."""
        return self.side * ESCAPE_RAD if self.escape_s > 0.0 else 0.0


def step(state: State, position: Vec2, distance_m: float, elapsed_s: float, *, free: bool) -> State:
    """State at this tick.

    Args:
        distance_m: to the goal.
        free: whether nothing else explains that it stands.
    """
    if state.escape_s > 0.0:
        left_s = state.escape_s - elapsed_s
        return (
            State(position, 0.0, left_s, state.side)
            if left_s > 0.0
            else State(position, side=-state.side)
        )
    if (
        not free
        or distance_m <= NEAR_M
        or state.place is None
        or length(position[0] - state.place[0], position[1] - state.place[1]) > HEADWAY_M
    ):
        return State(position, side=state.side)
    still_s = state.still_s + elapsed_s
    if still_s < PATIENCE_S:
        return State(state.place, still_s, side=state.side)
    return State(position, 0.0, ESCAPE_S, state.side)
