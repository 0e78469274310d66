"""Options for USD stages, which the command line names as usdrecord does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

PURPOSES = ("default", "render", "proxy", "guide")
COMPLEXITIES = {"low": 0, "medium": 1, "high": 2, "veryhigh": 3}  # levels of subdivision
CONFORM = {
    "vertical": "adjustApertureWidth", "horizontal": "adjustApertureHeight", "expand": "expandAperture", "crop": "cropAperture",
    "pixels": "adjustPixelAspectRatio",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class StageOptions:
    """How a stage is read. None: as the stage's RenderSettings say, else the default."""

    variants: Mapping[str, str] = field(default_factory=dict)  # {"/prim:set": "name"}
    purposes: tuple[str, ...] | None = None  # default is always drawn; None: default and render, or proxy where there is nothing else
    mask: tuple[str, ...] = ()  # paths of prims: only they, their ancestors, descendants and targets are populated
    complexity: int = 0  # times that subdivision surfaces are refined
    default_light: bool = True  # a light at the camera of a stage without lights
    cull_backfaces: bool = False  # whether meshes that are not doubleSided are seen from their front alone
    conform: str | None = None  # key of CONFORM: what is kept of a camera's film in a picture of another aspect; None: vertical
    render_settings: str | None = None  # path of a RenderSettings or RenderProduct prim; None: the stage's renderSettingsPrimPath
    session_layer: Path | None = None  # a layer over the root layer
    size: tuple[int, int] | None = None  # pixels of the picture, for `conform`
    as_asset: bool = False  # a sharp picture with a sun and a sky as default lights; without main_cam, from three quarters

    def option_names(self) -> list[str]:
        """Names on the command line of the options that are not at their default, without --variant and --size."""
        plain = StageOptions()
        skipped = ("variants", "size", "as_asset")
        changed = [f.name for f in fields(self) if f.name not in skipped and getattr(self, f.name) != getattr(plain, f.name)]
        return [{"default_light": "no-default-light"}.get(name, name.replace("_", "-")) for name in changed]

    def words(self) -> list[str]:
        """The options as words of a command line, without --size."""
        arguments = [word for where, choice in self.variants.items() for word in ("--variant", f"{where}={choice}")]
        for option in self.option_names():
            value = getattr(self, {"no-default-light": "default_light"}.get(option, option.replace("-", "_")))
            text = ",".join(value) if isinstance(value, tuple) else next((n for n, k in COMPLEXITIES.items() if k == value), str(value))
            arguments += [f"--{option}"] if option in ("no-default-light", "cull-backfaces") else [f"--{option}", text]
        return arguments
