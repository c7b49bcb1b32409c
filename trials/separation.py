"""Least clearance between any two aircraft over every sample, without evaluating every sample."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from trials.motion import PathCells

__all__ = ["ChordBlocks", "PairReport", "chord_blocks", "least_clearances"]

_BLOCK = 1024
"""Samples per block: about a second, in which a path deviates from its chord by about a metre."""

_RESOLUTION = 1e-6
"""Least possible improvement of a block worth its evaluation, m: aircraft in formation would require every block."""


class PairReport(NamedTuple):
    """Closest approach of each pair, one entry per pair."""

    first: Int[np.ndarray, " pair"]
    second: Int[np.ndarray, " pair"]
    clearance: Float[np.ndarray, " pair"]
    """Least value over the common flight, m, of the greater of horizontal distance - required and vertical distance -
    required; negative if the separation is lost."""
    time: Float[np.ndarray, " pair"]
    """Time of closest approach, s."""
    horizontal: Float[np.ndarray, " pair"]
    """Horizontal distance at that time, m."""
    vertical: Float[np.ndarray, " pair"]
    """Difference of altitude at that time, m."""


class ChordBlocks(NamedTuple):
    """A path as one straight line per block of samples, with the greatest deviation of its samples."""

    middle: Float[np.ndarray, "block 3"]
    """Line in the middle of the block, NED, m."""
    slope: Float[np.ndarray, "block 3"]
    """Per sample, m."""
    off_flat: Float[np.ndarray, " block"]
    """Greatest distance in the plane, m."""
    off_up: Float[np.ndarray, " block"]
    """Greatest difference of altitude, m."""


def chord_blocks(position: Float[np.ndarray, "3 sample"]) -> ChordBlocks:
    """Lines through the first and last sample of each block of positions (NED, m)."""
    count = position.shape[1]
    blocks = -(-count // _BLOCK)
    padded = np.pad(position, ((0, 0), (0, blocks * _BLOCK - count)), mode="edge").reshape(3, blocks, _BLOCK)
    last_index = np.minimum(count - _BLOCK * np.arange(blocks), _BLOCK) - 1
    begin, end = padded[:, :, 0], padded[:, np.arange(blocks), last_index]
    slope = (end - begin) / np.maximum(last_index, 1)
    deviation = padded - begin[:, :, None] - slope[:, :, None] * np.minimum(np.arange(_BLOCK), last_index[:, None])
    off_flat = np.sqrt(np.max(deviation[0] ** 2 + deviation[1] ** 2, axis=1))
    return ChordBlocks((begin + slope * (0.5 * _BLOCK)).T, slope.T, off_flat, np.max(np.abs(deviation[2]), axis=1))


def least_clearances(
    paths: list[PathCells],
    blocks: list[ChordBlocks],
    arrivals: Float[np.ndarray, " aircraft"],
    separation: tuple[float, float],
    start: float,
    step: float,
) -> PairReport:
    """Closest approach of each pair until its earlier arrival.

    Parameters
    ----------
    paths
        Path of each aircraft.
    blocks
        Chords of each path over the samples at start + k step (s), k = 0, 1, ...
    arrivals
        Arrival time of each aircraft, s.
    separation
        Required horizontal and vertical distance, m: either is sufficient.

    Notes
    -----
    In a block each path is a straight line plus a deviation measured at the samples. The distance of two lines minus
    both deviations is a lower bound for the samples; only blocks with a bound below the best value so far are evaluated
    sample by sample. The result is the minimum over the samples, to a micrometre.
    """
    first_indices, second_indices = np.triu_indices(len(paths), 1)
    closest = np.empty((first_indices.size, 4))
    for pair, (i, j) in enumerate(zip(first_indices, second_indices, strict=True)):
        bound = _block_bounds(blocks[i], blocks[j], separation)
        end = float(min(arrivals[i], arrivals[j]))
        closest[pair] = _closest(paths[i], paths[j], bound, separation, start, end, step)
    return PairReport(first_indices, second_indices, *closest.T)


def _block_bounds(a: ChordBlocks, b: ChordBlocks, separation: tuple[float, float]) -> Float[np.ndarray, " block"]:
    """Lower bound of the clearance in each common block, m."""
    count, half = min(a.middle.shape[0], b.middle.shape[0]), 0.5 * _BLOCK
    offset, closing = a.middle[:count] - b.middle[:count], a.slope[:count] - b.slope[:count]
    square = np.sum(closing[:, :2] ** 2, axis=1)
    nearest = np.clip(-np.sum(offset[:, :2] * closing[:, :2], axis=1) / np.maximum(square, 1e-30), -half, half)
    flat = np.linalg.norm(offset[:, :2] + nearest[:, None] * closing[:, :2], axis=1)
    up = np.maximum(np.abs(offset[:, 2]) - half * np.abs(closing[:, 2]), 0.0)
    flat_least = flat - a.off_flat[:count] - b.off_flat[:count] - separation[0]
    return np.maximum(flat_least, up - a.off_up[:count] - b.off_up[:count] - separation[1])


def _closest(
    path: PathCells,
    other_path: PathCells,
    bound: Float[np.ndarray, " block"],
    separation: tuple[float, float],
    start: float,
    end: float,
    step: float,
) -> tuple[float, float, float, float]:
    """Least clearance, its time, and both distances at that time."""

    def closest_of(times: Float[np.ndarray, " time"]) -> tuple[float, float, float, float]:
        rel = path.at(times)[:3] - other_path.at(times)[:3]
        flat, up = np.hypot(rel[0], rel[1]), np.abs(rel[2])
        clearance = np.maximum(flat - separation[0], up - separation[1])
        at = int(np.argmin(clearance))
        return float(clearance[at]), float(times[at]), float(flat[at]), float(up[at])

    best = closest_of(np.array([end]))
    count = int(np.floor((end - start) / step + 1e-9)) + 1
    for block in np.argsort(bound):
        if bound[block] >= best[0] - _RESOLUTION:
            break
        samples = np.arange(block * _BLOCK, min((block + 1) * _BLOCK, count))
        if samples.size:
            best = min(best, closest_of(np.minimum(start + step * samples, end)))
    return best
