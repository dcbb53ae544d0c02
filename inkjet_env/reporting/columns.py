"""Columns of numbers as the text of a CSV file."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from inkjet_env.typing import Real


def columns_text(columns: Mapping[str, Real]) -> str:
    """Columns of equal length as CSV with a header line; all numbers but times are read back exactly.

    Times (names ending in ``_s``) have 12 significant digits, so that ``k / rate`` is written without rounding noise.
    """
    formats = ["%.12g" if name.endswith("_s") else "%.17g" for name in columns]
    lines = [",".join(columns)]
    lines += [
        ",".join(f % value for f, value in zip(formats, row, strict=True))
        for row in zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    ]
    return "\n".join(lines) + "\n"
