"""Where what tests read stands."""

from __future__ import annotations

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
CONFIGS: Final = ROOT / "configs"
DOCS: Final = ROOT / "docs"
DATA: Final = ROOT.parent / "shared" / "data"
"""Real captures, read in place; not there in every clone."""
FIELD_CASES: Final = ROOT.parent / "shared" / "field_cases"
"""Small inputs that once went wrong, read in place likewise."""
