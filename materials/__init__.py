"""Materials, one module each: schema, lowering, traits, lanes of kernels and exported forms.

A material is a member of ir.MaterialModel and the module with its name here. May import: lang.schema, compiler.scene, shapes.
Begin with `contract.py`, then `metal.py`.
"""

from importlib import import_module

from ..compiler import ir
from .contract import Lobe, Material

MATERIALS: dict[int, Material] = {
    model: import_module(f".{model.name.lower()}", __name__)  # type: ignore[misc]
    for model in ir.MaterialModel
}
"""The module of each model."""
ADDED: tuple[tuple[Lobe, tuple[int, ...]], ...] = tuple(
    (lobe, tuple(int(model) for model, material in MATERIALS.items() if material.LOBE is lobe))
    for lobe in dict.fromkeys(material.LOBE for material in MATERIALS.values())
    if lobe is not None
)
"""The modules of lobes that materials name as LOBE, each with the models that have it."""
