"""Cost of a simulator's step, and of a controller from outside the package beside the built-in one; `make bench`.

Times are of the processor, the least of several rounds in turns, so that other work on the machine counts little.
"""

import time

import numpy as np

import anser
from anser.parts import AbstractController
from anser.single_aircraft.flight import autopilot

STEPS, ROUNDS = 2000, 5


class OutsideInversion(AbstractController):
    """The arithmetic of the built-in autopilot in a controller from outside the package."""

    autopilot: AbstractController

    def init(self, state, attitude):
        return self.autopilot.init(state, attitude)

    def control(self, controller_state, belief, command, step):
        return self.autopilot.control(controller_state, belief, command, step)


def processor_time(function):
    start = time.process_time()
    function()
    return time.process_time() - start


def steps_of(simulator, count):
    def run():
        for _ in range(count):
            state = simulator.state
            simulator.step({"elevator": -2.0 + 0.1 * (state["pitch_deg"] - 2.8) + 0.1 * state["pitch_rate_deg_s"]})

    return run


def test_a_step_of_one_aircraft_read_by_names(benchmark):
    simulator = anser.Simulator("f16", anser.trim("f16", 150, 1000))
    benchmark.pedantic(steps_of(simulator, STEPS), rounds=ROUNDS, warmup_rounds=1)
    print(f"\none aircraft: {1e6 * benchmark.stats.stats.min / STEPS:.1f} us a step (wanted: 60)")


def test_a_step_of_a_thousand_aircraft(benchmark):
    simulator = anser.Simulator("f16", [anser.trim("f16", 150, 1000)] * 1024)
    elevators = np.linspace(-3.0, -1.0, 1024)

    def run():
        for _ in range(100):
            simulator.step({"elevator": elevators})

    benchmark.pedantic(run, rounds=ROUNDS, warmup_rounds=1)
    per_aircraft = benchmark.stats.stats.min / 100 / 1024
    print(f"\n1,024 aircraft: {1e6 * per_aircraft:.2f} us per aircraft and step (wanted: 1.0)")


def test_a_controller_from_outside_costs_no_more_than_the_built_in_one(benchmark):
    f16 = anser.aircraft("f16")
    trim = f16.trim(150, 1000)
    built_in = autopilot(f16.airframe, trim.point, "inversion")
    command = {"course_deg": anser.step_input(20)}

    def fly(controller):
        return lambda: anser.simulate(f16, trim, controller=controller, command=command, duration_s=160)

    flights = {"built-in": fly(built_in), "outside": fly(OutsideInversion(built_in))}
    for flight in flights.values():
        flight()
    times = [[processor_time(flight) for flight in flights.values()] for _ in range(ROUNDS)]
    benchmark.pedantic(flights["outside"], rounds=1)
    least = np.min(times, axis=0)
    ratio = least[1] / least[0]
    print(f"\ncontroller from outside: {ratio:.3f} of the built-in one's time (wanted: at most 1.05)")
