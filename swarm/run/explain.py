"""A Why in words, for somebody who has never seen the inside of a robot.

Angles are told as people do: degrees to the left or right of where the robot looks.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, inf, pi

from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm import geometry
from swarm.geometry import Twist
from swarm.messages import Intent
from swarm.run.why import Force, Heard, Why

PICTURE_COLUMNS_MAX = 72
SHOWN_RAD = 1e-3  # a smaller angle is none to a person

MODES = {
    "GO": "it drives to its goal, pulled by the goal and pushed by obstacles",
    "ROUND": "it came no nearer to its goal, so it goes round what is in the way",
    "FORM": "it keeps its place in the formation",
    "AVOID": "something is near, so it leaves its place and goes where the forces push it",
    "ARRIVED": "it is where it should be",
    "HOLD": "it stands",
    "FAILED": "it has given up",
}
REASONS = {
    "contact": "it has touched something",
    "sensors": "what its sensors say cannot be true",
    "motors": "its motors do not do what it orders",
    "enclosed": "it went round all that is between it and its goal, both ways",
    "too-long": "it tried for too long",
    "blocked": "its way is closed, from where it is",
    "leader": "its leader has given up",
}
TERMS = {
    "attractive": "pulled to where it should be",
    "repulsive": "pushed off obstacles",
    "rotating": "turned round obstacles",
    "robots": "pushed off other robots",
    "resultant": "all of it, where it wants to",
}


def show(found: Why) -> None:
    """Print it."""
    console = Console(highlight=False)

    def say(*lines: str) -> None:
        for line in lines:
            console.print(Text(line), soft_wrap=True)

    def head(text: str) -> None:
        console.print(Text(f"\n{text}", style="bold"))

    console.print(
        Text(
            f"{found.robot} at {found.time_s:.2f} s (tick {found.tick}): {found.scenario}", "bold"
        ),
        soft_wrap=True,
    )
    say(*_state(found))
    head("What it saw")
    say(*_sight(found))
    if found.arcs:
        console.print(_arcs(found))
    head("What pulled and pushed it")
    if any(force.size > 0.0 for force in found.forces):
        console.print(_forces(found.forces))
    else:
        say("  nothing: no force counts in this mode" if found.answered else "  unknown")
    say(*_steering(found))
    head("Whom it heard")
    if found.heard:
        console.print(_peers(found.heard))
    else:
        say("  nobody")
    if found.unheard:
        say(f"  not heard, though alive: {', '.join(found.unheard)}")
    say(*_right_of_way(found))
    head("What it did")
    say(*_deed(found))
    head("What happened about then, within 2 s")
    say(
        *(
            f"  {one.time_s:7.2f} s  {one.kind} {one.robot or ''}  {one.text}".rstrip()
            for one in found.events
        )
        if found.events
        else ["  nothing"]
    )


def _state(found: Why) -> list[str]:
    pose, twist = found.pose, found.twist
    lines = [
        f"It was {'alive' if found.alive else 'dead'}"
        + (f", started for the {found.incarnation + 1}. time" if found.incarnation else "")
        + f", at x {pose.x_m:.3f} m, y {pose.y_m:.3f} m, looking to {degrees(pose.yaw_rad):.1f} deg"
        f" (0 is along x), {_motion(twist)}.",
    ]
    if found.contact:
        lines.append("It had touched something and stood for good.")
    if not found.answered:
        lines.append("It did not answer this frame: what follows is only what it was sent.")
    if found.mode:
        why = REASONS.get(found.reason, found.reason)
        if found.mode == "HOLD" and not why:
            why = "it has nothing to do, or nobody to follow"
        because = f", because {why}" if why else ""
        lines.append(f"Its mode was {found.mode}: {MODES.get(found.mode, '')}{because}.")
    return lines


def _motion(twist: Twist) -> str:
    if twist == Twist(0.0, 0.0):
        return "standing"
    return f"driving at {twist.speed_mps:.3f} m/s and turning {_turning(twist.turn_rate_radps)}"


def _turning(rate_radps: float) -> str:
    side = "left" if rate_radps >= 0.0 else "right"
    return f"{side} at {degrees(abs(rate_radps)):.1f} deg/s"


def side(bearing_rad: float) -> str:
    """A direction as people say it."""
    angle = degrees(bearing_rad)
    if abs(bearing_rad) <= SHOWN_RAD:
        return "straight ahead"
    if pi - abs(bearing_rad) <= SHOWN_RAD:
        return "straight behind"
    return f"{abs(angle):.1f} deg {'left' if angle > 0.0 else 'right'}"


def _sight(found: Why) -> list[str]:
    lines = []
    lines += [
        f"  an obstacle that moves ({one.speed_mps:g} m/s) {one.gap_m:.2f} m from its body, "
        f"{side(one.bearing_rad)}"
        for one in found.passing
    ]
    if found.blind_beams:
        lines.append(f"  {found.blind_beams} beams of its lidar showed no number at all")
    if not found.sectors_m:
        return [*lines, "  it did not tell"]
    if found.nearest is None:
        other = "else " if found.blind_beams else ""
        return [*lines, f"  nothing {other}within reach of its lidar, but robots it knew about"]
    nearest = found.nearest
    lines.append(
        f"  {len(found.occupied)} of {len(found.sectors_m)} sectors occupied, the nearest "
        f"{nearest.range_m:.2f} m away, {side(nearest.bearing_rad)}. Each column is a direction, "
        "its figure the whole metres to what is there:"
    )
    return [*lines, *picture(found.sectors_m)]


def picture(sectors_m: Sequence[float]) -> list[str]:
    """The map unrolled: left of the robot on the left, ahead in the middle."""
    count = len(sectors_m)
    group = -(-count // PICTURE_COLUMNS_MAX)  # so many sectors to a column
    turned = list(reversed(sectors_m))  # sectors go from behind over the right to the left
    columns = [min(turned[at : at + group]) for at in range(0, count, group)]
    signs = "".join("." if one == inf else str(min(9, int(one))) for one in columns)
    width = len(signs)
    ruler = [" "] * (width + 8)
    for text, at in (
        ("behind", 0.0),
        ("left", 0.25),
        ("ahead", 0.5),
        ("right", 0.75),
        ("behind", 1.0),
    ):
        begin = min(max(0, round(at * width) - len(text) // 2), width - len(text))
        if width >= 40 or text == "ahead":
            ruler[begin : begin + len(text)] = text
    return [f"    {signs}", f"    {''.join(ruler).rstrip()}"]


def _arcs(found: Why) -> Table:
    table = _table("ARC", "DIRECTION", "DISTANCE", "WIDTH", "WEIGHT")
    for number, arc in enumerate(found.arcs, 1):
        table.add_row(
            str(number),
            side(arc.bearing_rad),
            f"{arc.range_m:.2f} m",
            f"{degrees(arc.width_rad):.0f} deg",
            f"{arc.weight:.2f}",
        )
    return table


def _forces(forces: Sequence[Force]) -> Table:
    table = _table("FORCE", "SIZE", "ANGLE", "FROM ITS HEADING", "MEANING")
    for force in forces:
        there = force.size > 0.0
        table.add_row(
            force.term,
            f"{force.size:.3f}",
            f"{degrees(force.angle_rad):.1f} deg" if there else "",
            side(force.bearing_rad) if there else "",
            TERMS[force.term] if there else "none",
        )
    return table


def _steering(found: Why) -> list[str]:
    lines = []
    if found.waypoint is not None and found.waypoint_distance_m is not None:
        x_m, y_m = found.waypoint
        what = "way-point" if found.tracking is None else "place in the formation"
        lines.append(
            f"  its {what} was x {x_m:.3f} m, y {y_m:.3f} m: {found.waypoint_distance_m:.3f} m "
            f"away, {side(found.waypoint_bearing_rad or 0.0)}"
        )
    tracking = found.tracking
    if tracking is not None:
        lines.append(
            f"  that is {tracking.slot.distance_m:.3f} m behind the leader, "
            f"{_aside(tracking.bearing_now_rad)} it"
        )
        if abs(tracking.bearing_now_rad - tracking.slot.bearing_rad) > SHOWN_RAD:
            nominal = _aside(tracking.slot.bearing_rad)
            lines.append(f"  (by rights {nominal} it, but something is in the way there)")
        lines += [
            f"  it is off by {tracking.error_along_m:+.4f} m along the line from the leader, "
            f"{degrees(tracking.error_across_rad):+.2f} deg across",
            "  its controller's gains (P, I, D): along "
            + ", ".join(f"{gain:.3f}" for gain in tracking.gains[:3])
            + "; across "
            + ", ".join(f"{gain:.3f}" for gain in tracking.gains[3:]),
        ]
    return lines


def _aside(bearing_rad: float) -> str:
    """Bearing of a slot, which is positive to the leader's right."""
    if abs(bearing_rad) <= SHOWN_RAD:
        return "straight behind"
    return (
        f"{degrees(abs(bearing_rad)):.1f} deg to the {'right' if bearing_rad > 0.0 else 'left'} of"
    )


def _peers(heard: Sequence[Heard]) -> Table:
    table = _table(
        "PEER", "AGE, TICKS", "MODE", "DISTANCE", "DIRECTION", "PASSES", "YIELDS TO", "A GAP"
    )
    for one in heard:
        table.add_row(
            one.name,
            f"{one.age_ticks} ({one.age_s:.2f} s)",
            one.mode,
            f"{one.distance_m:.2f} m",
            side(one.bearing_rad),
            "first" if one.passes_first else "after",
            one.yields_to or "",
            "" if one.passage is None else "holds" if one.passage.holds else "wants",
        )
    return table


def _towards(found: Why, intent: Intent) -> str:
    if intent.target is None:
        return ""
    bearing_rad = geometry.bearing(found.pose, *intent.target) - found.pose.yaw_rad
    return f", to a point {side(geometry.wrap_angle(bearing_rad))}"


def _right_of_way(found: Why) -> list[str]:
    claim = " ".join(map(str, found.claim)) or "unknown"
    lines = [f"  its own claim is {claim}; the smaller one passes first"]
    lines.append(
        f"  it waited for {found.yields_to}" if found.yields_to else "  it waited for nobody"
    )
    if (passage := found.passage) is not None:
        lines.append(
            f"  it {'held' if passage.holds else 'wanted'} the gap at "
            f"({passage.mouth[0]:.2f}, {passage.mouth[1]:.2f}), claimed at tick {passage.since}"
        )
    if (intent := found.intent) is not None:
        speed_mps = geometry.length(*intent.velocity)
        lines.append(f"  it told that it meant to go {speed_mps:.2f} m/s{_towards(found, intent)}")
    leadership = found.leadership
    if leadership is None:
        lines.append("  it followed nobody")
        return lines
    if leadership.name == found.robot:
        lines.append(f"  it led, in term {leadership.term}")
        return lines
    sign = (
        "whose last sign of life is too old to count"
        if found.leader_age_s is None
        else f"whose newest sign of life was {found.leader_age_s:.2f} s old"
    )
    lines.append(f"  it followed {leadership.name}, leader of term {leadership.term}, {sign}")
    return lines


def _deed(found: Why) -> list[str]:
    if found.commanded is None or found.speed_limit_mps is None:
        return [f"  it gave no answer; in force was: {_order(found.applied)}"]
    lines = []
    if found.limited_by == "":
        lines.append(f"  nothing held it back (it may drive {found.speed_limit_mps:.3f} m/s)")
    elif found.limited_by == "brake":
        lines.append(
            f"  an obstacle held it back: {found.speed_limit_mps:.3f} m/s is all from which it "
            "can still brake in time"
        )
    else:
        lines.append(
            f"  {found.limited_by} held it back: no faster than {found.speed_limit_mps:.3f} m/s, "
            "so that both can stop in time"
        )
    lines.append(f"  it ordered: {_order(found.commanded)}")
    if found.late_ticks:
        lines.append(f"  the order arrived {found.late_ticks} ticks late")
    if found.applied != found.commanded:
        lines.append(f"  in force in this tick was: {_order(found.applied)}")
    return lines


def _order(twist: Twist) -> str:
    return f"{twist.speed_mps:.3f} m/s, turn {_turning(twist.turn_rate_radps)}"


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=True)
    for name in columns:
        table.add_column(name, no_wrap=name != columns[-1])
    return table
