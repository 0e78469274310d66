"""File name extensions by kind of content."""

SCENE = (".scene",)
USD = (".usd", ".usda", ".usdc", ".usdz")
MESH = (".obj", ".ply", ".stl", ".glb", ".gltf", ".off")
SAVED = (".npz",)
FONT = (".ttf", ".otf", ".ttc")
