"""Search for keys without effect, such as settings of turbulence in a scenario without turbulence."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from anser.aircraft_files.deviations import Deviation
from anser.config.errors import Problem, format_number, format_value, quoted_list
from anser.config.tables import Table
from anser.scenario.schema import Scenario
from anser.scenario.schema_sensing import PRESETS, Navigation

_GUST_KEYS = ("wind_time_s", "gust_time_s")
"""Keys of [navigation] that an aircraft with exact sensors uses in gusts too."""


@dataclass(frozen=True)
class UnusedKeys:
    """Keys of one table that have no effect; a study may vary none of them."""

    path: str  # key path of the table
    table: Table
    keys: tuple[str, ...]
    cause: str  # why the keys have no effect; the text follows the value in messages: `with intensity "none"`
    remedy: str  # setting with which the keys have an effect
    is_whole: bool = False  # True: the whole table has no effect, and messages name only the first key
    # True: a file that sets the keys is invalid. False: only a caution, as the speed or aircraft may be set elsewhere
    is_refused: bool = True

    def contains(self, path: str) -> bool:
        """Whether a key path (list items by index) is one of the keys, or leads into one of the keys."""
        keys = (f"{self.path}.{key}" for key in self.keys)
        return any(path == key or path.startswith((f"{key}.", f"{key}[")) for key in keys)

    def problems(self) -> Iterator[Problem]:
        """Yield a problem for each of the keys that the file sets to another value than the default."""
        for key in self.keys[:1] if self.is_whole else self.keys:
            value, default = getattr(self.table, key), type(self.table).model_fields[key].default
            if key in self.table.model_fields_set and value != default:
                expected = self.remedy if self.is_whole else f"{self.remedy}, or no {key}"
                yield Problem(f"{self.path}.{key}", f"{format_value(value)} {self.cause}", expected)


def unused_key_problems(scenario: Scenario, *, is_refused: bool = True) -> list[Problem]:
    """List problems of keys without effect that make a file invalid, or (`is_refused` False) only cause a caution."""
    candidates = [unused_keys for unused_keys in find_unused_keys(scenario) if unused_keys.is_refused == is_refused]
    return [problem for unused_keys in candidates for problem in unused_keys.problems()]


def unused_key_cautions(scenario: Scenario) -> list[str]:
    """Return a sentence for each key without effect that does not make a file invalid."""
    return [
        f"{problem.path}: {problem.arrived} changes nothing; expected {problem.expected}"
        for problem in unused_key_problems(scenario, is_refused=False)
    ]


def find_unused_keys(scenario: Scenario) -> list[UnusedKeys]:
    """List the keys in the tables of a scenario that have no effect, whether the file sets or omits them."""
    return [
        *_unused_sensing_keys(scenario),
        *_unused_air_keys(scenario),
        *_unused_directions(scenario),
        *_unused_fleet_keys(scenario),
        *_unused_goals(scenario),
        *_unused_event_keys(scenario),
    ]


def _unused_sensing_keys(scenario: Scenario) -> Iterator[UnusedKeys]:
    navigation, sensor, estimator = scenario.navigation, scenario.goal_sensor, scenario.estimator
    if navigation.sensors == "exact":
        is_smooth = scenario.turbulence.intensity == "none" and not scenario.gust
        cause, remedy = 'with sensors "exact"', 'sensors = "satellite-inertial" beside it, which alone has this number'
        errors = _keys_except(Navigation, ("sensors", *_GUST_KEYS))
        yield UnusedKeys("navigation", navigation, errors, cause, remedy)
        if is_smooth:
            yield UnusedKeys("navigation", navigation, _GUST_KEYS, f"{cause} in smooth air", f"{remedy} in smooth air")
    if sensor.preset == "exact":
        remedy = f'goal_sensor.preset other than "exact", whose measurements the filter needs: {quoted_list(PRESETS)}'
        keys = tuple(type(estimator).model_fields)
        yield UnusedKeys("estimator", estimator, keys, 'with goal_sensor.preset "exact"', remedy)
    elif estimator.motion != "changing":
        cause, remedy = f'with motion "{estimator.motion}"', 'motion = "changing" beside it'
        yield UnusedKeys("estimator", estimator, ("sojourn_s",), cause, remedy)
        if estimator.motion == "steady":
            remedy = 'motion = "turning" or "changing" beside it'
            yield UnusedKeys("estimator", estimator, ("turn_rate_deg_s",), cause, remedy)
    for path, table in (("goal_sensor", sensor), ("network", scenario.network)):
        if table is not None and table.outage_share == 0.0:
            remedy = "an outage_share above 0 beside it"
            yield UnusedKeys(path, table, ("outage_mean_s",), "with outage_share 0", remedy)


def _unused_air_keys(scenario: Scenario) -> Iterator[UnusedKeys]:
    if scenario.turbulence.intensity == "none":
        remedy = 'intensity = "light", "moderate" or "severe" beside it'
        yield UnusedKeys("turbulence", scenario.turbulence, ("spectrum",), 'with intensity "none"', remedy)
    end_s = scenario.timing.duration_s
    for index, gust in enumerate(scenario.gust):
        if gust.time_s >= end_s:
            remedy = f"a time before the end of the flight, timing.duration_s = {format_number(end_s)} s"
            keys = ("time_s", *_keys_except(type(gust), ("time_s",)))
            yield UnusedKeys(f"gust[{index}]", gust, keys, "for a gust", remedy, is_whole=True)


def _unused_directions(scenario: Scenario) -> Iterator[UnusedKeys]:
    """Yield the direction keys of winds, goals and keep-outs whose speed is 0."""
    remedy = "speed_m_s above 0 beside it"
    wind = scenario.wind
    layers = [(f"wind.layers[{k}]", layer, "from_deg") for k, layer in enumerate(wind.layers or ())]
    moving = [
        *(layers or [("wind", wind, "from_deg")]),
        *((f"goal[{k}]", goal, "course_deg") for k, goal in enumerate(scenario.goal) if goal.waypoints is None),
        *((f"keep_out[{k}]", volume, "course_deg") for k, volume in enumerate(scenario.keep_out)),
    ]
    for path, table, key in moving:
        if table.speed_m_s == 0.0:
            yield UnusedKeys(path, table, (key,), "with speed_m_s 0", remedy, is_refused=False)


def _unused_fleet_keys(scenario: Scenario) -> Iterator[UnusedKeys]:
    timing, separation, requirements = scenario.timing, scenario.separation, scenario.requirements
    if timing.replan_period_s == 0.0:
        remedy = "replan_period_s above 0 beside it: a plan that is made once stays as it is"
        yield UnusedKeys("timing", timing, ("freeze_s",), "with replan_period_s 0", remedy)
    alone = ("with one aircraft", "a second [[aircraft]]") if len(scenario.aircraft) == 1 else None
    if alone is not None:
        yield UnusedKeys("separation", separation, tuple(type(separation).model_fields), *alone)
        yield UnusedKeys("requirements", requirements, ("separation_min_m",), *alone)
    elif separation.horizontal_m == 0.0:
        remedy = "horizontal_m above 0 beside it"
        yield UnusedKeys("separation", separation, ("reserve_m",), "without horizontal_m", remedy)
    if not scenario.arrival.is_common:
        cause, remedy = f'with arrival.rule "{scenario.arrival.rule}"', "a rule by which all arrive at one time"
        yield UnusedKeys("requirements", requirements, ("arrival_spread_max_s",), cause, remedy)
    elif alone is not None:
        yield UnusedKeys("requirements", requirements, ("arrival_spread_max_s",), *alone)
    for index, aircraft in enumerate(scenario.aircraft):
        if aircraft.gains.inversion == "model":
            cause, remedy = 'with inversion "model"', 'inversion = "incremental" or "adaptive" beside it'
            yield UnusedKeys(f"aircraft[{index}].gains", aircraft.gains, ("sensor_bandwidth_rad_s",), cause, remedy)
        if aircraft.gains.inversion != "adaptive":
            cause, remedy = f'with inversion "{aircraft.gains.inversion}"', 'gains.inversion = "adaptive"'
            keys = tuple(type(aircraft.adaptation).model_fields)
            yield UnusedKeys(f"aircraft[{index}].adaptation", aircraft.adaptation, keys, cause, remedy)


def _unused_goals(scenario: Scenario) -> Iterator[UnusedKeys]:
    flown_to = {aircraft.goal for aircraft in scenario.aircraft}
    for index, goal in enumerate(scenario.goal):
        if goal.name not in flown_to:
            keys = ("name", *_keys_except(type(goal), ("name",)))
            cause, remedy = "for a goal of no aircraft", f'an aircraft with goal = "{goal.name}"'
            yield UnusedKeys(f"goal[{index}]", goal, keys, cause, remedy, is_whole=True, is_refused=False)


def _unused_event_keys(scenario: Scenario) -> Iterator[UnusedKeys]:
    for index, event in enumerate(scenario.event):
        path = f"event[{index}]"
        if event.kind == "thrust-lost" and event.thrust_left == 1.0:
            yield UnusedKeys(path, event, ("thrust_left",), "for a loss of thrust", "less than 1")
        if event.deviation == Deviation():
            remedy = "a key that deviates, such as deviation = { drag = 1.2 }"
            yield UnusedKeys(path, event, ("deviation",), "without a deviation", remedy, is_whole=True)
        if event.kind == "aircraft-leaves" and scenario.arrival.rule != "sequence":
            cause = f'with arrival.rule "{scenario.arrival.rule}"'
            yield UnusedKeys(path, event, ("gaps",), cause, 'arrival.rule = "sequence"')


def _keys_except(model: type[Table], excluded: Iterable[str]) -> tuple[str, ...]:
    return tuple(key for key in model.model_fields if key not in excluded)
