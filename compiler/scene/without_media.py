"""Scenes without their participating media: for rays that do not scatter in them."""

from __future__ import annotations

import numpy as np

from ...materials import traits
from .. import ir


def substitute(tables: ir.Tables) -> ir.Tables:
    """The tables without media that scatter, emit or have invisible boundaries; the same tables if there are none."""
    if not traits.participates(tables):
        return tables
    none = np.full(len(tables.materials.model), -1, np.int32)
    return tables._replace(materials=tables.materials._replace(medium=none), media=ir.table_of("media", {}))
