"""Nonlinear programs composed of many small elements of a few kinds, with exact derivatives, solved by IPOPT."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse
from jaxtyping import Float, Int

__all__ = ["Kind", "Program", "ProgramSolution"]

FEASIBLE = 1e-8
"""Violation at which the solver stops, regardless of the cost."""


class Kind:
    """One kind of element: constraints and cost of a few unknowns and parameters, with their derivatives.

    Parameters
    ----------
    unknowns, parameters
        Numbers of unknowns and parameters.
    formula
        Constraints and cost as symbolic expressions of both.
    """

    def __init__(self, unknowns: int, parameters: int, formula: Callable[[Any, Any], tuple[Any, Any]]) -> None:
        z, p = ca.SX.sym("z", unknowns), ca.SX.sym("p", parameters)  # pyright: ignore[reportArgumentType]
        g, cost = formula(z, p)
        self.rows = int(g.shape[0])
        cost_weight, multipliers = ca.SX.sym("of_cost"), ca.SX.sym("of_g", self.rows)  # pyright: ignore[reportArgumentType]
        jacobian = ca.jacobian(g, z)
        hessian = ca.hessian(cost_weight * cost + ca.dot(multipliers, g), z)[0]
        self.values = ca.Function("values", [z, p], [g, ca.SX(cost)])
        self.gradient = ca.Function("gradient", [z, p], [ca.densify(ca.gradient(ca.SX(cost), z))])
        self.jacobian = ca.Function("jacobian", [z, p], [jacobian])
        self.hessian = ca.Function("hessian", [z, p, cost_weight, multipliers], [hessian])
        self.jacobian_at = tuple(np.array(indices, dtype=int) for indices in jacobian.sparsity().get_triplet())
        self.hessian_at = tuple(np.array(indices, dtype=int) for indices in hessian.sparsity().get_triplet())


class _Block(NamedTuple):
    """Elements of one kind."""

    kind: Kind
    unknown_indices: Int[np.ndarray, "element unknown"]
    """Of the program's unknowns."""
    parameters: Float[np.ndarray, "element parameter"]
    first_row: int
    """Row of the program's constraints where these begin."""


class ProgramSolution(NamedTuple):
    """Result of the solver."""

    x: Float[np.ndarray, " unknown"]
    feasible: bool
    iterations: int
    violation: float
    """Greatest violation of a constraint."""


@dataclass
class Program:
    """A nonlinear program: unknowns with bounds and initial values, and elements."""

    _x: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)
    _bounds: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)
    _blocks: list[_Block] = field(default_factory=list)
    _unknowns: int = 0
    _rows: int = 0

    def add_unknowns(self, start: np.ndarray, low: np.ndarray, high: np.ndarray) -> Int[np.ndarray, " unknown"]:
        """Add unknowns; return their indices."""
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
        """Add elements of a kind, with the same constraint bounds for every element."""
        self._blocks.append(_Block(kind, index, parameters, self._rows))
        self._bounds.append((np.tile(low, len(index)), np.tile(high, len(index))))
        self._rows += kind.rows * len(index)

    def derivatives(self, x: ca.MX) -> dict[str, ca.Function]:
        """Functions of the unknowns x required by IPOPT, by option name: values and derivatives."""
        p = ca.MX.sym("p", 0)  # pyright: ignore[reportArgumentType]
        elements = self._each(x)
        f, g = self._values(elements)
        return {
            "grad_f": ca.Function("grad_f", [x, p], [f, self._gradient(elements)], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("jac_g", [x, p], [g, self._jacobian(elements)], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": self._hessian(x, p, elements),
        }

    def _each(self, x: ca.MX) -> list[tuple[_Block, ca.MX, ca.DM]]:
        """Blocks of elements with their unknowns and parameters."""
        return [
            (
                block,
                ca.reshape(
                    x[block.unknown_indices.ravel().tolist()],
                    block.unknown_indices.shape[1],
                    len(block.unknown_indices),
                ),
                ca.DM(block.parameters.T),
            )
            for block in self._blocks
        ]

    def _values(self, elements: list[tuple[_Block, ca.MX, ca.DM]]) -> tuple[ca.MX, ca.MX]:
        """Cost and constraints."""
        values = [block.kind.values.map(len(block.unknown_indices))(z, q) for block, z, q in elements]
        return ca.sum2(ca.horzcat(*(cost for _, cost in values))), ca.vertcat(
            *(ca.vec(constraints) for constraints, _ in values)
        )

    def solve(self, iterations: int) -> ProgramSolution:
        """Solve for a point that satisfies the constraints; the cost only guides the search."""
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
        constraint_values = np.asarray(result["g"]).ravel()
        violation = float(np.max(np.maximum(g_low - constraint_values, constraint_values - g_high), initial=0.0))
        iteration_count = int(solver.stats()["iter_count"])
        return ProgramSolution(
            np.asarray(result["x"]).ravel(), violation <= 10.0 * FEASIBLE, iteration_count, violation
        )

    def _gradient(self, elements: list[tuple[_Block, ca.MX, ca.DM]]) -> ca.MX:
        parts = [ca.vec(block.kind.gradient.map(len(block.unknown_indices))(z, q)) for block, z, q in elements]
        unknown_indices = np.concatenate([block.unknown_indices.ravel() for block in self._blocks])
        sums = scipy.sparse.csc_matrix(
            (np.ones(unknown_indices.size), (unknown_indices, np.arange(unknown_indices.size))),
            (self._unknowns, unknown_indices.size),
        )
        return ca.densify(ca.mtimes(ca.DM(sums), ca.vertcat(*parts)))

    def _jacobian(self, elements: list[tuple[_Block, ca.MX, ca.DM]]) -> ca.MX:
        row_indices, columns = [], []
        for block in self._blocks:
            at_row, at_column = block.kind.jacobian_at
            begin = block.first_row + block.kind.rows * np.arange(len(block.unknown_indices))
            row_indices.append((begin[:, None] + at_row).ravel())
            columns.append(block.unknown_indices[:, at_column].ravel())
        parts = [_nonzeros(block.kind.jacobian.map(len(block.unknown_indices))(z, q)) for block, z, q in elements]
        keep = np.ones(sum(block.size for block in row_indices), dtype=bool)
        return _sparse(np.concatenate(row_indices), np.concatenate(columns), keep, parts, (self._rows, self._unknowns))

    def _hessian(self, x: ca.MX, p: ca.MX, elements: list[tuple[_Block, ca.MX, ca.DM]]) -> ca.Function:
        """Upper triangle of the Hessian of the Lagrangian."""
        cost_weight, multipliers = ca.MX.sym("of_f"), ca.MX.sym("of_g", self._rows)  # pyright: ignore[reportArgumentType]
        row_indices, columns, parts = [], [], []
        for block, z, q in elements:
            at_row, at_column = block.kind.hessian_at
            row_indices.append(block.unknown_indices[:, at_row].ravel())
            columns.append(block.unknown_indices[:, at_column].ravel())
            count = len(block.unknown_indices)
            block_multipliers = ca.reshape(
                multipliers[block.first_row : block.first_row + count * block.kind.rows], block.kind.rows, count
            )
            parts.append(
                _nonzeros(block.kind.hessian.map(count)(z, q, ca.repmat(cost_weight, 1, count), block_multipliers))
            )
        all_rows, all_columns = np.concatenate(row_indices), np.concatenate(columns)
        upper = _sparse(all_rows, all_columns, all_rows <= all_columns, parts, (self._unknowns, self._unknowns))
        names = ["x", "p", "lam_f", "lam_g"]
        return ca.Function("hess_lag", [x, p, cost_weight, multipliers], [upper], names, ["triu_hess_gamma_x_x"])


def _nonzeros(values: ca.MX) -> ca.MX:
    return ca.vec(values.nz[:])  # pyright: ignore[reportAttributeAccessIssue]


def _sparse(
    row_indices: Int[np.ndarray, " entry"],
    columns: Int[np.ndarray, " entry"],
    keep: np.ndarray,
    parts: list[ca.MX],
    shape: tuple[int, int],
) -> ca.MX:
    """Sparse matrix of the selected entries; entries at the same position are added."""
    entries = np.flatnonzero(keep)
    key, entry_index = np.unique(columns[keep] * shape[0] + row_indices[keep], return_inverse=True)
    sums = scipy.sparse.csc_matrix((np.ones(entries.size), (entry_index, entries)), (key.size, keep.size))
    pattern = ca.Sparsity.triplet(*shape, (key % shape[0]).tolist(), (key // shape[0]).tolist())
    return ca.MX(pattern, ca.densify(ca.mtimes(ca.DM(sums), ca.vertcat(*parts))))
