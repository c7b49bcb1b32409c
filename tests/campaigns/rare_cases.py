"""Studies with a rare event, and synthetic flights with known probabilities."""

from anser.results.flight_rows import FlightRow
from campaigns.study_cases import THREE, study_of

FEW = {"flights": 300, "repetitions": 3}
ABOVE = {"statistic": "miss_m", "threshold": 8.91, **FEW}  # wind is even from 0 to 9 m/s: 1e-2
BELOW = {"statistic": "separation_min_m", "threshold": 500.09, **FEW}
RARE_TEXT = (
    'format = 1\nname = "test"\nscenario = "three.toml"\nseed = 1\n'
    '[rare]\nstatistic = "miss_m"\nthreshold = 8.91\nflights = 300\nrepetitions = 3\n'
    '[[vary]]\npath = "wind.speed_m_s"\ndistribution = "uniform"\nlow = 0.0\nhigh = 9.0\n'
)


def rare_study(**changes):
    return study_of(**{"sampling": None, "rare": ABOVE, **changes})


def made_up(cases, batch=None, precision="float64"):
    """Rows with a greatest miss equal to the wind speed, and a least separation of 500 m plus the wind speed."""
    return [_row(case.scenario.wind.speed_m_s) for case in cases]


def _row(wind_m_s):
    aircraft = [
        {"name": config.name, "miss_m": wind_m_s / (k + 1), "clearance_min_m": 200.0, "status": "arrived"}
        for k, config in enumerate(THREE.aircraft)
    ]
    return FlightRow(aircraft, {"arrival_spread_s": 0.0, "separation_min_m": 500.0 + wind_m_s}, [], met=True)
