"""What the models of all stages have in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

LARGEST_SIDE = 65_535
"""Width or height of an image, pixels, at most: columns and rows of events are uint16."""


class StageConfig(BaseModel):
    """Base of the stages' models: immutable; a misspelt field or a NaN is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
