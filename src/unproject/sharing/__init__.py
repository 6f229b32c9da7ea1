"""Sharing: a run for others, as a folder or on the Hugging Face Hub, with a card that says what it is."""

from __future__ import annotations

from .hub import from_pretrained, push_to_hub
from .shared import EXAMPLES, example_path, put_example, save_pretrained

__all__ = ["EXAMPLES", "example_path", "from_pretrained", "push_to_hub", "put_example", "save_pretrained"]
