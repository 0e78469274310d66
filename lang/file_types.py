"""File name extensions by kind of content, and whether data is text."""

from . import text_encoding

SCENE = (".scene",)
USD = (".usd", ".usda", ".usdc", ".usdz")
GLTF = (".glb", ".gltf")
MESH = (".obj", ".ply", ".stl", *GLTF, ".off", ".3mf", ".xyz")
SAVED = (".npz",)
FONT = (".ttf", ".otf", ".ttc")
# Metres in the units of length of mesh files.
UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "um": 1e-6, "km": 1000.0, "in": 0.0254, "inch": 0.0254, "ft": 0.3048}
AXES = ("x", "y", "z")
MOST_ZEROS = 1 / 16  # share of zero bytes in a text; UTF-16 has about a half


def is_binary(data: bytes) -> bool:
    """Whether zero bytes show that data is no text. A UTF-8 text with stray ones is parsed, so that they are errors with their places."""
    if b"\0" not in data or text_encoding.is_wide(data):
        return False
    try:
        data.decode()
    except UnicodeDecodeError:
        return True
    return data.count(0) > len(data) * MOST_ZEROS
