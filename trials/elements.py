"""Nonlinear programs put together from many small elements of few kinds, with exact derivatives, solved by IPOPT."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse
from jaxtyping import Float, Int

__all__ = ["Kind", "Program", "ProgramSolution"]

FEASIBLE = 1e-8
"""Violation with which the solver stops, whatever the cost could still gain."""


class Kind:
    """One kind of element: constraints and a cost of a few unknowns and parameters, with their derivatives.

    Parameters
    ----------
    unknowns, parameters
        How many.
    formula
        Constraints and cost as symbolic expressions of both.
    """

    def __init__(self, unknowns: int, parameters: int, formula: Callable[[Any, Any], tuple[Any, Any]]) -> None:
        z, p = ca.SX.sym("z", unknowns), ca.SX.sym("p", parameters)  # pyright: ignore[reportArgumentType]
        g, cost = formula(z, p)
        self.rows = int(g.shape[0])
        of_cost, of_g = ca.SX.sym("of_cost"), ca.SX.sym("of_g", self.rows)  # pyright: ignore[reportArgumentType]
        jacobian = ca.jacobian(g, z)
        hessian = ca.hessian(of_cost * cost + ca.dot(of_g, g), z)[0]
        self.values = ca.Function("values", [z, p], [g, ca.SX(cost)])
        self.gradient = ca.Function("gradient", [z, p], [ca.densify(ca.gradient(ca.SX(cost), z))])
        self.jacobian = ca.Function("jacobian", [z, p], [jacobian])
        self.hessian = ca.Function("hessian", [z, p, of_cost, of_g], [hessian])
        self.jacobian_at = tuple(np.array(one, dtype=int) for one in jacobian.sparsity().get_triplet())
        self.hessian_at = tuple(np.array(one, dtype=int) for one in hessian.sparsity().get_triplet())


class _Block(NamedTuple):
    """Elements of one kind."""

    kind: Kind
    where: Int[np.ndarray, "element unknown"]
    """Of the program's unknowns."""
    parameters: Float[np.ndarray, "element parameter"]
    first: int
    """Row of the program's constraints where these begin."""


class ProgramSolution(NamedTuple):
    """What the solver ended with."""

    x: Float[np.ndarray, " unknown"]
    feasible: bool
    iterations: int
    violation: float
    """Greatest violation of a constraint."""


@dataclass
class Program:
    """Unknowns with their bounds and start, and elements."""

    _x: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)
    _bounds: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)
    _blocks: list[_Block] = field(default_factory=list)
    _unknowns: int = 0
    _rows: int = 0

    def add_unknowns(self, start: np.ndarray, low: np.ndarray, high: np.ndarray) -> Int[np.ndarray, " unknown"]:
        """Add unknowns and return their indices."""
        self._x.append((np.clip(start, low, high), low, high))
        index = self._unknowns + np.arange(start.size)
        self._unknowns += start.size
        return index

    def add(
        self,
        kind: Kind,
        index: Int[np.ndarray, "element unknown"],
        parameters: Float[np.ndarray, "element parameter"],
        low: Float[np.ndarray, " row"],
        high: Float[np.ndarray, " row"],
    ) -> None:
        """Add elements of a kind; the bounds of their constraints are the same for all."""
        self._blocks.append(_Block(kind, index, parameters, self._rows))
        self._bounds.append((np.tile(low, len(index)), np.tile(high, len(index))))
        self._rows += kind.rows * len(index)

    def derivatives(self, x: ca.MX) -> dict[str, ca.Function]:
        """Functions of unknowns x that IPOPT asks for, named as its options: values and their derivatives."""
        p = ca.MX.sym("p", 0)  # pyright: ignore[reportArgumentType]
        each = self._each(x)
        f, g = self._values(each)
        return {
            "grad_f": ca.Function("grad_f", [x, p], [f, self._gradient(each)], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("jac_g", [x, p], [g, self._jacobian(each)], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": self._hessian(x, p, each),
        }

    def _each(self, x: ca.MX) -> list[tuple[_Block, ca.MX, ca.DM]]:
        """Elements of each kind, with their own unknowns and parameters."""
        return [
            (
                one,
                ca.reshape(x[one.where.ravel().tolist()], one.where.shape[1], len(one.where)),
                ca.DM(one.parameters.T),
            )
            for one in self._blocks
        ]

    def _values(self, each: list[tuple[_Block, ca.MX, ca.DM]]) -> tuple[ca.MX, ca.MX]:
        """Cost and constraints."""
        values = [one.kind.values.map(len(one.where))(z, q) for one, z, q in each]
        return ca.sum2(ca.horzcat(*(cost for _, cost in values))), ca.vertcat(*(ca.vec(rows) for rows, _ in values))

    def solve(self, iterations: int) -> ProgramSolution:
        """Solve for a point that meets the constraints; the cost is minimised on the way only."""
        x = ca.MX.sym("x", self._unknowns)  # pyright: ignore[reportArgumentType]
        f, g = self._values(self._each(x))
        options = {
            **self.derivatives(x),
            "print_time": False,
            "error_on_fail": False,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.max_iter": iterations,
            "ipopt.tol": 1e-6,
            "ipopt.constr_viol_tol": FEASIBLE,
            # Stop at the first point that is feasible, optimal or not.
            "ipopt.acceptable_iter": 1,
            "ipopt.acceptable_tol": 1e20,
            "ipopt.acceptable_dual_inf_tol": 1e20,
            "ipopt.acceptable_compl_inf_tol": 1e20,
            "ipopt.acceptable_constr_viol_tol": FEASIBLE,
            "ipopt.mu_init": 1e-2,
            "ipopt.bound_relax_factor": 0.0,
        }
        solver = ca.nlpsol("collocation", "ipopt", {"x": x, "f": f, "g": g}, options)
        start, low, high = (np.concatenate(part) for part in zip(*self._x, strict=True))
        g_low, g_high = (np.concatenate(part) for part in zip(*self._bounds, strict=True))
        result = solver(x0=start, lbx=low, ubx=high, lbg=g_low, ubg=g_high)
        found = np.asarray(result["g"]).ravel()
        violation = float(np.max(np.maximum(g_low - found, found - g_high), initial=0.0))
        made = int(solver.stats()["iter_count"])
        return ProgramSolution(np.asarray(result["x"]).ravel(), violation <= 10.0 * FEASIBLE, made, violation)

    def _gradient(self, each: list[tuple[_Block, ca.MX, ca.DM]]) -> ca.MX:
        parts = [ca.vec(one.kind.gradient.map(len(one.where))(z, q)) for one, z, q in each]
        where = np.concatenate([one.where.ravel() for one in self._blocks])
        sums = scipy.sparse.csc_matrix(
            (np.ones(where.size), (where, np.arange(where.size))), (self._unknowns, where.size)
        )
        return ca.densify(ca.mtimes(ca.DM(sums), ca.vertcat(*parts)))

    def _jacobian(self, each: list[tuple[_Block, ca.MX, ca.DM]]) -> ca.MX:
        rows, columns = [], []
        for one in self._blocks:
            at_row, at_column = one.kind.jacobian_at
            begin = one.first + one.kind.rows * np.arange(len(one.where))
            rows.append((begin[:, None] + at_row).ravel())
            columns.append(one.where[:, at_column].ravel())
        parts = [_nonzeros(one.kind.jacobian.map(len(one.where))(z, q)) for one, z, q in each]
        keep = np.ones(sum(one.size for one in rows), dtype=bool)
        return _sparse(np.concatenate(rows), np.concatenate(columns), keep, parts, (self._rows, self._unknowns))

    def _hessian(self, x: ca.MX, p: ca.MX, each: list[tuple[_Block, ca.MX, ca.DM]]) -> ca.Function:
        """Of the Lagrangian, upper triangle."""
        of_f, of_g = ca.MX.sym("of_f"), ca.MX.sym("of_g", self._rows)  # pyright: ignore[reportArgumentType]
        rows, columns, parts = [], [], []
        for one, z, q in each:
            at_row, at_column = one.kind.hessian_at
            rows.append(one.where[:, at_row].ravel())
            columns.append(one.where[:, at_column].ravel())
            count = len(one.where)
            mine = ca.reshape(of_g[one.first : one.first + count * one.kind.rows], one.kind.rows, count)
            parts.append(_nonzeros(one.kind.hessian.map(count)(z, q, ca.repmat(of_f, 1, count), mine)))
        row, column = np.concatenate(rows), np.concatenate(columns)
        upper = _sparse(row, column, row <= column, parts, (self._unknowns, self._unknowns))
        names = ["x", "p", "lam_f", "lam_g"]
        return ca.Function("hess_lag", [x, p, of_f, of_g], [upper], names, ["triu_hess_gamma_x_x"])


def _nonzeros(values: ca.MX) -> ca.MX:
    return ca.vec(values.nz[:])  # pyright: ignore[reportAttributeAccessIssue]


def _sparse(
    rows: Int[np.ndarray, " entry"],
    columns: Int[np.ndarray, " entry"],
    keep: np.ndarray,
    parts: list[ca.MX],
    shape: tuple[int, int],
) -> ca.MX:
    """Matrix of entries, those at the same place added, some left out."""
    entries = np.flatnonzero(keep)
    key, place = np.unique(columns[keep] * shape[0] + rows[keep], return_inverse=True)
    sums = scipy.sparse.csc_matrix((np.ones(entries.size), (place, entries)), (key.size, keep.size))
    pattern = ca.Sparsity.triplet(*shape, (key % shape[0]).tolist(), (key // shape[0]).tolist())
    return ca.MX(pattern, ca.densify(ca.mtimes(ca.DM(sums), ca.vertcat(*parts))))
