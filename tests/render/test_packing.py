"""Packed bytes keep data, arrays and plans, and hold no pickles."""

from __future__ import annotations

from typing import Any

import maquette
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.render import packing

SCENE = """sphere(1, material: lambert(checker(#d0402a, #ffffff, size: 0.1)))
point([2, 4, 3], intensity: 20)
camera(position: [0, 1.6, 5], look_at: [0, 1, 0])
"""
PLAIN = st.recursive(st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5), st.lists, max_leaves=4)
KINDS = st.sampled_from([np.float64, np.float32, np.int64, np.int32, np.uint8, np.bool_])
ARRAY = arrays.arrays(KINDS, arrays.array_shapes(min_dims=0, min_side=0, max_side=5))


@pytest.mark.long
@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(st.dictionaries(st.text(max_size=5), PLAIN, max_size=3), st.dictionaries(st.text(max_size=5), ARRAY, max_size=3))
def test_a_message_keeps_data_and_arrays(about: dict[str, Any], given_arrays: dict[str, np.ndarray]) -> None:
    unpacked, unpacked_arrays = packing.unpack(packing.pack(about, given_arrays))
    assert unpacked == about
    assert list(unpacked_arrays) == list(given_arrays)
    for name, array in given_arrays.items():
        assert unpacked_arrays[name].dtype == array.dtype
        assert unpacked_arrays[name].tobytes() == array.tobytes()
        assert unpacked_arrays[name].shape == array.shape


def test_a_message_with_objects_is_refused() -> None:
    message = packing.pack({}, {"a": np.zeros(2)}).replace(b'"<f8"', b'"|O"  ')
    with pytest.raises(ValueError, match="an array of object"):
        packing.unpack(message)


def test_a_plan_keeps_its_values() -> None:
    scene = maquette.load_text(SCENE)
    plan = planner.make_plan(scene, ir.Settings(size=(40, 30), aov=("depth",), budget=3.0), {"texture_filter": "point"})
    about, _ = packing.unpack(packing.pack({"plan": packing.plan_to(plan)}))
    again = packing.plan_from(about["plan"], 3)
    assert again.values() == {**plan.values(), "threads": 3}
    assert [again[name] for name in plan.decisions if name != "threads"] == [plan[name] for name in plan.decisions if name != "threads"]
    assert again.decisions["texture_filter"].overridden
    assert not again.decisions["backend"].overridden
