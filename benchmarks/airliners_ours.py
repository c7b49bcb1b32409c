"""BeBOT's four airliners by the certified planner, compared with BeBOT: `python benchmarks/airliners_ours.py`.

The example prescribes 205 m/s at both ends and leaves the speed free between 200 and 260 m/s. The certified planner
does not prescribe a final speed: it plans at 205 m/s throughout, which satisfies every constraint of the example but
takes about a fifth longer than a faster flight in between. The benchmark compares planning times.
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from airliners import main
from airliners_example import GRAVITY_M_S2, Flown, flown_from_ned, load_example, our_request

from anser.environment import SteadyWind
from anser.numerics.arrays import stack_rows
from anser.parts import make_rendezvous
from anser.planning import PathLimits, Separation
from anser.planning.certified.arrival_times import direct_times
from anser.planning.certified.certified_plan import CertifiedPlan, plan_at
from anser.planning.certified.task import AircraftTask, Airspace, KeepOuts
from anser.planning.certified.timed_profiles import MINIMAL

_INTERVALS = 512
_ROLL_RATE = np.deg2rad(3.0)  # a gentle roll rate, typical of airliners
_STRAIGHT_ON = 1.0 + 2e-4  # factor of the direct path's time


def fleet() -> tuple[AircraftTask, Airspace]:
    """Tasks and airspace of the example for the certified planner."""
    request = our_request(load_example())

    def aircraft_task(k: int) -> AircraftTask:
        final = request.goal_velocity_n[k]
        return AircraftTask(
            position_n=jnp.asarray(request.start_n[k]),
            air_velocity_n=jnp.asarray(request.start_velocity_n[k]),
            air_acceleration_n=jnp.zeros(3),
            goal_position_n=jnp.asarray(request.goal_n[k]),
            goal_velocity_n=jnp.zeros(3),
            rendezvous=make_rendezvous(jnp.zeros(3), course=float(np.arctan2(final[1], final[0])), path_angle=0.0),
            speed=jnp.asarray(float(np.linalg.norm(request.start_velocity_n[k]))),
            side=jnp.asarray(0),
            limits=PathLimits(
                *(
                    jnp.asarray(x)
                    for x in (
                        request.speed_min,
                        request.speed_max,
                        request.bank_max,
                        20.0,
                        0.0,
                        2e4,
                        request.load_factor_max,
                    )
                )
            ),
            roll_rate_max=jnp.asarray(_ROLL_RATE),
            active=jnp.asarray(1.0),
        )

    airspace = Airspace(
        SteadyWind(jnp.zeros(3)),
        jnp.asarray(GRAVITY_M_S2),
        Separation(jnp.asarray(request.separation), jnp.asarray(0.0)),
        KeepOuts(*map(jnp.zeros, ((0, 2), (0, 2), 0, 0, 0))),
    )
    return stack_rows([aircraft_task(k) for k in range(len(request.names))]), airspace


def plan_example() -> CertifiedPlan:
    """Each as early as its direct path allows at the airspeed that the ends prescribe."""
    tasks, airspace = fleet()
    durations, _ = direct_times(tasks, airspace, tasks.speed, 64)
    return plan_at(0.0, tasks, airspace, _STRAIGHT_ON * durations, _INTERVALS, MINIMAL)


def read_plan(plan: object) -> Flown:
    """For the dense check."""
    assert isinstance(plan, CertifiedPlan)
    if not bool(jnp.all(plan.feasible)):
        raise RuntimeError("the certified planner has no plan of the example that keeps everything")

    def state(k: int, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        path = jax.tree.map(lambda leaf: leaf[k], plan.paths)
        at = jax.vmap(lambda t: (path.position_n(t), path.velocity_n(t), path.acceleration_n(t)))
        position, velocity, acceleration = (np.asarray(x) for x in at(jnp.asarray(times)))
        return position, velocity, acceleration

    return flown_from_ned(load_example(), np.asarray(plan.arrival_times), state)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(main(plan_example, read_plan))
