"""The flights of the founding work: one aircraft to one boat, three aircraft to three goals."""

from importlib import resources

from anser.campaign import Flown, run
from anser.scenario import loads
from anser.verification.missions import mission

__all__ = ["SINGLE", "published_flights"]

SINGLE = "single-aircraft.toml"
"""The single case: a copy of the shipped scenario, which a test holds equal to it."""


def published_flights() -> dict[str, Flown]:
    """Fly the published single and three-aircraft cases, the second cut short after its arrival."""
    text = resources.files("anser.verification").joinpath(f"data/{SINGLE}").read_text(encoding="utf-8")
    return {"single": run(loads(text, SINGLE)), "three": mission()}
