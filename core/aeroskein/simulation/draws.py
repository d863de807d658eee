"""Random numbers that depend on what they are for, not on when they are asked for.

A flight's choices are hashed from the seed, the flight and the question (SplitMix64; Steele, Lea and Flood 2014, "Fast
splittable pseudorandom number generators"), so the same flight is flown whatever else is in the air and however the
time is cut into chunks. Measurement noise comes from one NumPy generator per sensor and block of time.
"""

from __future__ import annotations

import zlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array

__all__ = ["Keys", "block_generator", "hash_keys", "hashed_normal_pair", "hashed_uniform"]

Keys = NDArray[np.uint64]

# Constants of SplitMix64: the golden ratio as the increment, and the two multipliers of its finaliser.
_INCREMENT: Final = np.uint64(0x9E3779B97F4A7C15)
_FIRST: Final = np.uint64(0xBF58476D1CE4E5B9)
_SECOND: Final = np.uint64(0x94D049BB133111EB)


def hash_keys(*parts: Any) -> Keys:
    """Hash non-negative integers, or columns of them, into one 64-bit key each, shape of the longest part."""
    key = np.zeros(1, dtype=np.uint64)
    for part in parts:
        column = np.atleast_1d(np.asarray(part)).astype(np.uint64)
        key = key ^ (column * _INCREMENT + _SECOND)
        key = (key ^ (key >> np.uint64(30))) * _FIRST
        key = (key ^ (key >> np.uint64(27))) * _SECOND
        key = key ^ (key >> np.uint64(31))
    return key


def hashed_uniform(keys: Keys, *question: Any, low: Any = 0.0, high: Any = 1.0) -> Array:
    """Uniform numbers in ``[low, high)``, the same for the same key and question."""
    bits = hash_keys(keys, *question) >> np.uint64(11)
    return np.asarray(low + (np.asarray(high) - low) * (bits.astype(np.float64) * 2.0**-53), dtype=np.float64)


def hashed_normal_pair(keys: Keys, *question: Any) -> tuple[Array, Array]:
    """Two independent standard normal numbers for each key (Box and Muller 1958)."""
    radius = np.sqrt(-2.0 * np.log1p(-hashed_uniform(keys, *question, 0)))
    angle = 2.0 * np.pi * hashed_uniform(keys, *question, 1)
    return radius * np.cos(angle), radius * np.sin(angle)


def block_generator(seed: int, purpose: str, block: int) -> np.random.Generator:
    """The generator of one purpose (a sensor) in one block of time."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, zlib.crc32(purpose.encode()), block])))
