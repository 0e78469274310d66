"""Plan: the decisions of a render by name, and how a user overrides one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ...lang.schema.picture_settings import MAX_SAMPLES
from .. import ir


class PlanError(ValueError):
    """An unknown decision, an impossible value, or a setting that the scene cannot have; the message lists the possible ones."""


@dataclass(frozen=True, slots=True)
class Decision:
    """One decision: its name, value and reason.

    `choices` are the values that an override may have; empty: any value of the same type. `fixed` names what determines the value
    instead of `--plan`: an option or a part of the scene.
    """

    name: str
    value: Any
    reason: str
    choices: tuple[Any, ...] = ()
    overridden: bool = False
    fixed: str = ""

    @property
    def switch(self) -> str:
        """The option that changes the value, unless it is `fixed`."""
        if isinstance(self.value, bool):
            return f"--plan {self.name}=on|off"
        return f"--plan {self.name}={'|'.join(map(str, self.choices)) or '…'}"


@dataclass(frozen=True, slots=True)
class Plan:
    """Decisions by name: `plan["raster.coverage"]` is a value."""

    decisions: Mapping[str, Decision]

    def __getitem__(self, name: str) -> Any:
        return self.decisions[name].value

    def values(self) -> dict[str, Any]:
        """The values as plain data, for `--stats` and the metadata of pictures."""
        return {d.name: list(d.value) if isinstance(d.value, tuple) else d.value for d in self.decisions.values()}


DEFAULT_ERROR = 0.03  # √relMSE

Rule = Callable[[ir.Scene, ir.Settings, Plan], Decision]  # makes one decision; the plan holds the earlier ones


def override(decision: Decision, text: str) -> Decision:
    """A decision with the value that a user wrote. Raises PlanError."""
    if decision.fixed:
        raise PlanError(f"`{decision.name}` is set by {decision.fixed}")
    value: Any = text
    if isinstance(decision.value, bool):
        value = {"true": True, "on": True, "yes": True, "false": False, "off": False, "no": False}.get(text.lower())
        choices: tuple[Any, ...] = ("on", "off")
    else:
        choices = decision.choices
        if isinstance(decision.value, int | float):
            try:
                value = type(decision.value)(text)
            except ValueError:
                value = None
    valid = value is not None and (isinstance(decision.value, bool) or not choices or value in choices)
    if isinstance(value, int | float) and not isinstance(value, bool):
        valid = valid and math.isfinite(value) and (value > 0 or value == decision.value)
    if not valid:
        wanted = ", ".join(map(str, choices)) if choices else f"a positive number like {decision.value}"
        raise PlanError(f"`{decision.name}` cannot be {text}; it can be: {wanted}")
    return Decision(decision.name, value, "set with --plan", decision.choices, overridden=True)


def adaptive(plan: Plan) -> bool:
    """Whether each pixel takes as many samples as it needs, until an error or a budget is reached."""
    return plan["error"] > 0.0 or math.isfinite(plan["budget"])


def by_default(plan: Plan) -> bool:
    """Whether the picture has the default error and the default limit of samples, as neither samples, error nor budget were asked for."""
    return bool(plan["error"] > 0.0 and plan["samples"] < MAX_SAMPLES)


def error_asked(plan: Plan) -> float:
    """The error that the user asked for; 0 for none."""
    return 0.0 if by_default(plan) else float(plan["error"])


def denoises(plan: Plan, error: float | None, partial: bool = False) -> bool:
    """Whether a picture of this estimated error is denoised; `error` is None if a budget ended before it was known."""
    if plan["denoise"] != "above_error":
        return bool(plan["denoise"] == "on")
    if partial:
        return False
    return math.isfinite(plan["budget"]) if error is None else error > denoised_above(plan)


def denoised_above(plan: Plan) -> float:
    """The error above which a plan with `denoise` "above_error" denoises the picture."""
    return float(plan["error"] or DEFAULT_ERROR)


def may_denoise(plan: Plan) -> bool:
    """Whether a picture is denoised where its noise is too much."""
    return bool(plan["denoise"] != "off")
