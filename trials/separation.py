"""Least clearance between any two aircraft at every sample, without looking at every sample."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from trials.motion import PathCells

__all__ = ["ChordBlocks", "PairReport", "chord_blocks", "least_clearances"]

_BLOCK = 1024
"""Samples per block: about a second, in which a path leaves its chord by a metre or so."""

_RESOLUTION = 1e-6
"""A block that could improve the least clearance by no more than this, m, is left out: aircraft that keep formation
would need all of them."""


class PairReport(NamedTuple):
    """Closest moment of each pair, one entry per pair."""

    first: Int[np.ndarray, " pair"]
    second: Int[np.ndarray, " pair"]
    clearance: Float[np.ndarray, " pair"]
    """Greater of horizontal distance - least horizontal and vertical distance - least vertical, m: its least value over
    the common flight, negative where the separation is lost."""
    time: Float[np.ndarray, " pair"]
    """s."""
    horizontal: Float[np.ndarray, " pair"]
    """Distance in the plane then, m."""
    vertical: Float[np.ndarray, " pair"]
    """Difference of altitude then, m."""


class ChordBlocks(NamedTuple):
    """A path as one straight line per block of samples, and how far its samples lie off that line."""

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
    last = np.minimum(count - _BLOCK * np.arange(blocks), _BLOCK) - 1
    begin, end = padded[:, :, 0], padded[:, np.arange(blocks), last]
    slope = (end - begin) / np.maximum(last, 1)
    off = padded - begin[:, :, None] - slope[:, :, None] * np.minimum(np.arange(_BLOCK), last[:, None])
    off_flat = np.sqrt(np.max(off[0] ** 2 + off[1] ** 2, axis=1))
    return ChordBlocks((begin + slope * (0.5 * _BLOCK)).T, slope.T, off_flat, np.max(np.abs(off[2]), axis=1))


def least_clearances(
    paths: list[PathCells],
    blocks: list[ChordBlocks],
    arrivals: Float[np.ndarray, " aircraft"],
    separation: tuple[float, float],
    start: float,
    step: float,
) -> PairReport:
    """Closest moment of each pair until the earlier of its arrivals.

    Parameters
    ----------
    paths
        Path of each aircraft.
    blocks
        Its lines over the samples at start + k step (s), k = 0, 1, ...
    arrivals
        When each arrives, s.
    separation
        Least horizontal and vertical distance, m: one of the two suffices.

    Notes
    -----
    In a block each path is a straight line but for a residue that was measured at the samples themselves. The distance
    of two lines less both residues bounds that of all samples from below; only blocks whose bound is below the best
    that another has are looked at sample by sample. The least value is that over all samples
    to a micrometre.
    """
    first, second = np.triu_indices(len(paths), 1)
    found = np.empty((first.size, 4))
    for row, (i, j) in enumerate(zip(first, second, strict=True)):
        bound = _block_bounds(blocks[i], blocks[j], separation)
        end = float(min(arrivals[i], arrivals[j]))
        found[row] = _closest(paths[i], paths[j], bound, separation, start, end, step)
    return PairReport(first, second, *found.T)


def _block_bounds(a: ChordBlocks, b: ChordBlocks, separation: tuple[float, float]) -> Float[np.ndarray, " block"]:
    """Lower bound of the clearance in each block that both have, m."""
    count, half = min(a.middle.shape[0], b.middle.shape[0]), 0.5 * _BLOCK
    apart, closing = a.middle[:count] - b.middle[:count], a.slope[:count] - b.slope[:count]
    square = np.sum(closing[:, :2] ** 2, axis=1)
    nearest = np.clip(-np.sum(apart[:, :2] * closing[:, :2], axis=1) / np.maximum(square, 1e-30), -half, half)
    flat = np.linalg.norm(apart[:, :2] + nearest[:, None] * closing[:, :2], axis=1)
    up = np.maximum(np.abs(apart[:, 2]) - half * np.abs(closing[:, 2]), 0.0)
    flat_least = flat - a.off_flat[:count] - b.off_flat[:count] - separation[0]
    return np.maximum(flat_least, up - a.off_up[:count] - b.off_up[:count] - separation[1])


def _closest(
    one: PathCells,
    other: PathCells,
    bound: Float[np.ndarray, " block"],
    separation: tuple[float, float],
    start: float,
    end: float,
    step: float,
) -> tuple[float, float, float, float]:
    """Least clearance, its time, and both distances then."""

    def closest_of(times: Float[np.ndarray, " time"]) -> tuple[float, float, float, float]:
        rel = one.at(times)[:3] - other.at(times)[:3]
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
