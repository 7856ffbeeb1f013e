"""What every file that people write, and every record vrbench reads back, is checked by."""

from pydantic import BaseModel, ConfigDict


class Strict(BaseModel):
    """A model that refuses fields it doesn't know, and doesn't change."""

    model_config = ConfigDict(extra="forbid", frozen=True)
