"""Stability derivatives of an aircraft, and tables in the place of some."""

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model

from anser.derivative_names import ARGUMENTS, COEFFICIENTS, DERIVATIVES
from anser.scenario.errors import Problem, plain, show
from anser.scenario.schema_base import Table, choice, expects, number

_WHAT: dict[str, str] = dict(
    zip(COEFFICIENTS, ("lift", "drag", "side force", "roll moment", "pitch moment", "yaw moment"), strict=True)
)
_PER: dict[str, str] = dict(
    zip(
        ARGUMENTS,
        (
            "at zero angles",
            "per angle of attack",
            "per sideslip",
            "per roll rate p b/2V",
            "per pitch rate q c/2V",
            "per yaw rate r b/2V",
            "per square of the angle of attack",
            "per square of the sideslip",
        ),
        strict=True,
    )
)
AXES_MAX = 3


class _Build(Table):
    """What the derivatives are, besides the derivatives."""

    per: Literal["rad", "deg"] = choice(
        "angle that the derivatives by alpha, beta and the surfaces are given per; rates are always in rad/s",
        ("rad", "deg"),
        "rad",
    )
    oswald: float | None = number(
        "e of the induced drag (CL0 + CL_alpha alpha)^2 / (pi e AR); left out: none", 0, 2, "", None, above=True
    )
    stall_alpha_deg: float | None = number(
        "alpha0, where lift fades into that of a flat plate; left out: no stall", 0, 90, "deg", None, above=True
    )
    stall_sharpness: float = number("M, how suddenly it does", 1, 1000, "per rad", 50.0)


def _field(name: str) -> Any:
    row, ending = name[:2], name[2:]
    return (float, number(f"{_WHAT[row]} {_PER[ending]}", -1e4, 1e4, "", 0.0))


if TYPE_CHECKING:
    Aerodynamics = _Build
else:
    Aerodynamics = create_model(
        "Aerodynamics",
        __base__=_Build,
        __module__=__name__,
        __doc__="Stability derivatives: lift and drag turned into body axes by alpha alone, the others in body axes.",
        **{name: _field(name) for name in DERIVATIVES},
    )


class CoefficientTable(Table):
    """Values over one to three angles, linear between breakpoints, in the place of a derivative or of several."""

    replaces: str = Field(
        description="a coefficient, such as Cm, or a derivative, such as Cm_q or Cl_aileron",
        json_schema_extra=expects('the name of a coefficient or derivative, such as "Cm" or "Cm_q"'),
    )
    over: Annotated[tuple[str, ...], Field(strict=False)] = Field(
        min_length=1,
        max_length=AXES_MAX,
        description='what the values depend on: "alpha", "beta" and names of surfaces',
        json_schema_extra=expects(f'a list of one to {AXES_MAX} of "alpha", "beta" and names of surfaces'),
    )
    breakpoints_deg: Annotated[tuple[Annotated[tuple[float, ...], Field(strict=False)], ...], Field(strict=False)] = (
        Field(
            description="of each in turn, rising",
            json_schema_extra=expects("a list of lists of rising numbers, one list for each of over, deg"),
        )
    )
    values: Annotated[tuple[Any, ...], Field(strict=False)] = Field(
        description="at the breakpoints, in lists within lists",
        json_schema_extra=expects("a list of numbers as long as the breakpoints; for two axes, a list of such lists"),
    )
    beyond: Literal["hold", "extend"] = choice(
        "what holds beyond the ends: the last value, or the last slope", ("hold", "extend"), "hold"
    )

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of breakpoints of each axis."""
        return tuple(len(points) for points in self.breakpoints_deg)

    def own_problems(self) -> list[Problem]:
        """Find axes that do not rise, and values that are not as many as the breakpoints."""
        if len(self.breakpoints_deg) != len(self.over):
            words = f"a list of {len(self.over)} lists, one for each of over"
            return [Problem("breakpoints_deg", f"a list of {len(self.breakpoints_deg)}", words)]
        found = []
        for k, points in enumerate(self.breakpoints_deg):
            if len(points) < 2:
                found.append(Problem(f"breakpoints_deg[{k}]", f"a list of {len(points)}", "two numbers or more"))
            for i, (low, high) in enumerate(pairwise(points)):
                if not low < high:
                    words = f"a number greater than the one before it, {plain(low)}"
                    found.append(Problem(f"breakpoints_deg[{k}][{i + 1}]", plain(high), words))
        return found or misshapen(self.values, self.shape, "values")


def misshapen(values: object, shape: tuple[int, ...], path: str) -> list[Problem]:
    """Find where nested lists are not of a shape, or hold what is no finite number."""
    if not shape:
        is_number = isinstance(values, int | float) and not isinstance(values, bool) and math.isfinite(values)
        return [] if is_number else [Problem(path, show(values), "a finite number")]
    if not isinstance(values, list | tuple) or len(values) != shape[0]:
        return [Problem(path, show(values), f"a list of {shape[0]}, one for each breakpoint")]
    return [problem for k, one in enumerate(values) for problem in misshapen(one, shape[1:], f"{path}[{k}]")]
