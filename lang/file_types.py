"""What file names end with, by what the files hold."""

SCENE = (".scene",)
USD = (".usd", ".usda", ".usdc", ".usdz")
MESH = (".obj", ".ply", ".stl", ".glb", ".off")
SAVED = (".npz",)
