"""Random numbers per exchange: exchange n of a seed has the same ones in whatever batches it is made."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeVar

import numpy as np
import numpy.typing as npt

T = TypeVar("T", bound=np.generic)
Array = npt.NDArray[np.float64]

_EXCHANGE_STREAM: Final = 2
_BLOCK: Final = 128
_NORMAL, _UNIFORM = 5, 7


@dataclass(frozen=True, slots=True, eq=False)
class ExchangeDraws:
    """Draws of N exchanges. In pairs, the first is for the record at the beacon, the second for that at the UAV.

    Columns of normals and uniforms are standard normal and uniform in [0, 1).
    """

    normals: Array
    """(N, 5): turnaround, detection delay x 2, scale x 2."""
    uniforms: Array
    """(N, 7): ping time, outlier, its size, loss x 2, antenna selection x 2."""
    delivery: Array
    """(N, 2): exponential with mean 1."""
    noise: npt.NDArray[np.complex128]
    """(N, 2, 30, 3): complex normal of variance 1."""


def exchange_draws(seed: int, first: int, count: int) -> ExchangeDraws:
    """The draws of the exchanges first .. first + count - 1."""
    last = first + count - 1
    blocks = [_block(seed, number) for number in range(first // _BLOCK, last // _BLOCK + 1)]
    begin = first % _BLOCK
    return ExchangeDraws(
        normals=_cut([block.normals for block in blocks], begin, count),
        uniforms=_cut([block.uniforms for block in blocks], begin, count),
        delivery=_cut([block.delivery for block in blocks], begin, count),
        noise=_cut([block.noise for block in blocks], begin, count),
    )


def _cut(blocks: list[npt.NDArray[T]], begin: int, count: int) -> npt.NDArray[T]:
    whole = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    return whole[begin : begin + count]


@lru_cache(maxsize=4)
def _block(seed: int, number: int) -> ExchangeDraws:
    rng = np.random.default_rng([seed, _EXCHANGE_STREAM, number])
    parts = rng.standard_normal((_BLOCK, 2, 30, 3, 2)) / np.sqrt(2)
    return ExchangeDraws(
        normals=rng.standard_normal((_BLOCK, _NORMAL)),
        uniforms=rng.random((_BLOCK, _UNIFORM)),
        delivery=rng.standard_exponential((_BLOCK, 2)),
        noise=parts[..., 0] + 1j * parts[..., 1],
    )
