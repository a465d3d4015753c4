"""How the path is cut into sub-apertures."""

from __future__ import annotations

import numpy as np
import pytest

from wsr.subapertures import sub_apertures

SCALES = (1, 2, 4, 8)


@pytest.mark.parametrize("bins", [8, 57, 220, 282, 283])
@pytest.mark.parametrize("breaks", [(), (20,), (5, 6, 31)])
def test_every_scale_has_its_number_of_equal_parts(bins: int, breaks: tuple[int, ...]) -> None:
    rng = np.random.default_rng(bins)
    p_m = np.cumsum(rng.normal(size=(bins, 3)), axis=0)
    segment = np.searchsorted([at for at in breaks if at < bins], np.arange(bins), "right")
    parts = sub_apertures(p_m, np.ones((bins, 1), np.complex128), segment, 0.05, SCALES)
    for scale, number in enumerate(SCALES):
        mine = parts.pieces[parts.pieces[:, 0] == scale]
        sizes = [int(mine[mine[:, 1] == part, 4].sum()) for part in range(number)]
        assert sum(sizes) == bins
        assert set(sizes) <= {bins // number, -(-bins // number)}
        for _, part, first, after, size in mine.tolist():
            begin, end = parts.cuts[first], parts.cuts[after]
            assert end - begin == size
            assert len(set(segment[begin:end].tolist())) == 1
            assert begin * number // bins >= part - 1
        # The longest piece of each sub-aperture comes first: the others take their signs from it.
        for part in range(number):
            assert np.all(np.diff(mine[mine[:, 1] == part, 4]) <= 0)
