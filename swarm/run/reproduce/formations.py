"""Fig. 13 to 18: a formation of six crosses two, three and random obstacles."""

from __future__ import annotations

from collections.abc import Sequence

from dashboards import figures
from swarm.run.reproduce import claims
from swarm.run.reproduce.claims import Run
from swarm.run.reproduce.experiments import Claim, Experiment, Figure, Picture

TORQUE_FIELD = "motion"  # of RobotParameters, where bodies can have inertia and torques
SAFE = "all robots cross and avoid the obstacles and each other"
REFORMED = "after crossing they quickly reform the predefined formation"
CONVERGED = "the tracking errors converge to zero after the switch"


def table(robot_fields: Sequence[str]) -> dict[str, Figure]:
    """Figures by name; the one with torques only where robots have the field for it."""
    result = {**_two_obstacles(), **_three_obstacles(), **_random_field()}
    if TORQUE_FIELD in robot_fields:
        result["fig13-torque"] = _torque()
    return result


def _formation(number: int, where: str, experiment: Experiment, *said: Claim) -> dict[str, Figure]:
    """A figure of trajectories with what is said of them, and the next one of tracking errors."""
    of = (experiment.name,)
    ways, errors = f"fig{number}", f"fig{number + 1}"
    return {
        ways: Figure(
            f"Fig. {number}: trajectories of six robots, {where}",
            (experiment,),
            (
                Picture(
                    ways,
                    "Trajectories, with the positions and the shape of the formation at equal "
                    "times.",
                    of,
                    _draw_trajectories,
                ),
            ),
            (
                Claim(SAFE, of, claims.all_arrive_without_contact),
                *said,
                Claim(REFORMED, of, claims.reforms),
            ),
        ),
        errors: Figure(
            f"Fig. {number + 1}: tracking errors of the followers, {where}",
            (experiment,),
            (
                Picture(
                    errors,
                    "Desired minus actual distance and bearing as seen from the leader, distance "
                    "from the nominal slot, and what each robot was doing.",
                    of,
                    _draw_tracking,
                ),
            ),
            (Claim(CONVERGED, of, claims.errors_converge),),
        ),
    }


def _draw_trajectories(runs: Sequence[Run]) -> bytes:
    return figures.png(figures.trajectories(runs[0].tracks))


def _draw_tracking(runs: Sequence[Run]) -> bytes:
    return figures.png(figures.tracking(runs[0].tracks))


def _two_obstacles() -> dict[str, Figure]:
    experiment = Experiment(name="two-obstacles", scenario="two-obstacles")
    of = (experiment.name,)
    return _formation(
        13,
        "two obstacles",
        experiment,
        Claim(
            "leader and robot 4 have the same trajectory",
            of,
            claims.on_one_line("leader", "robot4"),
        ),
        Claim("robots 1 and 2 are symmetric, and 3 and 5", of, claims.mirrors),
    )


def _three_obstacles() -> dict[str, Figure]:
    experiment = Experiment(name="three-obstacles", scenario="three-obstacles")
    return _formation(
        15,
        "three obstacles",
        experiment,
        Claim(
            "robots 3 and 4 turn back and pass the third obstacle below",
            (experiment.name,),
            claims.turn_back_and_pass_below("robot3", "robot4"),
        ),
    )


def _random_field() -> dict[str, Figure]:
    experiment = Experiment(name="random-field", scenario="random-field")
    return _formation(17, "random obstacles", experiment)


def _torque() -> Figure:
    experiment = Experiment(
        name="two-obstacles-torque",
        scenario="two-obstacles",
        settings=(f"robot.{TORQUE_FIELD}=dynamic",),
    )
    of = (experiment.name,)
    return Figure(
        "Fig. 13 with the dynamics of (16): mass, inertia and limited torques",
        (experiment,),
        (
            Picture(
                "fig13-torque",
                "Trajectories, with the positions and the shape of the formation at equal times.",
                of,
                _draw_trajectories,
            ),
            Picture(
                "fig13-torque-errors",
                "Tracking errors, and what each robot was doing.",
                of,
                _draw_tracking,
            ),
        ),
        (
            Claim(SAFE, of, claims.all_arrive_without_contact),
            Claim("robots keep their distance", of, claims.stays_apart),
        ),
    )
